# SPDX-License-Identifier: Apache-2.0
"""The cells of a text table as numbers, a block of lines at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import io
import os
from pathlib import Path
import re

from imu_bench.errors import RecordingError
from imu_bench.offline.recordings import spelling
from imu_bench.offline.recordings.layout import is_number, Layout, split
import numpy as np
import numpy.typing as npt

BLOCK = 1 << 23
_STAMP_WIDTH = 40
_MAX_NS = 9.2e18


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of a table."""

    values: npt.NDArray[np.float64]  # wanted columns; an empty cell is NaN
    stamps: npt.NDArray[np.bytes_] | None  # cells of the time column as written
    # which of the samples each row was: damaged rows count, blank lines and remarks do not
    places: npt.NDArray[np.int64]
    lines: int  # number of samples, those of damaged rows counted
    bad: tuple[int, ...]  # numbers, within the table, of lines that are no rows


def blocks(path: Path, start: int) -> Iterator[bytes]:
    """Yield the lines of a file from a byte on, about 8 MiB at a time, each with its end."""
    with path.open('rb') as file:
        file.seek(start)
        rest = b''
        while data := file.read(BLOCK):
            data = rest + data
            cut = data.rfind(b'\n') + 1
            rest = data[cut:]
            if cut:
                yield data[:cut]
            elif len(rest) > 4 * BLOCK:
                raise RecordingError(f'{path}: a line is longer than {len(rest) >> 20} MiB')
        if rest.strip():
            yield rest + b'\n'


def ends_with_line(path: Path) -> bool:
    """Return whether the last line of a file has a line end, as those before it have."""
    with path.open('rb') as file:
        file.seek(-min(1, path.stat().st_size), os.SEEK_END)
        return file.read() in (b'\n', b'\r', b'')


def parse(
    block: bytes, layout: Layout, wanted: Sequence[int], stamp: int | None, first_line: int = 0
) -> Rows:
    """Return the wanted columns of some lines."""
    lines = spelling.plain(block, layout.spelled).replace(b'\r\n', b'\n')
    if layout.decimal_comma:
        lines = lines.replace(b',', b'.')
    if _regular(lines, layout):
        try:
            return _fast(lines, layout, wanted, stamp)
        except (ValueError, UnicodeDecodeError):
            pass  # some line is no row: find out which, one by one
    return _slow(lines, layout, wanted, stamp, first_line)


def nanoseconds(cells: npt.NDArray[np.bytes_], digits: int) -> npt.NDArray[np.int64]:
    """Return decimal numbers times a power of ten, exact to the last digit."""
    try:
        rough = cells.astype(np.float64) * 10.0**digits
    except ValueError as problem:
        raise RecordingError(f'a time stamp is not a number: {problem}') from problem
    if not (np.isfinite(rough) & (np.abs(rough) < _MAX_NS)).all():
        raise RecordingError('a time stamp is not finite or does not fit 64 bits of nanoseconds')
    characters = np.frombuffer(cells.tobytes(), np.uint8).reshape(-1, cells.dtype.itemsize)
    digit = (characters >= ord('0')) & (characters <= ord('9'))
    dot = characters == ord('.')
    minus = np.zeros_like(digit)
    minus[:, 0] = characters[:, 0] == ord('-')
    plain = (digit | dot | minus | (characters == 0)).all(axis=1)
    total = np.zeros(cells.size, np.int64)
    carry = np.zeros(cells.size, bool)
    after = np.full(cells.size, -1)
    for column in range(characters.shape[1]):
        after += (after >= 0) & digit[:, column]
        used = digit[:, column] & (after <= digits)
        value = characters[:, column].astype(np.int64) - ord('0')
        total = np.where(used, total * 10 + value, total)
        carry |= digit[:, column] & (after == digits + 1) & (value >= 5)
        after[dot[:, column]] = 0
    exact = total * 10 ** (digits - np.clip(after, 0, digits)) + carry
    exact = np.where(minus[:, 0], -exact, exact)
    # an exponent, say
    return np.asarray(np.where(plain, exact, np.rint(rough).astype(np.int64)), np.int64)


def _regular(lines: bytes, layout: Layout) -> bool:
    """Return whether the lines look like rows and nothing else."""
    if b'"' in lines or b'\n\n' in lines or lines.startswith(b'\n'):
        return False
    # the reader of numbers looks at the wanted columns only, whatever else a line has or lacks
    characters = np.frombuffer(lines, np.uint8)
    ends = np.flatnonzero(characters == ord('\n'))
    if layout.delimiter == ' ':
        gap = (characters == ord(' ')) | (characters == ord('\t'))
        gap[ends] = True
        marks = ~gap
        marks[1:] &= gap[:-1]  # where a cell begins
        wanted = layout.width
    else:
        marks = characters == ord(layout.delimiter)
        wanted = layout.width - 1
    in_line = np.add.reduceat(marks, np.append(0, ends[:-1] + 1), dtype=np.int64)
    return bool((in_line == wanted).all())


def _fast(lines: bytes, layout: Layout, wanted: Sequence[int], stamp: int | None) -> Rows:
    delimiter = None if layout.delimiter == ' ' else layout.delimiter
    if delimiter is not None:
        lines = _filled(lines, delimiter.encode())
    kind: list[tuple[object, ...]] = [('values', np.float64, (len(wanted),))]
    columns = list(wanted)
    if stamp is not None:
        kind.insert(0, ('stamps', f'S{_STAMP_WIDTH}'))
        columns.insert(0, stamp)
    table = np.loadtxt(
        io.BytesIO(lines),
        dtype=np.dtype(kind),
        delimiter=delimiter,
        comments=None,
        usecols=columns,
        ndmin=1,
        encoding='latin-1',
    )
    stamps = None
    if stamp is not None:
        stamps = np.char.strip(table['stamps'])
        if (np.char.str_len(stamps) == 0).any() or (stamps == b'nan').any():
            raise ValueError('a row without a time stamp')
    size = table.size
    return Rows(np.ascontiguousarray(table['values']), stamps, np.arange(size), size, ())


def _filled(lines: bytes, delimiter: bytes) -> bytes:
    """Return lines with NaN written into their empty cells."""
    gaps = (delimiter * 2, delimiter + b'\n', b'\n' + delimiter)
    if not lines.startswith(delimiter) and not any(gap in lines for gap in gaps):
        return lines
    mark = re.escape(delimiter)
    filled = re.sub(
        rb'(?:(?<=' + mark + rb')|^)(?=' + mark + rb'|$)', b'nan', lines, flags=re.MULTILINE
    )
    return filled.removesuffix(b'nan')  # after the last end of line


def _slow(
    lines: bytes, layout: Layout, wanted: Sequence[int], stamp: int | None, first_line: int
) -> Rows:
    values, stamps, places, bad = [], [], [], []
    count = 0
    for number, line in enumerate(lines.decode('utf-8', 'replace').split('\n')[:-1]):
        fields = split(line, layout.delimiter)
        if not any(fields):
            continue
        count += 1
        numbers = [fields[index] for index in wanted] if len(fields) == layout.width else []
        fits = bool(numbers) and all(not cell or is_number(cell) for cell in numbers)
        if not fits or (stamp is not None and not is_number(fields[stamp])):
            bad.append(first_line + number)
            # a damaged row was a sample; a date or a remark between rows was none
            count -= len(fields) != layout.width and not all(map(is_number, filter(None, fields)))
            continue
        values.append([float(cell) if cell else np.nan for cell in numbers])
        places.append(count - 1)
        if stamp is not None:
            stamps.append(fields[stamp].encode())
    return Rows(
        np.array(values, np.float64).reshape(-1, len(wanted)),
        None if stamp is None else np.array(stamps, f'S{_STAMP_WIDTH}'),
        np.array(places, np.int64),
        count,
        tuple(bad),
    )
