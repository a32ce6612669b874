# SPDX-License-Identifier: Apache-2.0
"""
A ride from one standstill to another: where it is, how fast, how far.

Velocity and displacement are integrals of the acceleration (Shabulinzenze 2020, Tampere
University MSc thesis, equations (2.7) and (2.8)).  A constant error of the acceleration grows in
them with time and its square; that both ends are at rest takes it out.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

from imu_bench.errors import DataError
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
from imu_bench.metrology.stretches import longest, stretches
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]

SMOOTHING_S = 0.25
"""The highest acceleration is also given averaged over this time, which vibration is not in."""

_BLOCK_S = 0.5
"""Acceleration is looked at in means over this time, which vibration is not in."""

_SHORTEST_S = 1.0
_LEAST = 0.1
"""
Push in s and m/s²: a lift starts more strongly (0.93 m/s² in the data set elevator_phone); drift
of a sensor does not reach it.
"""

_HAND = 0.5
_HAND_RATIO = 20.0
"""A block whose scatter is more than this, in m/s² and times the median, is handling."""

_PEAK_REACH = 3.0
"""Standard deviations of noise that the highest of many averages may be off by."""


@dataclass(frozen=True)
class Span:
    """Where a ride is, in samples."""

    # begin, end: from standstill to standstill, with a block of rest at either end
    begin: int
    end: int
    # first, last: what can be used around it, free of handling
    first: int
    last: int


@dataclass(frozen=True, eq=False)
class Ride:
    """A ride."""

    time: Floats  # s since the beginning of the ride
    # acceleration, velocity, displacement: m/s², m/s, m
    acceleration: Floats
    velocity: Floats
    displacement: Floats
    peak_acceleration: Estimate  # largest reading, vibration included
    smooth_acceleration: Estimate  # largest acceleration averaged over `SMOOTHING_S`
    peak_velocity: Estimate
    travel: Estimate
    closing: Estimate  # velocity at the end before it was taken out


def find_ride(acceleration: npt.ArrayLike, rate_hz: float) -> Span:
    """
    Return where a ride is: a push one way, and one as large the other way.

    Parameters
    ----------
    acceleration : array_like, shape (n,)
        Along the way of the ride, m/s²; a constant does not matter.

    Raises
    ------
    DataError
        If there is none; the text says what is missing.

    Examples
    --------
    >>> a = np.zeros(3000)
    >>> a[1000:1200], a[1800:2000] = 0.5, -0.5
    >>> span = find_ride(a, 100.0)
    >>> span.begin, span.end
    (950, 2050)
    """
    values = np.asarray(acceleration, dtype=np.float64)
    size = max(4, round(_BLOCK_S * rate_hz))
    count = values.size // size
    if count < 8:
        raise DataError(f'{values.size / rate_hz:.3g} s are too short for a ride')
    blocks = values[: count * size].reshape(count, size)
    mean = blocks.mean(axis=1)
    first, last = _undisturbed(blocks)
    off = mean[first:last] - np.median(mean[first:last])
    scale = float(np.median(np.abs(off))) * 1.4826
    limit = max(0.5 * _LEAST, 5.0 * scale)
    pushes = [
        (a, b, float(off[a:b].sum()) * _BLOCK_S)
        for sign in (1.0, -1.0)
        for a, b in stretches(sign * off > limit).tolist()
        if (b - a) * _BLOCK_S >= _SHORTEST_S and np.abs(off[a:b]).max() >= _LEAST
    ]
    forward = max((p for p in pushes if p[2] > 0), key=lambda p: p[2], default=None)
    back = min((p for p in pushes if p[2] < 0), key=lambda p: p[2], default=None)
    if forward is None or back is None:
        raise DataError(
            f'no ride found: nothing pushes it by {_LEAST:g} m/s² for {_SHORTEST_S:g} s one way '
            'and the other'
        )
    if not 0.5 < -forward[2] / back[2] < 2.0:
        raise DataError(
            f'no ride found: it gains {forward[2]:.2g} m/s and loses {-back[2]:.2g} m/s; a ride '
            'ends at rest'
        )
    begin = max(first, first + min(forward[0], back[0]) - 1)
    end = min(last, first + max(forward[1], back[1]) + 1)
    return Span(begin * size, end * size, first * size, last * size)


def _undisturbed(blocks: Floats) -> tuple[int, int]:
    """Return the longest run of blocks in which nobody handles the sensor."""
    scatter = np.diff(blocks, axis=1).std(axis=1) / math.sqrt(2.0)
    spread = np.maximum(scatter, blocks.std(axis=1) * (blocks.std(axis=1) > _HAND))
    calm = spread <= max(_HAND, _HAND_RATIO * float(np.median(scatter)))
    part = longest(calm)
    if part.start == part.stop:
        raise DataError('no ride found: no part of it is free of handling')
    return part.start, part.stop


def integrate_ride(
    acceleration: npt.ArrayLike, rate_hz: float, span: Span, confidence: float = CONFIDENCE
) -> Ride:
    """
    Return speed and distance of a ride that begins and ends at rest.

    Parameters
    ----------
    acceleration : array_like, shape (n,)
        Along the way, m/s², gravity and bias included.
    confidence : float
        Level of the intervals.

    Raises
    ------
    DataError
        If the span holds fewer than eight samples.

    Notes
    -----
    The mean over the ride is taken off, which is what is needed for the velocity to end at
    zero.  White noise of density N then leaves a Brownian bridge: N √T / 2 in the velocity half
    way and N T^(3/2) / √12 in the distance.  Where the mean of the ride differs from that of
    the rests on either side, an error was not constant: had it come all at once, at an unknown
    moment, it would leave up to half the closing velocity v in the velocity and v T / √12
    (standard deviation over the moments) in the distance.  Both are in the intervals; an error
    of the scale is not.

    Examples
    --------
    >>> a = np.full(3000, 9.8)
    >>> a[1000:1200] += 0.5
    >>> a[1800:2000] -= 0.5
    >>> ride = integrate_ride(a, 100.0, find_ride(a, 100.0))
    >>> round(ride.peak_velocity.value, 2), round(ride.travel.value, 2)
    (1.0, 8.0)
    """
    values = np.asarray(acceleration, dtype=np.float64)
    inside = values[span.begin : span.end]
    if inside.size < 8:
        raise DataError(f'a ride of {inside.size} samples')
    period = 1.0 / rate_hz
    bias = float(inside.mean())
    pure = inside - bias
    velocity = scipy.integrate.cumulative_trapezoid(pure, dx=period, initial=0.0)
    displacement = scipy.integrate.cumulative_trapezoid(velocity, dx=period, initial=0.0)
    duration = inside.size * period
    reach = float(scipy.special.ndtri(0.5 + confidence / 2.0))
    density, rest, known = _at_rest(values, rate_hz, span)
    drift = (bias - rest) * duration if known else 0.0
    fast = math.hypot(0.5 * density * math.sqrt(duration), 0.5 * drift)
    far = math.hypot(density * duration**1.5, drift * duration) / math.sqrt(12.0)
    smooth = scipy.ndimage.uniform_filter1d(
        pure, max(1, round(SMOOTHING_S * rate_hz)), mode='nearest'
    )
    error = _PEAK_REACH * density / math.sqrt(SMOOTHING_S)
    highest = float(np.abs(smooth).max())
    top = float(velocity[np.argmax(np.abs(velocity))])
    closing = Estimate.not_observable(
        'm/s', 'no rest on either side to take the bias from', confidence=confidence
    )
    if known:
        half = reach * density * math.sqrt(duration)
        closing = Estimate(drift, drift - half, drift + half, 'm/s', confidence)
    time = np.asarray(np.arange(inside.size) * period, np.float64)

    def estimate(value: float, half: float, unit: str, method: str) -> Estimate:
        return Estimate(value, value - half, value + half, unit, confidence, method=method)

    return Ride(
        time, pure, velocity, displacement,
        Estimate(float(np.abs(pure).max()), None, None, 'm/s²', confidence, method='observed'),
        estimate(highest, error, 'm/s²', f'mean over {SMOOTHING_S:g} s'),
        estimate(abs(top), reach * fast, 'm/s', 'integral, at rest at both ends'),
        estimate(abs(float(displacement[-1])), reach * far, 'm', 'twice integrated'),
        closing,
    )  # fmt: skip


def _at_rest(values: Floats, rate_hz: float, span: Span) -> tuple[float, float, bool]:
    """Return noise density (two-sided, N), mean at rest, and whether there was any rest."""
    size = max(4, round(_BLOCK_S * rate_hz))
    parts = [values[span.first : span.begin], values[span.end : span.last]]
    means = [
        part[: part.size // size * size].reshape(-1, size).mean(axis=1)
        for part in parts
        if part.size >= 2 * size
    ]
    if not means:
        inner = values[span.begin : span.end]
        return float(np.diff(inner).std() / math.sqrt(2.0 * rate_hz)), 0.0, False
    freedom = sum(m.size - 1 for m in means)
    variance = sum(float(np.sum((m - m.mean()) ** 2)) for m in means) / freedom
    # the mean of the two ends, whatever their lengths: a steady drift is half way there
    rest = float(np.mean([m.mean() for m in means]))
    return math.sqrt(variance * size / rate_hz), rest, True
