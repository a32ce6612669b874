# SPDX-License-Identifier: Apache-2.0
"""Findings about the reading: an incomplete file, messages lost, values left out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from imu_bench.bags.problems import (
    code_of,
    COUNTS,
    INCOMPLETE,
    NOT_A_NUMBER,
    Problem,
    REMARK,
    STAMPS,
)
from imu_bench.offline.health.finding import Finding
from imu_bench.offline.notation import count, percent
from imu_bench.offline.recordings import Recording

_SEVERE = 0.05  # share of messages lost or left out, as `stamps._MANY_MISSING`
_ELSEWHERE = (COUNTS, STAMPS, NOT_A_NUMBER)  # codes of notes that are findings of their own


def reading_findings(recording: Recording, problems: Sequence[str]) -> Iterator[Finding]:
    """
    Yield what happened while a recording was read.

    Parameters
    ----------
    recording : Recording
    problems : sequence of str
        Of its source: about the file as a whole.
    """
    for words in problems:
        own = isinstance(words, Problem) and words.topic == recording.topic
        if not (own and code_of(words) == COUNTS):  # compared below
            yield _remark(words)
    for words in recording.notes:
        if code_of(words) not in _ELSEWHERE:
            yield _remark(words)
    yield from _counts(recording)
    yield from _left_out(recording)


def _remark(words: str) -> Finding:
    if code_of(words) == INCOMPLETE:
        return Finding(
            'warning',
            INCOMPLETE,
            f'{words}.',
            'The numbers describe the part that could be read.',
            'Check that the recorder was stopped properly, and the disk it wrote to.',
        )
    return Finding(
        'info',
        REMARK,
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
        COUNTS,
        f'The metadata announces {count(announced, "message")}, {stored} were read.',
        'Metadata and storage disagree: messages may be missing at the end or in between.',
        'Compare with the original recording; do not use it as evidence of a data rate.',
    )


def _left_out(recording: Recording) -> Iterator[Finding]:
    if not recording.left_out:
        return
    details = '; '.join(note for note in recording.notes if code_of(note) == NOT_A_NUMBER)
    share = recording.left_out / max(recording.stored, 1)
    yield Finding(
        'severe' if share > _SEVERE else 'warning',
        NOT_A_NUMBER,
        f'{count(recording.left_out, "sample")} ({percent(share)}) hold NaN or infinite '
        f'values{f": {details}" if details else ""}.',
        'They are left out and treated as gaps; nothing is averaged over them.',
        'Look for read errors or a division by zero in the driver.',
    )
