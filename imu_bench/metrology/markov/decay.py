# SPDX-License-Identifier: Apache-2.0
"""
A correlation time read from an autocorrelation, with an interval that holds for short records.

A record of a few dozen correlation times scatters the time at which its autocorrelation falls to
1/e far more, and further down, than theory for long records says.  How far was simulated once.
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

_METHOD = 'autocorrelation'

_FEWEST_LAGS = 4
"""Lags that a decay needs before it can be told from one step."""

_LONGEST_SHARE = 0.05
"""
Longest correlation time over the record that the record can show.  The autocorrelation of a
random walk, which has none, falls to 1/e within this share in one of twenty records.
"""

_SHARES = np.array([0.003, 0.01, 0.02, 0.035, 0.06, 0.1, 0.2, 0.5])
"""Correlation times over the record of the simulation below."""

_SCORES = (-2.5, -2.0, -1.0, 0.0, 1.0, 2.0, 2.5)
"""Its quantiles, as quantiles of a normal distribution."""

_READ = np.array([
    [-6.090, -6.039, -5.938, -5.823, -5.698, -5.545, -5.465],
    [-5.110, -5.023, -4.850, -4.656, -4.424, -4.101, -3.870],
    [-4.610, -4.500, -4.277, -4.020, -3.699, -3.215, -2.869],
    [-4.252, -4.121, -3.851, -3.536, -3.135, -2.586, -2.195],
    [-4.041, -3.837, -3.506, -3.111, -2.646, -2.040, -1.756],
    [-3.835, -3.636, -3.232, -2.791, -2.307, -1.802, -1.611],
    [-3.646, -3.440, -2.969, -2.467, -1.978, -1.606, -1.517],
    [-3.511, -3.242, -2.761, -2.232, -1.778, -1.535, -1.488],
])  # fmt: skip
"""
Quantiles of the logarithm of the T_c that is read, over the record, by the true share of T_c:
6000 processes of each share, `from_autocorrelation` without white noise.  For long records they
tend to the normal distribution after M. S. Bartlett, J. R. Stat. Soc. Suppl. 8 (1946) 27: an
autocorrelation e^−s has the variance T_c/T · (1 − e^−2s (1 + 2s)), 0.594 T_c/T at s = 1, and the
slope there is 1/e, which makes 2.1 √(T_c/T) of T_c.
"""

_WHITE_ON_SIGMA = 0.1
"""Share of the scatter that white noise adds to ln T_c which reaches 2 ln sigma (simulated)."""

_HIDDEN = 0.25
"""Variance of ln T_c from white noise above which the decay is hidden: it comes out too short."""


@dataclass(frozen=True, eq=False)
class Autocorrelation:
    """Autocorrelation of a signal about its mean: lags in s and values, both (k,)."""

    lag: Floats
    value: Floats
    unit: str
    span: float


@dataclass(frozen=True)
class Decay:
    """A Gauss-Markov process read from an autocorrelation."""

    # sigma, T_c: standard deviation and correlation time of the process
    sigma: Estimate
    T_c: Estimate
    white: Estimate  # standard deviation of the white noise on top, which adds to lag zero only
    misfit: float  # RMS difference between the normalised autocorrelation and e^(−t/T_c) up to T_c

    @property
    def process(self) -> Process | None:
        """The process, or None if the data do not show one."""
        if self.sigma.value is None or self.T_c.value is None:
            return None
        return Process(self.sigma.value, self.T_c.value)


def autocorrelation(
    data: npt.ArrayLike, rate_hz: float, *, longest_s: float | None = None, unit: str = '1'
) -> Autocorrelation:
    """
    Return the (biased) autocorrelation about the mean.

    Parameters
    ----------
    data : array_like, shape (n,)
        Samples without gaps.
    rate_hz : float
        Sample rate in Hz.
    longest_s : float, optional
        Longest lag in s; half the record if not given.
    unit : str
        Unit of the samples.

    Raises
    ------
    DataError
        If there are fewer than two samples, some are not finite, or there are several axes.

    Notes
    -----
    R(k) = 1/n Σ x_i x_(i+k), by a zero-padded FFT.  Divided by n and not by n − k it is a
    positive sequence, and its long lags are not dominated by a handful of products.

    Examples
    --------
    >>> r = autocorrelation([1.0, -1.0, 1.0, -1.0], 1.0)
    >>> r.value.round(2).tolist()
    [1.0, -0.75, 0.5]
    """
    x = _samples(data, rate_hz)
    x = x - x.mean()
    longest = x.size // 2 if longest_s is None else min(int(longest_s * rate_hz), x.size - 1)
    size = scipy.fft.next_fast_len(x.size + longest + 1, real=True)
    spectrum = scipy.fft.rfft(x, size)
    value = scipy.fft.irfft(spectrum.real**2 + spectrum.imag**2, size)[: longest + 1] / x.size
    lag = np.arange(longest + 1) / rate_hz
    return Autocorrelation(lag, np.asarray(value, np.float64), unit, x.size / rate_hz)


def from_autocorrelation(correlation: Autocorrelation, *, confidence: float = CONFIDENCE) -> Decay:
    """
    Return the Gauss-Markov process whose autocorrelation this is.

    T_c is the lag at which the autocorrelation has fallen to 1/e (Shabulinzenze 2020, Tampere
    University MSc thesis, section 5.1.3) of its value at lag zero without white noise.  White
    noise adds to lag zero only, so that value is extrapolated from the lags behind it.

    Parameters
    ----------
    confidence : float
        Level of the intervals.

    Returns
    -------
    Decay
        Not observable, with the reason, where the autocorrelation does not decay like one.

    Notes
    -----
    The interval of T_c holds every time whose processes show the one that is read, by the
    simulation in `_READ`.  The scatter of sigma is that of a record of T: sigma √(T_c/2T).
    White noise of w times the variance of the process adds (w² + 2w (1 + e^−2))/n to the
    variance of a lag near T_c, by Bartlett's formula, and e² of that to the one of ln T_c.

    Examples
    --------
    >>> x = Process(1.0, 2.0).simulate(200_000, 10.0, np.random.default_rng(1))
    >>> decay = from_autocorrelation(autocorrelation(x, 10.0, longest_s=100.0))
    >>> 1.8 < decay.T_c.value < 2.2
    True
    """
    lag, value, unit = correlation.lag, correlation.value, correlation.unit
    start, reason = _without_white(value)
    if reason:
        return _no_decay(unit, reason, confidence)
    below = np.flatnonzero(value[1:] <= start / math.e)
    longest = _LONGEST_SHARE * correlation.span
    if not below.size or lag[below[0] + 1] > longest:
        reason = f'the autocorrelation has not fallen to 1/e after {min(lag[-1], longest):.3g} s'
        return _no_decay(unit, f'{reason}: record longer, or this is a random walk', confidence)
    at = int(below[0]) + 1
    if at < _FEWEST_LAGS:
        reason = f'the autocorrelation falls to 1/e within {at} samples: no memory to speak of'
        return _no_decay(unit, reason, confidence)
    share = (value[at - 1] - start / math.e) / (value[at - 1] - value[at])
    time = float(lag[at - 1] + share * (lag[at] - lag[at - 1]))
    normalised = value[1 : at + 1] / start
    misfit = float(np.sqrt(np.mean((normalised - np.exp(-lag[1 : at + 1] / time)) ** 2)))
    z = float(scipy.special.ndtri(0.5 + 0.5 * confidence))
    share, hidden = time / correlation.span, _white_scatter(correlation, start)
    if hidden > _HIDDEN:
        reason = 'white noise hides the decay: average over longer blocks, or record longer'
        return _no_decay(unit, reason, confidence)
    # a crossing between few lags scatters more than the curve does: 1/lags, found by simulation
    shortest, longest = _true_shares(share, z, hidden, 1.0 + lag[1] / time)
    if math.isinf(longest):
        reason = f'a decay within {time:.3g} s can be that of a random walk: record longer'
        return _no_decay(unit, reason, confidence)
    white = math.sqrt(max(float(value[0]) - start, 0.0))
    ends = shortest * correlation.span, longest * correlation.span
    return Decay(
        _sigma(math.sqrt(start), z, share, longest, hidden, unit, confidence),
        Estimate(time, min(ends[0], time), max(ends[1], time), 's', confidence, method=_METHOD),
        Estimate(white, None, None, unit, confidence, method=_METHOD),
        misfit,
    )


def _samples(data: npt.ArrayLike, rate_hz: float) -> Floats:
    x = np.asarray(data, np.float64)
    if x.ndim != 1:
        raise DataError(f'one axis at a time: data have {x.ndim} dimensions instead of 1')
    if x.size < 2:
        raise DataError(f'{x.size} samples; an autocorrelation needs 2')
    if not np.all(np.isfinite(x)):
        raise DataError('data hold NaN or infinite samples')
    if not (math.isfinite(rate_hz) and rate_hz > 0.0):
        raise DataError(f'the sample rate must be positive, got {rate_hz} Hz')
    return x


def _white_scatter(correlation: Autocorrelation, start: float) -> float:
    """Return the variance of ln T_c that white noise causes; see `from_autocorrelation`."""
    white = max(float(correlation.value[0]) / start - 1.0, 0.0)
    samples = correlation.span / float(correlation.lag[1])
    return math.e**2 * (white**2 + 2.0 * white * (1.0 + math.exp(-2.0))) / samples


def _true_shares(read: float, z: float, hidden: float, coarse: float) -> tuple[float, float]:
    """
    Return the shortest and the longest T_c over the record that goes with the one that is read.

    They are where that is just the upper, and just the lower, quantile of score z of what a
    process shows; the longest is infinite if a random walk shows it as well.
    """
    reach = min(z, _SCORES[-1])
    low, middle, high = (
        np.array([np.interp(score, _SCORES, row) for row in _READ]) for score in (-reach, 0, reach)
    )
    # below the simulated ones the scatter goes with the root of the share, the bias with it
    shorter = _SHARES[0] * 0.25 ** np.arange(12.0, 0.0, -1.0)
    ratio = np.concatenate([shorter / _SHARES[0], np.ones(_SHARES.size)])
    shares = np.log(np.concatenate([shorter, _SHARES]))
    first = np.zeros(shorter.size, np.int64)
    row = np.concatenate([first, np.arange(_SHARES.size)])
    centre = shares + (middle - np.log(_SHARES))[row] * ratio

    def ends(off: Floats) -> Floats:
        own = off[row] ** 2 * ratio * (z / reach) ** 2
        return np.asarray(coarse * np.sqrt(own + z**2 * hidden), np.float64)

    tops = np.maximum.accumulate(centre + ends(high - middle))
    bottoms = np.maximum.accumulate(centre - ends(middle - low))
    shortest = np.interp(math.log(read), tops, shares)
    longest = np.interp(math.log(read), bottoms, shares, right=math.inf)
    return math.exp(float(shortest)), math.exp(float(longest))


def _without_white(value: Floats) -> tuple[float, str]:
    """Return the autocorrelation at lag zero without white noise, or why there is none."""
    if value.size <= _FEWEST_LAGS:
        return 0.0, f'{value.size} lags; a decay needs more than {_FEWEST_LAGS}'
    if value[0] <= 0.0:
        return 0.0, 'the signal never changes: stuck, or below its own resolution'
    if value[1] <= 0.0:
        return 0.0, 'neighbouring samples are not correlated: white noise only'
    below = np.flatnonzero(value[1:] <= value[1] / math.e)
    count = int(below[0]) if below.size else value.size - 1
    if count < _FEWEST_LAGS - 1:
        return float(value[1]), ''
    k = np.arange(1, count + 1)
    slope, logarithm = np.polyfit(k, np.log(value[1 : count + 1]), 1)
    if slope >= 0.0:
        return 0.0, 'the autocorrelation does not fall'
    return min(math.exp(float(logarithm)), float(value[0])), ''


def _sigma(
    sigma: float, z: float, share: float, longest: float, hidden: float, unit: str,
    confidence: float,
) -> Estimate:  # fmt: skip
    """Return the standard deviation with its interval."""
    # A record that happens to vary little also shows a T_c that is too short, and its mean has
    # followed a part of the process, T_c/T of sigma: the upper end takes a T_c half way, by
    # logarithm, to the longest possible one.
    slow = math.sqrt(share * longest)
    low = math.exp(-z * math.sqrt(0.5 * share + _WHITE_ON_SIGMA * hidden))
    high = (1.0 + slow) * math.exp(z * math.sqrt(0.5 * slow + _WHITE_ON_SIGMA * hidden))
    return Estimate(sigma, sigma * low, sigma * high, unit, confidence, method=_METHOD)


def _no_decay(unit: str, reason: str, confidence: float) -> Decay:
    def blank(of: str) -> Estimate:
        return Estimate.not_observable(of, reason, confidence=confidence, method=_METHOD)

    return Decay(blank(unit), blank('s'), blank(unit), 1.0)
