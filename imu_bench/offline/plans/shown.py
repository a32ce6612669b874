# SPDX-License-Identifier: Apache-2.0
"""Cells of a plan's tables as people read them, the same in the terminal and on a page."""

from __future__ import annotations

from typing import NamedTuple

from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.notation import bare, value_text
from imu_bench.offline.plans.result import Cell, Column, Table


class Shown(NamedTuple):
    """
    One cell.

    Attributes
    ----------
    text : str
    note : str
        Why there is no value.
    """

    text: str
    note: str = ''


def cells(table: Table) -> list[list[Shown]]:
    """
    Return the rows of a table, every number in the unit of its column.

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
    return [
        [_cell(cell, column) for cell, column in zip(row, table.columns, strict=True)]
        for row in table.rows
    ]


def words(table: Table) -> list[bool]:
    """Return for every column whether it holds words, which are set from the left."""
    return [
        index == 0 or all(isinstance(row[index], str | None) for row in table.rows)
        for index in range(len(table.columns))
    ]


def _cell(cell: Cell, column: Column) -> Shown:
    if cell is None:
        return Shown('–')
    if isinstance(cell, str):
        return Shown(cell)
    if isinstance(cell, Estimate):
        unit = column.unit or cell.unit
        text = value_text(cell.to(unit))
        own = '' if column.unit or unit == '1' or text == '–' else f' {unit}'
        return Shown(f'{text}{own}', cell.reason)
    if isinstance(cell, int):
        return Shown(str(cell))
    return Shown(bare(cell))
