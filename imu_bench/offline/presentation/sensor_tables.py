# SPDX-License-Identifier: Apache-2.0
"""Tables of several sensors: ranked, what their noise comes to, and against datasheets."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import partial
import math

from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.analysis.axis_result import AxisResult
from imu_bench.offline.analysis.results import RecordingResult
from imu_bench.offline.comparing.sensors import Comparison, Verdict
from imu_bench.offline.notation import (
    number,
    percent,
    readable_unit,
    short,
    unit_of,
    value_text,
)
from imu_bench.offline.presentation.axis_tables import health_of
from imu_bench.offline.presentation.tables import Cell, Column, Shown, side_by_side, Table
from imu_bench.offline.presentation.uses import error_after, TIMES_S, worst
from msg_conversions.quantities import ANGULAR_VELOCITY, BY_NAME, LINEAR_ACCELERATION

_KINDS = ((ANGULAR_VELOCITY, 'Angle', 'rad'), (LINEAR_ACCELERATION, 'Speed', 'm/s'))
_ORDER = ('worse', 'better', 'as specified', 'not observable')

_ERRORS_NOTE = (
    'One standard deviation of the noise on the worst axis at rest, if the bias is the mean of a '
    'rest just as long right before: √2 τ σ(τ) of the Allan deviation, whatever the kind of '
    'noise. Errors of scale, alignment and temperature come on top. A speed needs the tilt '
    'besides: an angle that is off by 0.1° adds 17 mm/s every second, soon more than the noise '
    'does.'
)


def rankings(
    recordings: Sequence[RecordingResult], compared: Comparison, confidence: float
) -> list[Table]:
    """Return a comparison table for each quantity, the quietest sensor first."""
    tables = [_ranking(name, recordings, compared) for name in compared.standings]
    return _with_note(
        tables,
        f'The quietest first. ±: the widest {percent(confidence)} interval among the axes; “<” is '
        'an upper bound, where the recording cannot show the term.',
    )


def _ranking(quantity: str, recordings: Sequence[RecordingResult], compared: Comparison) -> Table:
    standings = compared.standings[quantity]
    groups = [recordings[row.index].of(quantity) for row in standings]
    flat = [axis for group in groups for axis in group]
    slow = [axis for axis in flat if axis.shows_constants] or flat
    density = unit_of([axis.white_density for axis in flat], 'density')
    bias = unit_of([axis.model.B for axis in slow], 'B')
    walk = unit_of([axis.model.K for axis in slow], 'K')
    alone = len(standings) == 1
    ratio = Column(f'Ratio to {compared.reference or "the quietest"}', 'all axes')
    columns = (
        Column('Sensor'), Column('Rate', 'Hz'), Column('Noise density x / y / z', density),
        *(() if alone else (ratio,)),
        Column('Bias instability B', bias), Column('Rate random walk K', walk), Column('Health'),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for row, axes in zip(standings, groups, strict=True):
        to_best = '1' if row.ratio.low == row.ratio.high == 1.0 else value_text(row.ratio)
        rows.append(
            (
                row.label,
                Shown(short(recordings[row.index].rate_of(quantity), 4)),
                side_by_side([axis.white_density for axis in axes], density),
                *(() if alone else (Shown(to_best),)),
                _slow([axis.model.B for axis in axes], bias, axes),
                _slow([axis.model.K for axis in axes], walk, axes),
                health_of(recordings[row.index].health),
            )
        )
    return Table(f'{BY_NAME[quantity].sensor.capitalize()}s', columns, tuple(rows))


def _slow(estimates: Sequence[Estimate], unit: str, axes: Sequence[AxisResult]) -> Shown:
    """Return coefficients of slow noise; a high-pass has none, and its bounds would impress."""
    if any(axis.shows_constants for axis in axes):
        return side_by_side(estimates, unit, 2)
    return Shown('–', small=('no constant signal',))


def _with_note(tables: Sequence[Table], note: str) -> list[Table]:
    """Return tables with what is to be known of all of them below the last."""
    return [
        Table(table.title, table.columns, table.rows, note if table is tables[-1] else '')
        for table in tables
    ]


def errors(recordings: Sequence[RecordingResult], labels: Sequence[str]) -> list[Table]:
    """
    Return how far an angle and a speed are off after a time, the smallest after the longest first.

    A recording with a severe finding has none: its curve may be that of a motion.
    """
    tables = []
    for quantity, title, unit in _KINDS:
        found = {
            label: [
                worst(axes, partial(error_after, seconds=seconds, unit=unit))
                for seconds in TIMES_S.values()
            ]
            for recording, label in zip(recordings, labels, strict=True)
            if recording.health.severity != 'severe'
            and (axes := recording.of(quantity.name))
            and all(axis.shows_constants for axis in axes)
        }
        used = [i for i in range(len(TIMES_S)) if any(row[i] for row in found.values())]
        if used:
            sizes = [e.value for row in found.values() for e in row if e is not None]
            shown = '°' if unit == 'rad' else readable_unit(unit, 'Q', sizes)
            columns = (Column('Sensor'), *(Column(list(TIMES_S)[i], shown) for i in used))
            rows = tuple(
                (label, *(None if (e := row[i]) is None else side_by_side([e], shown, 2)
                          for i in used))
                for label, row in sorted(found.items(), key=lambda item: _rank(item[1]))
            )  # fmt: skip
            tables.append(Table(f'{title} without correction: error after', columns, rows))
    several = bool(tables) and len(tables[0].rows) > 1
    last = ' The smallest error after the longest time first.' if several else ''
    return _with_note(tables, _ERRORS_NOTE + last)


def _rank(row: Sequence[Estimate | None]) -> tuple[float, ...]:
    """Return the key by which the smallest error after the longest time that is known is first."""
    return tuple(math.inf if e is None else e.value or 0.0 for e in reversed(row))


PARAMETERS = {
    'noise density': 'density',
    'bias instability': 'B',
    'temperature coefficient': 'per kelvin',
}
"""What a datasheet gives, and its role for `notation.unit_of`."""


def against_datasheets(
    compared: Comparison, doubtful: Collection[str] = (), *, simulated: bool = False
) -> list[Table]:
    """
    Return the numbers against their typical values, a line for the axes of a quantity.

    Of doubtful sensors findings affect the numbers; simulated data judge the simulation.
    """
    groups = _groups(compared.verdicts)
    if not groups:
        return []
    axes = _letters(groups[0])
    columns = (
        Column('Sensor'), Column('Parameter'), Column('Verdict'), Column('Measured', axes),
        Column('Typical'), Column('Unit'), Column('Ratio'),
    )  # fmt: skip
    rows = tuple(_judged(group, axes, group[0].label in doubtful) for group in groups)
    sources: dict[str, list[str]] = {}
    for verdict in compared.verdicts:
        sources.setdefault(verdict.label, []).append(verdict.source)
    note = 'As specified: within a factor of 1.2 of the typical value, intervals considered.'
    if sources.keys() & set(doubtful):
        note += (
            ' * This sensor has findings that affect its numbers; they may say more of the '
            'recording than of the part.'
        )
    named = [f'{label}: {"; ".join(dict.fromkeys(said))}' for label, said in sources.items()]
    note += f' Typical values: {". ".join(named)}.'
    if unknown := [label for label in compared.labels if label not in sources]:
        note += f' None are known for {", ".join(unknown)}.'
    what = 'The simulation' if simulated else 'Measured'
    return [Table(f'{what} against the datasheet', columns, rows, note)]


def datasheet_sentence(verdicts: Sequence[Verdict]) -> list[str]:
    """Return one sentence, or none without a datasheet."""
    if not verdicts:
        return []
    worse = [
        f'{group[0].label} ({_name(group[0])}{_axes(group, "worse")})'
        for group in _groups(verdicts)
        if any(verdict.verdict == 'worse' for verdict in group)
    ]
    good = sum(verdict.verdict in ('as specified', 'better') for verdict in verdicts)
    said = f'{good} of {len(verdicts)} numbers are as the datasheets say, or better'
    said += f'; worse: {", ".join(worse)}' if worse else ''
    unseen = sum(verdict.verdict == 'not observable' for verdict in verdicts)
    said += f'; {unseen} could not be observed' if unseen else ''
    return [f'{said}.']


def _groups(verdicts: Sequence[Verdict]) -> list[list[Verdict]]:
    found: dict[tuple[str, str, str], list[Verdict]] = {}
    for verdict in verdicts:
        quantity = verdict.axis.rpartition('.')[0]
        found.setdefault((verdict.label, quantity, verdict.parameter), []).append(verdict)
    return list(found.values())


def _judged(group: Sequence[Verdict], usual: str, doubtful: bool) -> tuple[Cell, ...]:
    first, axes = group[0], _letters(group)
    role = PARAMETERS[first.parameter]
    unit = readable_unit(first.measured.unit, role, [verdict.typical for verdict in group])
    measured = side_by_side([verdict.measured for verdict in group], unit)
    kind = min((verdict.verdict for verdict in group), key=_ORDER.index).replace(' ', '-')
    there = [kind for kind in _ORDER if any(verdict.verdict == kind for verdict in group)]
    said = (
        there[0] if len(there) == 1 else '; '.join(f'{kind}{_axes(group, kind)}' for kind in there)
    )
    return (
        first.label,
        _name(first),
        Shown(f'{said} *' if doubtful else said, kind=f'verdict-{kind}'),
        measured if axes == usual else measured._replace(small=(*measured.small, axes)),
        Shown(' / '.join(dict.fromkeys(_typical(verdict, unit) for verdict in group))),
        Shown(unit),
        Shown(' / '.join(_ratio(verdict) for verdict in group)),
    )


def _name(verdict: Verdict) -> str:
    return f'{BY_NAME[verdict.axis.rpartition(".")[0]].title.lower()}, {verdict.parameter}'


def _typical(verdict: Verdict, unit: str) -> str:
    given = Estimate(verdict.typical, None, None, verdict.measured.unit)
    return number(given.to(unit).value or 0.0, 3)


def _ratio(verdict: Verdict) -> str:
    ratio = verdict.measured.value and verdict.measured.value / verdict.typical
    return number(ratio, 2) if ratio else '–'


def _letters(group: Sequence[Verdict]) -> str:
    return ' / '.join(verdict.axis.rpartition('.')[2] for verdict in group)


def _axes(group: Sequence[Verdict], kind: str) -> str:
    """Return which axes are meant, if it is not all of them."""
    letters = [v.axis.rpartition('.')[2] for v in group if v.verdict == kind]
    return '' if len(letters) == len(group) else f' {", ".join(letters)}'
