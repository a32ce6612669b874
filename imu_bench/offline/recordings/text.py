# SPDX-License-Identifier: Apache-2.0
"""CSV and other tables of numbers in text files, alone or continuing each other."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
import shutil
from tempfile import mkdtemp
from typing import NamedTuple
import weakref

from imu_bench.bags.problems import INCOMPLETE, Problem
from imu_bench.errors import RecordingError
from imu_bench.offline.recordings import cells, spelling
from imu_bench.offline.recordings.columns import assign, Assigned, INERTIAL
from imu_bench.offline.recordings.discovery import following, is_text_name, name_key, Part
from imu_bench.offline.recordings.layout import detect, Layout
from imu_bench.offline.recordings.source import Chunk, ReadOptions, Source, Topic
from imu_bench.offline.recordings.tables import chunk_of, DECIMALS, in_nanoseconds, Merger
import numpy as np
import numpy.typing as npt

_SECOND_NS = 1e9
_DENSE = 0.95
"""Share of filled cells above which empty ones are losses and not the format of the file."""


def open_text(path: Path, options: ReadOptions) -> Source:
    """Open a CSV or text file: one stream, named after the file."""
    folder = Path(mkdtemp(prefix='imu_bench_')) if options.layout else None
    try:
        return _opened(path, options, folder)
    except BaseException:
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)
        raise


def _opened(path: Path, options: ReadOptions, folder: Path | None) -> Source:
    table = path
    if folder is not None:
        table = folder / path.name
        table.write_bytes(spelling.reflowed(path, options.layout))
    parts, columns, notes = parts_of(table, options)
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
    if folder is not None:
        reader.remove(folder)
    if parts[0].layout.spelled == spelling.DATES and reader.stamps_from == 'column':
        notes.append('dates are UTC where they name no zone')
    if options.rate_hz is not None and reader.stamps_from == 'column':
        notes.append('--rate is not used: the file has a time column')
    files = tuple(part.path for part in parts) if folder is None else (path,)
    return Source(path, 'text', (topic,), reader, problems=notes, files=files)


def parts_of(path: Path, options: ReadOptions) -> tuple[list[Part], list[Assigned], list[str]]:
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
        parts += following(path, layout, stamp.index, scale, options.join)
    return parts, columns, notes


def _meaning(path: Path, layout: Layout, options: ReadOptions) -> tuple[list[Assigned], list[str]]:
    try:
        return assign(path, layout, options)
    except RecordingError:
        known = None if options.columns or options.units else recognise(path, layout)
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
    def __init__(self, parts: list[Part], columns: list[Assigned], rate_hz: float | None) -> None:
        self._parts = parts
        self._path, self._layout = parts[0]
        by_target = {column.target: column for column in columns}
        self._stamp = by_target.pop('stamp', None)
        self._index = by_target.pop('index', None)
        self._nanoseconds = by_target.pop('nanoseconds', None)
        self._cleaning: weakref.finalize[..., _Reader] | None = None
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
        problems.extend(
            f'{part.path.name}: its last line has no line end: if the file was cut off there, '
            'the last number may be cut, too'
            for part in self._parts
            if not cells.ends_with_line(part.path)
        )
        if bad.lines:
            words = (
                f'{self._path.name}: {bad.lines} lines of the table are no rows and were skipped, '
                f'the first is {bad.first}'
            )
            problems.append(Problem(words, INCOMPLETE))

    def remove(self, folder: Path) -> None:
        """Remove a folder when the reader is closed or gone."""
        self._cleaning = weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)

    def close(self) -> None:
        if self._cleaning is not None:
            self._cleaning()

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
        # behind the others: what tells the time beside the stamp, or instead of it
        if (beside := self._index if self._stamp is None else self._nanoseconds) is not None:
            wanted.append(beside.index)
        factors = np.array([column.scale.factor for column in self._columns])
        offsets = np.array([column.scale.offset for column in self._columns])
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
                    values = (rows.values[:, : factors.size] + offsets) * factors
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
                whole = cells.nanoseconds(text, DECIMALS[unit])
                return whole if self._nanoseconds is None else whole + _whole(rows.values[:, -1])
            seconds = np.asarray(text.astype(np.float64) * self._stamp.scale.factor, np.float64)
            return in_nanoseconds(seconds)
        except RecordingError as problem:
            raise RecordingError(f'{self._path}: {problem}') from problem


def _whole(nanoseconds: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
    if not ((nanoseconds >= 0.0) & (nanoseconds < _SECOND_NS)).all():
        raise RecordingError('nanoseconds beside seconds are not between 0 and 999999999')
    return np.rint(nanoseconds).astype(np.int64)


def grouped(paths: Sequence[Path], options: ReadOptions) -> tuple[list[Path], ReadOptions]:
    """
    Return recordings without the text files that continue others among them.

    With the options returned, a file is read together with those that continue it.
    """
    alike: dict[tuple[Path, str], list[Path]] = {}
    for path in paths:
        if is_text_name(path) and path.is_file():
            alike.setdefault((path.resolve().parent, name_key(path)[0]), []).append(path)
    continued: set[Path] = set()
    for group in alike.values():
        joining = replace(options, join=tuple(str(path.resolve()) for path in group))
        for path in sorted(group, key=name_key) if len(group) > 1 else ():
            if path.resolve() not in continued:
                continued |= _continuing(path, joining)
    kept = [path for path in paths if path.resolve() not in continued]
    return kept, replace(options, join=tuple(sorted(map(str, continued))))


def _continuing(path: Path, joining: ReadOptions) -> set[Path]:
    try:
        parts, _, _ = parts_of(path, joining)
    except (RecordingError, OSError):
        return set()  # told when it is read
    return {part.path.resolve() for part in parts[1:]}


Floats = npt.NDArray[np.float64]

_SAMPLE = 1 << 16
_LEAST_ROWS = 10
_MURATA_WIDTH = 8
_SIZE = 0.15
"""Acceleration of a still sensor may be this far from 1 g, relative: it is moved between tests."""
_ANGLE_DEG = 1.0


class Preset(NamedTuple):
    """Options that a log needs, and what the user is told."""

    columns: str
    units: str
    note: str


def recognise(path: Path, layout: Layout) -> Preset | None:
    """
    Return how to read a log of "Murata MEMS Demo", None if it is none.

    Its columns are time in s, one that is not used, acceleration z, y, x in g, inclination z,
    y, x in degrees, and others (thesis on Murata SCL3300 and TDK IIM-42652, appendices 8, 10
    and 11).  The file proves it: the inclinations are the angles of the accelerations,
    atan(a_x / sqrt(a_y² + a_z²)) and so on (Murata SCL3300 data sheet, section 2.3.4), and these
    are one g long.
    """
    if layout.spelled == spelling.SENTENCES:
        return _sentence(path, layout)
    if layout.width < _MURATA_WIDTH or not all(layout.numeric[:_MURATA_WIDTH]):
        return None
    with path.open('rb') as file:
        file.seek(layout.start)
        block = file.read(_SAMPLE)
    complete = block[: block.rfind(b'\n') + 1]
    rows = cells.parse(complete, layout, range(_MURATA_WIDTH), None).values
    rows = rows[np.isfinite(rows).all(axis=1)]
    if len(rows) < _LEAST_ROWS or not (np.diff(rows[:, 0]) > 0).all():
        return None
    return _MURATA if _fits(rows[:, 2:5], rows[:, 5:8]) else None


def _sentence(path: Path, layout: Layout) -> Preset | None:
    """Return how to read a log of sentences by their name."""
    with path.open('rb') as file:
        file.seek(layout.start)
        name, *cells_of_first = file.readline().partition(b'*')[0].lstrip(b'$').split(b',')
    columns = _SENTENCES.get(name.decode('ascii', 'replace'), ())
    if len(columns) != len(cells_of_first):
        return None
    return Preset(
        ','.join(('-', *columns)),
        'linear_acceleration=m/s^2,angular_velocity=rad/s,magnetic_field=G',
        f'read as {name.decode()} of VectorNav sensors: m/s², rad/s and Gauss; name the columns '
        'with --columns if it is something else',
    )


_VECTORS = tuple(
    f'{quantity}.{axis}'
    for quantity in ('magnetic_field', 'linear_acceleration', 'angular_velocity')
    for axis in 'xyz'
)
_SENTENCES = {
    'VNYMR': ('-', '-', '-', *_VECTORS),
    'VNMAR': _VECTORS,
    'VNIMU': (*_VECTORS, '-', '-'),
}
"""Cells behind the names of sentences: VectorNav VN-100 User Manual (UM001), registers 27, 20
and 54."""


def _fits(acceleration: Floats, degrees: Floats) -> bool:
    """Return whether accelerations are one g, and angles are theirs."""
    with np.errstate(over='ignore', invalid='ignore'):
        size = np.linalg.norm(acceleration, axis=1)
        others = np.sqrt(np.maximum(size[:, None] ** 2 - acceleration**2, 0.0))
        expected = np.degrees(np.arctan2(acceleration, others))
        off = np.abs(np.abs(degrees) - np.abs(expected))
    return bool(
        abs(float(np.median(size)) - 1.0) < _SIZE
        and (np.median(off, axis=0) < _ANGLE_DEG).all()
        and np.ptp(expected) > 3 * _ANGLE_DEG
    )


_MURATA = Preset(
    'stamp,-,linear_acceleration.z,linear_acceleration.y,linear_acceleration.x',
    'stamp=s,linear_acceleration=g',
    'read as a log of Murata MEMS Demo: time in s, acceleration z, y, x in g (its angles fit '
    'them); name the columns with --columns if it is something else',
)
