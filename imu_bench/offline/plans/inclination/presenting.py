# SPDX-License-Identifier: Apache-2.0
"""Tables and figures of the inclination plan."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
import math

from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.notation import number, power_of_ten
from imu_bench.offline.plans.inclination.comparing import DEGREE, Judged
from imu_bench.offline.plans.inclination.measuring import AVERAGING_S
from imu_bench.offline.presentation.figure import Figure, Series
from imu_bench.offline.presentation.tables import Cell, Column, Table
import numpy as np

_STEPS_NOTE = (
    'Mean with its interval, which knows correlated noise; 3σ is that of single samples within '
    'the step. Error is measured minus set; without offset it is less the error of the first '
    'step, as in table 4.'
)
_ERRORS_NOTE = (
    'Over all steps, n − 1, as appendix 6 of the thesis. Offset, scale and linearity (largest '
    'distance) are those of a straight line through measured against set angles.'
)
_HYSTERESIS_NOTE = (
    'How much more an angle reads when it is reached from above than from below; play of the '
    'table looks the same as hysteresis of the sensor. What drifts between the two visits is in '
    'it: a difference that grows towards the first angle is drift, as of a sensor that warms up.'
)
_NEARLY = 0.1


def tables(sensors: Sequence[Judged], probability: float) -> Iterator[Table]:
    """Yield the tables of all sensors."""
    if any(sensor.wanted for sensor in sensors):
        yield _errors(sensors)
    for sensor in sensors:
        yield _steps(sensor)
    for sensor in sensors:
        if sensor.turns:
            yield _hysteresis(sensor)
    if any(sensor.detectable for sensor in sensors):
        yield _smallest(sensors, probability)


def _errors(sensors: Sequence[Judged]) -> Table:
    factor, unit = _of_variances(sensors)
    columns = (
        Column('sensor, angle'), Column('mean error', '°'), Column('variance', unit),
        Column('3σ of the errors', '°'), Column('largest error', '°'), Column('offset', '°'),
        Column('scale error', '%'), Column('linearity', '°'),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for sensor in sensors:
        known, line = sensor.statistics, sensor.line
        if known is not None:
            rows.append(
                (
                    f'{sensor.name} {sensor.tilted.axis}',
                    known.mean,
                    known.variance * DEGREE**2 * factor,
                    known.three_sigma,
                    known.largest * DEGREE,
                    line and line.offset,
                    line and line.scale_error,
                    line and line.linearity * DEGREE,
                )
            )
    title = 'Errors of the angle (mast thesis, appendix 6)'
    return Table(title, columns, tuple(rows), _ERRORS_NOTE)


def _of_variances(sensors: Sequence[Judged]) -> tuple[float, str]:
    """Return factor and unit by which the smallest variance has digits before the point."""
    sizes = [s.statistics.variance * DEGREE**2 for s in sensors if s.statistics is not None]
    smallest = min((size for size in sizes if size > 0.0), default=1.0)
    power = min(3 * math.floor(math.log10(smallest) / 3.0), 0)
    return 10.0**-power, f'{power_of_ten(power)} °²' if power else '°²'


def _steps(sensor: Judged) -> Table:
    chip = any(step.on_chip is not None for step in sensor.tilted.steps)
    columns = [Column('step'), Column('time, s')]
    columns += [Column('set', '°')] if sensor.wanted else []
    columns += [Column('measured', '°'), Column('3σ', '°')]
    columns += [Column('error', '°'), Column('without offset', '°')] if sensor.wanted else []
    columns += [Column('on chip', '°'), Column('on chip − trigonometry', '°')] if chip else []
    rows: list[tuple[Cell, ...]] = []
    for index, step in enumerate(sensor.tilted.steps):
        row: list[Cell] = [str(index + 1), f'{step.begin_s:.1f} to {step.end_s:.1f}']
        row += [sensor.wanted[index] * DEGREE] if sensor.wanted else []
        row += [step.mean, step.three_sigma]
        row += [sensor.errors[index], sensor.compensated[index]] if sensor.wanted else []
        row += [step.on_chip, step.disagreement] if chip else []
        rows.append(tuple(row))
    title = f'{sensor.name}: angle of {sensor.tilted.axis}, step by step'
    title += ' (mast thesis, tables 3 and 4)'
    return Table(title, tuple(columns), tuple(rows), _STEPS_NOTE)


def _hysteresis(sensor: Judged) -> Table:
    columns = (Column('set, °'), Column('up', '°'), Column('down', '°'), Column('hysteresis', '°'))
    rows = tuple(
        (number(turn.angle * DEGREE, 5), turn.up, turn.down, turn.hysteresis)
        for turn in sensor.turns
    )
    return Table(f'{sensor.name}: hysteresis', columns, rows, _HYSTERESIS_NOTE)


def _smallest(sensors: Sequence[Judged], probability: float) -> Table:
    seen = [sensor for sensor in sensors if sensor.detectable]
    rows: list[tuple[Cell, ...]] = [
        (f'{tau:g} s', *found)
        for tau in AVERAGING_S
        if any(found := [_at(sensor, tau) for sensor in seen])
    ]
    note = (
        f'A step of this size is found with a chance of {100 * probability:g} % when the means '
        'over the averaging time before and after it are compared, and noise alone is taken for '
        f'one with a chance of {100 * (1 - probability):.2g} %. It is the Allan deviation of the '
        'angle within the steps times √2 and the limits of that probability (3.6 at 95 %).'
    )
    columns = (Column('averaging time'), *(Column(sensor.name, '°') for sensor in seen))
    return Table('Smallest step that is found', columns, tuple(rows), note)


def _at(sensor: Judged, tau: float) -> Estimate | None:
    """Return the smallest step at about this averaging time."""
    near = [step for own, step in sensor.detectable if abs(own / tau - 1.0) < _NEARLY]
    return near[0] if near else None


def figures(sensors: Sequence[Judged]) -> Iterator[Figure]:
    """Yield the step plot, the errors, and the smallest step against averaging time."""
    yield _step_plot(sensors)
    wanted = [sensor for sensor in sensors if sensor.wanted]
    if wanted:
        yield Figure(
            'Error of every step, without that of the first', 'set angle in °', 'error in °',
            tuple(_error_points(sensor) for sensor in wanted),
        )  # fmt: skip
    seen = [sensor for sensor in sensors if sensor.detectable]
    if seen:
        yield Figure(
            'Smallest step that is found', 'averaging time τ in s', 'step in °',
            tuple(_detectable(sensor) for sensor in seen), log_x=True, log_y=True,
        )  # fmt: skip


def _step_plot(sensors: Sequence[Judged]) -> Figure:
    series = []
    first = next((sensor for sensor in sensors if sensor.wanted), None)
    for sensor in sensors:
        angle = sensor.tilted.angle * DEGREE
        series.append(Series(f'{sensor.name} {sensor.tilted.axis}', sensor.tilted.time, angle))
    if first is not None:
        steps = first.tilted.steps
        # the table was set somewhere between two steps
        moves = [0.5 * (a.end_s + b.begin_s) for a, b in pairwise(steps)]
        times = np.array([steps[0].begin_s, *moves, steps[-1].end_s])
        angles = np.array([*first.wanted, first.wanted[-1]]) * DEGREE
        series.append(Series('set', times, angles, kind='step', dash='dashed'))
    return Figure(
        'Set and measured angle (mast thesis, figures 20 and 21)', 'time in s', 'inclination in °',
        tuple(series),
    )  # fmt: skip


def _error_points(sensor: Judged) -> Series:
    return Series(
        sensor.name,
        np.array(sensor.wanted) * DEGREE,
        *_ends(sensor.compensated),
        kind='points',
    )


def _detectable(sensor: Judged) -> Series:
    taus = np.array([tau for tau, _ in sensor.detectable])
    return Series(sensor.name, taus, *_ends([step for _, step in sensor.detectable]))


def _ends(estimates: Sequence[Estimate]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    value = np.array([e.value or 0.0 for e in estimates]) * DEGREE
    low = np.array([e.value if e.low is None else e.low for e in estimates], float) * DEGREE
    high = np.array([e.value if e.high is None else e.high for e in estimates], float) * DEGREE
    return value, low, high
