# SPDX-License-Identifier: Apache-2.0
"""
Arrays that lie in files: larger than the memory, and open to several processes.

The pages of such an array that were touched count as memory of the process, although the
system could have them back at any time.  `MappedLimit` gives them back before they add up.
"""

from __future__ import annotations

from collections.abc import Sequence
import errno
import mmap
import os
from pathlib import Path
import threading
from typing import Any, NamedTuple
import weakref

from imu_bench.errors import RecordingError
import numpy as np
import numpy.typing as npt

_FULL = (errno.ENOSPC, errno.EDQUOT)
_NOT_OFFERED = (errno.EOPNOTSUPP, errno.EINVAL)  # by some file systems
_WATCH_S = 0.004
_STATISTICS = Path('/proc/self/statm')


class _Mapping(mmap.mmap):
    """A mapped file that knows its path."""

    path: str


_LIVE: weakref.WeakSet[_Mapping] = weakref.WeakSet()
_LOCK = threading.Lock()


class Place(NamedTuple):
    """Where an array lies: file, offset in bytes, and how to look at it."""

    path: str
    offset: int
    dtype: str
    shape: tuple[int, ...]
    strides: tuple[int, ...]


class ArrayFolder:
    """A folder of arrays."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def empty(self, shape: Sequence[int], dtype: npt.DTypeLike) -> npt.NDArray[Any]:
        """Return a new array of zeros in a file of its own."""
        mapping = self._new(int(np.prod(shape)) * np.dtype(dtype).itemsize)
        return np.ndarray(tuple(shape), dtype, mapping)

    def lend(self, size: int, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
        """Return a new array of shape (size,) whose file goes when nobody uses it any more."""
        mapping = self._new(size * np.dtype(dtype).itemsize)
        Path(mapping.path).unlink()
        return np.ndarray((size,), dtype, mapping)

    def put(self, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return an array that other processes can open: this one, or a copy of it."""
        if locate(array) is not None or array.size == 0:
            return array
        copy = self.empty(array.shape, array.dtype)
        copy[...] = array
        return copy

    def _new(self, size: int) -> _Mapping:
        # several processes may put arrays into one folder
        number = sum(1 for _ in self.folder.iterdir())
        while True:
            path = self.folder / f'{number}.bin'
            try:
                with path.open('x+b') as file:
                    _reserve(file.fileno(), max(1, size), path)
                    mapping = _Mapping(file.fileno(), max(1, size))
            except FileExistsError:
                number += 1
                continue
            _remember(mapping, str(path))
            return mapping


def _remember(mapping: _Mapping, path: str) -> None:
    mapping.path = path
    with _LOCK:
        _LIVE.add(mapping)


def _reserve(file: int, size: int, path: Path) -> None:
    """Make the file so long, on the disk: writing to a hole of a full disk kills the process."""
    try:
        os.ftruncate(file, size)
        if hasattr(os, 'posix_fallocate'):
            os.posix_fallocate(file, 0, size)
    except OSError as problem:
        if problem.errno in _NOT_OFFERED:
            return
        path.unlink(missing_ok=True)
        if problem.errno not in _FULL:
            raise
        raise RecordingError(
            f'{path.parent}: no room for another {size >> 20} MiB of columns; set TMPDIR to a '
            'folder on a larger disk, or for analyze name one with --cache'
        ) from problem


def locate(array: npt.NDArray[Any]) -> Place | None:
    """Return where an array lies that is, or is a view of, a mapped one; None for others."""
    base: Any = array
    while isinstance(base, np.ndarray):
        base = base.base
    if not isinstance(base, _Mapping) or array.size == 0:
        return None
    start = np.frombuffer(base, np.uint8).__array_interface__['data'][0]
    offset = array.__array_interface__['data'][0] - start
    return Place(base.path, offset, array.dtype.str, array.shape, array.strides)


def attach(place: Place) -> npt.NDArray[Any]:
    """Return the array at a place, read-only."""
    with open(place.path, 'rb') as file:
        mapping = _Mapping(file.fileno(), 0, access=mmap.ACCESS_READ)
    _remember(mapping, place.path)
    return np.ndarray(place.shape, np.dtype(place.dtype), mapping, place.offset, place.strides)


def release() -> None:
    """Give the touched pages of all mapped arrays back; their content stays as it is."""
    if hasattr(mmap, 'MADV_DONTNEED'):
        with _LOCK:
            live = list(_LIVE)
        for mapping in live:
            mapping.madvise(mmap.MADV_DONTNEED)


class MappedLimit:
    """
    Keeps the touched pages of mapped arrays below a limit while it is entered.

    Does nothing where the system does not say how many there are.

    Parameters
    ----------
    limit_bytes : int
        Mapped memory above which everything is given back.
    """

    def __init__(self, limit_bytes: int) -> None:
        self._limit = limit_bytes
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._watch, name='residency', daemon=True)

    def __enter__(self) -> MappedLimit:
        if hasattr(mmap, 'MADV_DONTNEED') and _STATISTICS.exists():
            with _STATISTICS.open('rb') as statistics:
                self._limit += _mapped_bytes(statistics.fileno())
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        if self._thread.is_alive():
            self._thread.join()

    def _watch(self) -> None:
        with _STATISTICS.open('rb') as statistics:
            while not self._done.wait(_WATCH_S):
                if _mapped_bytes(statistics.fileno()) > self._limit:
                    release()


def _mapped_bytes(statistics: int) -> int:
    """Return the resident bytes of files: proc(5), /proc/pid/statm, third field."""
    return int(os.pread(statistics, 100, 0).split()[2]) * mmap.PAGESIZE
