# SPDX-License-Identifier: Apache-2.0
"""
First-order Gauss-Markov processes: the drift of a bias with a memory.

Autocorrelation, correlation time and strength from it and from an Allan deviation curve, and the
exact discrete model.  `kalman` tracks a bias with it.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

from imu_bench.errors import DataError
from imu_bench.metrology.curve import DeviationCurve, Floats
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
from imu_bench.metrology.noise_model import (
    coefficient_unit,
    GaussMarkov,
    GM_PEAK,
    GM_PEAK_TAU,
)
import numpy as np
import numpy.typing as npt
from scipy import fft, special

_FEWEST_LAGS = 4
"""Lags that a decay needs before it can be told from one step."""

_LONGEST_SHARE = 0.05
"""
Longest correlation time over the record that the record can show.  The autocorrelation of a
random walk, which has none, falls to 1/e within this share in one of twenty records.
"""

_CROSSING_ERROR = 2.1
"""
Relative standard deviation of T_c read at 1/e, over √(T_c/T).  Bartlett's formula gives an
autocorrelation e^−s the variance T_c/T · (1 − e^−2s (1 + 2s)), 0.594 T_c/T at s = 1, and the
slope there is 1/e: √0.594 · e = 2.1.  M. S. Bartlett, J. R. Stat. Soc. Suppl. 8 (1946) 27.
"""

_WHITE_ON_SIGMA = 0.1
"""Share of the scatter that white noise adds to ln T_c which reaches 2 ln sigma (simulated)."""

_HIDDEN = 0.25
"""Variance of ln T_c from white noise above which the decay is hidden: it comes out too short."""


@dataclass(frozen=True)
class Process:
    """
    A stationary first-order Gauss-Markov process.

    Attributes
    ----------
    sigma : float
        Standard deviation.
    correlation_time : float
        T_c in s: the autocorrelation is sigma² e^(−|t|/T_c) (Shabulinzenze 2020, Tampere
        University MSc thesis, equation 3.26).

    Raises
    ------
    DataError
        If either is not positive.

    Examples
    --------
    >>> Process(2.0, 100.0).q_c.__round__(4)
    0.2828
    """

    sigma: float
    correlation_time: float

    def __post_init__(self) -> None:
        for name in ('sigma', 'correlation_time'):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise DataError(f'{name} of a Gauss-Markov process must be positive')

    @property
    def q_c(self) -> float:
        """Strength of the driving noise, sigma √(2/T_c): IEEE Std 952-1997 annex C."""
        return self.sigma * math.sqrt(2.0 / self.correlation_time)

    @classmethod
    def from_strength(cls, q_c: float, correlation_time: float) -> Process:
        """Return the process of a driving noise q_c: sigma = q_c √(T_c/2)."""
        if not correlation_time > 0.0:
            raise DataError(f'correlation time must be positive, got {correlation_time} s')
        return cls(q_c * math.sqrt(0.5 * correlation_time), correlation_time)

    def transition(self, step: float) -> float:
        """Return e^(−step/T_c): equation 3.27 of the thesis named above."""
        return math.exp(-step / self.correlation_time)

    def driving_variance(self, step: float) -> float:
        """
        Return the variance of the noise that a step in s adds, sigma² (1 − e^(−2 step/T_c)).

        Exact for any step.  Equation 3.29 of the thesis named above prints the index k in the
        exponent as well; with it the process would not be stationary.
        """
        return -(self.sigma**2) * math.expm1(-2.0 * step / self.correlation_time)

    def simulate(self, n: int, rate_hz: float, rng: np.random.Generator) -> Floats:
        """Return n samples, stationary from the first on."""
        from scipy.signal import lfilter  # half of the start-up time, and seldom needed

        step = 1.0 / rate_hz
        drive = rng.standard_normal(n) * math.sqrt(self.driving_variance(step))
        if n:
            drive[0] *= self.sigma / math.sqrt(self.driving_variance(step))
        return np.asarray(lfilter([1.0], [1.0, -self.transition(step)], drive), np.float64)


@dataclass(frozen=True, eq=False)
class Autocorrelation:
    """Autocorrelation of a signal about its mean: lags in s and values, both (k,)."""

    lag: Floats
    value: Floats
    unit: str
    span: float


@dataclass(frozen=True)
class Decay:
    """
    A Gauss-Markov process read from an autocorrelation.

    Attributes
    ----------
    sigma, T_c : Estimate
        Standard deviation and correlation time of the process.
    white : Estimate
        Standard deviation of the white noise on top, which adds to lag zero only.
    misfit : float
        RMS difference between the normalised autocorrelation and e^(−t/T_c) up to T_c.
    """

    sigma: Estimate
    T_c: Estimate
    white: Estimate
    misfit: float

    @property
    def process(self) -> Process | None:
        """The process, or None if the data do not show one."""
        if self.sigma.value is None or self.T_c.value is None:
            return None
        return Process(self.sigma.value, self.T_c.value)


def block_average(data: npt.ArrayLike, rate_hz: float, block_s: float) -> tuple[Floats, float]:
    """
    Return averages over blocks that do not overlap, and their rate in Hz.

    A process far below the white noise of a sample comes out once enough samples are averaged;
    a tenth of the correlation time costs the process nothing.  A moving average would do the
    same but leave neighbours that share samples, whose white noise looks correlated.

    Examples
    --------
    >>> averages, rate = block_average([0.0, 2.0, 4.0, 6.0, 9.0], 2.0, 1.0)
    >>> averages.tolist(), rate
    ([1.0, 5.0], 1.0)
    """
    x = _samples(data, rate_hz)
    size = max(round(block_s * rate_hz), 1)
    blocks = x.size // size
    if blocks < 2:
        raise DataError(f'{x.size / rate_hz:g} s of data hold no two blocks of {block_s:g} s')
    averages = x[: blocks * size].reshape(blocks, size).mean(axis=1)
    return np.asarray(averages, np.float64), rate_hz / size


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
    size = fft.next_fast_len(x.size + longest + 1, real=True)
    spectrum = fft.rfft(x, size)
    value = fft.irfft(spectrum.real**2 + spectrum.imag**2, size)[: longest + 1] / x.size
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
    correlation : Autocorrelation
    confidence : float
        Level of the intervals.

    Returns
    -------
    Decay
        Not observable, with the reason, where the autocorrelation does not decay like one.

    Notes
    -----
    Scatter for a record of T: sigma √(T_c/2T); T_c after Bartlett, see `_CROSSING_ERROR`.
    White noise of w times the variance of the process adds (w² + 2w (1 + e^−2))/n to the
    variance of a lag near T_c, by the same formula, and e² of that to the one of ln T_c.

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
    z = float(special.ndtri(0.5 + 0.5 * confidence))
    share, hidden = time / correlation.span, _white_scatter(correlation, start)
    if hidden > _HIDDEN:
        reason = 'white noise hides the decay: average over longer blocks, or record longer'
        return _no_decay(unit, reason, confidence)
    own = math.sqrt(0.5 * share + _WHITE_ON_SIGMA * hidden)
    # a crossing between few lags scatters more than the curve does: 1/lags, found by simulation
    error = math.sqrt(_CROSSING_ERROR**2 * share + hidden) * (1.0 + lag[1] / time)
    method = 'autocorrelation'
    return Decay(
        _spread(math.sqrt(start), z * own, unit, confidence, method),
        _spread(time, z * error, 's', confidence, method),
        Estimate(
            math.sqrt(max(float(value[0]) - start, 0.0)),
            None,
            None,
            unit,
            confidence,
            method=method,
        ),
        misfit,
    )


def from_allan(
    curve: DeviationCurve, *, white: float = 0.0, confidence: float | None = None
) -> GaussMarkov:
    """
    Return q_c and T_c from the peak of an Allan deviation curve.

    A process alone peaks at τ = 1.89 T_c with 0.437 q_c √T_c: IEEE Std 952-1997 annex C;
    Shabulinzenze 2020, Tampere University MSc thesis, section 3.1.4.

    Parameters
    ----------
    curve : DeviationCurve
    white : float
        Coefficient N of white noise to take off the curve first.
    confidence : float, optional
        Level written into the estimates; the intervals are those of the curve.

    Returns
    -------
    GaussMarkov
        Not observable, with the reason, where the curve has no peak.

    Notes
    -----
    T_c lies between the averaging times whose deviation cannot be told from the peak.  The
    whole-curve fit (`coefficients.fit` with term 'G') uses all points and is more precise.
    """
    level = curve.confidence if confidence is None else confidence
    unit = coefficient_unit(curve.unit, 'G')
    variance = curve.deviation**2 - white**2 / curve.tau
    usable = np.flatnonzero(variance > 0.0)
    method = 'peak of the Allan deviation'
    if usable.size < 3:
        reason = 'fewer than three averaging times rise above the white noise'
        return _no_peak(unit, reason, level, method)
    tau, deviation = curve.tau[usable], np.sqrt(variance[usable])
    scale = deviation / curve.deviation[usable]
    low, high = curve.low[usable] * scale, curve.high[usable] * scale
    top = int(np.argmax(deviation))
    if top in (0, usable.size - 1):
        end = 'shortest' if top == 0 else 'longest'
        reason = f'the curve is highest at its {end} averaging time: no peak'
        return _no_peak(unit, reason, level, method)
    if not (high[: top + 1].min() < low[top] and high[top:].min() < low[top]):
        reason = 'the peak does not stand out of the uncertainty of the curve: record longer'
        return _no_peak(unit, reason, level, method)
    peak_tau, peak = _vertex(np.log(tau[top - 1 : top + 2]), np.log(deviation[top - 1 : top + 2]))
    alike = np.flatnonzero(high >= low[top])
    first, last = tau[max(alike[0] - 1, 0)], tau[min(alike[-1] + 1, tau.size - 1)]
    times = np.array([peak_tau, min(first, peak_tau), max(last, peak_tau)]) / GM_PEAK_TAU
    # strength and time trade off against one another: their ends are combined
    strength = peak / (GM_PEAK * math.sqrt(times[0]))
    weakest = min(low[top] / (GM_PEAK * math.sqrt(times[2])), strength)
    strongest = max(high[top] / (GM_PEAK * math.sqrt(times[1])), strength)
    return GaussMarkov(
        Estimate(strength, weakest, strongest, unit, level, method=method),
        Estimate(times[0], times[1], times[2], 's', level, method=method),
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


def _vertex(x: Floats, y: Floats) -> tuple[float, float]:
    """Return (τ, deviation) of the top of the parabola through three points in logarithms."""
    a, b, c = np.polyfit(x - x[1], y - y[1], 2)
    shift = float(np.clip(-b / (2.0 * a), x[0] - x[1], x[2] - x[1])) if a < 0.0 else 0.0
    height = (a * shift + b) * shift + c
    return math.exp(float(x[1]) + shift), math.exp(float(y[1]) + height)


def _spread(value: float, relative: float, unit: str, confidence: float, method: str) -> Estimate:
    """Return an estimate whose interval is a factor wide: a time is never negative."""
    factor = math.exp(relative)
    return Estimate(value, value / factor, value * factor, unit, confidence, method=method)


def _no_decay(unit: str, reason: str, confidence: float) -> Decay:
    def blank(of: str) -> Estimate:
        return Estimate.not_observable(of, reason, confidence=confidence, method='autocorrelation')

    return Decay(blank(unit), blank('s'), blank(unit), 1.0)


def _no_peak(unit: str, reason: str, confidence: float, method: str) -> GaussMarkov:
    return GaussMarkov(
        Estimate.not_observable(unit, reason, confidence=confidence, method=method),
        Estimate.not_observable('s', reason, confidence=confidence, method=method),
    )
