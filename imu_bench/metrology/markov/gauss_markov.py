# SPDX-License-Identifier: Apache-2.0
"""
First-order Gauss-Markov processes: the drift of a bias with a memory.

The exact discrete model, and correlation time and strength from an Allan deviation curve.
`decay` reads them from an autocorrelation, `kalman` tracks a bias with them.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

from imu_bench.errors import DataError
from imu_bench.metrology.curve import DeviationCurve, Floats
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.fitting.noise_model import (
    coefficient_unit,
    GaussMarkov,
    GM_PEAK,
    GM_PEAK_TAU,
)
import numpy as np
import scipy


@dataclass(frozen=True)
class Process:
    """
    A stationary first-order Gauss-Markov process.

    Raises
    ------
    DataError
        If either is not positive.

    Examples
    --------
    >>> Process(2.0, 100.0).q_c.__round__(4)
    0.2828
    """

    sigma: float  # standard deviation
    # T_c in s: the autocorrelation is sigma² e^(−|t|/T_c) (Shabulinzenze 2020, Tampere University
    # MSc thesis, equation 3.26)
    correlation_time: float

    def __post_init__(self) -> None:
        for name in ('sigma', 'correlation_time'):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise DataError(f'{name} of a Gauss-Markov process must be positive')

    @property
    def q_c(self) -> float:
        """Strength of the driving noise, sigma √(2/T_c): IEEE Std 952-1997 annex C."""
        return self.sigma * math.sqrt(2.0 / self.correlation_time)

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
        step = 1.0 / rate_hz
        drive = rng.standard_normal(n) * math.sqrt(self.driving_variance(step))
        if n:
            drive[0] *= self.sigma / math.sqrt(self.driving_variance(step))
        return np.asarray(
            scipy.signal.lfilter([1.0], [1.0, -self.transition(step)], drive), np.float64
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


def _vertex(x: Floats, y: Floats) -> tuple[float, float]:
    """Return (τ, deviation) of the top of the parabola through three points in logarithms."""
    a, b, c = np.polyfit(x - x[1], y - y[1], 2)
    shift = float(np.clip(-b / (2.0 * a), x[0] - x[1], x[2] - x[1])) if a < 0.0 else 0.0
    height = (a * shift + b) * shift + c
    return math.exp(float(x[1]) + shift), math.exp(float(y[1]) + height)


def _no_peak(unit: str, reason: str, confidence: float, method: str) -> GaussMarkov:
    return GaussMarkov(
        Estimate.not_observable(unit, reason, confidence=confidence, method=method),
        Estimate.not_observable('s', reason, confidence=confidence, method=method),
    )
