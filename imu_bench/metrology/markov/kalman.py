# SPDX-License-Identifier: Apache-2.0
"""
A Kalman filter that tracks a drifting bias under white noise, and how well it does.

The bias is a first-order Gauss-Markov process, the measurement is the bias plus white noise:
Shabulinzenze 2020 (Tampere University MSc thesis), sections 3.3.2 and 5.1.3.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

from imu_bench.errors import DataError
from imu_bench.metrology.curve import Floats
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
from imu_bench.metrology.markov.gauss_markov import Process
import numpy as np
import numpy.typing as npt
import scipy

Bools = npt.NDArray[np.bool_]

_SETTLED = 1e-10
"""Relative change of the gain at which it counts as constant."""

_LAGS = 20
"""Lags of the whiteness test."""

_UNLIKELY = 1e-3
"""
Probability below which innovations are not white: two tests call 2 of 1000 right models wrong.
"""

_BLOCK_SHARE = 0.25
"""Averages of the slow test, in correlation times: a drift is seen before it is forgotten."""

_BLOCKS = 60
"""Blocks that the slow whiteness test needs; fewer say nothing about 20 lags."""


@dataclass(frozen=True, eq=False)
class Whiteness:
    """Whether innovations are white, as those of a filter with the right model are."""

    # fast, slow: probability of autocorrelations this large by chance, between samples and between
    # averages over a quarter of the correlation time; `slow` is 1 for a short record
    fast: float
    slow: float
    variance: float  # mean square of the normalised innovations; 1 for the right noise levels
    white: bool  # whether both probabilities exceed one in a thousand


@dataclass(frozen=True, eq=False)
class Track:
    """A tracked bias.  All arrays have shape (n,)."""

    # bias, deviation: estimate after each sample and its standard deviation, in the unit of the
    # signal, mean of the signal included
    bias: Floats
    deviation: Floats
    # difference between each sample and its prediction over its standard deviation; 0 for missing
    # samples
    innovation: Floats
    valid: Bools  # false where a sample was missing
    whiteness: Whiteness


def white_sigma(two_sided_density: float, rate_hz: float) -> float:
    """
    Return the standard deviation of samples of white noise, N √rate.

    N is the two-sided density (the coefficient N of an Allan deviation).  A one-sided density
    of a datasheet gives density √(rate/2) instead; section 5.1.3 of the thesis named above
    multiplies a one-sided density with √rate, √2 too much.

    Examples
    --------
    >>> white_sigma(0.002, 100.0)
    0.02
    """
    return two_sided_density * math.sqrt(rate_hz)


def track(
    data: npt.ArrayLike,
    rate_hz: float,
    process: Process,
    white: float,
    *,
    valid: npt.ArrayLike | None = None,
) -> Track:
    """
    Track the bias of a signal.

    Parameters
    ----------
    data : array_like, shape (n,)
        Samples; their mean is taken off before and put back after.
    rate_hz : float
        Sample rate in Hz.
    process : Process
        Model of the bias about its mean.
    white : float
        Standard deviation of the white noise of a sample.
    valid : array_like of bool, shape (n,), optional
        False where a sample is missing: the filter predicts across.

    Raises
    ------
    DataError
        If the data hold no sample, one that is not finite or several axes, or a setting is not
        positive.

    Notes
    -----
    R. E. Kalman, J. Basic Eng. 82 (1960) 35, for one state: prediction with e^(−dt/T_c), gain
    P/(P + R).  The gain settles after a few correlation times of the filter; from there on the
    recursion is a linear filter with constant coefficients and runs as one.

    Examples
    --------
    >>> rng = np.random.default_rng(2)
    >>> drift = Process(1.0, 50.0)
    >>> x = drift.simulate(20_000, 10.0, rng) + rng.standard_normal(20_000)
    >>> track(x, 10.0, drift, 1.0).whiteness.white
    True
    """
    x, good = _checked(data, rate_hz, white, valid)
    mean = float(x[good].mean())
    filtered = _Filter(process, 1.0 / rate_hz, white**2, x.size)
    edges = np.flatnonzero(np.diff(good)) + 1
    for start, end in zip([0, *edges], [*edges, x.size], strict=True):
        if good[start]:
            filtered.update(x[start:end] - mean, int(start))
        else:
            filtered.predict(int(start), int(end))
    block = max(int(_BLOCK_SHARE * process.correlation_time * rate_hz), 1)
    innovation = filtered.innovation
    return Track(
        filtered.bias + mean,
        np.sqrt(filtered.variance),
        innovation,
        good,
        whiteness(innovation[good], block),
    )


class _Filter:
    """One state and its variance, running over an array piece by piece."""

    def __init__(self, process: Process, step: float, noise: float, n: int) -> None:
        self._transition = process.transition(step)
        self._drive = process.driving_variance(step)
        self._noise = noise
        self._stationary = process.sigma**2
        # before the first sample the process is anywhere in its stationary range
        self._state, self._spread = 0.0, self._stationary
        self._first = True
        self.bias = np.zeros(n)
        self.variance = np.zeros(n)
        self.innovation = np.zeros(n)

    def predict(self, start: int, end: int) -> None:
        """Carry the state across missing samples."""
        steps = np.arange(1, end - start + 1)
        decay = self._transition**steps
        self.bias[start:end] = self._state * decay
        self.variance[start:end] = self._stationary - decay**2 * (self._stationary - self._spread)
        self._state = float(self.bias[end - 1])
        self._spread = float(self.variance[end - 1])
        self._first = False

    def update(self, x: Floats, start: int) -> None:
        """Take in samples without gaps."""
        count, gain, before = self._settle(x, start)
        if count < x.size:
            rest = slice(start + count, start + x.size)
            keep = self._transition * (1.0 - gain)
            bias = _smoothed(gain * x[count:], keep, self._state)
            predicted = self._transition * np.concatenate([[self._state], bias[:-1]])
            self.bias[rest] = bias
            self.variance[rest] = self._spread
            self.innovation[rest] = (x[count:] - predicted) / math.sqrt(before + self._noise)
            self._state = float(bias[-1])

    def _settle(self, x: Floats, start: int) -> tuple[int, float, float]:
        """Run sample by sample until the gain is constant; return how many, gain, variance."""
        gain, before = 0.0, self._spread
        for index, sample in enumerate(x.tolist()):
            if self._first:
                predicted, before, self._first = self._state, self._spread, False
            else:
                predicted = self._transition * self._state
                before = self._transition**2 * self._spread + self._drive
            last, gain = gain, before / (before + self._noise)
            self._state = predicted + gain * (sample - predicted)
            self._spread = (1.0 - gain) * before
            at = start + index
            self.bias[at], self.variance[at] = self._state, self._spread
            self.innovation[at] = (sample - predicted) / math.sqrt(before + self._noise)
            if abs(gain - last) <= _SETTLED * gain:
                return index + 1, gain, before
        return x.size, gain, before


def _smoothed(drive: Floats, keep: float, before: float) -> Floats:
    """Return y with y[k] = keep y[k-1] + drive[k]; `before` is the first y[k-1]."""
    # As a system of equations with two diagonals: the import of scipy.signal, which has filters,
    # takes longer than most recordings.
    bands = np.empty((2, drive.size))
    bands[0], bands[1] = 1.0, -keep
    right = drive.copy()
    right[0] += keep * before
    solved, _ = scipy.linalg.lapack.dtbtrs(bands, right[:, None], uplo='L')
    return np.asarray(solved[:, 0], np.float64)


def whiteness(innovation: npt.ArrayLike, block: int) -> Whiteness:
    """
    Return whether normalised innovations are white.

    G. M. Ljung and G. E. P. Box, Biometrika 65 (1978) 297, over 20 lags.
    """
    x = np.asarray(innovation, np.float64)
    blocks = x.size // max(block, 1)
    fast = _ljung_box(x)
    slow = 1.0
    if block > 1 and blocks >= _BLOCKS:
        slow = _ljung_box(x[: blocks * block].reshape(blocks, block).mean(axis=1))
    variance = float(x @ x / x.size) if x.size else 0.0
    return Whiteness(fast, slow, variance, min(fast, slow) > _UNLIKELY)


def moving_average(
    data: npt.ArrayLike, rate_hz: float, window_s: float, valid: npt.ArrayLike | None = None
) -> Floats:
    """
    Return the centred moving average; at the ends, and at gaps, over what there is.

    Parameters
    ----------
    rate_hz : float
        Samples per second.
    window_s : float
        Length of the window in s.
    valid : array_like of bool, shape (n,), optional
        False where a sample is missing.

    Examples
    --------
    >>> moving_average([0.0, 3.0, 6.0, 9.0], 1.0, 3.0).tolist()
    [1.5, 3.0, 6.0, 7.5]
    """
    x, good = _checked(data, rate_hz, 1.0, valid)
    half = int(0.5 * window_s * rate_hz)
    index = np.arange(x.size)
    first, last = np.maximum(index - half, 0), np.minimum(index + half + 1, x.size)
    mean = float(x[good].mean())
    sums = np.concatenate([[0.0], np.cumsum(np.where(good, x - mean, 0.0))])
    counts = np.concatenate([[0], np.cumsum(good)])
    total, count = sums[last] - sums[first], counts[last] - counts[first]
    return np.asarray(mean + total / np.maximum(count, 1), np.float64)


def rmse(
    tracked: Track,
    data: npt.ArrayLike,
    rate_hz: float,
    window_s: float,
    *,
    unit: str = '1',
    confidence: float = CONFIDENCE,
) -> Estimate:
    """
    Return the RMS difference between a tracked bias and the smoothed measurement.

    Table 5.8 of the thesis named above lists it.  It measures agreement, not error: both come
    from the same samples.  Its interval counts the difference as correlated as it is.

    Parameters
    ----------
    data : array_like, shape (n,)
        The samples that were tracked.
    rate_hz : float
        Sample rate in Hz.
    window_s : float
        Length of the moving average in s.
    unit : str
        Unit of the samples.
    confidence : float
        Level of the interval.
    """
    smoothed = moving_average(data, rate_hz, window_s, tracked.valid)
    difference = (tracked.bias - smoothed)[tracked.valid]
    square = float(difference @ difference / difference.size)
    value = math.sqrt(square)
    centred = difference - difference.mean()
    power = float(centred @ centred)
    r = float(centred[1:] @ centred[:-1]) / power if power > 0.0 else 0.0
    # squares of a first-order process are correlated as r²
    degrees = max(difference.size * (1.0 - r**2) / (1.0 + r**2), 1.0)
    tail = 0.5 * (1.0 - confidence)
    low = value * math.sqrt(degrees / scipy.special.chdtri(degrees, tail))
    high = value * math.sqrt(degrees / scipy.special.chdtri(degrees, 1.0 - tail))
    return Estimate(value, low, high, unit, confidence, method='against the moving average')


def _checked(
    data: npt.ArrayLike, rate_hz: float, white: float, valid: npt.ArrayLike | None
) -> tuple[Floats, Bools]:
    x = np.asarray(data, np.float64)
    if x.ndim != 1:
        raise DataError(f'one axis at a time: data have {x.ndim} dimensions instead of 1')
    good = np.ones(x.size, np.bool_) if valid is None else np.asarray(valid, np.bool_)
    if good.shape != x.shape:
        raise DataError(f'valid has shape {good.shape}, data {x.shape}')
    if not good.any():
        raise DataError('no sample to work on')
    if not np.all(np.isfinite(x[good])):
        raise DataError('data hold NaN or infinite samples; mark them in valid')
    for name, number in (('sample rate in Hz', rate_hz), ('white noise', white)):
        if not (math.isfinite(number) and number > 0.0):
            raise DataError(f'the {name} must be positive, got {number}')
    return x, good


def _ljung_box(x: Floats) -> float:
    """Return the probability of autocorrelations this large in white noise."""
    centred = x - x.mean() if x.size else x
    power = float(centred @ centred)
    lags = min(_LAGS, x.size // 3)
    if lags < 1 or power == 0.0:
        return 1.0
    r = np.array([float(centred[k:] @ centred[:-k]) / power for k in range(1, lags + 1)])
    statistic = x.size * (x.size + 2) * float(np.sum(r**2 / (x.size - np.arange(1, lags + 1))))
    return float(scipy.special.chdtrc(lags, statistic))
