# SPDX-License-Identifier: Apache-2.0
"""
How many samples a reader owes: found by comparing bytes, without reading any format.

Whoever reads a damaged recording has to give so many, or say that it does not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from imu_bench.offline.analysis.results import RecordingResult

from benchmarks._fuzz_content import SAMPLES

_TELLING = ('incomplete', 'counts', 'gaps', 'not_a_number')
"""Codes of findings that no sound recording of the benchmark has."""

_WORDS = ('no line end', 'of another length', 'cut off')


def owed(before: Mapping[str, bytes], after: Mapping[str, bytes], text: str) -> int:
    """
    Return how many samples must be found, or said to be missing.

    A binary format knows itself how many there are: it owes all of them.  Of a text everything
    that can be known is in its lines: it owes those that are still there as they were written,
    and if it has stamps also what is missing between the first and the last of them.

    Parameters
    ----------
    before, after : mapping of str to bytes
        Contents of the files by name, as written and as damaged.
    text : str
        '' for binary formats, 'lines' for text, 'stamps' for text with a time or index column.
    """
    if not text:
        return SAMPLES
    rows = [row for name in sorted(before) for row in before[name].splitlines() if row.strip()]
    rows = [row for row in rows if b'0' <= row.strip()[:1] <= b'9' or row[:1] in b'-.'][-SAMPLES:]
    there = {row for content in after.values() for row in content.splitlines()}
    found = [index for index, row in enumerate(rows) if row in there]
    if text == 'lines' or not found:
        return len(found)
    return found[-1] - found[0] + 1


def cut_within_a_row(before: Mapping[str, bytes], after: Mapping[str, bytes], text: str) -> bool:
    """Return whether a text ends in the middle of a row, which somebody has to say."""
    return bool(text) and any(
        before[name] != content and before[name].startswith(content)
        and not content.endswith((b'\n', b'\r')) and content
        for name, content in after.items()
    )  # fmt: skip


def told(recordings: Sequence[RecordingResult]) -> bool:
    """Return whether a result says that something is missing."""
    return any(
        finding.code in _TELLING or any(words in finding.text for words in _WORDS)
        for recording in recordings
        for finding in recording.health.findings
    )
