# SPDX-License-Identifier: Apache-2.0
"""Files that hold arrays, of NumPy and of MATLAB: names and arrays of numbers out of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import math
from pathlib import Path
import struct
from typing import Any
import zipfile
import zlib

from imu_bench.errors import RecordingError
from imu_bench.offline.mapped import attach, Place, Shelf
import numpy as np
import numpy.typing as npt

Arrays = dict[str, npt.NDArray[Any]]

NPY_MAGIC = b'\x93NUMPY'
ZIP_MAGIC = b'PK\x03\x04'
_MATLAB_5, _MATLAB_7 = b'MATLAB 5.0 MAT-file', b'MATLAB 7.3 MAT-file'
MAGIC_SIZE = len(_MATLAB_5)

MATLAB_BYTES = 512 << 20
"""Most that a variable of a .mat file may take in memory."""

_MATLAB_HEADER, _TAG, _COMPRESSED, _EDGE = 128, 8, 15, 1 << 10
_NUMERIC = frozenset(
    ['double', 'single', 'int8', 'uint8', 'int16', 'uint16', 'int32', 'uint32', 'int64', 'uint64']
)
_LONGEST = 8
"""Bytes of the longest number."""

_STEP = 1 << 20
_RATIO = 1032
"""Times that zip can shrink anything: 258 bytes in two bits (RFC 1951, section 3.2.5)."""


def kind(path: Path, start: bytes) -> str:
    """
    Return 'npy', 'npz' or 'mat' by the first bytes of a file, '' if it is none of them.

    Examples
    --------
    >>> kind(Path('a.dat'), NPY_MAGIC), kind(Path('a.csv'), b't,ax,ay')
    ('npy', '')
    """
    suffix = path.suffix.lower()
    if start.startswith(NPY_MAGIC):
        return 'npy'
    if start.startswith(ZIP_MAGIC) and suffix == '.npz':
        return 'npz'
    if start.startswith((_MATLAB_5, _MATLAB_7)) or suffix == '.mat':
        return 'mat'
    return ''


def mapped(path: Path) -> npt.NDArray[Any]:
    """
    Return the array in a .npy file, without reading it.

    Raises
    ------
    RecordingError
        If the file is damaged, or holds something else than numbers.
    """
    try:
        with path.open('rb') as file:
            old = np.lib.format.read_magic(file) == (1, 0)
            header = np.lib.format
            read = header.read_array_header_1_0 if old else header.read_array_header_2_0
            shape, fortran, dtype = read(file)
            offset = file.tell()
        size = dtype.itemsize * int(np.prod(np.array(shape, dtype=object)))
        stored = path.stat().st_size - offset
        if dtype.hasobject or size <= 0:
            raise ValueError(f'it holds {dtype} of shape {shape}')
        if size > stored:
            raise ValueError(f'cut off: {size} bytes are announced, {stored} are there')
        data = attach(Place(str(path), offset, '|u1', (size,), (1,)))
        return data.view(dtype).reshape(shape, order='F' if fortran else 'C')
    except OSError:
        raise
    except Exception as problem:  # numpy raises whatever a damaged header leads it to
        raise RecordingError(f'{path}: not an array of numbers: {problem}') from problem


def unzipped(path: Path, folder: Path) -> Arrays:
    """
    Return the arrays of a .npz file, unpacked into a folder.

    Raises
    ------
    RecordingError
        If the file is damaged, or the folder has no room.
    """
    arrays = {}
    try:
        with zipfile.ZipFile(path) as archive:
            for number, member in enumerate(archive.infolist()):
                if member.filename.endswith('.npy'):
                    if member.file_size > _RATIO * max(member.compress_size, 1):
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

    Raises
    ------
    RecordingError
        If the file is damaged, of version 7.3, or a variable may take more than `MATLAB_BYTES`;
        of numbers in a struct only the bytes stored are known, an eighth of that at least.
    """
    from scipy.io import loadmat  # only this format needs it

    found: Arrays = {}
    shelf = Shelf(folder)
    try:
        for key, size in _variables(path).items():
            if size > MATLAB_BYTES:
                raise RecordingError(
                    f'{path}: variable {key} may take {size >> 20} MiB, and those of MATLAB are '
                    f'read in one piece up to {MATLAB_BYTES >> 20}: save its columns as variables '
                    'of their own, or the recording as CSV or .npy'
                )
            entry = loadmat(str(path), variable_names=[key], simplify_cells=True).get(key)
            for name, value in _leaves(key, entry):
                found[name] = shelf.put(value)
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
    return _shortened(found)


def _variables(path: Path) -> dict[str, int]:
    """Return the variables of a .mat file and about how many bytes each takes in memory."""
    from scipy.io import whosmat

    stored = list(_element_sizes(path))
    described = whosmat(str(path))
    if len(stored) != len(described):  # of version 4, or damaged: whatever is not known is 0
        stored = [0] * len(described)
    # numbers are stored in the smallest integers that hold them, and read as what they are; of
    # those in a struct only the bytes stored are known
    return {
        name: _LONGEST * math.prod(shape) if kind in _NUMERIC else _LONGEST * size
        for (name, shape, kind), size in zip(described, stored, strict=True)
    }


def _element_sizes(path: Path) -> Iterator[int]:
    """
    Yield the bytes of every variable of a MATLAB file of version 5 to 7, unpacked.

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
            if kind == _COMPRESSED:
                tag = zlib.decompressobj().decompress(file.read(_EDGE), _TAG)
                size = struct.unpack(f'{order}II', tag)[1]
            yield size


def _leaves(name: str, value: object) -> Iterator[tuple[str, npt.NDArray[Any]]]:
    """Yield the arrays in a struct and in its structs, under dotted names."""
    if isinstance(value, Mapping):
        for key, entry in value.items():
            yield from _leaves(f'{name}.{key}', entry)
    elif isinstance(value, np.ndarray) and value.dtype.kind in 'iuf' and value.size:
        yield name, value


def _shortened(found: Arrays) -> Arrays:
    """Return arrays under the last part of their names where no two are equal."""
    short = [name.rpartition('.')[2] for name in found]
    if len(set(short)) < len(short):
        return found
    return dict(zip(short, found.values(), strict=True))
