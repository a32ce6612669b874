# SPDX-License-Identifier: Apache-2.0
"""The terminal's view of a test plan: the answer, what casts doubt on it, the tables."""

from __future__ import annotations

from imu_bench.cli.table import console, fits
from imu_bench.cli.table import finding as finding_line
from imu_bench.cli.words import clean
from imu_bench.offline.plans import shown
from imu_bench.offline.plans.result import PlanResult, Table
from rich import box, table
from rich.console import Console
from rich.padding import Padding
from rich.text import Text


def show(result: PlanResult, out: Console | None = None) -> None:
    """Print the summary, the findings and the tables of a plan."""
    out = out or console()
    out.print()
    out.print(Text(clean(result.title), style='bold'))
    for sentence in result.summary:
        out.print(Padding(Text(clean(sentence)), (0, 0, 0, 2)))
    for found in result.findings:
        out.print(Padding(finding_line(found), (0, 0, 0, 2)))
    for one in result.tables:
        out.print()
        _table(one, out)


def _table(one: Table, out: Console) -> None:
    cells = shown.cells(one)
    made = table.Table(
        title=Text(clean(one.title), style='bold'), title_justify='left', box=box.SIMPLE_HEAD,
        pad_edge=False, padding=(0, 1),
    )  # fmt: skip
    for column, words in zip(one.columns, shown.words(one), strict=True):
        head = clean(column.title) + (f'\n{column.unit}' if column.unit else '')
        made.add_column(Text(head), justify='left' if words else 'right', no_wrap=True)
    for row in cells:
        made.add_row(*(Text(clean(cell.text)) for cell in row))
    if fits(made, out):
        out.print(made)
    else:
        _stacked(one, out)
    if one.note:
        out.print(Padding(Text(clean(one.note), style='dim'), (0, 0, 0, 2)))


def _stacked(one: Table, out: Console) -> None:
    """Print one cell per line, for terminals too narrow for a table."""
    out.print(Text(clean(one.title), style='bold'))
    width = max(len(column.title) for column in one.columns) + 2
    for row in shown.cells(one):
        out.print(Text(clean(row[0].text)))
        for column, cell in zip(one.columns[1:], row[1:], strict=True):
            unit = f' {column.unit}' if column.unit and cell.text not in ('', '–') else ''
            out.print(Text(clean(f'  {column.title:<{width}}{cell.text}{unit}')))
