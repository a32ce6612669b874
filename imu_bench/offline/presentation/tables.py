# SPDX-License-Identifier: Apache-2.0
"""What a table is, and its cells as people read them: pages and the terminal show every table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import NamedTuple

from imu_bench.counting import common_power
from imu_bench.errors import DataError
from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.notation import bare, number, short, text, unit_of, value_text


class Shown(NamedTuple):
    """A cell as people read it."""

    text: str
    note: str = ''  # why there is no value
    small: tuple[str, ...] = ()  # what stands below in small print, where there is room
    kind: str = ''  # by which it is coloured, such as 'axis-x', 'badge severe' or 'verdict-worse'


Cell = Estimate | Shown | str | float | int | None
"""A measured number, words, a setting or count that nobody measured, or nothing."""


@dataclass(frozen=True)
class Column:
    """Head of a column."""

    title: str
    # unit in which its estimates are shown, and of its plain numbers; the estimates' own if empty
    unit: str = ''
    si: bool = False  # whether the number in SI stands below


@dataclass(frozen=True)
class Table:
    """One table, whoever shows it."""

    title: str
    columns: tuple[Column, ...]  # the first `heads` name the row
    rows: tuple[tuple[Cell, ...], ...]  # each as long as `columns`
    note: str = ''  # what to know when reading it: definitions, signs, where its form comes from
    heads: int = 1  # with two, the first names a group of rows and is not repeated below

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise DataError(
                    f'table {self.title!r}: a row of {len(row)} cells, not {len(self.columns)}'
                )
            for cell in row:
                if isinstance(cell, float) and not math.isfinite(cell):
                    raise DataError(f'table {self.title!r} cannot hold {cell}')


def cells(table: Table) -> list[list[Shown]]:
    """
    Return the rows of a table, every number in the unit and with the power of ten of its column.

    Raises
    ------
    UnitError
        If an estimate measures something else than its column.

    Examples
    --------
    >>> angle = Estimate(0.01, 0.009, 0.011, 'rad')
    >>> one = Table('Angles', (Column('step'), Column('angle', '°')), ((1, angle), (2.5, None)))
    >>> [[cell.text for cell in row] for row in cells(one)]
    [['1', '0.573 ± 0.057'], ['2.5', '–']]
    """
    shown = [_column(column, [row[at] for row in table.rows])
             for at, column in enumerate(table.columns)]  # fmt: skip
    return [list(row) for row in zip(*shown, strict=True)]


def _column(column: Column, given: Sequence[Cell]) -> list[Shown]:
    powers = _power(given, column.unit), _power(given, '') if column.si else None
    return [_cell(cell, column, *powers) for cell in given]


def _power(column: Sequence[Cell], unit: str) -> int | None:
    """Return the power of ten of a column, None where its numbers need none or share no unit."""
    numbers = [cell.to(unit or cell.unit) if isinstance(cell, Estimate) else cell
               for cell in column if isinstance(cell, Estimate | float)]  # fmt: skip
    units = {cell.unit for cell in numbers if isinstance(cell, Estimate)}
    said = (value_text(cell) if isinstance(cell, Estimate) else bare(cell) for cell in numbers)
    if len(units) > 1 or not any('×' in words for words in said):
        return None
    return common_power(size for cell in numbers for size in _sizes(cell))


def _sizes(cell: Estimate | float) -> list[float]:
    """Return the numbers that a cell shows."""
    if not isinstance(cell, Estimate):
        return [cell]
    ends = (cell.high,) if cell.value is None else (cell.value, cell.low, cell.high)
    return [end for end in ends if end is not None and math.isfinite(end)]


def words(table: Table) -> list[bool]:
    """Return for every column whether it holds words, which are set from the left."""
    return [
        index < table.heads or all(_is_words(row[index]) for row in table.rows)
        for index in range(len(table.columns))
    ]


def _is_words(cell: Cell) -> bool:
    return bool(cell.kind) if isinstance(cell, Shown) else isinstance(cell, str | None)


def _cell(cell: Cell, column: Column, power: int | None, power_of_si: int | None) -> Shown:
    if isinstance(cell, Shown):
        return cell
    if cell is None:
        return Shown('–')
    if isinstance(cell, str):
        return Shown(cell)
    if isinstance(cell, Estimate):
        unit = column.unit or cell.unit
        said = value_text(cell.to(unit), power)
        own = '' if column.unit or unit == '1' or said == '–' else f' {unit}'
        below = column.si and unit != cell.unit and said != '–'
        small = (text(cell, power=power_of_si),) if below else ()
        return Shown(f'{said}{own}', cell.reason, small)
    return Shown(str(cell) if isinstance(cell, int) else bare(cell, power=power))


def columns_of(
    estimates: Sequence[tuple[str, str, Sequence[Estimate]]], *, si: bool = True
) -> tuple[Column, ...]:
    """Return columns of estimates, each in the unit datasheets use for numbers of their size."""
    return tuple(Column(title, unit_of(found, role), si) for title, role, found in estimates)


def side_by_side(estimates: Sequence[Estimate], unit: str, digits: int = 3) -> Shown:
    """Return the same number of all axes in one cell, with the widest of their intervals below."""
    halves = [
        0.5 * (e.high - e.low) / abs(e.value)
        for e in estimates
        if e.value and e.low is not None and e.high is not None
    ]
    widest = (f'± {number(100.0 * max(halves), 2)} %',) if any(halves) else ()
    return Shown(' / '.join(short(e.to(unit), digits) for e in estimates), small=widest)
