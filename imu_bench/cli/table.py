# SPDX-License-Identifier: Apache-2.0
"""The terminal's view of an analysis: findings first, then one table per quantity."""

from __future__ import annotations

from collections.abc import Sequence
import shutil
import sys

from imu_bench.cli.words import clean
from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.axis_result import AxisResult
from imu_bench.offline.comparison import Comparison
from imu_bench.offline.health import Finding
from imu_bench.offline.notation import (
    count,
    duration,
    rate_text,
    readable_unit,
    short,
    text,
    value_text,
)
from imu_bench.offline.results import Analysis, RecordingResult
from imu_bench.samples import IMU_QUANTITIES
from rich import box
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

PIPE_WIDTH = 200
"""Columns where the output is not a terminal: nobody wraps lines of a file."""

_UNLIMITED = 10_000
_COLOURS = {'info': 'dim', 'warning': 'yellow', 'severe': 'bold red'}
_TITLES = {'linear_acceleration': 'Acceleration', 'angular_velocity': 'Angular velocity'}


class _Column:
    """One measured number of every axis: title, role of the unit, and where it is found."""

    def __init__(self, title: str, role: str, estimates: Sequence[Estimate], si: bool) -> None:
        sizes = [e.value if e.value is not None else e.high for e in estimates]
        unit = estimates[0].unit
        self.unit = unit if si else readable_unit(unit, role, sizes)
        self.title = title
        self.estimates = [estimate.to(self.unit) for estimate in estimates]


def console(width: int | None = None) -> Console:
    """Return the console for results: wide and plain in a pipe, as wide as the terminal else."""
    if width is None:
        width = shutil.get_terminal_size().columns if sys.stdout.isatty() else PIPE_WIDTH
    return Console(width=width, highlight=False, soft_wrap=False)


def show(
    analysis: Analysis, comparison: Comparison, out: Console | None = None, *, si: bool = False
) -> None:
    """Print findings and tables of an analysis."""
    out = out or console()
    for recording, label in zip(analysis.recordings, comparison.labels, strict=True):
        _findings(recording, label, out)
    for quantity in IMU_QUANTITIES:
        rows = [
            (label, recording.rate_of(axis.quantity), axis)
            for recording, label in zip(analysis.recordings, comparison.labels, strict=True)
            for axis in recording.of(quantity.name)
        ]
        if rows:
            out.print()
            _quantity(_TITLES[quantity.name], rows, out, si)


def _findings(recording: RecordingResult, label: str, out: Console) -> None:
    health = recording.health
    size = f'{duration(health.duration_s)}, {count(health.samples, "sample")}'
    head = Text.assemble((clean(label), 'bold'), f'  {size}, {rate_text(health.rate)}')
    out.print()
    out.print(head)
    out.print(Text(f'{clean(recording.source)}  {clean(recording.topic)}', style='dim'))
    if not health.findings:
        out.print(Text('  nothing found that casts doubt on the numbers', style='dim'))
    for found in health.findings:
        out.print(Padding(finding(found), (0, 0, 0, 2)))


def finding(found: Finding) -> Text:
    """Return one finding as a line: how bad, what, what it does, what to do."""
    line = Text(found.severity, style=_COLOURS[found.severity])
    line.append(f' {clean(found.text)} {found.effect} ', style='not bold default')
    line.append(found.action, style='not bold italic default')
    return line


def _quantity(
    title: str, rows: Sequence[tuple[str, Estimate, AxisResult]], out: Console, si: bool
) -> None:
    axes = [axis for _, _, axis in rows]
    columns = [
        _Column('mean', 'level', [axis.statistics['mean'] for axis in axes], si),
        _Column('σ, RMS', 'level', [axis.statistics['std'] for axis in axes], si),
        _Column('noise density', 'density', [axis.white_density for axis in axes], si),
        *(_Column(t, t, [axis.coefficient(t) for axis in axes], si) for t in 'NBK'),
    ]
    for with_interval, with_rate in ((True, True), (False, True), (False, False)):
        table = _table(title, rows, columns, with_interval=with_interval, with_rate=with_rate)
        if fits(table, out):
            out.print(table)
            return
    _stacked(title, rows, columns, out)


def fits(table: Table, out: Console) -> bool:
    """Return whether a table has room without wrapping."""
    unlimited = out.options.update(width=_UNLIMITED, max_width=_UNLIMITED)
    return out.measure(table, options=unlimited).maximum <= out.width


def _table(
    title: str,
    rows: Sequence[tuple[str, Estimate, AxisResult]],
    columns: Sequence[_Column],
    *,
    with_interval: bool,
    with_rate: bool,
) -> Table:
    table = Table(
        title=Text(title, style='bold'), title_justify='left', box=box.SIMPLE_HEAD,
        pad_edge=False, padding=(0, 1),
    )  # fmt: skip
    table.add_column('sensor')
    table.add_column('axis')
    if with_rate:
        table.add_column('rate\nHz', justify='right', no_wrap=True)
    for column in columns:
        title = column.title if with_interval else column.title.replace(' ', '\n')
        table.add_column(Text(f'{title}\n{column.unit}'), justify='right', no_wrap=True)
    last = ''
    for index, (label, rate, axis) in enumerate(rows):
        first = label != last
        last = label
        table.add_row(
            Text(clean(label) if first else ''),
            axis.letter,
            *([short(rate, 5) if first else ''] if with_rate else []),
            *(
                value_text(column.estimates[index])
                if with_interval
                else short(column.estimates[index])
                for column in columns
            ),
        )
    return table


def _stacked(
    title: str,
    rows: Sequence[tuple[str, Estimate, AxisResult]],
    columns: Sequence[_Column],
    out: Console,
) -> None:
    """Print one number per line, for terminals too narrow for a table."""
    out.print(Text(title, style='bold'))
    for index, (label, _, axis) in enumerate(rows):
        out.print(Text(f'{clean(label)} {axis.letter}'))
        for column in columns:
            out.print(Text(f'  {column.title:<14}{text(column.estimates[index])}'))
