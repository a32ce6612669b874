# SPDX-License-Identifier: Apache-2.0
"""Findings about the reading: an incomplete file, messages lost, values left out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from imu_bench.offline.health.finding import Finding
from imu_bench.offline.notation import count, percent
from imu_bench.offline.recordings import Recording

_SEVERE = 0.05  # share of messages lost or left out
_DAMAGE = ('cut off', 'damaged', 'did not close', 'missing', 'skipped', 'left out', 'were read')
_LEFT_OUT = 'values left out'
_ELSEWHERE = ('the metadata announces', 'stamps are the receive time', _LEFT_OUT)


def reading_findings(recording: Recording, problems: Sequence[str]) -> Iterator[Finding]:
    """
    Yield what happened while a recording was read.

    Parameters
    ----------
    recording : Recording
    problems : sequence of str
        Of its source: about the file as a whole.
    """
    notes = [n for n in recording.notes if not any(part in n for part in _ELSEWHERE)]
    for words in (*problems, *notes):
        if f'messages on {recording.topic},' not in words:  # compared below
            yield _remark(words)
    yield from _counts(recording)
    yield from _left_out(recording)


def _remark(words: str) -> Finding:
    if any(part in words for part in _DAMAGE):
        return Finding(
            'warning',
            'incomplete',
            f'{words}.',
            'The numbers describe the part that could be read.',
            'Check that the recorder was stopped properly, and the disk it wrote to.',
        )
    return Finding(
        'info',
        'reading',
        f'{words}.',
        'None, if this is what you expect.',
        'Check how the recording was made, and the options.',
    )


def _counts(recording: Recording) -> Iterator[Finding]:
    announced, stored = recording.announced, recording.stored
    if announced is None or announced == stored:
        return
    lost = abs(announced - stored) / max(announced, stored)
    yield Finding(
        'severe' if lost > _SEVERE else 'warning',
        'counts',
        f'The metadata announces {count(announced, "message")}, {stored} were read.',
        'Metadata and storage disagree: messages may be missing at the end or in between.',
        'Compare with the original recording; do not use it as evidence of a data rate.',
    )


def _left_out(recording: Recording) -> Iterator[Finding]:
    if not recording.left_out:
        return
    details = '; '.join(note for note in recording.notes if _LEFT_OUT in note)
    share = recording.left_out / max(recording.stored, 1)
    yield Finding(
        'severe' if share > _SEVERE else 'warning',
        'not_a_number',
        f'{count(recording.left_out, "sample")} ({percent(share)}) hold NaN or infinite '
        f'values{f": {details}" if details else ""}.',
        'They are left out and treated as gaps; nothing is averaged over them.',
        'Look for read errors or a division by zero in the driver.',
    )
