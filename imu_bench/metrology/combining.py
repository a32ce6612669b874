# SPDX-License-Identifier: Apache-2.0
"""Measured numbers put together: their intervals go along."""

from __future__ import annotations

import math

from imu_bench.errors import DataError
from imu_bench.metrology.estimate import Estimate
import numpy as np
import numpy.typing as npt
import scipy


def symmetric(
    value: float,
    error: float,
    unit: str,
    confidence: float,
    *,
    freedom: float = math.inf,
    method: str = '',
) -> Estimate:
    """Return an estimate from a standard error, by Student's distribution."""
    tail = 0.5 + confidence / 2.0
    quantile = (
        scipy.special.ndtri(tail) if math.isinf(freedom) else scipy.special.stdtrit(freedom, tail)
    )
    half = error * float(quantile)
    return Estimate(value, value - half, value + half, unit, confidence, method=method)


def shifted(estimate: Estimate, constant: float) -> Estimate:
    """
    Return an estimate plus an exact constant of the same unit.

    Examples
    --------
    >>> shifted(Estimate(2.0, 1.5, 2.5, 'rad'), -2.0).high
    0.5
    """
    if estimate.value is None:
        return estimate
    low, high = (None if end is None else end + constant for end in (estimate.low, estimate.high))
    return Estimate(
        estimate.value + constant, low, high, estimate.unit, estimate.confidence,
        method=estimate.method,
    )  # fmt: skip


def difference(first: Estimate, second: Estimate) -> Estimate:
    """
    Return first minus second, whose errors have nothing to do with each other.

    The distances from the values to the ends of the intervals are added as squares.

    Raises
    ------
    DataError
        If the units differ.

    Examples
    --------
    >>> found = difference(Estimate(5.0, 4.7, 5.3, 's'), Estimate(1.0, 0.6, 1.4, 's'))
    >>> found.value, found.low, found.high
    (4.0, 3.5, 4.5)
    """
    if first.unit != second.unit:
        raise DataError(f'no difference between {first.unit} and {second.unit}')
    if first.value is None or second.value is None:
        missing = first if first.value is None else second
        return Estimate.not_observable(first.unit, missing.reason, confidence=first.confidence)
    value = first.value - second.value
    if first.low is None or first.high is None or second.low is None or second.high is None:
        return Estimate(value, None, None, first.unit, first.confidence, method='difference')
    down = math.hypot(first.value - first.low, second.high - second.value)
    up = math.hypot(first.high - first.value, second.value - second.low)
    return Estimate(
        value, value - down, value + up, first.unit, first.confidence, method='difference'
    )


def sample_statistics(
    values: npt.ArrayLike, unit: str, confidence: float
) -> tuple[Estimate, Estimate]:
    """Return mean and standard deviation (n - 1) of a few independent numbers."""
    numbers = np.asarray(values, np.float64)
    if numbers.size < 2:
        raise DataError('a spread needs two numbers or more')
    freedom = numbers.size - 1
    std = float(numbers.std(ddof=1))
    mean = symmetric(
        float(numbers.mean()), std / math.sqrt(numbers.size), unit, confidence, freedom=freedom
    )
    tail = (1.0 - confidence) / 2.0
    low, high = (std * math.sqrt(freedom / float(scipy.special.chdtri(freedom, p)))
                 for p in (tail, 1.0 - tail))  # fmt: skip
    return mean, Estimate(std, low, high, unit, confidence)
