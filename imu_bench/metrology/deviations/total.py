# SPDX-License-Identifier: Apache-2.0
"""
The rest of the Allan family: total deviations, Thêo1 and ThêoH, MTIE and the rms time error.

They squeeze more out of the longest averaging times, or answer what a clock that is followed
wants to know.  All take the phase, the cumulative sum of a rate, of one stretch without gaps.
Definitions: W. J. Riley, "Handbook of Frequency Stability Analysis", NIST SP 1065 (2008),
sections 5.2.12 to 5.2.18.  None is corrected for the bias that its noise would give it, but
ThêoH, which finds that of Thêo1 by itself.

The total deviations take 9 m operations per sample, Thêo1 takes m/2: they are for a few
averaging times of records up to some 10⁵ samples.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

from imu_bench.errors import DataError
from imu_bench.metrology.deviations.allan_kernels import second_difference_sums
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

_LEAST = 12
"""Samples of the shortest Thêo1 that the bias of a longer one is found from."""

_TOGETHER = 1 << 21
"""Numbers that are worked on together."""

SHORT_SHARE = 0.2
"""Part of a record up to which ThêoH is the Allan deviation: SP 1065, equation (33)."""


def mtotdev(phase: Floats, m: Sequence[int], period: float) -> Floats:
    """
    Return the modified total deviation, shape (k,): SP 1065, equation (27).

    Parameters
    ----------
    phase : ndarray, shape (n + 1,)
        In unit times second.
    m : sequence of int, length k
        Averaging factors, at most (n + 1)/3.
    period : float
        Sample period in s.

    Raises
    ------
    DataError
        If a factor is too long for the record.

    Examples
    --------
    >>> phase = np.cumsum(np.r_[0.0, np.random.default_rng(1).normal(size=2000)])
    >>> mtotdev(phase, [1, 10], 1.0).round(2).tolist()  # white: 1 and 1/(10 √2), less 13 %
    [0.71, 0.2]
    """
    x = _checked(phase, m, 3)
    return np.array([math.sqrt(_over_stretches(x, f, 2.0)) / (f * period) for f in m])


def ttotdev(phase: Floats, m: Sequence[int], period: float) -> Floats:
    """
    Return the time total deviation τ/√3 of `mtotdev`, in unit times second: SP 1065, eq. (28).

    Examples
    --------
    >>> phase = np.cumsum(np.random.default_rng(1).normal(size=2000))
    >>> ratio = ttotdev(phase, [10], 0.1) / mtotdev(phase, [10], 0.1)
    >>> ratio.round(4).tolist()
    [0.5774]
    """
    tau = np.asarray(m, np.float64) * period
    return np.asarray(mtotdev(phase, m, period) * tau / math.sqrt(3.0), np.float64)


def htotdev(phase: Floats, m: Sequence[int], period: float) -> Floats:
    """
    Return the Hadamard total deviation, shape (k,): SP 1065, equation (29).

    Parameters and errors are those of `mtotdev`.  At m = 1 it is the overlapped Hadamard
    deviation, as in the published tables.

    Examples
    --------
    >>> phase = np.cumsum(np.random.default_rng(1).normal(size=2000))
    >>> htotdev(phase, [10], 1.0).round(2).tolist()
    [0.32]
    """
    x = _checked(phase, m, 3)
    rate = np.diff(x) / period
    found = []
    for factor in m:
        square = float(np.mean(np.diff(rate, 2) ** 2)) / 6.0 if factor == 1 else (
            _over_stretches(rate, factor, 6.0)
        )  # fmt: skip
        found.append(math.sqrt(square))
    return np.array(found)


def theo1(phase: Floats, m: Sequence[int], period: float) -> Floats:
    """
    Return Thêo1 at τ = 0.75 m periods, shape (k,): SP 1065, equation (30).

    Parameters
    ----------
    phase, period
        As for `mtotdev`.
    m : sequence of int, length k
        Even numbers up to n.

    Raises
    ------
    DataError
        If a number is odd, or too large for the record.

    Examples
    --------
    >>> phase = np.cumsum(np.random.default_rng(1).normal(size=2000))
    >>> theo1(phase, [40], 1.0).round(1).tolist()  # white: 1/√30
    [0.2]
    """
    x = _checked(phase, m, 1)
    if any(factor % 2 for factor in m):
        raise DataError(f'Thêo1 takes even numbers of samples, got {list(m)}')
    return np.array([math.sqrt(_theo_variance(x, f) / 0.75) / (f * period) for f in m])


def theoh(phase: Floats, m: Sequence[int], period: float) -> tuple[Floats, Floats]:
    """
    Return averaging times and ThêoH: the Allan deviation, and Thêo1 without bias beyond it.

    Parameters
    ----------
    phase, period
        As for `mtotdev`.
    m : sequence of int, length k
        Averaging factors up to 0.75 n; the long ones, beyond a fifth of the record, are taken
        to the nearest multiple of 1.5.

    Returns
    -------
    tau, deviation : ndarray, shape (k,)

    Notes
    -----
    SP 1065, equations (31) to (33).  The bias is the mean ratio of Allan variance and Thêo1 at
    τ = 9, 12, 15, ... samples up to a tenth of the record, so nothing is assumed of the noise.

    Examples
    --------
    >>> phase = np.cumsum(np.random.default_rng(1).normal(size=600))
    >>> tau, deviation = theoh(phase, [1, 10, 300], 1.0)
    >>> tau.tolist(), (deviation * tau**0.5).round(1).tolist()
    ([1.0, 10.0, 300.0], [1.0, 0.9, 1.4])
    """
    x = _checked(phase, m, 1)
    size = x.size - 1
    short = np.array([f for f in m if f <= SHORT_SHARE * size], np.int64)
    long = [2 * max(round(f / 1.5), 1) for f in m if f > SHORT_SHARE * size]
    if any(f > size for f in long):
        raise DataError(f'ThêoH reaches three quarters of {size} samples, not {max(m)}')
    tau = np.concatenate([short, 0.75 * np.array(long, np.float64)]) * period
    variance = _allan_variance(x, short, period)
    if long:
        bias = _theo_bias(x, period)
        variance = np.concatenate([variance, bias * theo1(x, long, period) ** 2])
    return tau, np.sqrt(variance)


def mtie(phase: Floats, m: Sequence[int]) -> Floats:
    """
    Return the maximum time interval error over m samples, shape (k,), in unit times second.

    The largest peak-to-peak phase in any window of m + 1 points: SP 1065, equation (36).

    Examples
    --------
    >>> mtie(np.array([0.0, 3.0, 1.0, 2.0]), [1, 3]).tolist()
    [3.0, 3.0]
    """
    x = _checked(phase, m, 1)
    found = []
    for factor in m:
        size = factor + 1
        inside = slice(size // 2, size // 2 + x.size - factor)
        highest = scipy.ndimage.maximum_filter1d(x, size)[inside]
        found.append(float(np.max(highest - scipy.ndimage.minimum_filter1d(x, size)[inside])))
    return np.array(found)


def tie_rms(phase: Floats, m: Sequence[int]) -> Floats:
    """
    Return the rms time interval error over m samples, shape (k,), in unit times second.

    SP 1065, equation (37): the rms of x[i + m] - x[i].

    Examples
    --------
    >>> tie_rms(np.array([0.0, 3.0, 1.0, 2.0]), [2]).tolist()
    [1.0]
    """
    x = _checked(phase, m, 1)
    return np.array([math.sqrt(float(np.mean((x[f:] - x[:-f]) ** 2))) for f in m])


def _checked(phase: npt.ArrayLike, m: Sequence[int], reach: int) -> Floats:
    x = np.asarray(phase, np.float64)
    if x.ndim != 1 or not np.all(np.isfinite(x)):
        raise DataError('the phase must be one row of finite numbers, of one stretch')
    if not len(m) or min(m) < 1 or reach * max(m) > x.size - (reach == 1):
        raise DataError(
            f'averaging factors must be from 1 to {(x.size - (reach == 1)) // reach} '
            f'for {x.size} points of the phase, got {list(m)}'
        )
    return x


def _over_stretches(points: Floats, m: int, scale: float) -> float:
    """Return the mean over all stretches of 3 m points of the second differences of m-averages."""
    # Each stretch loses the line through the means of its halves and is reflected at both ends.
    length = 3 * m
    half = length // 2
    place = np.arange(length) - 0.5 * (length - 1)
    stretches = np.lib.stride_tricks.sliding_window_view(points, length)
    together = max(1, _TOGETHER // (3 * length))
    total = 0.0
    for start in range(0, len(stretches), together):
        part = stretches[start : start + together]
        rise = part[:, length - half :].mean(axis=1) - part[:, :half].mean(axis=1)
        level = part - np.outer(rise / (length - half), place)
        level -= level.mean(axis=1, keepdims=True)
        back = level[:, ::-1]
        sums = np.cumsum(np.concatenate([np.zeros((len(part), 1)), back, level, back], 1), axis=1)
        averages = (sums[:, m:] - sums[:, :-m]) / m
        steps = averages[:, 2 * m :] - 2.0 * averages[:, m:-m] + averages[:, : -2 * m]
        total += float((steps[:, : 6 * m] ** 2).sum())
    return total / (6.0 * m * len(stretches) * scale)


def _theo_variance(x: Floats, m: int) -> float:
    half = m // 2
    total = 0.0
    for shift in range(half):
        steps = x[: x.size - m] - x[half - shift : x.size - half - shift]
        steps += x[m:] - x[half + shift : x.size - half + shift]
        total += float(steps @ steps) / (half - shift)
    return total / (x.size - m)


def _allan_variance(x: Floats, m: Integers, period: float) -> Floats:
    if not m.size:
        return np.empty(0)
    order = np.argsort(m, kind='stable')
    sums, terms = second_difference_sums(x, m[order], np.array([[0, x.size]], np.int64))
    variance = np.empty(m.size)
    variance[order] = sums / (2.0 * terms * (m[order] * period) ** 2)
    return variance


def _theo_bias(x: Floats, period: float) -> float:
    last = max((x.size - 1) // 30 - 3, 0)
    steps = np.arange(last + 1)
    # every one of them for short records; spread evenly over long ones
    steps = np.unique(np.linspace(0, last, min(last + 1, 64)).astype(np.int64))
    short = [int(9 + 3 * i) for i in steps]
    if x.size - 1 < _LEAST:
        raise DataError(f'ThêoH needs {_LEAST} samples or more, got {x.size - 1}')
    allan = _allan_variance(x, np.array(short), period)
    theo = theo1(x, [int(12 + 4 * i) for i in steps], period) ** 2
    return float(np.mean(allan / theo))
