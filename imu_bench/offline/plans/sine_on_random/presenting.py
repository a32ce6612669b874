# SPDX-License-Identifier: Apache-2.0
"""Tables IV to VII of Capriglione et al. 2021 from a campaign."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import math

from imu_bench.metrology.combining import difference
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.trials.crosstalk import Repeated
from imu_bench.offline.plans.sine_on_random.comparing import Campaign, Case, INDICES
from imu_bench.offline.plans.sine_on_random.measuring import Shaken
from imu_bench.offline.presentation.figure import Figure, Series
from imu_bench.offline.presentation.tables import Cell, Column, Table
from imu_bench.units import convert, STANDARD_GRAVITY
from msg_conversions.quantities import AXES, IMU_QUANTITIES, LINEAR_ACCELERATION, Quantity
import numpy as np

TITLES = {'linear_acceleration': 'Accelerometer', 'angular_velocity': 'Gyroscope'}
UNITS = {'linear_acceleration': 'mg', 'angular_velocity': 'm°/s'}

_WORDS = {'RR': 'rejection ratio', 'SR': 'spurious response ratio'}
_TABLES = {'RR': 'V', 'SR': 'VI'}
_NOTES = {
    'RR': (
        'RR_ij = |20 log10(RMS_i / RMS_j)| in the test zone, equation (1): i is not excited, j is '
        'the excited accelerometer axis. The magnitude, as printed there: ideally infinite, 0 if '
        'the axis that is not excited shows as much as the excited one.'
    ),
    'SR': (
        'SR_ij = |20 log10(RMS_i in the test zone / RMS_i in the zone before)|, equation (2), '
        'where j is excited. The magnitude, as printed there: ideally 0.'
    ),
}
_ZERO = 'RMS about the mean of the zone before, which holds bias and gravity.'
_GYROSCOPE = (
    'RMS of the gyroscope in °/s, of the accelerometer in g; other units, other numbers. A shaker '
    'turns nothing: a gyroscope that shows only its own noise has the same RR on all axes, that '
    'noise against the level of the shaker.'
)


def tables(campaign: Campaign) -> Iterator[Table]:
    """Yield all tables: what the answer rests on first, the repetitions of one condition last."""
    yield compatible(campaign)
    if any(run.snr.value is not None for runs in campaign.runs.values() for run in runs):
        yield ratios(campaign)
    present = [q for q in IMU_QUANTITIES if _has(campaign, q)]
    for quantity in present:
        for name in INDICES:
            yield _over_repetitions(campaign, name, quantity)
    for condition in campaign.conditions[:1]:
        for name in INDICES:
            yield _each(campaign, name, LINEAR_ACCELERATION, condition)
        yield _each_ratio(campaign, condition)
        yield _before_after(campaign, condition)


def _has(campaign: Campaign, quantity: Quantity) -> bool:
    return any(
        name.startswith(quantity.name)
        for runs in campaign.runs.values()
        for run in runs
        for name in run.axes
    )


def _pair(name: str, i: str, j: str) -> Column:
    return Column(f'{name} {i}{j}', 'dB')


def _note(name: str, quantity: Quantity) -> str:
    gyroscope = f' {_GYROSCOPE}' if name == 'RR' and quantity is not LINEAR_ACCELERATION else ''
    return f'{_NOTES[name]} {_ZERO}{gyroscope}'


def _over_repetitions(campaign: Campaign, name: str, quantity: Quantity) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for condition in campaign.conditions:
        for sensor in campaign.sensors:
            means: list[Cell] = []
            spreads: list[float] = []
            for i, j in campaign.pairs:
                case = Case(condition, j, sensor, True)
                _, over = campaign.index(name, quantity, case, i)
                means.append(None if over is None else over.mean)
                if over is not None and over.spread.value is not None:
                    spreads.append(over.spread.value)
            largest = float(f'{max(spreads):.2g}') if spreads else None
            rows.append((f'{condition} {sensor}', *means, largest))
    columns = (
        Column('condition, sensor'),
        *(_pair(name, i, j) for i, j in campaign.pairs),
        Column('largest σ', 'dB'),
    )
    title = f'{TITLES[quantity.name]}: {_WORDS[name]} {name}, mean of the repetitions'
    note = (
        f'{_note(name, quantity)} σ is the standard deviation of a repetition, the largest of '
        'the row.'
    )
    return Table(title, columns, tuple(rows), note)


def _each(campaign: Campaign, name: str, quantity: Quantity, condition: str) -> Table:
    """Return the form of tables V and VI."""
    rows: list[tuple[Cell, ...]] = []
    for sensor in campaign.sensors:
        found = {
            (i, j): campaign.index(name, quantity, Case(condition, j, sensor, True), i)[0]
            for i, j in campaign.pairs
        }
        for number in range(max(map(len, found.values()), default=0)):
            cells = [run[number] if number < len(run) else None for run in found.values()]
            rows.append((f'{sensor} repetition {number + 1}', *cells))
    columns = (Column('sensor'), *(_pair(name, i, j) for i, j in campaign.pairs))
    title = (
        f'{TITLES[quantity.name]}: {name} of each repetition, {condition} '
        f'(Capriglione 2021, table {_TABLES[name]})'
    )
    return Table(title, columns, tuple(rows), _note(name, quantity))


def ratios(campaign: Campaign) -> Table:
    """Return the SNR with and without random vibration, and its loss."""
    rows: list[tuple[Cell, ...]] = []
    cases = sorted({case._replace(random=True) for case in campaign.runs})
    for case in cases:
        alone = case._replace(random=False)
        both = [campaign.ratio(case), campaign.ratio(alone)]
        runs = campaign.runs.get(case, []) + campaign.runs.get(alone, [])
        if all(run.snr.value is None for run in runs):
            continue
        sines = [run.fundamental for run in runs if run.fundamental is not None]
        rows.append(
            (
                f'{case.condition} {case.sensor} {case.axis}',
                runs[0].identity.sine_hz,
                sum(sines) / len(sines) if sines else None,
                *(None if found is None else found.mean for found in both),
                campaign.loss(case),
                None if both[0] is None else both[0].spread,
            )
        )
    columns = (
        Column('condition, sensor, axis'), Column('sine', 'Hz'), Column('seen at', 'Hz'),
        Column('SNR', 'dB'), Column('SNR, sine alone', 'dB'), Column('loss', 'dB'),
        Column('σ', 'dB'),
    )  # fmt: skip
    note = (
        "SNR of the excited accelerometer axis in the test zone, as MATLAB's snr defines it: "
        'Kaiser β = 38 periodogram, fundamental over all but itself, its next five harmonics and '
        'the constant part. Loss is what the random vibration takes from the sine alone. σ is '
        'the standard deviation of a repetition.'
    )
    return Table('Signal-to-noise ratio, mean of the repetitions', columns, tuple(rows), note)


def _each_ratio(campaign: Campaign, condition: str) -> Table:
    """Return the form of table VII."""
    rows: list[tuple[Cell, ...]] = []
    for sensor in campaign.sensors:
        cases = [Case(condition, axis, sensor, True) for axis in AXES]
        runs = [campaign.runs.get(case, []) for case in cases]
        alone = [campaign.ratio(case._replace(random=False)) for case in cases]
        for number in range(max(map(len, runs))):
            cells: list[Cell] = []
            for group, reference in zip(runs, alone, strict=True):
                cells.append(group[number].snr if number < len(group) else None)
                cells.append(None if reference is None or number else reference.mean)
            rows.append((f'{sensor} repetition {number + 1}', *cells))
    heads = [Column(f'{kind} {a}', 'dB') for a in AXES for kind in ('SNR', 'reference')]
    title = f'Signal-to-noise ratio of each repetition, {condition} (Capriglione 2021, table VII)'
    note = 'Reference is the sine without random vibration.'
    return Table(title, (Column('sensor'), *heads), tuple(rows), note)


def compatible(campaign: Campaign) -> Table:
    """Return how the quiet zones before and after compare, all runs of an axis in one row."""
    rows: list[tuple[Cell, ...]] = []
    for quantity in IMU_QUANTITIES:
        for sensor in campaign.sensors:
            for letter in AXES:
                row = _agreement(campaign, quantity, sensor, letter)
                if row is not None:
                    rows.append(row)
    columns = (
        Column('sensor, axis'), Column('runs'), Column('compatible'),
        Column('largest ratio'), Column('largest shift'), Column('verdict'),
    )  # fmt: skip
    note = (
        f'The means of the zones before and after are compatible if they differ by no more than '
        f'{campaign.coverage:g} √(σ² before + σ² after), with σ of the readings as in table IV; '
        'ratio is the difference over that. The shift is after less before, with the interval '
        "that the means have: one that does not hold zero shows more than the sensor's noise, "
        'such as drift.'
    )
    return Table('Before and after the vibration', columns, tuple(rows), note)


def _agreement(
    campaign: Campaign, quantity: Quantity, sensor: str, letter: str
) -> tuple[Cell, ...] | None:
    judged = [
        (verdict, axis)
        for _, axis in campaign.quiet(quantity, sensor)
        if axis.name.endswith(f'.{letter}') and (verdict := campaign.compared(axis)) is not None
    ]
    if not judged:
        return None
    agree = sum(verdict.compatible for verdict, _ in judged)
    ratio = max(verdict.ratio for verdict, _ in judged)
    _, moved = max(judged, key=lambda item: abs(item[0].difference))
    shift = moved.before[0] if moved.after is None else difference(moved.after[0], moved.before[0])
    return (
        f'{sensor} {TITLES[quantity.name].lower()} {letter}',
        len(judged),
        agree,
        ratio if math.isfinite(ratio) else None,
        _shown(shift, quantity),
        'compatible' if agree == len(judged) else 'not compatible',
    )


def _shown(estimate: Estimate, quantity: Quantity) -> Estimate:
    return estimate.to(UNITS[quantity.name])


def _before_after(campaign: Campaign, condition: str) -> Table:
    """Return the form of table IV, of the first axis that was excited."""
    axis = min((c.axis for c in campaign.runs if c.condition == condition), default=AXES[0])
    rows: list[tuple[Cell, ...]] = []
    for sensor in campaign.sensors:
        for number, run in enumerate(
            campaign.runs.get(Case(condition, axis, sensor, True), []), 1
        ):
            cells: list[Cell] = []
            for letter in AXES:
                own = run.axes.get(f'{LINEAR_ACCELERATION.name}.{letter}')
                cells += (None,) * 4 if own is None else (*own.before, *(own.after or (None,) * 2))
            rows.append((f'{sensor} repetition {number}', *cells))
    heads = [
        Column(f'{letter} {zone} {what}', 'mg')
        for letter in AXES
        for zone in ('before', 'after')
        for what in ('mean', 'σ')
    ]
    title = (
        f'Accelerometer before and after, {condition} along {axis} (Capriglione 2021, table IV)'
    )
    note = (
        'As recorded: the document takes offsets and gravity out by a calibration in six '
        'positions before.'
    )
    return Table(title, (Column('sensor'), *heads), tuple(rows), note)


_RATIOS = {
    ('RR', 'linear_acceleration'): ('8', '0: as much as shaken axis'),
    ('RR', 'angular_velocity'): ('9', '°/s against g'),
    ('SR', 'linear_acceleration'): ('10', '0: as at rest'),
    ('SR', 'angular_velocity'): ('11', '0: as at rest'),
}
"""Number of the figure of a ratio; what its size means, in the room that an axis has."""


def figures(campaign: Campaign, measured: Sequence[Shaken]) -> Iterator[Figure]:
    """Yield all figures; bars with the standard deviation of a repetition."""
    for quantity in IMU_QUANTITIES:
        for name in INDICES:
            for sensor in campaign.sensors:
                yield from _bars(campaign, name, quantity, sensor)
    for sensor in campaign.sensors:
        yield from _ratio_bars(campaign, sensor)
    for sensor in campaign.sensors:
        yield from _error_bars(campaign, sensor)
    yield _zones(measured[0])


def _bar(label: str, found: Sequence[Repeated | None]) -> Series | None:
    """Return the bars of what was measured, with one standard deviation either side."""
    places, means, spreads = [], [], []
    for place, over in enumerate(found):
        if over is not None and over.mean.value is not None:
            places.append(float(place))
            means.append(over.mean.value)
            spreads.append(over.spread.value or 0.0)
    if not places:
        return None
    mean, spread = np.array(means), np.array(spreads)
    return Series(label, np.array(places), mean, mean - spread, mean + spread, 'bars')


def _bars(campaign: Campaign, name: str, quantity: Quantity, sensor: str) -> Iterator[Figure]:
    series = [
        bars
        for condition in campaign.conditions
        if (
            bars := _bar(
                condition,
                [
                    campaign.index(name, quantity, Case(condition, j, sensor, True), i)[1]
                    for i, j in campaign.pairs
                ],
            )
        )
        is not None
    ]
    if series:
        number, scale = _RATIOS[name, quantity.name]
        yield Figure(
            f'{TITLES[quantity.name]} of {sensor}: {_WORDS[name]} {name} (Capriglione 2021, '
            f'figure {number})',
            'yx: y while x is shaken; whiskers: σ of a repetition',
            f'{name} in dB; {scale}',
            tuple(series), categories=tuple(f'{i}{j}' for i, j in campaign.pairs),
        )  # fmt: skip


def _ratio_bars(campaign: Campaign, sensor: str) -> Iterator[Figure]:
    places = sorted(
        {
            (case.condition, case.axis)
            for case, runs in campaign.runs.items()
            if case.sensor == sensor and any(run.snr.value is not None for run in runs)
        }
    )
    series = []
    for random, label in ((False, 'sine alone'), (True, 'sine on random')):
        found = [campaign.ratio(Case(c, axis, sensor, random)) for c, axis in places]
        bars = _bar(label, found)
        if bars is not None:
            series.append(bars)
    if series:
        yield Figure(
            f'Accelerometer of {sensor}: signal-to-noise ratio SNR (Capriglione 2021, figure 12)',
            'condition and axis; whiskers: σ of a repetition',
            'SNR in dB; 0: sine as strong as noise',
            tuple(series), categories=tuple(f'{c} {axis}' for c, axis in places),
        )  # fmt: skip


def _error_bars(campaign: Campaign, sensor: str) -> Iterator[Figure]:
    """Yield means before and after with the standard deviation of the readings."""
    for condition in campaign.conditions[:1]:
        wanted = (condition, sensor, True)
        cases = [c for c in campaign.runs if (c.condition, c.sensor, c.random) == wanted]
        if not cases:
            continue
        case = cases[0]
        name = f'{LINEAR_ACCELERATION.name}.{case.axis}'
        runs = [run.axes[name] for run in campaign.runs[case]]
        series = []
        for label, off, zones in (
            ('before', -0.1, [run.before for run in runs]),
            ('after', 0.1, [run.after for run in runs]),
        ):
            known = [(k, zone) for k, zone in enumerate(zones) if zone is not None]
            if not known:
                continue
            mean = np.array([convert(z[0].value or 0.0, z[0].unit, 'mg') for _, z in known])
            spread = np.array([convert(z[1].value or 0.0, z[1].unit, 'mg') for _, z in known])
            middle = float(np.mean([convert(run.before[0].value or 0.0, run.unit, 'mg')
                                    for run in runs]))  # fmt: skip
            x = np.array([k for k, _ in known]) + off
            mean = mean - middle
            series.append(Series(label, x, mean, mean - spread, mean + spread, 'points'))
        yield Figure(
            f'Accelerometer {case.axis} of {sensor} before and after, {condition} '
            '(Capriglione 2021, figure 7)',
            'repetition', 'mean and σ about the mean of all, mg',
            tuple(series), categories=tuple(str(k + 1) for k in range(len(runs))),
        )  # fmt: skip


def _zones(shaken: Shaken) -> Figure:
    run = shaken.runs[0]
    time, level = shaken.level[0], shaken.level[1] / STANDARD_GRAVITY
    top = float(level.max())
    series = [Series('RMS of the accelerometer', time, level)]
    for name, zone in zip(
        ('before', 'test', 'after'), (run.zones.before, run.zones.test, run.zones.after),
        strict=True,
    ):  # fmt: skip
        if zone is not None:
            ends = np.array([zone.begin_s, zone.end_s])
            series.append(
                Series(
                    name, ends, np.full(2, 1.2 * top), dash='solid' if name == 'test' else 'dashed'
                )
            )
    return Figure(
        f'Zones of {shaken.source.rsplit("/", 1)[-1]}, {run.sensor} (Capriglione 2021, figure 3)',
        'time in s', 'acceleration in g', tuple(series), log_y=True,
    )  # fmt: skip
