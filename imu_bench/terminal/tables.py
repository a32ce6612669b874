# SPDX-License-Identifier: Apache-2.0
"""The terminal's view of results: what casts doubt on them, and their tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
import json
import os
from pathlib import Path
import sys
from typing import TYPE_CHECKING

from imu_bench.counting import clean
from imu_bench.offline.analysis.results import Analysis, RecordingResult
from imu_bench.offline.comparing.sensors import Comparison
from imu_bench.offline.health import Finding, ranked, SEVERITIES
from imu_bench.offline.notation import count, duration, rate_text
from imu_bench.offline.plans.result import PlanResult
from imu_bench.offline.presentation.axis_tables import (
    LEVELS,
    MOVED,
    MOVED_NOTE,
    overview,
    SLOW,
    WHITE,
)
from imu_bench.offline.presentation.sentences import of_all, OF_OTHERS, of_simulation
from imu_bench.offline.presentation.tables import cells, Table, words
from imu_bench.offline.presentation.uses import filter_numbers
from imu_bench.recording.fault_news import RECOVERED, telling
from msg_conversions.quantities import IMU_QUANTITIES
from rich import box
from rich.console import Console
from rich.padding import Padding
import rich.table
from rich.text import Text

if TYPE_CHECKING:
    from imu_bench.live.views import SensorView

FILE_WIDTH = 200
"""Columns where nobody looks: no terminal at all, and nobody wraps lines of a file."""

_MOST_TOLD = 3
"""Sensors of which the same finding is told with its numbers."""

_FEW_ROWS = 12
"""Rows of a table of a plan that are shown without being asked for all of them."""

_UNLIMITED = 10_000

COLOURS = {
    'info': 'dim', 'warning': 'yellow', 'severe': 'bold red',
    'verdict-higher': 'yellow', 'verdict-lower': 'yellow', 'verdict-undecided': 'dim',
}  # fmt: skip
"""By the severity of a finding, and by the kind of a cell."""


def console(width: int | None = None) -> Console:
    """Return the console for results: as wide as the terminal, also that of a pager behind us."""
    return Console(width=width or _width(), highlight=False, soft_wrap=False)


def _width() -> int:
    """Return COLUMNS, else the width of the terminal that any of our streams goes to."""
    asked = os.environ.get('COLUMNS', '')
    if asked.isdigit() and int(asked) > 0:
        return int(asked)
    for stream in (sys.__stdout__, sys.__stderr__, sys.__stdin__):
        with suppress(OSError, ValueError, AttributeError):  # a pipe, a file, closed, or none
            if found := os.get_terminal_size(stream.fileno()).columns:  # type: ignore[union-attr]
                return found
    return FILE_WIDTH


def show(
    analysis: Analysis,
    comparison: Comparison,
    out: Console | None = None,
    *,
    si: bool = False,
    full: bool = False,
) -> None:
    """
    Print tables, findings and, last, where a reader looks first, the summary of an analysis.

    Parameters
    ----------
    full : bool
        With every finding of every recording; otherwise what several share is said once, and
        what casts no doubt on the numbers is left out.
    """
    out = out or console()
    banner = of_simulation([recording.simulated for recording in analysis.sensors])
    for sentence in banner:
        out.print(Text(sentence, style='bold black on yellow'))
    labelled = dict(zip(comparison.labels, analysis.recordings, strict=True))
    number = len(analysis.sensors)
    recordings = dict(list(labelled.items())[:number])
    _show(recordings, out, si=si, full=full)
    for one in filter_numbers(recordings)[:1]:
        out.print()
        _narrowed(out, one)
    if not full:
        _shared_findings(recordings, out)
    out.print()
    for sentence in of_all(analysis, comparison, si=si)[len(banner) :]:
        out.print(Text(clean(sentence)))
    if others := dict(list(labelled.items())[number:]):
        out.print()
        out.print(Text(OF_OTHERS, style='bold'))
        _show(others, out, si=si, full=True)


def _show(
    recordings: Mapping[str, RecordingResult], out: Console, *, si: bool, full: bool
) -> None:
    """Print headings and tables of some recordings."""
    moved = {label for label, recording in recordings.items() if recording.health.moved}
    for label, recording in recordings.items():
        _heading(recording, label, out, full=full)
    for quantity in IMU_QUANTITIES:
        rows = [
            (
                f'{label} {MOVED}' if label in moved else label,
                recording.rate_of(axis.quantity),
                axis,
            )
            for label, recording in recordings.items()
            for axis in recording.of(quantity.name)
        ]
        if rows:
            out.print()
            _overview(out, partial(overview, quantity.title, rows, si=si))
    if moved:
        out.print(Text(f'{MOVED} {MOVED_NOTE}', style='yellow'))


def _overview(out: Console, one: Callable[..., Table]) -> None:
    """Print as many columns as have room, the others in tables of their own below."""
    halves = [one(shown=(*LEVELS, WHITE[0]), rate=False), one(shown=(WHITE[1], *SLOW), rate=False)]
    if put(out, one(), one(rate=False)):
        return
    if all(map(partial(_fits, out), halves)):
        for half in halves:
            put(out, half)
    else:
        stack(out, one(rate=False))


def _heading(recording: RecordingResult, label: str, out: Console, *, full: bool) -> None:
    health = recording.health
    size = f'{duration(health.duration_s)}, {count(health.samples, "sample")}'
    head = Text.assemble((clean(label), 'bold'), f'  {size}, {rate_text(health.rate)}')
    made = '  SIMULATED' if recording.simulated else ''
    if not full:
        out.print(head.append(made, style='bold black on yellow'))
        return
    out.print()
    out.print(head.append(made, style='bold black on yellow'))
    out.print(Text(f'{clean(recording.source)}  {clean(recording.topic)}', style='dim'))
    if not health.findings:
        out.print(Text('  nothing found that casts doubt on the numbers', style='dim'))
    for found in health.findings:
        out.print(Padding(finding(found), (0, 0, 0, 2)))


def _shared_findings(recordings: Mapping[str, RecordingResult], out: Console) -> None:
    """Print every kind of finding once, with what was found where."""
    kinds: dict[tuple[str, str], list[tuple[str, Finding]]] = {}
    notes = 0
    for label, recording in recordings.items():
        for found in recording.health.findings:
            if found.severity == 'info':
                notes += 1
            else:
                kinds.setdefault((found.severity, found.code), []).append((label, found))
    out.print()
    ranked = sorted(kinds.items(), key=lambda item: -SEVERITIES.index(item[0][0]))
    for (severity, _), several in ranked:
        line = Text(severity, style=COLOURS[severity])
        told = [f'{label}: {f.text}' if len(recordings) > 1 else f.text for label, f in several]
        if likewise := [label for label, _ in several[_MOST_TOLD:]]:
            told[_MOST_TOLD:] = [f'Likewise {", ".join(likewise)}.']
        said = ' '.join(told)
        effects = ' '.join(dict.fromkeys(found.effect for _, found in several))
        actions = ' '.join(dict.fromkeys(found.action for _, found in several))
        line.append(f' {clean(said)} {clean(effects)} ', style='not bold default')
        out.print(line.append(clean(actions), style='not bold italic default'))
    if notes:
        out.print(
            Text(f'{count(notes, "note")} without effect on the numbers: --full', style='dim')
        )


def finding(found: Finding) -> Text:
    """Return one finding as a line: how bad, what, what it does, what to do."""
    line = Text(found.severity, style=COLOURS[found.severity])
    line.append(f' {clean(found.text)} {found.effect} ', style='not bold default')
    line.append(found.action, style='not bold italic default')
    return line


def show_plan(result: PlanResult, out: Console | None = None, *, full: bool = False) -> None:
    """Print the tables and, last, the findings and the summary of a test plan."""
    out = out or console()
    out.print(Text(clean(result.title), style='bold'))
    for one in result.tables:
        out.print()
        if full:
            if not put(out, one):
                stack(out, one)
        else:
            # that one row is left out takes a row to say
            shown = len(one.rows) if len(one.rows) == _FEW_ROWS + 1 else _FEW_ROWS
            _narrowed(out, replace(one, rows=one.rows[:shown]))
            if (more := len(one.rows) - shown) > 0:
                out.print(Text(f'  and {count(more, "row")} more: --full', style='dim'))
        if one.note and full:
            out.print(Padding(Text(clean(one.note), style='dim'), (0, 0, 0, 2)))
    out.print()
    for found in ranked(result.findings):
        out.print(finding(found))
    for sentence in result.summary:
        out.print(Text(clean(sentence)))


def _narrowed(out: Console, one: Table) -> None:
    """Print as many of the columns as have room, and say how many have none."""
    for last in range(len(one.columns), one.heads, -1):
        rows = tuple(row[:last] for row in one.rows)
        if put(out, Table(one.title, one.columns[:last], rows, heads=one.heads)):
            if left := len(one.columns) - last:
                out.print(Text(f'  {count(left, "column")} without room: --full', style='dim'))
            return
    stack(out, one)


def _fits(out: Console, one: Table) -> bool:
    """Return whether the terminal is as wide as a table."""
    unlimited = out.options.update(width=_UNLIMITED, max_width=_UNLIMITED)
    return out.measure(_drawn(one), options=unlimited).maximum <= out.width


def put(out: Console, *tables: Table) -> bool:
    """Print the first of several forms of a table that has room; return whether one had."""
    for one in tables:
        if _fits(out, one):
            out.print(_drawn(one))
            return True
    return False


def _drawn(one: Table) -> rich.table.Table:
    drawn = rich.table.Table(
        title=Text(clean(one.title), style='bold'), title_justify='left', box=box.SIMPLE_HEAD,
        pad_edge=False, padding=(0, 1),
    )  # fmt: skip
    for column, left in zip(one.columns, words(one), strict=True):
        lines = [clean(line) for line in column.title.split('\n')]
        head = Text('\n'.join([*lines, column.unit] if column.unit else lines))
        drawn.add_column(head, justify='left' if left else 'right', no_wrap=True)
    group = ''
    for row in cells(one):
        shown = [Text(clean(cell.text), style=COLOURS.get(cell.kind, '')) for cell in row]
        if one.heads > 1 and row[0].text == group:
            shown[0] = Text()
        drawn.add_row(*shown)
        group = row[0].text
    return drawn


def stack(out: Console, one: Table) -> None:
    """Print a table one cell per line, for terminals too narrow for it."""
    out.print(Text(clean(one.title), style='bold'))
    titles = one.columns[one.heads :]
    width = max((len(column.title) for column in titles), default=0) + 1
    for row in cells(one):
        out.print(Text(clean(' '.join(cell.text for cell in row[: one.heads]))))
        for column, cell in zip(titles, row[one.heads :], strict=True):
            unit = f' {column.unit}' if column.unit and cell.text not in ('', '–') else ''
            out.print(Text(clean(f'  {column.title:<{width}}{cell.text}{unit}')))


def show_faults(sensors: Mapping[str, SensorView]) -> int:
    """Print what came of every fault; return 1 if one was not played or not recovered from."""
    faults = [
        (sensor, fault) for sensor, view in sensors.items() for fault in view.faults.values()
    ]
    table = rich.table.Table(
        title='Faults', title_justify='left', box=box.SIMPLE_HEAD, pad_edge=False,
        show_edge=False,
    )  # fmt: skip
    for name in ('sensor', 'fault', 'at s', 'for s', 'named', 'counted', 'lost', 'back after s'):
        right = name in ('at s', 'for s', 'lost', 'back after s')
        table.add_column(name, justify='right' if right else 'left', no_wrap=name != 'counted')
    for sensor, fault in faults:
        shown = (
            sensor, fault['kind'], fault['at_s'],
            fault['for_s'] if fault['for_s'] != '0' else 'once',
            fault['errors'] or '-', telling(fault['counted']) or '-', fault['lost'],
            f'{float(fault["recovery_s"]):.2f}' if fault['recovery_s'] else fault['state'],
        )  # fmt: skip
        table.add_row(*(Text(clean(cell)) for cell in shown))
    Console(width=None if Console().is_terminal else 120).print(table)
    return _summary(faults)


def _summary(faults: list[tuple[str, dict[str, str]]]) -> int:
    failed = [(sensor, fault) for sensor, fault in faults if fault['state'] != RECOVERED]
    lost = count(sum(int(fault['lost']) for _, fault in faults), 'sample')
    print()
    for sensor, fault in failed:
        why = {
            'planned': 'was not played; give a longer --duration',
            'active': 'was not over; give a longer --duration',
        }.get(fault['state'], f'has NOT recovered: {fault["error"] or "no data"}')
        print(clean(f'{sensor}: {fault["kind"]} at {fault["at_s"]} s {why}'))
    if not faults:
        print('no fault was reported: does a sensor of this bench have simulation.faults?')
        return 1
    recovered = len(faults) - len(failed)
    print(f'{recovered} of {len(faults)} faults recovered from, {lost} lost and counted')
    return int(bool(failed))


def show_gaps(results: Path, sensors: Mapping[str, SensorView]) -> None:
    """Print, sensor by sensor, what the recording misses beside what was counted as lost."""
    document = json.loads(results.read_text(encoding='utf-8'))
    for recording in document['recordings']:
        sensor = recording['topic'].split('/')[2]
        if sensor not in sensors or not sensors[sensor].faults:
            continue
        view = sensors[sensor]
        otherwise = max(0, view.tally['lost'] - view.lost_by_faults)
        also = f' and {otherwise} otherwise' if otherwise else ''
        missing = int(recording['health']['missing'])
        print(
            f'{sensor}: {view.lost_by_faults} lost by faults{also}; '
            f'{missing} missing in the recording'
        )
