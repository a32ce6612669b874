# SPDX-License-Identifier: Apache-2.0
"""Finding the recordings in a folder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from imu_bench.bags import bag, metadata
from imu_bench.errors import RecordingError
from imu_bench.offline.recordings.layout import detect_in, SAMPLE
from imu_bench.offline.whole_files import UNFINISHED

STAMPS_FILE = 'stamps.npy'
"""A folder that has it is a recording, as `imu-bench simulate --storage npy` writes it."""

_ROS1_SUFFIXES = ('.bag', '.bag.active')
_TEXT_SUFFIXES = ('.csv', '.tsv', '.txt', '.log', '.dat')
_ARRAY_SUFFIXES = ('.npy', '.npz', '.mat')
_LEAST_COLUMNS = 3
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
        raise RecordingError(f'{place}: no recording in this folder: no bag, text file or array')
    return found


def _search(folder: Path) -> Iterator[Path]:
    files = sorted(entry for entry in folder.iterdir() if entry.is_file())
    storages = [file for file in files if bag.kind(file)]
    if (folder / metadata.FILE_NAME).is_file() and storages:
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
    yield from (file for file in files if _is_loose_recording(file))
    for entry in sorted(entry for entry in folder.iterdir() if entry.is_dir()):
        # a link may lead in circles
        if not entry.is_symlink() and not entry.name.startswith(UNFINISHED):
            yield from _search(entry)


def is_text_name(file: Path) -> bool:
    """Return whether the name of a file is that of a table of text."""
    return file.suffix.lower() in _TEXT_SUFFIXES


def _is_loose_recording(file: Path) -> bool:
    if file.name.endswith((*_ROS1_SUFFIXES, *_ARRAY_SUFFIXES)):
        return True
    if not is_text_name(file):
        return False
    with file.open('rb') as opened:
        layout = detect_in(opened.read(SAMPLE))
    return layout is not None and (layout.width >= _LEAST_COLUMNS or _NATIVE in layout.header)
