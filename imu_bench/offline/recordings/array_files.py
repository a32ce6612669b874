# SPDX-License-Identifier: Apache-2.0
"""Files that hold arrays, of NumPy and of MATLAB: names and arrays of numbers out of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
import zipfile

from imu_bench.errors import RecordingError
from imu_bench.offline.mapped import attach, Place
import numpy as np
import numpy.typing as npt

Arrays = dict[str, npt.NDArray[Any]]

NPY_MAGIC = b'\x93NUMPY'
ZIP_MAGIC = b'PK\x03\x04'
_MATLAB_5, _MATLAB_7 = b'MATLAB 5.0 MAT-file', b'MATLAB 7.3 MAT-file'
MAGIC_SIZE = len(_MATLAB_5)

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


def matlab(path: Path) -> Arrays:
    """
    Return the numeric arrays of a .mat file, those in structs by their field; read as a whole.

    Raises
    ------
    RecordingError
        If the file is damaged, or of version 7.3.
    """
    from scipy.io import loadmat  # only this format needs it

    try:
        content = loadmat(str(path), simplify_cells=True)
    except NotImplementedError as problem:
        raise RecordingError(
            f'{path}: a MATLAB file of version 7.3 (HDF5) is not read: save it again with '
            "save(file, '-v7')"
        ) from problem
    except MemoryError:
        raise
    except Exception as problem:  # scipy raises whatever a damaged file leads it to
        reason = ' '.join(str(problem).split()) or type(problem).__name__
        raise RecordingError(f'{path}: damaged, or no MATLAB file: {reason}') from problem
    found = {
        name: value
        for key, entry in content.items()
        if not key.startswith('__')
        for name, value in _leaves(key, entry)
    }
    return _shortened(found)


def _leaves(name: str, value: object) -> Iterator[tuple[str, npt.NDArray[Any]]]:
    """Yield the arrays in a struct and in its structs, under dotted names."""
    if isinstance(value, Mapping):
        for key, entry in value.items():
            yield from _leaves(f'{name}.{key}', entry)
    elif isinstance(value, np.ndarray):
        yield name, value


def _shortened(found: Arrays) -> Arrays:
    """Return arrays under the last part of their names where no two are equal."""
    short = [name.rpartition('.')[2] for name in found]
    if len(set(short)) < len(short):
        return found
    return dict(zip(short, found.values(), strict=True))
