# SPDX-License-Identifier: Apache-2.0
"""CSV and other tables of numbers in text files."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from imu_bench.bags.problems import INCOMPLETE, Problem
from imu_bench.errors import RecordingError
from imu_bench.offline.recordings import cells, continuation, vendor
from imu_bench.offline.recordings.columns import assign, Column, INERTIAL
from imu_bench.offline.recordings.continuation import Part
from imu_bench.offline.recordings.layout import detect, Layout
from imu_bench.offline.recordings.options import ReadOptions
from imu_bench.offline.recordings.source import Chunk, Source, Topic
from imu_bench.offline.recordings.sparse import Merger
from imu_bench.offline.recordings.tables import chunk_of, DECIMALS, in_nanoseconds
import numpy as np
import numpy.typing as npt

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
    parts, columns, notes = parts_of(path, options)
    if len(parts) > 1:
        notes.append(
            f'{len(parts)} files that continue each other are read as one recording: '
            f'{path.name} to {parts[-1].path.name}'
        )
    rows = sum(
        block.count(b'\n')
        for part in parts
        for block in cells.blocks(part.path, part.layout.start)
    )
    topic = Topic(path.stem, 'text', rows, is_imu=True)
    reader = _Reader(parts, columns, options.rate_hz)
    if options.rate_hz is not None and reader.stamps_from == 'column':
        notes.append('--rate is not used: the file has a time column')
    files = tuple(part.path for part in parts)
    return Source(path, 'text', (topic,), reader, problems=notes, files=files)


def parts_of(path: Path, options: ReadOptions) -> tuple[list[Part], list[Column], list[str]]:
    """
    Return the files of a recording, the meaning of their columns, and notes on it.

    Errors are those of `open_text`; little of the files is read.
    """
    layout = detect(path)
    columns, notes = _meaning(path, layout, options)
    parts = [Part(path, layout)]
    stamp = next((column for column in columns if column.target == 'stamp'), None)
    if options.join and stamp is not None:
        scale = stamp.scale.factor
        parts += continuation.following(path, layout, stamp.index, scale, options.join)
    return parts, columns, notes


def _meaning(path: Path, layout: Layout, options: ReadOptions) -> tuple[list[Column], list[str]]:
    try:
        return assign(path, layout, options)
    except RecordingError:
        known = None if options.columns or options.units else vendor.recognise(path, layout)
        if known is None:
            raise
    chosen = replace(options, columns=known.columns, units=known.units)
    columns, notes = assign(path, layout, chosen)
    return columns, [f'{path.name}: {known.note}', *notes]


@dataclass
class _Skipped:
    """Lines that are no rows: how many, and which is the first."""

    lines: int = 0
    first: str = ''


class _Reader:
    def __init__(self, parts: list[Part], columns: list[Column], rate_hz: float | None) -> None:
        self._parts = parts
        self._path, self._layout = parts[0]
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
        bad = _Skipped()
        inertial = np.array([column.quantity in INERTIAL for column in self._columns])
        merger = Merger(inertial) if self._sparse() else None
        for values, stamps in self._rows(bad):
            if merger is not None:
                values, stamps = merger.add(values, stamps)
            if stamps.size:
                yield self._path.stem, chunk_of(self._columns, values, stamps)
        if merger is not None:
            values, stamps = merger.rest()
            if stamps.size:
                yield self._path.stem, chunk_of(self._columns, values, stamps)
            problems.append(
                f'{self._path.name}: the columns are filled in different rows: '
                f'{merger.rows} rows were joined into {merger.samples} samples'
            )
        if bad.lines:
            words = (
                f'{self._path.name}: {bad.lines} lines of the table are no rows and were skipped, '
                f'the first is {bad.first}'
            )
            problems.append(Problem(words, INCOMPLETE))

    def close(self) -> None:
        pass

    def _sparse(self) -> bool:
        """Return whether the axes of one sample stand in different rows."""
        used = [c.index for c in self._columns if c.quantity in INERTIAL]
        shares = [self._layout.filled[index] for index in used]
        return self._stamp is not None and min(shares) < _DENSE

    def _rows(
        self, bad: _Skipped
    ) -> Iterator[tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]]:
        """Yield values in SI and stamps in ns, block by block."""
        wanted = [column.index for column in self._columns]
        if self._index is not None:
            wanted.append(self._index.index)
        factors = np.array([column.scale.factor for column in self._columns])
        stamp = None if self._stamp is None else self._stamp.index
        before = 0
        for part in self._parts:
            lines = 0
            of = f' of {part.path.name}' if len(self._parts) > 1 else ''
            for block in cells.blocks(part.path, part.layout.start):
                rows = cells.parse(block, part.layout, wanted, stamp, lines)
                if rows.bad:
                    bad.first = bad.first or f'its line {rows.bad[0] + 1}{of}'
                    bad.lines += len(rows.bad)
                with np.errstate(over='ignore', invalid='ignore'):
                    values = rows.values[:, : factors.size] * factors
                yield values, self._stamps(rows, before)
                lines += block.count(b'\n')
                before += rows.lines

    def _stamps(self, rows: cells.Rows, before: int) -> npt.NDArray[np.int64]:
        if self._stamp is None:
            places = rows.places + float(before) if self._index is None else rows.values[:, -1]
            try:
                return in_nanoseconds(np.asarray(places / self._rate, np.float64))
            except RecordingError as problem:
                raise RecordingError(
                    f'{self._path}: the index column holds no usable numbers'
                ) from problem
        unit = self._stamp.scale.unit
        text = rows.stamps if rows.stamps is not None else np.empty(0, 'S1')
        try:
            if unit in DECIMALS and self._stamp.scale.factor == 10.0 ** (DECIMALS[unit] - 9):
                return cells.nanoseconds(text, DECIMALS[unit])
            seconds = np.asarray(text.astype(np.float64) * self._stamp.scale.factor, np.float64)
            return in_nanoseconds(seconds)
        except RecordingError as problem:
            raise RecordingError(f'{self._path}: {problem}') from problem
