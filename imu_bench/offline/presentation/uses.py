# SPDX-License-Identifier: Apache-2.0
"""The answer first: which sensor is best for what, and the numbers that a filter wants."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
import math
from typing import NamedTuple

from imu_bench.errors import RecordingError
from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.analysis.axis_result import AxisResult
from imu_bench.offline.analysis.results import RecordingResult
from imu_bench.offline.comparing.sensors import Comparison, ratio
from imu_bench.offline.exports.numbers import Number, Numbers
from imu_bench.offline.notation import number, power_of_ten, readable_unit, text, value_text
from imu_bench.offline.presentation.tables import Cell, Column, Shown, Table
from imu_bench.units import STANDARD_GRAVITY
from msg_conversions.quantities import ANGULAR_VELOCITY, LINEAR_ACCELERATION, Quantity
import numpy as np

TIMES_S = {'1 s': 1.0, '10 s': 10.0, '1 min': 60.0, '10 min': 600.0, '1 h': 3600.0}

_LEVELLING_S = 10.0
"""Over which a tilt is averaged: what shakes a mast or a machine is gone, and nobody waits."""


_SHARE = 0.1
"""Of a recording: up to there intervals hold the truth as often as they say, and are narrow enough
to tell sensors apart (docs/how_right_how_fast.md)."""


class _Use(NamedTuple):
    """
    One thing that sensors are used for.

    Attributes
    ----------
    name, what : str
        Of the use, and of the number by which it is judged; the smallest is best.
    role : str
        What the number is for `notation.readable_unit`.
    found : mapping of str to Estimate
        By sensor.
    drifts : bool
        Whether it hangs on what a simulation leaves out.
    """

    name: str
    what: str
    role: str
    found: Mapping[str, Estimate]
    drifts: bool


def deviation_at(curve: DeviationCurve, seconds: float) -> Estimate | None:
    """Return the deviation at an averaging time, None beyond the ends of the curve."""
    if not curve.tau.size or not curve.tau[0] <= seconds <= curve.tau[-1]:
        return None
    if not np.all(curve.low > 0.0):
        return None
    value, low, high = (
        math.exp(float(np.interp(math.log(seconds), np.log(curve.tau), np.log(part))))
        for part in (curve.deviation, curve.low, curve.high)
    )
    return Estimate(value, low, high, curve.unit, curve.confidence, method='Allan deviation')


def error_after(curve: DeviationCurve, seconds: float, unit: str) -> Estimate | None:
    """
    Return the error of the integral over a time, None beyond the ends of the curve.

    Notes
    -----
    The bias is the mean of a rest just as long.  The Allan variance is half the mean square of
    the difference of two such means in a row (NIST SP 1065 (2008), eq. (7)), so the root mean
    square of the integral is √2 τ σ(τ), whatever the noise.  Between averaging times the curve
    is a straight line on logarithmic axes.

    Examples
    --------
    >>> from imu_bench.metrology.allan import deviation
    >>> white = np.random.default_rng(1).normal(0.0, 1e-3, 100_000)
    >>> found = error_after(deviation(white, 100.0, unit='rad/s'), 4.0, 'rad')
    >>> found.low < math.sqrt(2.0 * 4.0) * 1e-4 < found.high
    True
    """
    found = deviation_at(curve, seconds)
    return None if found is None else found.scaled(math.sqrt(2.0) * seconds, unit)


def worst(
    axes: Sequence[AxisResult], found: Callable[[DeviationCurve], Estimate | None]
) -> Estimate | None:
    """Return what is found on the curve of the worst axis; None if one shows no constants."""
    if not axes or not all(axis.shows_constants for axis in axes):
        return None
    seen = [found(axis.allan) for axis in axes if axis.allan is not None]
    return max((e for e in seen if e is not None), key=lambda e: e.value or 0.0, default=None)


def answers(
    recordings: Sequence[RecordingResult],
    labels: Sequence[str],
    compared: Comparison,
    *,
    si: bool = False,
) -> list[str]:
    """
    Return which sensor is best for what and by how much, or why the data cannot tell.

    A recording with a severe finding is left out: a sensor that moved is not loud.
    """
    sound = {
        label: recording
        for label, recording in zip(labels, recordings, strict=True)
        if not recording.health.severe
    }
    if not sound:
        severe = [finding for recording in recordings for finding in recording.health.severe]
        codes = dict.fromkeys(finding.code.replace('_', ' ') for finding in severe)
        actions = dict.fromkeys(finding.action for finding in severe)
        who = 'the recording has' if len(recordings) == 1 else 'every recording has'
        which = 'What it is good for' if len(recordings) == 1 else 'Which sensor is best'
        advice = next(iter(actions))
        said = f'{which}, the data cannot tell: {who} severe findings ({", ".join(codes)}).'
        return [f'{said} {advice}']
    made = any(recording.simulated for recording in sound.values())
    prefix = 'Of the simulation: ' if made else ''
    return [
        f'{prefix}{_sentence(use, si)}'
        for use in _uses(sound, compared)
        # a simulation without bias instability would drift least
        if use.found and not (made and use.drifts)
    ]


def _uses(sound: Mapping[str, RecordingResult], compared: Comparison) -> Iterator[_Use]:
    after, times = _angles(sound)
    yield _Use('Dead reckoning', f'angle off by … after {after}', 'angle', times, True)
    for name, quantity in (
        ('VIO and filters', ANGULAR_VELOCITY),
        ('Vibration', LINEAR_ACCELERATION),
    ):
        densities = {
            row.label: row.noise_density
            for row in compared.standings.get(quantity.name, ())
            if row.label in sound and row.noise_density.value is not None
        }
        yield _Use(name, f'{quantity.sensor} noise of …', 'density', densities, False)
    level = partial(deviation_at, seconds=_LEVELLING_S)
    scatter = {
        label: found.scaled(1.0 / STANDARD_GRAVITY, 'rad')
        for label, found in _of_worst(sound, LINEAR_ACCELERATION, level).items()
    }
    yield _Use('Tilt', f'scatter of … averaged over {_LEVELLING_S:g} s', 'angle', scatter, True)


def _angles(sound: Mapping[str, RecordingResult]) -> tuple[str, dict[str, Estimate]]:
    """Return the angle errors after the longest time that most sensors were recorded for."""
    best: tuple[str, dict[str, Estimate]] = ('', {})
    for name, seconds in TIMES_S.items():
        angle = partial(error_after, seconds=seconds, unit='rad')
        long = {
            label: one for label, one in sound.items() if seconds <= _SHARE * one.health.duration_s
        }
        found = _of_worst(long, ANGULAR_VELOCITY, angle)
        if found and len(found) >= len(best[1]):
            best = name, found
    return best


def _of_worst(
    sound: Mapping[str, RecordingResult],
    quantity: Quantity,
    found: Callable[[DeviationCurve], Estimate | None],
) -> dict[str, Estimate]:
    every = {label: worst(one.of(quantity.name), found) for label, one in sound.items()}
    return {label: estimate for label, estimate in every.items() if estimate is not None}


def _sentence(use: _Use, si: bool) -> str:
    rows = sorted(use.found.items(), key=lambda row: row[1].value or 0.0)
    label, best = rows[0]
    unit = '°' if use.role == 'angle' else readable_unit(best.unit, use.role, [best.value])
    unit = best.unit if si else unit
    if len(rows) == 1:
        return f'{use.name}: {label}, {use.what.replace("…", text(best, unit))}.'
    alike = [name for name, other in rows[1:] if overlap(best, other)]
    if len(alike) == len(rows) - 1:
        ends = f'{number(best.to(unit).value or 0.0, 2)} to {text(rows[-1][1], unit)}'
        return (
            f'{use.name}: the data cannot tell the {len(rows)} sensors apart, '
            f'{use.what.replace("…", ends)}; their intervals overlap.'
        )
    tied = f' (not told apart from {", ".join(alike)})' if alike else ''
    name, other = next(row for row in rows[1:] if row[0] not in alike)
    next_ = f'{name} has {value_text(ratio(other, best))} times as much'
    last, most = rows[-1]
    if last != name:
        next_ += f', {last} {value_text(ratio(most, best))} times'
    return (
        f'{use.name}: {label} is best{tied}, {use.what.replace("…", text(best, unit))}; {next_}.'
    )


def overlap(one: Estimate, other: Estimate) -> bool:
    """Return whether two intervals have something in common."""
    lows = [e.low or 0.0 for e in (one, other)]
    highs = [e.high for e in (one, other) if e.high is not None]
    return len(highs) == 2 and max(lows) <= min(highs)


_KEYS: tuple[tuple[str, Quantity, str, tuple[str, ...]], ...] = (
    ('Gyroscope N', ANGULAR_VELOCITY, 'N',
     ('gyroscope_noise_density', 'IMU.NoiseGyro', 'gyr_n', 'setGyroscopeCovariance')),
    ('Gyroscope K', ANGULAR_VELOCITY, 'K',
     ('gyroscope_random_walk', 'IMU.GyroWalk', 'gyr_w', 'setBiasOmegaCovariance')),
    ('Accelerometer N', LINEAR_ACCELERATION, 'N',
     ('accelerometer_noise_density', 'IMU.NoiseAcc', 'acc_n', 'setAccelerometerCovariance')),
    ('Accelerometer K', LINEAR_ACCELERATION, 'K',
     ('accelerometer_random_walk', 'IMU.AccWalk', 'acc_w', 'setBiasAccCovariance')),
)  # fmt: skip
_PER_SECOND = {'m/s²': 'm/s³', 'rad/s': 'rad/s²'}

_NUMBERS_NOTE = (
    'Continuous-time, two-sided, in SI: root of the mean square of the axes, and up to where the '
    'interval of the worst one reaches (imu-bench export --conservative); “<” is an upper '
    'bound, which programs that refuse 0 are given. B has no place in these programs.'
)
_DOUBTED = ' † The recording has severe findings: these describe it, not the sensor.'


def filter_numbers(recordings: Mapping[str, RecordingResult]) -> list[Table]:
    """Return the four numbers of every sensor, and what each program calls them."""
    rows = [row for item in recordings.items() if (row := _numbers(*item)) is not None]
    if not rows:
        return []
    columns = [Column('Sensor')]
    columns += [
        Column(title, f'{quantity.unit if term == "N" else _PER_SECOND[quantity.unit]}/√Hz')
        for title, quantity, term, _ in _KEYS
    ]
    note = _NUMBERS_NOTE
    if any(recording.health.severe for recording in recordings.values()):
        note += _DOUBTED
    programs = ('Kalibr, OpenVINS', 'ORB-SLAM3', 'VINS: times √rate', 'GTSAM: squared')
    return [
        Table('Numbers for your filter', tuple(columns), tuple(rows), note),
        Table(
            'What programs call them',
            (Column('Number'), *map(Column, programs)),
            tuple((title, *names) for title, _, _, names in _KEYS),
        ),
    ]


def _numbers(label: str, recording: RecordingResult) -> tuple[Cell, ...] | None:
    value, upper = Numbers(recording), Numbers(recording, conservative=True)
    cells = [_number(value, upper, quantity, term) for _, quantity, term, _ in _KEYS]
    if all(cell.text == '–' for cell in cells):
        return None
    return (f'{label} †' if recording.health.severe else label, *cells)


def _number(value: Numbers, upper: Numbers, quantity: Quantity, term: str) -> Shown:
    try:
        found, most = (_of(numbers, quantity, term) for numbers in (value, upper))
    except RecordingError as error:
        return Shown('–', str(error))
    if found.bound:
        return Shown(f'< {_power(found.value)}')
    return Shown(_power(found.value), small=(f'up to {_power(most.value)}',))


def _of(numbers: Numbers, quantity: Quantity, term: str) -> Number:
    return numbers.white_noise(quantity) if term == 'N' else numbers.random_walk(quantity)


def _power(value: float) -> str:
    mantissa, _, power = f'{value:.2e}'.partition('e')
    return f'{mantissa}×{power_of_ten(int(power))}'
