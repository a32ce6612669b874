# SPDX-License-Identifier: Apache-2.0
"""Tables of what was measured on the axes of a quantity, and how it differs between runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import math
from statistics import median

from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.fitting.noise_model import TERM_NAMES
from imu_bench.offline.analysis.axis_result import AxisResult
from imu_bench.offline.analysis.drift import METHODS as DRIFT_METHODS
from imu_bench.offline.analysis.results import RecordingResult
from imu_bench.offline.health import Health
from imu_bench.offline.notation import date, duration, percent, short, unit_of
from imu_bench.offline.presentation.tables import Cell, Column, columns_of, Shown, Table
from msg_conversions.quantities import IMU_QUANTITIES

Titled = tuple[str, str, Sequence[Estimate]]
"""Title of a column, what its numbers are for `notation.unit_of`, one number per axis."""

MOVED = '†'
MOVED_NOTE = 'moved during the recording: noise density, N, B and K describe the motion, too.'
"""Mark of a sensor that moved, in every table of noise figures, and what it means."""

_STATISTICS = (
    ('Mean', 'mean'),
    ('σ', 'std'),
    ('RMS, bias removed', 'rms'),
    ('Peak to peak', 'peak_to_peak'),
)
_DENSITIES = {
    'allan': 'Allan deviation, √2 N',
    'plateau': 'Plateau of the spectrum',
    'sigma': 'σ over √(half the rate)',
}
_BY = {'whittle': 'spectrum (Whittle)', 'tangent': 'slope tangent'}


LEVELS, WHITE, SLOW = ('mean', 'σ, RMS'), ('noise density', 'N'), ('B', 'K')
"""Columns of the overview, for tables that have room for some of them."""


def overview(
    title: str,
    rows: Sequence[tuple[str, Estimate, AxisResult]],
    *,
    si: bool = False,
    shown: Sequence[str] = (*LEVELS, *WHITE, *SLOW),
    rate: bool = True,
) -> Table:
    """
    Return what matters most of all axes of all sensors, for the terminal.

    Parameters
    ----------
    rows : sequence of (str, Estimate, AxisResult)
        Name and rate of the sensor with each axis.
    si : bool
        In SI, not in the units of datasheets.
    shown : sequence of str
        Which numbers; fewer of them where there is little room, but each with its interval.
    rate : bool
        With the rates of the sensors.
    """
    axes = [axis for _, _, axis in rows]
    every: list[Titled] = [
        ('mean', 'level', [axis.statistics['mean'] for axis in axes]),
        ('σ, RMS', 'level', [axis.statistics['std'] for axis in axes]),
        ('noise density', 'density', [axis.white_density for axis in axes]),
        *((term, term, [axis.coefficient(term) for axis in axes]) for term in 'NBK'),
    ]
    numbers = [titled for titled in every if titled[0] in shown]
    columns = columns_of(numbers, si=False)
    if si:
        columns = tuple(Column(said, found[0].unit) for said, _, found in numbers)
    cells: list[Sequence[Cell]] = [found for _, _, found in numbers]
    names = [label for label, _, _ in rows]
    if rate:
        columns = (Column('rate', 'Hz'), *columns)
        first = [names.index(name) == at for at, name in enumerate(names)]
        rates = [
            Shown(short(row[1], 5) if new else '') for row, new in zip(rows, first, strict=True)
        ]
        cells.insert(0, rates)
    columns = (Column('sensor'), Column('axis'), *columns)
    letters = [axis.letter for axis in axes]
    return Table(title, columns, tuple(zip(names, letters, *cells, strict=True)), heads=2)


def coefficients(axes: Sequence[AxisResult], health: Health | None = None) -> Table:
    """Return the noise table of one quantity: density and coefficients."""
    numbers: list[Titled] = [('Noise density', 'density', [axis.white_density for axis in axes])]
    for term in 'NBKQR':
        estimates = [axis.coefficient(term) for axis in axes]
        if term in 'NBK' or any(e.observable for e in estimates):
            numbers.append((f'{term}, {TERM_NAMES[term]}', term, estimates))
    if health is None or not health.moved:
        return _by_axis(axes, numbers)
    marked = [(f'{title} {MOVED}', kind, found) for title, kind, found in numbers]
    return replace(_by_axis(axes, marked), note=f'{MOVED} The sensor {MOVED_NOTE}')


def statistics(axes: Sequence[AxisResult], health: Health) -> Table:
    """Return the plain statistics of one quantity, its outliers and its distribution."""
    numbers: list[Titled] = [
        (title, 'level', [axis.statistics[name] for axis in axes])
        for title, name in _STATISTICS
        if all(name in axis.statistics for axis in axes)
    ]
    if any(axis.per_kelvin for axis in axes):
        still = Estimate.not_observable(f'{axes[0].unit}/K', 'the temperature hardly changed')
        slopes = [axis.per_kelvin or still for axis in axes]
        numbers.append(('Temperature coefficient', 'per kelvin', slopes))
    steps = [health.resolution.get(axis.name) for axis in axes]
    if all(step is not None for step in steps):
        numbers.append(('Resolution', 'level', [step for step in steps if step is not None]))
    more: list[tuple[str, list[Cell]]] = []
    if all(axis.outliers is not None for axis in axes):
        more.append(('Outliers', [axis.outliers for axis in axes]))
    shapes = [axis.checks.normality for axis in axes]
    if any(shapes):
        verdicts: list[Cell] = [
            Shown('–', 'not tested')
            if shape is None
            else Shown(shape.verdict, small=(f'D = {percent(shape.distance.value or 0.0)}',))
            for shape in shapes
        ]
        more.append(('Distribution', verdicts))
    return _by_axis(axes, numbers, more)


def densities(axes: Sequence[AxisResult]) -> Table | None:
    """Return the noise density as found in different ways."""
    lost = Estimate.not_observable(axes[0].noise_density.unit, 'not computed')
    numbers: list[Titled] = [
        (title, 'density', [axis.noise_density_methods.get(name, lost) for axis in axes])
        for name, title in _DENSITIES.items()
        if any(name in axis.noise_density_methods for axis in axes)
    ]
    # a pooled curve has no spectrum: nothing to hold beside the fit
    alone = len(numbers) == 1 and any(axis.between for axis in axes)
    return _by_axis(axes, numbers) if numbers and not alone else None


def other_methods(axes: Sequence[AxisResult]) -> Table | None:
    """Return N, B and K by the other methods."""
    found = [axis.checks.second for axis in axes]
    if not any(found):
        return None
    numbers: list[Titled] = []
    for term in 'NBK':
        for name, title in _BY.items():
            blank = Estimate.not_observable(getattr(axes[0].model, term).unit, 'not computed')
            estimates = [s.coefficients[name][term] if s else blank for s in found]
            numbers.append((f'{term}, {title}', term, estimates))
    return _by_axis(axes, numbers)


def drift(axes: Sequence[AxisResult]) -> Table | None:
    """Return every Gauss-Markov model found, or None if there is none."""
    found = [
        (axis, title, axis.checks.drift.models[name])
        for axis in axes
        if axis.checks.drift
        for name, title in DRIFT_METHODS.items()
        if name in axis.checks.drift.models and axis.checks.drift.models[name].process
    ]
    if not found:
        return None
    models = [model for _, _, model in found]
    numbers: list[Titled] = [
        ('Correlation time T_c', 's', [model.T_c for model in models]),
        ('σ of the process', 'level', [model.sigma for model in models]),
        ('Strength q_c', 'K', [model.q_c for model in models]),
    ]
    columns = (Column('Axis'), Column('From'), *columns_of(numbers))
    rows = tuple((_letter(axis), title, m.T_c, m.sigma, m.q_c) for axis, title, m in found)
    return Table('', columns, rows)


def between(axes: Sequence[AxisResult]) -> Table | None:
    """Return how the numbers of one quantity differ from run to run, None of a single run."""
    if not any(axis.between for axis in axes):
        return None
    numbers: list[Titled] = []
    for term, (title, role) in _BETWEEN.items():
        found = [axis.between.get(term) for axis in axes]
        if not any(found):
            continue
        blank = Estimate.not_observable(
            next(one.mean.unit for one in found if one), 'seen in fewer than two runs'
        )
        if term == 'mean':
            means = [one.mean if one else blank for one in found]
            numbers.append((f'{title}, mean of the runs', role, means))
        numbers.append(
            (f'{title}, σ of the runs', role, [one.std if one else blank for one in found])
        )
    several = max((one.records for axis in axes for one in axis.between.values()), default=0)
    return replace(_by_axis(axes, numbers), title=f'From run to run: {several} runs')


_BETWEEN = {
    'mean': ('Turn-on bias', 'level'),
    'std': ('σ within a run', 'level'),
    'N': ('N', 'N'),
    'B': ('B', 'B'),
    'K': ('K', 'K'),
}
"""What differs from run to run, by its name in `AxisResult.between`."""


def of_runs(recording: RecordingResult, names: Sequence[str]) -> Table:
    """Return the runs of a pooled sensor, a row each: when, how long, bias, noise, health."""
    columns = [Column('Run'), Column('Begin', 'UTC'), Column('Duration')]
    rows: list[list[Cell]] = [
        [name, date(run.start_ns).removesuffix(' UTC') or '–', duration(run.health.duration_s)]
        for name, run in zip(names, recording.runs, strict=True)
    ]
    for quantity in IMU_QUANTITIES:
        groups = [run.of(quantity.name) for run in recording.runs]
        flat = [axis for axes in groups for axis in axes]
        if not flat:
            continue
        for title, role, seen in (
            ('mean', 'level', [[axis.statistics['mean'] for axis in axes] for axes in groups]),
            ('noise', 'density', [[axis.white_density for axis in axes] for axes in groups]),
        ):
            unit = unit_of([one for found in seen for one in found], role)
            letters = ' / '.join(axis.letter for axis in max(groups, key=len))
            columns.append(Column(f'{quantity.sensor.capitalize()} {title} {letters}', unit))
            places = _decimals([one.to(unit) for found in seen for one in found])
            for row, found in zip(rows, seen, strict=True):
                shown = [
                    short(one) if one.value is None or title == 'noise'
                    else f'{one.value:.{places}f}'
                    for one in (each.to(unit) for each in found)
                ]  # fmt: skip
                row.append(Shown(' / '.join(shown) or '–'))
    columns.append(Column('Health'))
    for row, run in zip(rows, recording.runs, strict=True):
        row.append(health_of(run.health))
    return Table('Runs', tuple(columns), tuple(map(tuple, rows)))


def _decimals(found: Sequence[Estimate]) -> int:
    """Return the decimals that the uncertainty of most of these leaves."""
    halves = [0.5 * (e.high - e.low) for e in found if e.low is not None and e.high is not None]
    middle = median(halves) if halves else 0.0
    return max(0, -math.floor(math.log10(middle))) if middle > 0.0 else 3


def health_of(health: Health) -> Shown:
    """Return the health of a recording in a word."""
    words = {'info': 'good', 'warning': 'warning', 'severe': 'severe'}
    return Shown(words[health.severity], kind=f'badge {health.severity}')


def _by_axis(
    axes: Sequence[AxisResult],
    numbers: Sequence[Titled],
    more: Sequence[tuple[str, Sequence[Cell]]] = (),
) -> Table:
    """Return a table with a row per axis: columns of estimates, and then of other cells."""
    columns = (Column('Axis'), *columns_of(numbers), *(Column(title) for title, _ in more))
    cells = (map(_letter, axes), *(found for _, _, found in numbers), *(c for _, c in more))
    return Table('', columns, tuple(zip(*cells, strict=True)))


def _letter(axis: AxisResult) -> Shown:
    return Shown(axis.letter, kind=f'axis-{axis.letter}')
