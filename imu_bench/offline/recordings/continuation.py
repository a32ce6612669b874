# SPDX-License-Identifier: Apache-2.0
"""Text logs in several files: which file continues another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
import os
from pathlib import Path
import re
from typing import NamedTuple

from imu_bench.errors import RecordingError
from imu_bench.offline.recordings import cells
from imu_bench.offline.recordings.discovery import is_text_name
from imu_bench.offline.recordings.layout import detect, Layout
import numpy as np
import numpy.typing as npt

_NUMBER = re.compile(r'[ _-]*\(?(\d+)\)?')
_EDGE = 1 << 16
_MOST_MISSING = 100.0
"""Sample periods from the last sample of a file to the first one of the next, at most."""


class Part(NamedTuple):
    """One file of a recording, and how it is laid out."""

    path: Path
    layout: Layout


def siblings(path: Path, known: Sequence[str]) -> list[Path]:
    """
    Return the known text files beside one whose names differ from its in numbers only, in order.

    Those that come before it are left out, as is the file itself.
    """
    home = str(path.resolve().parent)
    shape, own = name_key(path)
    beside = (Path(file) for file in known if os.path.dirname(file) == home)
    found = [
        (key, path.parent / file.name)
        for file in beside
        if is_text_name(file) and (parts := name_key(file))[0] == shape and (key := parts[1]) > own
    ]
    return [file for _, file in sorted(found)]


def following(
    path: Path, layout: Layout, stamp: int, scale_s: float, known: Sequence[str]
) -> Iterator[Part]:
    """
    Yield the files that continue one: alike in columns, and beginning where the last one ended.

    Parameters
    ----------
    path : Path
    layout : Layout
        Of that file.
    stamp : int
        Its time column.
    scale_s : float
        Seconds per unit of that column.
    known : sequence of str
        Resolved paths of the files that may continue it.
    """
    end = _times(path, layout, stamp)
    for file in siblings(path, known):
        try:
            own = detect(file)
        except RecordingError:
            return
        if replace(own, start=0, filled=()) != replace(layout, start=0, filled=()):
            return
        times = _times(file, own, stamp)
        if end.size < 2 or times.size < 2:
            return
        period = float(np.median(np.abs(np.diff(end))))
        if not 0.0 < times[0] - end[-1] <= _MOST_MISSING * max(period, 1e-9 / scale_s):
            return
        yield Part(file, own)
        end = times


def name_key(path: Path) -> tuple[str, list[int]]:
    """Return what names of one recording have in common, and their numbers."""
    numbers = [int(number) for number in _NUMBER.findall(path.stem)]
    return _NUMBER.sub('', path.stem) + path.suffix, numbers


def _times(path: Path, layout: Layout, stamp: int) -> npt.NDArray[np.float64]:
    """Return the first time in a file, and those near its end."""
    size = path.stat().st_size
    with path.open('rb') as file:
        file.seek(layout.start)
        head = file.read(_EDGE)
        file.seek(max(layout.start, size - _EDGE))
        tail = file.read(_EDGE)
    first = cells.parse(head[: head.rfind(b'\n') + 1], layout, [stamp], None).values[:1, 0]
    if layout.start < size - _EDGE:
        tail = tail[tail.find(b'\n') + 1 :]
    last = cells.parse(tail.rstrip(b'\n') + b'\n', layout, [stamp], None).values[:, 0]
    times = np.concatenate((first, last))
    return times[np.isfinite(times)]
