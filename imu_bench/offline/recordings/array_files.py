# SPDX-License-Identifier: Apache-2.0
"""Files that hold arrays, of NumPy and of MATLAB: names and arrays of numbers out of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import json
import math
from pathlib import Path
import re
import struct
import subprocess
import sys
from typing import Any, BinaryIO
import zipfile
import zlib

from imu_bench.errors import RecordingError
from imu_bench.offline.running.mapped import attach, Place
import numpy as np
import numpy.typing as npt

Arrays = dict[str, npt.NDArray[Any]]

NPY_MAGIC = b'\x93NUMPY'
ZIP_MAGIC = b'PK\x03\x04'
_MATLAB_5, _MATLAB_7 = b'MATLAB 5.0 MAT-file', b'MATLAB 7.3 MAT-file'
MAGIC_SIZE = len(_MATLAB_5)

MATLAB_BYTES = 512 << 20
"""Most that a variable of a .mat file may take in memory."""

_MOST_PARTS = 1000
"""Arrays of a struct or cell, at most: within one another, 5000 fill a stack of 1 MiB."""

_MATLAB_HEADER, _TAG, _EDGE = 128, 8, 1 << 10
_NUMERIC = frozenset(
    ['double', 'single', 'int8', 'uint8', 'int16', 'uint16', 'int32', 'uint32', 'int64', 'uint64']
)
_LONGEST = 8
"""Bytes of the longest number."""

_STEP = 1 << 20
_LONGEST_REASON = 200
"""Characters of a damaged header that an error text repeats."""
_RATIO = 1032
"""Times that zip can shrink anything: 258 bytes in two bits (RFC 1951, section 3.2.5)."""


_ASCII = re.compile(rb'[\s\d.,;eE+-]+')


def kind(path: Path, start: bytes) -> str:
    """Return 'npy', 'npz' or 'mat' by the first bytes of a file, '' if it is none of them."""
    suffix = path.suffix.lower()
    if start.startswith(NPY_MAGIC):
        return 'npy'
    if start.startswith(ZIP_MAGIC) and suffix == '.npz':
        return 'npz'
    if start.startswith((_MATLAB_5, _MATLAB_7)):
        return 'mat'
    # save -ascii writes numbers in lines; others of version 4 have no name of their own
    if suffix == '.mat' and not _ASCII.fullmatch(start):
        return 'mat'
    return ''


def mapped(path: Path) -> npt.NDArray[Any]:
    """Return the array in a .npy file, without reading it."""
    try:
        with path.open('rb') as file:
            old = np.lib.format.read_magic(file) == (1, 0)
            header = np.lib.format
            read = header.read_array_header_1_0 if old else header.read_array_header_2_0
            shape, fortran, dtype = read(file)
            offset = file.tell()
        size = dtype.itemsize * int(np.prod(np.array(shape, dtype=object)))
        stored = path.stat().st_size - offset
        if dtype.hasobject or size <= 0 or not _flat(dtype):
            kind = 'object' if dtype.hasobject else 'columns' if dtype.names else dtype.name
            raise ValueError(f'it holds {kind} of shape {shape}')
        if size > stored:
            raise ValueError(f'cut off: {size} bytes are announced, {stored} are there')
        data = attach(Place(str(path), offset, '|u1', (size,), (1,)))
        return data.view(dtype).reshape(shape, order='F' if fortran else 'C')
    except OSError:
        raise
    except Exception as problem:  # numpy raises whatever a damaged header leads it to
        reason = ' '.join(str(problem).split())[:_LONGEST_REASON]
        raise RecordingError(f'{path}: not an array of numbers: {reason}') from problem


def _flat(dtype: np.dtype[Any]) -> bool:
    """Return whether numbers, or named columns of numbers, are all that there is."""
    if dtype.names is None:
        return dtype.subdtype is None
    return all(dtype[name].base.names is None for name in dtype.names)


def unzipped(path: Path, folder: Path) -> Arrays:
    """Return the arrays of a .npz file, unpacked into a folder."""
    arrays = {}
    try:
        with zipfile.ZipFile(path) as archive:
            room = _RATIO * path.stat().st_size  # several may claim the same bytes
            for number, member in enumerate(archive.infolist()):
                if member.filename.endswith('.npy'):
                    room -= member.file_size
                    if room < 0 or member.file_size > _RATIO * max(member.compress_size, 1):
                        raise ValueError(f'{member.filename} claims {member.file_size} bytes')
                    target = folder / f'{number}.npy'
                    with archive.open(member) as packed, target.open('wb') as plain:
                        while data := packed.read(_STEP):
                            plain.write(data)
                    arrays[member.filename.removesuffix('.npy')] = mapped(target)
    except RecordingError as problem:
        raise RecordingError(f'{path}: {problem}') from problem
    except OSError as problem:
        raise RecordingError(
            f'{path}: cannot be unpacked into {folder}: {problem.strerror or problem}'
        ) from problem
    except Exception as problem:  # zipfile raises whatever a damaged archive leads it to
        raise RecordingError(f'{path}: damaged: {problem}') from problem
    return arrays


def matlab(path: Path, folder: Path) -> Arrays:
    """
    Return the numeric arrays of a .mat file, those in structs by their field.

    One variable after the other is read as a whole and put into files in a folder.
    """
    try:
        variables = _variables(path)
        for key, (size, parts) in variables.items():
            if parts > _MOST_PARTS:
                raise RecordingError(
                    f'{path}: variable {key} is a struct or cell of more than {_MOST_PARTS} '
                    'arrays: save the columns of the recording as variables of their own'
                )
            if size > MATLAB_BYTES:
                raise RecordingError(
                    f'{path}: variable {key} may take {size >> 20} MiB, and those of MATLAB are '
                    f'read in one piece up to {MATLAB_BYTES >> 20}: save its columns as variables '
                    'of their own, or the recording as CSV or .npy'
                )
        names = _unpacked_apart(path, folder, list(variables))
    except NotImplementedError as problem:
        raise RecordingError(
            f'{path}: a MATLAB file of version 7.3 (HDF5) is not read: save it again with '
            "save(file, '-v7')"
        ) from problem
    except (MemoryError, RecordingError):
        raise
    except Exception as problem:  # scipy raises whatever a damaged file leads it to
        reason = ' '.join(str(problem).split()) or type(problem).__name__
        raise RecordingError(f'{path}: damaged, or no MATLAB file: {reason}') from problem
    return _shortened({n: mapped(folder / f'{k}.npy') for k, n in enumerate(names)})


def _unpacked_apart(path: Path, folder: Path, variables: Sequence[str]) -> list[str]:
    """Return the names of the arrays that another process has put into a folder."""
    child = [sys.executable, '-m', f'{__package__}.matlab_child', str(path), str(folder)]
    done = subprocess.run([*child, *variables], capture_output=True, text=True, check=False)
    if done.returncode < 0:
        raise ValueError('reading it ends in a crash')
    if done.returncode:
        raise ValueError(done.stderr.strip().rpartition('\n')[2][:_LONGEST_REASON])
    return list(json.loads(done.stdout))


def _variables(path: Path) -> dict[str, tuple[int, int]]:
    """Return the variables of a .mat file: about how many bytes each takes, and its arrays."""
    from scipy.io import whosmat

    stored = list(_elements(path))
    described = whosmat(str(path))
    if len(stored) != len(described):  # of version 4, or damaged: whatever is not known is 0
        stored = [(0, max((parts for _, parts in stored), default=0))] * len(described)
    # numbers are stored in the smallest integers that hold them, and read as what they are; of
    # those in a struct only the bytes stored are known
    return {
        name: (_LONGEST * (math.prod(shape) if kind in _NUMERIC else size), parts)
        for (name, shape, kind), (size, parts) in zip(described, stored, strict=True)
    }


def _elements(path: Path) -> Iterator[tuple[int, int]]:
    """
    Yield the bytes of every variable of a MATLAB file of version 5 to 7, unpacked, and its arrays.

    MathWorks, MAT-File Format, version 5: a header of 128 bytes, then elements with a tag of
    two numbers of 4 bytes, type and size; what is compressed begins with the tag of the matrix
    in it.
    """
    end = path.stat().st_size
    with path.open('rb') as file:
        header = file.read(_MATLAB_HEADER)
        order = '<' if header.endswith(b'IM') else '>'
        place = file.tell()
        while header.startswith(_MATLAB_5) and place + _TAG <= end:
            file.seek(place)
            kind, size = struct.unpack(f'{order}II', file.read(_TAG))
            place += _TAG + size
            begin, compressed = file.tell(), kind == COMPRESSED
            parts = arrays_in(file, size, order, compressed=compressed, most=_MOST_PARTS)
            if compressed:
                file.seek(begin)
                tag = zlib.decompressobj().decompress(file.read(_EDGE), _TAG)
                size = struct.unpack(f'{order}II', tag)[1]
            yield size, parts


def _shortened(found: Arrays) -> Arrays:
    """Return arrays under the last part of their names where no two are equal."""
    short = [name.rpartition('.')[2] for name in found]
    if len(set(short)) < len(short):
        return found
    return dict(zip(short, found.values(), strict=True))


_MATRIX, COMPRESSED = 14, 15
_PLAIN = frozenset(range(4, 16))  # classes of text, sparse and full arrays of numbers
_PIECE = 1 << 16

Read = Callable[[int], bytes]


def arrays_in(file: BinaryIO, size: int, order: str, *, compressed: bool, most: int) -> int:
    """Return how many arrays there are in an element that begins at the place of a file."""
    read = _Stream(_unpacked(file, size) if compressed else _stored(file, size)).read
    count = 0 if compressed else 1
    if not compressed and _is_plain(read, order):
        return 1
    while count <= most and len(tag := read(_TAG)) == _TAG:
        kind, length = struct.unpack(f'{order}II', tag)
        if kind == _MATRIX:
            count += 1
            if length and _is_plain(read, order) and count == 1:
                break
        elif kind >> 16 == 0:
            read(length + -length % _TAG)
    return count


def _is_plain(read: Read, order: str) -> bool:
    """Return whether an array, behind its tag, holds no others."""
    flags = read(2 * _TAG)
    if len(flags) < 2 * _TAG:
        return False
    return struct.unpack_from(f'{order}I', flags, _TAG)[0] & 0xFF in _PLAIN


def _stored(file: BinaryIO, size: int) -> Iterator[bytes]:
    while size > 0 and (data := file.read(min(size, _PIECE))):
        size -= len(data)
        yield data


def _unpacked(file: BinaryIO, size: int) -> Iterator[bytes]:
    unpacker = zlib.decompressobj()
    for data in _stored(file, size):
        while data:
            yield unpacker.decompress(data, _PIECE)
            data = unpacker.unconsumed_tail


class _Stream:
    """Reads exact numbers of bytes of pieces; of many only the last are kept."""

    def __init__(self, pieces: Iterator[bytes]) -> None:
        self._pieces = pieces
        self._rest = b''

    def read(self, size: int) -> bytes:
        """Return the next bytes, fewer at the end; of more than a tag and its flags none."""
        while len(self._rest) < size:
            piece = next(self._pieces, None)
            if piece is None:
                break
            if size > 2 * _TAG:
                size -= len(self._rest)
                self._rest = piece
            else:
                self._rest += piece
        found, self._rest = self._rest[:size], self._rest[size:]
        return found
