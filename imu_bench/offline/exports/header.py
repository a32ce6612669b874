# SPDX-License-Identifier: Apache-2.0
"""What stands above every export: what it is, how it was measured, from which recording."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timezone
import json

from imu_bench import __version__
from imu_bench.offline.exports.numbers import Number, Numbers
from imu_bench.offline.notation import duration, rate_text
from imu_bench.offline.results import RecordingResult
from imu_bench.samples import AXES


def plain(words: str) -> str:
    r"""
    Return text from a recording in ASCII on one line, so that no file format can trip over it.

    Examples
    --------
    >>> print(plain('Prüf\nstand'))
    Pr\xfcf\nstand
    """
    return words.encode('unicode_escape').decode('ascii')


def exponent(value: float) -> str:
    """
    Return a number that every YAML parser takes for one: with a point, and a sign in the exponent.

    Examples
    --------
    >>> exponent(2e-5)
    '2.000000e-05'
    """
    return f'{value:.6e}'


def lines(numbers: Numbers, title: str, *conventions: str) -> list[str]:
    """Return the lines of the heading, without comment signs."""
    recording = numbers.recording
    health = recording.health
    kind = 'conservative' if numbers.conservative else 'nominal'
    length = f'{duration(health.duration_s)} at {numbers.rate:.4f} Hz'
    heading = [
        f'{title}: {kind} values, written by imu-bench {__version__}',
        f'from {plain(recording.source)}, topic {plain(recording.topic)}',
        f'{_date(recording.start_ns)}{length}',
        *(f'{name}: sampled at {rate_text(rate)}' for name, rate in recording.rates.items()),
        *conventions,
    ]
    severe = sorted({f.code for f in health.findings if f.severity == 'severe'})
    if severe:
        heading.append(f'WARNING: the recording is not to be trusted: {", ".join(severe)}')
    return heading


def topic_line(recording: RecordingResult) -> str:
    """Return the topic as a quoted string, with a word where it cannot be one of ROS."""
    quoted = json.dumps(plain(recording.topic))
    if recording.topic.startswith('/'):
        return quoted
    return f'{quoted}  # the recording was no bag: put the topic here'


def notes(found: Sequence[Number]) -> str:
    """Return how the numbers of x, y and z were found, once if in the same way."""
    words = [number.note for number in found]
    if len(set(words)) == 1:
        return words[0]
    return '; '.join(f'{letter}: {note}' for letter, note in zip(AXES, words, strict=True))


def commented(heading: list[str], sign: str = '# ') -> str:
    """Return lines as comments."""
    return ''.join(f'{sign}{line}\n' for line in heading)


def _date(stamp_ns: int) -> str:
    try:
        moment = datetime.fromtimestamp(stamp_ns * 1e-9, tz=timezone.utc)
    except (OverflowError, OSError, ValueError):
        return ''
    # stamps of an earlier year are seconds since power-up
    return f'{moment:%Y-%m-%d %H:%M} UTC, ' if moment.year >= 2000 else ''
