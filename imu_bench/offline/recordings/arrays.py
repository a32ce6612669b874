# SPDX-License-Identifier: Apache-2.0
"""Arrays of NumPy (npy, npz, folders of npy) and MATLAB as tables of named columns."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
import shutil
from tempfile import mkdtemp
from typing import Any
import weakref

from imu_bench.errors import RecordingError
from imu_bench.offline.recordings import array_files
from imu_bench.offline.recordings.array_files import Arrays
from imu_bench.offline.recordings.columns import assign, Assigned, INERTIAL, recognise
from imu_bench.offline.recordings.layout import Layout
from imu_bench.offline.recordings.source import Chunk, ReadOptions, Source, Topic
from imu_bench.offline.recordings.tables import chunk_of, DECIMALS, in_nanoseconds
from imu_bench.offline.running.mapped import release
from msg_conversions.quantities import BY_NAME, QUANTITIES
import numpy as np
import numpy.typing as npt

_FEW = 16
_BLOCK = 1 << 16
"""Rows that are read at once."""

_RELEASED = 4 * _BLOCK

_OURS = {
    'stamps': 'stamp [ns]',
    **{q.field: q.name if q.components else f'{q.name} [{q.unit}]' for q in QUANTITIES},
}
"""Columns of `Samples`, which are in SI, and what they are called in other tables."""


def open_arrays(path: Path, options: ReadOptions) -> Source:
    """Open arrays: one stream, named after the file or folder."""
    unpacked: Path | None = None
    if path.is_dir():
        form = 'npy'
        arrays = {file.stem: array_files.mapped(file) for file in sorted(path.glob('*.npy'))}
    else:
        with path.open('rb') as file:
            form = array_files.kind(path, file.read(array_files.MAGIC_SIZE))
        if form != 'npy':
            unpacked = Path(mkdtemp(prefix='imu_bench_'))
    try:
        if not path.is_dir():
            arrays = _read(path, form, unpacked)
        return _source(path, form, arrays, options, unpacked)
    except BaseException:
        if unpacked is not None:
            shutil.rmtree(unpacked, ignore_errors=True)
        raise


def _read(path: Path, form: str, folder: Path | None) -> Arrays:
    if folder is not None:
        read = array_files.matlab if form == 'mat' else array_files.unzipped
        return read(path, folder)
    name = path.stem if recognise(f'{path.stem}_x') is not None else ''
    return {name: array_files.mapped(path)}


def _source(
    path: Path, form: str, arrays: Arrays, options: ReadOptions, folder: Path | None
) -> Source:
    labels, columns, notes = _table(path, arrays)
    header = labels if any(labels) else ()
    layout = Layout('', len(columns), header, 0, (True,) * len(columns))
    meaning, more = assign(path, layout, options)
    reader = _Reader(path, columns, meaning, options.rate_hz)
    if folder is not None:
        reader.remove(folder)
    topic = Topic(path.stem, form, columns[0].size, is_imu=True)
    return Source(path, form, (topic,), reader, problems=[*notes, *more])


class _Reader:
    def __init__(
        self,
        path: Path,
        columns: list[npt.NDArray[Any]],
        meaning: list[Assigned],
        rate_hz: float | None,
    ) -> None:
        by_target = {column.target: column for column in meaning}
        self._path = path
        self._columns = columns
        self._stamp = by_target.pop('stamp', None)
        self._index = by_target.pop('index', None)
        self._nanoseconds = by_target.pop('nanoseconds', None)
        self._used = list(by_target.values())
        # without a time column there is a rate: that was checked with the columns
        self._rate = rate_hz or 1.0
        self._cleaning: weakref.finalize[..., _Reader] | None = None
        self.stamps_from = 'rate' if self._stamp is None else 'column'

    def remove(self, folder: Path) -> None:
        """Remove a folder when the reader is closed or gone."""
        self._cleaning = weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)

    def chunks(
        self, topics: Collection[Topic], problems: list[str]
    ) -> Iterator[tuple[str, Chunk]]:
        size = self._columns[0].size
        for start in range(0, size, _BLOCK):
            part = slice(start, min(start + _BLOCK, size))
            values = np.empty((part.stop - start, len(self._used)))
            with np.errstate(over='ignore', invalid='ignore'):
                for place, column in enumerate(self._used):
                    values[:, place] = self._columns[column.index][part]
                values += [column.scale.offset for column in self._used]
                values *= [column.scale.factor for column in self._used]
            try:
                stamps = self._stamps(part)
            except RecordingError as problem:
                raise RecordingError(f'{self._path}: {problem}') from problem
            yield self._path.stem, chunk_of(self._used, values, stamps)
            if start % _RELEASED == 0:
                release()  # reading is faster than whoever watches the pages

    def close(self) -> None:
        if self._cleaning is not None:
            self._cleaning()

    def _stamps(self, part: slice) -> npt.NDArray[np.int64]:
        if self._stamp is None:
            places = np.arange(part.start, part.stop, dtype=np.float64)
            if self._index is not None:
                places = self._columns[self._index.index][part].astype(np.float64)
            return in_nanoseconds(places / self._rate)
        times = self._columns[self._stamp.index][part]
        unit, factor = self._stamp.scale.unit, self._stamp.scale.factor
        rounded = in_nanoseconds(times.astype(np.float64) * factor)
        whole = times.dtype.kind in 'iu' and unit in DECIMALS
        if whole and factor == 10.0 ** (DECIMALS[unit] - 9):
            # float64 would cost the last digits of nanoseconds since 1970
            rounded = np.asarray(times.astype(np.int64) * 10 ** DECIMALS[unit], np.int64)
        if self._nanoseconds is not None:
            rounded = rounded + self._columns[self._nanoseconds.index][part].astype(np.int64)
        return rounded


def _table(
    path: Path, arrays: Arrays
) -> tuple[tuple[str, ...], list[npt.NDArray[Any]], list[str]]:
    """Return labels and columns of one length, that of most inertial ones, and notes on others."""
    found = [
        labelled for name, array in _named(arrays).items() for labelled in _split(name, array)
    ]
    lengths = Counter(column.size for _, column in found)
    if not lengths or max(lengths) < 2:
        raise RecordingError(
            f'{path}: no columns of numbers in it; a table of MATLAB must be saved as arrays '
            '(table2array) or as a struct of arrays'
        )
    inertial = Counter(column.size for label, column in found if _is_inertial(label))
    lengths = inertial or lengths
    size = max(lengths, key=lambda length: (lengths[length], length))
    left_out = [label for label, column in found if column.size != size]
    notes = [f'{path.name}: not used, being of another length: {", ".join(left_out)}']
    kept = [(label, column) for label, column in found if column.size == size]
    labels = tuple(label for label, _ in kept)
    return labels, [column for _, column in kept], notes if left_out else []


def _is_inertial(label: str) -> bool:
    meaning = recognise(label)
    return meaning is not None and meaning[0].partition('.')[0] in INERTIAL


def _named(arrays: Arrays) -> Arrays:
    """Return arrays under names that say their unit, if they are columns of ours."""
    stamps = arrays.get('stamps')
    if stamps is None or stamps.dtype.kind != 'i':
        return arrays
    return {_OURS.get(name, name): array for name, array in arrays.items()}


def _split(name: str, array: npt.NDArray[Any]) -> Iterator[tuple[str, npt.NDArray[Any]]]:
    """Yield label and column for each column of an array; nothing if it holds no numbers."""
    if array.dtype.names is not None:
        for field in array.dtype.names:
            yield from _split(field, array[field])
        return
    if array.dtype.kind not in 'iuf' or array.ndim not in (1, 2) or array.size < 2:
        return
    if array.ndim == 2 and array.shape[0] <= _FEW and array.shape[0] < array.shape[1]:
        array = array.T  # axes in rows
    if array.ndim == 1 or array.shape[1] == 1:
        yield name, array.reshape(-1)
        return
    three = array.shape[1] == len('xyz')
    names = BY_NAME[name].columns if name in BY_NAME else ()
    for place, column in enumerate(array.T):
        if array.shape[1] == len(names):
            yield names[place], column
        elif three and recognise(f'{name}_x') is not None:
            yield f'{name}_{"xyz"[place]}', column
        else:
            yield f'{name}_{place + 1}' if name else '', column
