# SPDX-License-Identifier: Apache-2.0
"""Which of the recordings named are one: text files that continue others among them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from imu_bench.errors import RecordingError
from imu_bench.offline.recordings.continuation import name_key
from imu_bench.offline.recordings.discovery import is_text_name
from imu_bench.offline.recordings.options import ReadOptions
from imu_bench.offline.recordings.text import parts_of


def grouped(paths: Sequence[Path], options: ReadOptions) -> tuple[list[Path], ReadOptions]:
    """
    Return recordings without the text files that continue others among them.

    With the options returned, a file is read together with those that continue it.
    """
    alike: dict[tuple[Path, str], list[Path]] = {}
    for path in paths:
        if is_text_name(path) and path.is_file():
            alike.setdefault((path.resolve().parent, name_key(path)[0]), []).append(path)
    continued: set[Path] = set()
    for group in alike.values():
        joining = replace(options, join=tuple(str(path.resolve()) for path in group))
        for path in sorted(group, key=name_key) if len(group) > 1 else ():
            if path.resolve() not in continued:
                continued |= _continuing(path, joining)
    kept = [path for path in paths if path.resolve() not in continued]
    return kept, replace(options, join=tuple(sorted(map(str, continued))))


def _continuing(path: Path, joining: ReadOptions) -> set[Path]:
    try:
        parts, _, _ = parts_of(path, joining)
    except (RecordingError, OSError):
        return set()  # told when it is read
    return {part.path.resolve() for part in parts[1:]}
