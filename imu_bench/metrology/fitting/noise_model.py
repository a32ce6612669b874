# SPDX-License-Identifier: Apache-2.0
"""
The noise of an inertial sensor as a sum of power laws, and what each does to the Allan variance.

Coefficients as in IEEE Std 952-1997 annex C: Q quantisation, N angle or velocity random walk
(white noise), B bias instability (flicker), K rate random walk, R rate ramp, and optionally one
Gauss-Markov process (q_c, T_c).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
import math

from imu_bench.errors import DataError, UnitError
from imu_bench.metrology.curve import Floats
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.fitting.low_pass import LowPass
from imu_bench.units import term_unit
import numpy as np
import numpy.typing as npt

TERMS = 'QNBKR'
"""The power-law coefficients, from short to long averaging times."""

TERM_NAMES = {
    'Q': 'quantisation',
    'N': 'white noise',
    'B': 'bias instability',
    'K': 'rate random walk',
    'R': 'rate ramp',
    'G': 'Gauss-Markov noise',
}

FLICKER_FLOOR = math.sqrt(2.0 * math.log(2.0) / math.pi)
"""Deviation of flicker noise over B, 0.664: IEEE Std 952-1997 annex C."""

GM_PEAK = 0.437
"""Highest deviation of a Gauss-Markov process over q_c √T_c: IEEE Std 952-1997 annex C."""

GM_PEAK_TAU = 1.89
"""Averaging time of that highest deviation over T_c: IEEE Std 952-1997 annex C."""


def variance_basis(tau: npt.ArrayLike, terms: str = TERMS) -> Floats:
    """
    Return the Allan variance of each noise term whose coefficient is one.

    IEEE Std 952-1997 annex C: 3/τ² (Q), 1/τ (N), 2 ln 2/π (B), τ/3 (K), τ²/2 (R).
    """
    t = np.asarray(tau, dtype=np.float64)
    rows = {
        'Q': lambda: 3.0 / t**2,
        'N': lambda: 1.0 / t,
        'B': lambda: np.full_like(t, FLICKER_FLOOR**2),
        'K': lambda: t / 3.0,
        'R': lambda: t**2 / 2.0,
    }
    return np.array([rows[term]() for term in terms])


def gauss_markov_variance(tau: npt.ArrayLike, correlation_time: float) -> Floats:
    """
    Return the Allan variance of a first-order Gauss-Markov process with q_c = 1.

    IEEE Std 952-1997 annex C, as in Shabulinzenze 2020 (Tampere University MSc thesis)
    equation 3.20: T_c²/τ · (1 − T_c/2τ · (3 − 4 e^(−τ/T_c) + e^(−2τ/T_c))).  Below τ = T_c/100
    its series T_c (x/3 − x²/4 + 7x³/60), x = τ/T_c, is used: the closed form cancels there.

    Parameters
    ----------
    tau : array_like, shape (k,)
        Averaging times in s.
    correlation_time : float
        T_c in s.

    Raises
    ------
    DataError
        If the correlation time is not positive.

    Examples
    --------
    >>> float(gauss_markov_variance([189.0], 100.0)[0] ** 0.5 / 100.0**0.5).__round__(3)
    0.437
    """
    if not correlation_time > 0.0:
        raise DataError(f'correlation time must be positive, got {correlation_time} s')
    x = np.asarray(tau, dtype=np.float64) / correlation_time
    inner = -4.0 * np.expm1(-x) + np.expm1(-2.0 * x)
    closed = (1.0 - inner / (2.0 * x)) / x
    series = x / 3.0 - x**2 / 4.0 + 7.0 * x**3 / 60.0
    result: Floats = correlation_time * np.where(x < 1e-2, series, closed)
    return result


def density_basis(frequency: npt.ArrayLike, period: float, terms: str = TERMS) -> Floats:
    """
    Return the one-sided power spectral density of each term whose coefficient is one.

    IEEE Std 952-1997 annex C gives them two-sided; one-sided is twice that.  White: 2 N².
    Flicker: B²/(π f).  Random walk: 2 K²/(2πf)².  Quantisation of rate sampled every τ0:
    8 Q²/τ0 · sin²(πfτ0).  The ramp is deterministic and has no density (zero).
    """
    f = np.asarray(frequency, dtype=np.float64)
    rows = {
        'Q': lambda: 8.0 / period * np.sin(np.pi * f * period) ** 2,
        'N': lambda: np.full_like(f, 2.0),
        'B': lambda: 1.0 / (np.pi * f),
        'K': lambda: 2.0 / (2.0 * np.pi * f) ** 2,
        'R': lambda: np.zeros_like(f),
    }
    return np.array([rows[term]() for term in terms])


def gauss_markov_density(frequency: npt.ArrayLike, correlation_time: float) -> Floats:
    """
    Return the one-sided density of a first-order Gauss-Markov process with q_c = 1.

    Twice the two-sided density of IEEE Std 952-1997 annex C: 2 T_c²/(1 + (2πfT_c)²).
    """
    f = np.asarray(frequency, dtype=np.float64)
    result: Floats = 2.0 * correlation_time**2 / (1.0 + (2.0 * np.pi * f * correlation_time) ** 2)
    return result


def coefficient_unit(unit: str, term: str) -> str:
    """
    Return the unit of a coefficient of a signal in any unit; 'G' stands for q_c.

    Examples
    --------
    >>> coefficient_unit('rad/s', 'K'), coefficient_unit('1', 'N')
    ('rad/s²/√Hz', '1/√Hz')
    """
    letter = 'K' if term == 'G' else term
    try:
        return term_unit(unit, letter)
    except UnitError:
        suffix = {'Q': '·s', 'N': '/√Hz', 'B': '', 'K': '/s/√Hz', 'R': '/s'}[letter]
        return f'{unit}{suffix}'


@dataclass(frozen=True)
class GaussMarkov:
    """Strength q_c and correlation time T_c of a first-order Gauss-Markov process."""

    q_c: Estimate
    T_c: Estimate


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """The noise coefficients of one axis."""

    unit: str  # unit of the signal, 'm/s²' or 'rad/s'
    # Q, N, B, K, R: the coefficients; one that the data do not support is not observable
    Q: Estimate
    N: Estimate
    B: Estimate
    K: Estimate
    R: Estimate
    # present when it was asked for and the data support it
    gauss_markov: GaussMarkov | None = None
    # the filter behind which the white noise is seen, where one bends the curve
    low_pass: LowPass | None = None
    # its cutoff (−3 dB) in Hz
    bandwidth: Estimate | None = None
    # coefficients of the fitted curve by letter.  More than the observable ones where the curve
    # shows something that could be either of two terms
    fitted: Mapping[str, float] = field(default_factory=dict)
    method: str = ''  # how the coefficients were found
    # tau_low, tau_high: averaging times in s over which the model was fitted
    tau_low: float = 0.0
    tau_high: float = math.inf
    chi2: float = 1.0  # mean squared residual over its expectation; about 1 for a model that fits
    flags: tuple[str, ...] = ()  # what a reader should know, one sentence each

    def __str__(self) -> str:
        return '\n'.join(f'{term} = {getattr(self, term)}' for term in 'QNBKR')

    @property
    def tau_flat(self) -> float:
        """
        Averaging time in s from which on no filter matters: `tau_low`, or later behind a filter.

        Its frequencies, up to 1/2τ, then end at a tenth of the cutoff, where a filter of first
        order takes one percent of the density.
        """
        return (
            self.tau_low
            if self.low_pass is None
            else max(self.tau_low, 5.0 / self.low_pass.cutoff)
        )

    @property
    def coefficients(self) -> dict[str, Estimate]:
        """The five power-law coefficients by letter."""
        return {'Q': self.Q, 'N': self.N, 'B': self.B, 'K': self.K, 'R': self.R}

    @property
    def values(self) -> dict[str, float]:
        """The coefficients that the data support, by letter, in SI."""
        return {t: e.value for t, e in self.coefficients.items() if e.value is not None}

    @property
    def terms(self) -> str:
        """The letters of the coefficients that the data support."""
        return ''.join(self.values)

    def deviation(self, tau: npt.ArrayLike) -> Floats:
        """
        Return the Allan deviation of the fitted curve.

        Parameters
        ----------
        tau : array_like, shape (k,)
            Averaging times in s.

        Returns
        -------
        ndarray of float64, shape (k,)
            In the unit of the signal.
        """
        t = np.asarray(tau, dtype=np.float64)
        values = self.fitted or self.values
        variance = variance_of(values, t)
        if self.low_pass is not None:
            white = values.get('N', 0.0) ** 2
            variance = variance + white * (self.low_pass.variance(t) - 1.0 / t)
        if self.gauss_markov is not None:
            strength, time = self.gauss_markov.q_c.value, self.gauss_markov.T_c.value
            if strength is not None and time is not None:
                variance = variance + strength**2 * gauss_markov_variance(t, time)
        result: Floats = np.sqrt(variance)
        return result


def variance_of(values: Mapping[str, float], tau: npt.ArrayLike) -> Floats:
    """
    Return the Allan variance of a sum of terms given by their coefficients.

    Examples
    --------
    >>> variance_of({'N': 2.0}, [1.0, 4.0]).tolist()
    [4.0, 1.0]
    """
    t = np.asarray(tau, dtype=np.float64)
    squares = np.array([v**2 for v in values.values()])
    if not values:
        return np.zeros_like(t)
    result: Floats = squares @ variance_basis(t, ''.join(values))
    return result
