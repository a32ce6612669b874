# SPDX-License-Identifier: Apache-2.0
"""
Bias against temperature: coefficient, hysteresis, curvature, warm-up, drift between end points.

The test is that of the MSc thesis on two MEMS inclinometers (SCL3300, IIM-42652), section 4.2.1:
heated from room temperature to about 80 °C; its straight lines between the mean values of the
end points (figure 19) are `Thermal.change`.
"""

from __future__ import annotations

from dataclasses import dataclass

from imu_bench.errors import DataError
from imu_bench.metrology.combining import difference
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
from imu_bench.metrology.moments import Moments
from imu_bench.metrology.trials.drifting import regress, Regression
from imu_bench.metrology.trials.warm_up import LEAST_S
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

POINTS = 400
"""Averages into which a recording is divided; fewer where it is short."""

LEAST_POINTS = 20
"""Averages below which there is nothing to tell noise from temperature with."""

MOST_EMPTY = 40
"""Empty averages; each costs a coefficient."""

SHORTEST_S = 1.0
"""Length of one average."""

LEAST_SPAN = 5.0
"""K; below, a coefficient is a guess: 5 K are 0.75 mg at the 0.15 mg/K of an IIM-42652."""

BINS = 8
"""Temperatures at which the branches are compared."""

_TOP = 0.95
_BOTTOM = 0.05
"""Shares of the span of temperatures where an oven has arrived, and where it began to heat."""

_END_SHARE = 0.02
"""Part of the recording that an end point is the mean of; the thesis does not say its own."""

_LOOP = 2  # place of h among the coefficients


@dataclass(frozen=True, eq=False)
class Averages:
    """A recording in equally long averages."""

    # which of the stretches into which the recording is divided; empty ones are left out
    index: npt.NDArray[np.int64]
    # time, temperature, bias: s since the first sample, °C, and the signal in its unit
    time: Floats
    temperature: Floats
    bias: Floats


@dataclass(frozen=True)
class Phases:
    """When it was heated, s since the first sample."""

    heating: float  # when the temperature began to rise
    # hot, cooling: first and last time near the highest temperature
    hot: float
    cooling: float
    returned: float  # share of the rise that was lost again at the end

    @property
    def cooled(self) -> bool:
        """Whether there is a branch downwards to compare with."""
        return self.returned > 0.3


@dataclass(frozen=True, eq=False)
class Thermal:
    """What temperature does to the bias of one axis."""

    coefficient: Estimate  # change per kelvin, in the unit of the signal per K
    reference: float
    # bias at the middle temperature `reference`, °C; with gravity, where there is some
    at_reference: Estimate
    # largest distance of a parabola through the data from its chord, over the range
    curvature: Estimate
    # bias when cooling minus bias when heating at the middle temperature, of a loop that closes
    # like a parabola at both ends
    hysteresis: Estimate
    branches: tuple[tuple[float, Estimate], ...]  # the same for every temperature bin, °C
    # mean of the last 2 % of the recording minus mean of the first: the drift between end points
    # of the thesis
    change: Estimate
    change_hot: Estimate  # the same from the first 2 % to the last 2 % before it cools
    warm_up: Estimate  # change from the first to the last tenth of the time before heating
    averages: Averages


def averages(stamps_s: npt.ArrayLike, data: Floats, temperature: Floats) -> Averages:
    """
    Return a recording in at most `POINTS` averages of equal length; empty ones are left out.

    Where more than `MOST_EMPTY` would be left out, the averages are longer.
    """
    when = np.asarray(stamps_s, np.float64)
    since = when - when[:1]
    span = float(since[-1]) if when.size else 0.0
    length = max(SHORTEST_S, span / POINTS)
    while True:
        count = int(span // length)
        place = (since / length).astype(np.int64)
        inside = place < count
        held = np.bincount(place[inside], minlength=count)
        full = held > 0.5 * held.max(initial=0)
        if np.count_nonzero(full) < LEAST_POINTS:
            raise DataError(_too_few(span))
        if np.count_nonzero(~full) <= MOST_EMPTY:
            break
        length *= 2.0

    def mean(values: Floats) -> Floats:
        # around the first value: gravity must not cost digits
        sums = np.bincount(place[inside], values[inside] - values[0], minlength=count)
        return np.asarray(values[0] + sums[full] / held[full], np.float64)

    return Averages(np.flatnonzero(full), mean(since), mean(temperature), mean(data))


def _too_few(span: float) -> str:
    if span >= LEAST_POINTS * SHORTEST_S:
        return 'most of the recording is missing: record it again without gaps'
    return f'{span:.3g} s are too short: {LEAST_POINTS} averages of {SHORTEST_S:g} s at least'


def phases(time: Floats, temperature: Floats) -> Phases:
    """
    Return when it was heated, hot and cooled.

    Heating begins where the straight line through the points at which 5 and 20 % of the rise
    have been passed for good meets the temperature before.

    Raises
    ------
    DataError
        If the temperature spans less than `LEAST_SPAN`.

    Examples
    --------
    >>> t = np.arange(0.0, 1000.0, 10.0)
    >>> found = phases(t, np.interp(t, [200, 500, 700, 1000], [20, 80, 80, 20]))
    >>> round(found.heating), found.hot, found.cooling, found.cooled
    (200, 490.0, 710.0, True)
    """
    low, high = float(temperature.min()), float(temperature.max())
    span = high - low
    if span < LEAST_SPAN:
        raise DataError(
            f'the temperature changes by {span:.2g} K only; heat by {LEAST_SPAN:g} K or more'
        )
    share = (temperature - low) / span
    near = np.flatnonzero(share >= _TOP)
    rising = share[: near[0] + 1]

    def passed(part: float) -> int:
        below = np.flatnonzero(rising < part)
        return int(below[-1]) + 1 if below.size else 0

    first, second = passed(_BOTTOM), passed(0.2)
    heating = float(time[0])
    if first > 0 and second > first:
        slope = (share[second] - share[first]) / (time[second] - time[first])
        settled = float(np.median(share[: max(first // 2, 1)]))
        heating = max(heating, float(time[first] - (share[first] - settled) / slope))
    return Phases(heating, float(time[near[0]]), float(time[near[-1]]), 1.0 - float(share[-1]))


def analyse(
    stamps_s: npt.ArrayLike,
    data: npt.ArrayLike,
    temperature: npt.ArrayLike,
    unit: str,
    confidence: float = CONFIDENCE,
) -> Thermal:
    """
    Return what temperature does to one axis.

    The model is bias = b + c (T - T_m) + h (1 - u²) when cooling, u from -1 to 1 over the
    temperatures, plus white noise, flicker noise and a random walk (see
    `imu_bench.metrology.trials.drifting`): what comes back at the same temperature is
    temperature, what does not is drift.  On an axis along gravity a change of the scale
    factor looks the same as one of the bias.

    Parameters
    ----------
    stamps_s : array_like, shape (n,)
        s since the first sample.
    temperature : array_like, shape (n,)
        °C, of the sensor itself.
    unit : str
        Of the data.

    Raises
    ------
    DataError
        If the recording is too short, or the temperature hardly changes.

    Examples
    --------
    >>> t = np.arange(0.0, 3000.0, 0.1)
    >>> T = np.interp(t, [300, 1500, 1800, 3000], [25, 65, 65, 25])
    >>> x = 0.5 + 2e-3 * (T - 25) + np.random.default_rng(2).normal(scale=0.01, size=t.size)
    >>> found = analyse(t, x, T, 'm/s²')
    >>> round(found.coefficient.value, 4), found.coefficient.unit
    (0.002, 'm/s²/K')
    """
    when, values = np.asarray(stamps_s, np.float64), np.asarray(data, np.float64)
    held = averages(when, values, np.asarray(temperature, np.float64))
    found = phases(held.time, held.temperature)
    middle = 0.5 * float(held.temperature.min() + held.temperature.max())
    off = held.temperature - middle
    reach = 0.5 * float(np.ptp(off))
    columns = [np.ones_like(off), off]
    if found.cooled:
        # a loop that closes at both ends of the temperatures, when it cools
        columns.append((1.0 - (off / reach) ** 2) * (held.time > found.cooling))
    model = regress(held.index, np.column_stack(columns), held.bias)
    bent = regress(held.index, np.column_stack([*columns, off**2]), held.bias)
    if found.cooled:
        loop = model.coefficient(_LOOP, unit, confidence)
    else:
        reason = 'the temperature does not come back: let it cool in the same recording'
        loop = Estimate.not_observable(unit, reason, confidence=confidence)
    return Thermal(
        coefficient=model.coefficient(1, f'{unit}/K', confidence),
        reference=middle,
        at_reference=model.coefficient(0, unit, confidence),
        curvature=bent.coefficient(len(columns), unit, confidence).scaled(reach**2, unit),
        hysteresis=loop,
        branches=_branches(model, held, found, unit, confidence),
        change=_ends(when, values, float(when[-1]), unit, confidence),
        change_hot=_ends(when, values, found.cooling, unit, confidence),
        warm_up=_warm_up(when, values, found, unit, confidence),
        averages=held,
    )


def _sides(held: Averages, found: Phases) -> tuple[Mask, Mask]:
    up = (held.time >= found.heating) & (held.time < found.hot)
    return up, held.time > found.cooling


def _between(held: Averages, sides: tuple[Mask, Mask], ends: tuple[float, float]) -> Floats | None:
    """Return the weights of the second branch minus the first between two temperatures."""
    inside = (held.temperature >= ends[0]) & (held.temperature < ends[1])
    up, down = (side & inside for side in sides)
    if not up.any() or not down.any():
        return None
    return np.asarray(down / np.count_nonzero(down) - up / np.count_nonzero(up), np.float64)


def _branches(
    model: Regression, held: Averages, found: Phases, unit: str, confidence: float
) -> tuple[tuple[float, Estimate], ...]:
    if not found.cooled:
        return ()
    low, high = float(held.temperature.min()), float(held.temperature.max())
    edges = low + (high - low) * np.linspace(_BOTTOM, _TOP, BINS + 1)
    made = []
    for ends in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        weights = _between(held, _sides(held, found), ends)
        if weights is not None:
            made.append((0.5 * sum(ends), model.contrast(weights, _LOOP, unit, confidence)))
    return tuple(made)


def _mean(values: Floats, chosen: Mask | slice, unit: str, confidence: float) -> Estimate:
    return Moments.of(values[chosen][None, :]).mean_estimate(0, unit, confidence)


def _ends(when: Floats, values: Floats, until: float, unit: str, confidence: float) -> Estimate:
    """Return the mean near a time minus the mean at the start."""
    length = _END_SHARE * float(when[-1] - when[0])
    start = _mean(values, when < when[0] + length, unit, confidence)
    end = _mean(values, (when > until - length) & (when <= until), unit, confidence)
    return difference(end, start)


def _warm_up(
    when: Floats, values: Floats, found: Phases, unit: str, confidence: float
) -> Estimate:
    length = found.heating - float(when[0])
    if length < LEAST_S:
        reason = f'heating begins after {max(length, 0.0):.0f} s: wait 10 min before it'
        return Estimate.not_observable(unit, reason, confidence=confidence)
    start = _mean(values, when < when[0] + 0.1 * length, unit, confidence)
    end = _mean(
        values, (when > found.heating - 0.1 * length) & (when < found.heating), unit, confidence
    )
    return difference(end, start)
