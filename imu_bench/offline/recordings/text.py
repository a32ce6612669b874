# SPDX-License-Identifier: Apache-2.0
"""CSV and other tables of numbers in text files."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from imu_bench.errors import RecordingError
from imu_bench.offline.recordings import cells
from imu_bench.offline.recordings.columns import assign, Column, INERTIAL
from imu_bench.offline.recordings.layout import detect, Layout
from imu_bench.offline.recordings.options import ReadOptions
from imu_bench.offline.recordings.source import Chunk, Source, Topic
from imu_bench.offline.recordings.sparse import Merger
import numpy as np
import numpy.typing as npt

_FIELDS = {
    'linear_acceleration': 'acceleration',
    'angular_velocity': 'angular_velocity',
    'magnetic_field': 'magnetic_field',
    'temperature': 'temperature',
}
_DECIMALS = {'s': 9, 'ms': 6, 'µs': 3, 'ns': 0}
_SECOND = 1_000_000_000
_MAX_SECONDS = 9.2e9
_DENSE = 0.95
"""Share of filled cells above which empty ones are losses and not the format of the file."""


def open_text(path: Path, options: ReadOptions) -> Source:
    """
    Open a CSV or text file: one stream, named after the file.

    Raises
    ------
    RecordingError
        If it holds no table, or its columns, units or rate are not known.
    """
    layout = detect(path)
    columns, notes = assign(path, layout, options)
    rows = sum(block.count(b'\n') for block in cells.blocks(path, layout.start))
    topic = Topic(path.stem, 'text', rows, is_imu=True)
    reader = _Reader(path, layout, columns, options.rate_hz)
    if options.rate_hz is not None and reader.stamps_from == 'column':
        notes.append('--rate is not used: the file has a time column')
    return Source(path, 'text', (topic,), reader, problems=notes)


class _Reader:
    def __init__(
        self, path: Path, layout: Layout, columns: list[Column], rate_hz: float | None
    ) -> None:
        self._path = path
        self._layout = layout
        by_target = {column.target: column for column in columns}
        self._stamp = by_target.pop('stamp', None)
        self._index = by_target.pop('index', None)
        self._columns = list(by_target.values())
        # without a time column there is a rate: that was checked with the columns
        self._rate = rate_hz or 1.0
        self.stamps_from = 'rate' if self._stamp is None else 'column'

    def chunks(
        self, topics: Collection[Topic], problems: list[str]
    ) -> Iterator[tuple[str, Chunk]]:
        bad: list[int] = []
        inertial = np.array([column.quantity in INERTIAL for column in self._columns])
        merger = Merger(inertial) if self._sparse() else None
        for values, stamps in self._rows(bad):
            if merger is not None:
                values, stamps = merger.add(values, stamps)
            if stamps.size:
                yield self._path.stem, self._chunk(values, stamps)
        if merger is not None:
            values, stamps = merger.rest()
            if stamps.size:
                yield self._path.stem, self._chunk(values, stamps)
            problems.append(
                f'{self._path.name}: the columns are filled in different rows: '
                f'{merger.rows} rows were joined into {merger.samples} samples'
            )
        if bad:
            problems.append(
                f'{self._path.name}: {len(bad)} lines of the table are no rows and were skipped, '
                f'the first is its line {bad[0] + 1}'
            )

    def close(self) -> None:
        pass

    def _sparse(self) -> bool:
        """Return whether the axes of one sample stand in different rows."""
        used = [c.index for c in self._columns if c.quantity in INERTIAL]
        shares = [self._layout.filled[index] for index in used]
        return self._stamp is not None and min(shares) < _DENSE

    def _rows(
        self, bad: list[int]
    ) -> Iterator[tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]]:
        """Yield values in SI and stamps in ns, block by block."""
        wanted = [column.index for column in self._columns]
        if self._index is not None:
            wanted.append(self._index.index)
        factors = np.array([column.scale.factor for column in self._columns])
        stamp = None if self._stamp is None else self._stamp.index
        lines = before = 0
        for block in cells.blocks(self._path, self._layout.start):
            rows = cells.parse(block, self._layout, wanted, stamp, lines)
            bad.extend(rows.bad)
            values = rows.values[:, : factors.size] * factors
            yield values, self._stamps(rows, before)
            lines += block.count(b'\n')
            before += rows.lines

    def _stamps(self, rows: cells.Rows, before: int) -> npt.NDArray[np.int64]:
        if self._stamp is None:
            places = rows.places + float(before) if self._index is None else rows.values[:, -1]
            seconds = places / self._rate
            if not (np.abs(seconds) < _MAX_SECONDS).all():
                raise RecordingError(f'{self._path}: the index column holds no usable numbers')
            return np.rint(seconds * _SECOND).astype(np.int64)
        unit = self._stamp.scale.unit
        text = rows.stamps if rows.stamps is not None else np.empty(0, 'S1')
        try:
            if unit in _DECIMALS and self._stamp.scale.factor == 10.0 ** (_DECIMALS[unit] - 9):
                return cells.nanoseconds(text, _DECIMALS[unit])
        except RecordingError as problem:
            raise RecordingError(f'{self._path}: {problem}') from problem
        seconds = text.astype(np.float64) * self._stamp.scale.factor
        return np.rint(seconds * _SECOND).astype(np.int64)

    def _chunk(self, values: npt.NDArray[np.float64], stamps: npt.NDArray[np.int64]) -> Chunk:
        fields: dict[str, Any] = {}
        for place, column in enumerate(self._columns):
            name = _FIELDS[column.quantity]
            if column.quantity == 'temperature':
                fields[name] = values[:, place]
                continue
            table = fields.setdefault(name, np.full((stamps.size, 3), np.nan))
            table[:, 'xyz'.index(column.target[-1])] = values[:, place]
        return Chunk(stamps=stamps, **fields)
