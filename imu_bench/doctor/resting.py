# SPDX-License-Identifier: Apache-2.0
"""
What a sensor at rest has to show, whatever its constants are: gravity, the Earth's field, noise.

A wrong scale, byte order, axis or rate of a driver shows here on the first day, on hardware that
nobody has measured before.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import math
from typing import Any

from imu_bench.config import BenchConfig
from imu_bench.doctor.minute import rest, Rested, SECONDS
from imu_bench.errors import DataError
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.moments import Moments
from imu_bench.metrology.spectra.spectrum import density_from_sigma, plateau
from imu_bench.metrology.spectra.welch import psd
from imu_bench.registers import Typical
from imu_bench.units import DEGREE, STANDARD_GRAVITY
from msg_conversions.quantities import AXES, IMU_QUANTITIES, Quantity
import numpy as np
import numpy.typing as npt

SCHEMA = 'imu_bench.doctor.check/1'

OK, WRONG, UNKNOWN = 'ok', 'wrong', 'not checked'

PLACES = 9.764, 9.834
"""m/s² from Huascarán to the Arctic Ocean: Hirt et al. 2013, Geophys. Res. Lett. 40:4279."""

FIELD = 25e-6, 65e-6
"""T at the surface of the Earth: NOAA NCEI, World Magnetic Model."""

OFFSET = 0.1 * STANDARD_GRAVITY
"""Of a document that gives none; the largest of those that do is 90 mg (LSM9DS1)."""

SLANT = 10 * DEGREE
"""Assumed: a board screwed on by hand stands no more askew; another axis is 90° away."""

RATE = 0.1
"""The nearest two rates of any chip here differ by a fifth."""

NOISE = 2.0
"""Assumed: parts scatter by less.  A quiet table does not shake more than that."""

ROOM = 5.0, 60.0
"""°C in a room where one can work, and up to 25 K that a chip warms itself, as assumed."""

WARMTH = 15.0
"""K, assumed of a document that gives no error at all."""

APART = 5.0
"""Standard deviations between the means of FIFO and registers."""


@dataclass(frozen=True)
class Row:
    """One thing that was looked at."""

    sensor: str
    what: str
    verdict: str
    measured: Estimate
    expected: str  # in words, with the unit of `measured`
    advice: str = ''  # what it may be if it is wrong; why it was not checked

    def as_json(self) -> dict[str, Any]:
        """Return it for machines."""
        return {**self.__dict__, 'measured': self.measured.to_json()}


def check(config: BenchConfig, seconds: float = SECONDS) -> list[Row]:
    """
    Let a bench stand still and return what is to be said of each sensor.

    Parameters
    ----------
    config : BenchConfig
        `up` says how each sensor is mounted.

    Raises
    ------
    ConfigError
        If driver and settings of a sensor do not go together.
    """
    rested = rest(config.sensors, seconds)
    return [row for one in rested for row in judge(one, config.up.get(one.sensor.name, ''))]


def as_json(bench: str, rows: list[Row]) -> dict[str, Any]:
    """Return everything for machines."""
    fine = all(row.verdict != WRONG for row in rows)
    return {'schema': SCHEMA, 'bench': bench, 'ok': fine, 'rows': [r.as_json() for r in rows]}


def judge(one: Rested, up: str) -> Iterator[Row]:
    """Yield what is to be said of a sensor."""
    name = one.sensor.name
    if one.sensor.backend == 'recorded':
        nothing = Estimate.not_observable('1', one.problem)
        yield Row(name, 'samples', UNKNOWN, nothing, '', one.problem)
        return
    if one.problem or one.stats is None or not any(len(run) for run in one.runs):
        reason = one.problem or (one.stats.last_error if one.stats else '') or 'no samples came'
        nothing = Estimate.not_observable('1', reason)
        yield Row(name, 'samples', WRONG, nothing, 'some', reason)
        if not one.runs:
            return
    for rows in (_rate, _gravity, _noise, _stuck, _field, _temperature, _fifo):
        yield from rows(one)
    yield from _direction(one, up)


def _row(
    one: Rested, what: str, fine: bool, measured: Estimate, expected: str, advice: str
) -> Row:
    return Row(
        one.sensor.name, what, OK if fine else WRONG, measured, expected, '' if fine else advice
    )


def _between(estimate: Estimate, low: float, high: float) -> bool:
    """Return whether any value that it may have lies between two bounds."""
    value = estimate.value or 0.0
    least = value if estimate.low is None else estimate.low
    most = value if estimate.high is None else estimate.high
    return most >= low and least <= high


def _rate(one: Rested) -> Iterator[Row]:
    stats = one.stats
    if stats is None:
        return
    rate = stats.rate if stats.rate.observable else stats.delivered
    nominal = stats.nominal_hz
    fine = rate.observable and _between(rate, (1 - RATE) * nominal, (1 + RATE) * nominal)
    yield _row(
        one, 'rate', fine, rate, f'{nominal:g} Hz ± {100 * RATE:g} %',
        'a wrong code for the rate, or a bus that is too full: imu-bench doctor BENCH',
    )  # fmt: skip
    lost = Estimate(one.lost, one.lost, one.lost, '1', method='counted')
    yield _row(
        one, 'samples lost', not one.lost, lost, 'none',
        'a bus that is too full, or a machine that is too busy: imu-bench doctor BENCH',
    )  # fmt: skip


def _mean(data: npt.NDArray[Any], unit: str) -> list[Estimate]:
    moments = Moments.of(np.ascontiguousarray(data.T))
    return [moments.mean_estimate(axis, unit) for axis in range(data.shape[1])]


def _length(data: npt.NDArray[Any], unit: str) -> Estimate:
    """Return the length of the mean vector; its error is that of its components along it."""
    means = _mean(data, unit)
    vector = np.array([mean.value for mean in means])
    length = float(np.linalg.norm(vector))
    halves = np.array([(m.high or 0.0) - (m.value or 0.0) for m in means])
    half = float(np.linalg.norm(vector * halves) / length) if length else float(max(halves))
    return Estimate(length, max(length - half, 0.0), length + half, unit, method='of the mean')


def _largest(value: float | tuple[float, ...] | None, default: float = 0.0) -> float:
    return default if value is None else float(np.max(np.abs(value)))


def _sees_gravity(one: Rested) -> npt.NDArray[Any] | None:
    """Return the acceleration of a sensor with three axes that shows constant values."""
    data = one.column('acceleration')
    typical = one.typical.get('acceleration')
    constant = typical is None or typical.high_pass is None
    return data if data is not None and constant and not np.isnan(data).any() else None


def _offset(one: Rested) -> float:
    typical = one.typical.get('acceleration')
    return _largest(typical.bias if typical else None, OFFSET)


def _gravity(one: Rested) -> Iterator[Row]:
    data = _sees_gravity(one)
    if data is None:
        return
    typical = one.typical.get('acceleration')
    scale = _largest(typical.scale_error if typical else None)
    # an offset across gravity hardly lengthens it
    slack = _offset(one) + scale * STANDARD_GRAVITY
    low, high = PLACES[0] - slack, PLACES[1] + slack
    length = _length(data, 'm/s²')
    yield _row(
        one, 'gravity', _between(length, low, high), length, f'{low:.2f} to {high:.2f} m/s²',
        'a wrong scale, range or byte order of the accelerometer, or it does not stand still',
    )  # fmt: skip


def _direction(one: Rested, up: str) -> Iterator[Row]:
    data = _sees_gravity(one)
    if data is None:
        return
    means = np.array([mean.value for mean in _mean(data, 'm/s²')])
    length = float(np.linalg.norm(means))
    if not up:
        names = [f'{sign}{axis}' for axis in AXES for sign in ('', '-')]
        nearest = names[int(np.argmax(np.concatenate([[m, -m] for m in means])))]
        reason = f'the bench does not say; {nearest} points up: give its entry up: {nearest}'
        nothing = Estimate.not_observable('°', reason)
        yield Row(one.sensor.name, 'mounting', UNKNOWN, nothing, '', reason)
        return
    along = float(means[AXES.index(up[-1])]) * (-1 if up.startswith('-') else 1)
    angle = math.degrees(math.acos(min(max(along / length, -1.0), 1.0))) if length else 180.0
    half = math.degrees(_offset(one) / STANDARD_GRAVITY)
    most = math.degrees(SLANT) + half
    measured = Estimate(angle, max(angle - half, 0.0), angle + half, '°', method='offset allowed')
    yield _row(
        one, 'mounting', angle <= most, measured, f'{up} up within {most:.0f}°',
        'an axis or sign of the driver is wrong, or the sensor is mounted otherwise than up: says',
    )  # fmt: skip


def _quantised(typical: Typical, rate_hz: float, axis: int) -> tuple[float, float, float]:
    """Return the noise density and the deviation of a document's sensor, and its step."""
    density = float(np.broadcast_to(typical.noise_density or 0.0, 3)[axis])
    steps = np.atleast_1d(typical.resolution or 0.0)
    step = float(steps[axis] if steps.size == len(AXES) else steps[0])
    band = min(typical.bandwidth or math.inf, rate_hz / 2)
    return density, density * math.sqrt(band), step


def _noise(one: Rested) -> Iterator[Row]:
    for quantity in IMU_QUANTITIES:
        data, typical = one.column(quantity.field), one.typical.get(quantity.field)
        if data is None or one.stats is None:
            continue
        rate_hz = one.stats.nominal_hz
        rows = [
            _noise_of(one, quantity, axis, data[:, axis], typical, rate_hz)
            for axis in range(len(AXES))
            if not np.isnan(data[:, axis]).any()
        ]
        # one row says it: the worst
        order = (WRONG, OK, UNKNOWN)
        yield min(rows, key=lambda row: order.index(row.verdict))


def _noise_of(
    one: Rested,
    quantity: Quantity,
    axis: int,
    data: npt.NDArray[Any],
    typical: Typical | None,
    rate_hz: float,
) -> Row:
    what = f'noise, {quantity.title.lower()} {AXES[axis]}'
    unit = f'{quantity.unit}/√Hz'
    try:
        found = plateau(psd(data, rate_hz, quantity.unit))
    except DataError as error:
        found = Estimate.not_observable(unit, str(error))
    if typical is None or typical.noise_density is None:
        reason = 'the document gives none'
        return Row(one.sensor.name, what, UNKNOWN, found, '', reason)
    density, deviation, step = _quantised(typical, rate_hz, axis)
    if not found.observable:
        moments = Moments.of(np.ascontiguousarray(data)[None])
        band = min(typical.bandwidth or math.inf, rate_hz / 2)
        found = density_from_sigma(moments.std_estimate(0, quantity.unit), band)
    rounding = step / math.sqrt(12) * math.sqrt(2 / rate_hz)
    # of noise below a step a few readings may show anything, or none
    low = density / NOISE if deviation > step / 2 else 0.0
    high = NOISE * math.hypot(density, rounding)
    return _row(
        one, what, _between(found, low, high), found, f'{low:.2g} to {high:.2g} {unit}',
        'a wrong scale or filter, or the bench does not stand still',
    )  # fmt: skip


def _stuck(one: Rested) -> Iterator[Row]:
    for field, title in (
        *((quantity.field, quantity.title.lower()) for quantity in IMU_QUANTITIES),
        ('magnetic_field', 'magnetic field'),
    ):
        data = one.column(field)
        if data is None or len(data) < 2 or one.stats is None:
            continue
        used = [axis for axis in range(len(AXES)) if not np.isnan(data[:, axis]).any()]
        values = {axis: len(np.unique(data[:, axis])) for axis in used}
        axis = min(values, key=lambda a: values[a])
        count = Estimate(values[axis], values[axis], values[axis], '1', method='counted')
        twins = [
            f'{AXES[a]} and {AXES[b]} are the same'
            for a in used for b in used if a < b and np.array_equal(data[:, a], data[:, b])
        ]  # fmt: skip
        typical = one.typical.get(field)
        deviation, step = 0.0, math.inf
        if typical is not None and typical.noise_density is not None:
            _, deviation, step = _quantised(typical, one.stats.nominal_hz, axis)
        what = f'values, {title} {AXES[axis]}'
        if values[axis] > 1 and not twins:
            yield _row(one, what, True, count, 'more than one', '')
        elif twins or deviation > step / 2:
            why = twins[0] if twins else 'the axis is stuck'
            yield _row(one, what, False, count, 'more than one', why)
        else:
            reason = 'its noise may be less than a step; turn the sensor and look'
            yield Row(one.sensor.name, what, UNKNOWN, count, '', reason)


def _field(one: Rested) -> Iterator[Row]:
    data = one.column('magnetic_field')
    if data is None:
        return
    typical = one.typical.get('magnetic_field')
    slack = _largest(typical.bias if typical else None)
    low, high = max(FIELD[0] - slack, 0.0), FIELD[1] + slack
    length = _length(data, 'T').to('µT')
    yield _row(
        one, 'magnetic field', _between(length, 1e6 * low, 1e6 * high), length,
        f'{1e6 * low:.0f} to {1e6 * high:.0f} µT',
        'a wrong scale or unit of the magnetometer, or iron, a magnet or a motor beside it',
    )  # fmt: skip


def _temperature(one: Rested) -> Iterator[Row]:
    data = one.column('temperature')
    if data is None:
        return
    typical = one.typical.get('temperature')
    slack = _largest(typical.bias if typical else None, WARMTH)
    low, high = ROOM[0] - slack, ROOM[1] + slack
    (mean,) = _mean(data[:, None], '°C')
    yield _row(
        one, 'temperature', _between(mean, low, high), mean, f'{low:g} to {high:g} °C',
        'a wrong scale or zero of the thermometer',
    )  # fmt: skip


def _fifo(one: Rested) -> Iterator[Row]:
    """Hold the FIFO against the output registers, read one by one: the worst axis."""
    for quantity in IMU_QUANTITIES:
        apart, data = one.apart.get(quantity.field), one.column(quantity.field)
        if apart is None or data is None:
            continue
        worst: tuple[float, Row] | None = None
        for axis, letter in enumerate(AXES):
            difference = float(data[:, axis].mean() - apart[:, axis].mean())
            deviation = float(np.std(data[:, axis]))
            step = _quantised(one.typical[quantity.field], 1.0, axis)[2]
            half = max(APART * deviation / math.sqrt(len(apart)), step)
            fine = abs(difference) <= half
            estimate = Estimate(difference, difference - half, difference + half, quantity.unit)
            row = _row(
                one, f'FIFO less registers, {quantity.title.lower()} {letter}', fine, estimate,
                f'0 ± {half:.2g} {quantity.unit}',
                'what the FIFO gives is not what the output registers hold: its order or its wrap',
            )  # fmt: skip
            excess = abs(difference) / half if half else float(difference != 0.0)
            worst = max(worst or (excess, row), (excess, row), key=lambda pair: pair[0])
        if worst is not None:
            yield worst[1]
