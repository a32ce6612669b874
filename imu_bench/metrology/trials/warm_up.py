# SPDX-License-Identifier: Apache-2.0
"""How a sensor warms itself after it is switched on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math

from imu_bench.metrology.estimate import CONFIDENCE, Estimate
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]

LEAST_S = 60.0
"""Shorter times before a sensor is heated from outside show nothing of its own heat."""


@dataclass(frozen=True)
class WarmUp:
    """How a sensor warms itself after it is switched on: rise in K, and its time constant in s."""

    rise: Estimate
    time_constant: Estimate


def warm_up(
    stamps_s: npt.ArrayLike,
    temperature: npt.ArrayLike,
    until_s: float,
    confidence: float = CONFIDENCE,
) -> WarmUp:
    """
    Return the exponential by which the temperature of a sensor settles.

    Parameters
    ----------
    stamps_s, temperature : array_like, shape (n,)
        s since the first sample, and °C.
    until_s : float
        When something else begins to heat it.

    Examples
    --------
    >>> t = np.arange(0.0, 900.0, 1.0)
    >>> rng = np.random.default_rng(1)
    >>> found = warm_up(t, 24 - 1.5 * np.exp(-t / 180) + rng.normal(scale=0.01, size=900), 600)
    >>> round(found.rise.value, 1), round(found.time_constant.value / 10) * 10
    (1.5, 180)
    """
    when, values = np.asarray(stamps_s, np.float64), np.asarray(temperature, np.float64)
    chosen = when < until_s
    reason = ''
    if np.count_nonzero(chosen) < 20 or until_s - when[0] < LEAST_S:
        reason = f'less than {LEAST_S:g} s before it is heated from outside'
    else:
        t, y = when[chosen] - when[0], values[chosen]
        step = max(1, t.size // 1000)
        t, y = t[::step], y[::step]
        rise = float(np.median(y[-max(t.size // 10, 2) :]) - y[0])
        scatter = float(np.std(np.diff(y))) / math.sqrt(2.0)
        if abs(rise) < 5.0 * max(scatter, 1e-3):
            reason = f'the temperature changes by {abs(rise):.2g} K only'
    if reason:
        return WarmUp(*(Estimate.not_observable(unit, reason, confidence=confidence)
                        for unit in ('K', 's')))  # fmt: skip
    return _exponential(t, y, rise, confidence)


def _exponential(t: Floats, y: Floats, rise: float, confidence: float) -> WarmUp:
    def settling(parameters: Floats) -> Floats:
        end, change, log_time = parameters
        return np.asarray(end - change * np.exp(-t / np.exp(log_time)) - y, np.float64)

    guess = np.array([y[-1], rise, math.log(t[-1] / 4.0)])
    bounds = ([-np.inf, -np.inf, math.log(t[1])], [np.inf, np.inf, math.log(10.0 * t[-1])])
    found = scipy.optimize.least_squares(settling, guess, bounds=bounds)
    freedom = t.size - 3
    # quantised readings repeat themselves: count only those that differ
    fresh = max(int(np.unique(y).size), 4)
    variance = 2.0 * float(found.cost) / freedom * max(t.size / fresh, 1.0)
    covariance = variance * np.linalg.pinv(found.jac.T @ found.jac)
    return WarmUp(
        _with(float(found.x[1]), covariance[1, 1], 'K', confidence, lambda value: value),
        _with(float(found.x[2]), covariance[2, 2], 's', confidence, math.exp),
    )


def _with(
    value: float, variance: float, unit: str, confidence: float, to: Callable[[float], float]
) -> Estimate:
    half = math.sqrt(max(variance, 0.0)) * float(scipy.special.ndtri(0.5 + confidence / 2.0))
    return Estimate(to(value), to(value - half), to(value + half), unit, confidence)
