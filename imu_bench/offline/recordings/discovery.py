# SPDX-License-Identifier: Apache-2.0
"""Finding the recordings in a folder, and the text files that continue one another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
import os
from pathlib import Path
import re
from typing import NamedTuple

from imu_bench.bags import bag, metadata
from imu_bench.errors import RecordingError
from imu_bench.offline.recordings import cells
from imu_bench.offline.recordings.layout import detect, detect_in, Layout, SAMPLE
from imu_bench.offline.whole_files import UNFINISHED
import numpy as np
import numpy.typing as npt

STAMPS_FILE = 'stamps.npy'
"""A folder that has it is a recording, as `imu-bench simulate --storage npy` writes it."""

_ROS1_SUFFIXES = ('.bag', '.bag.active')
TEXT_SUFFIXES = ('.csv', '.tsv', '.txt', '.log', '.dat')
_ARRAY_SUFFIXES = ('.npy', '.npz', '.mat')
_LEAST_COLUMNS = 3
_NUMBER = re.compile(r'[ _-]*\(?(\d+)\)?')
_NATIVE = 'stamp_s'
"""Who writes this writes recordings, if only of one axis."""


def find_recordings(path: str | Path) -> tuple[Path, ...]:
    """
    Return the recordings at a path, sorted by name.

    A file, or a folder that is a bag, is one recording; any other folder is searched
    for bags and for tables of numbers with at least three columns, or with ``stamp_s``.

    Raises
    ------
    RecordingError
        If there is no such path, or the folder holds no recording.
    """
    place = Path(path)
    try:
        if not place.exists():
            raise RecordingError(f'{place}: no such file or folder')
        if not (place.is_file() or place.is_dir()):  # opening a pipe may wait for ever
            raise RecordingError(f'{place}: neither a file nor a folder; write it to a file first')
        found = tuple(_search(place)) if place.is_dir() else (place,)
    except OSError as problem:
        raise RecordingError(
            f'{problem.filename}: cannot be read: {problem.strerror}'
        ) from problem
    if not found:
        alone = (place / metadata.FILE_NAME).is_file()
        without = 'metadata.yaml without its bag' if alone else 'no bag, text file or array'
        raise RecordingError(f'{place}: no recording in this folder: {without}')
    return found


def _search(folder: Path) -> Iterator[Path]:
    files = sorted(entry for entry in folder.iterdir() if entry.is_file())
    storages = [file for file in files if bag.kind(file)]
    # reading it will say what is wrong with files that are none
    if (folder / metadata.FILE_NAME).is_file() and any(map(bag.is_named_so, files)):
        yield folder
        return
    if (folder / STAMPS_FILE).is_file():
        yield folder
        return
    if storages:
        try:
            bag.only_recording(folder, storages)
            yield folder
        except RecordingError:
            yield from storages
    loose = [file for file in files if _is_loose_recording(file)]
    numbered = {shape for shape, numbers in map(name_key, filter(is_text_name, loose)) if numbers}
    # what is no table among files of one numbering is a damaged part, which reading it will say
    yield from (
        file
        for file in files
        if file in loose or (is_text_name(file) and name_key(file)[0] in numbered)
    )
    for entry in sorted(entry for entry in folder.iterdir() if entry.is_dir()):
        # a link may lead in circles
        if not entry.is_symlink() and not entry.name.startswith(UNFINISHED):
            yield from _search(entry)


def name_key(path: Path) -> tuple[str, list[int]]:
    """Return what names of one recording have in common, and their numbers."""
    numbers = [int(number) for number in _NUMBER.findall(path.stem)]
    return _NUMBER.sub('', path.stem) + path.suffix, numbers


def is_text_name(file: Path) -> bool:
    """Return whether the name of a file is that of a table of text."""
    return file.suffix.lower() in TEXT_SUFFIXES


def _is_loose_recording(file: Path) -> bool:
    if file.name.endswith((*_ROS1_SUFFIXES, *_ARRAY_SUFFIXES)):
        return True
    if not is_text_name(file):
        return False
    with file.open('rb') as opened:
        layout = detect_in(opened.read(SAMPLE))
    return layout is not None and (layout.width >= _LEAST_COLUMNS or _NATIVE in layout.header)


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
    """Yield the files that continue one: alike in columns, beginning where the last one ended."""
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
