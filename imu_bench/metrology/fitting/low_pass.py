# SPDX-License-Identifier: Apache-2.0
"""
White noise behind the low-pass filter of a sensor: what the filter does to the Allan variance.

Every inertial sensor filters before it samples.  The filter takes nothing from the density at low
frequencies, so N is the same with and without it, but it bends the start of the curve down:
from a few correlation times T on by the factor 1 − 3T/2τ, whatever the filter.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

from imu_bench.metrology.curve import Floats
import numpy as np
import numpy.typing as npt

ORDERS = (1, 2)
"""Orders that are tried; after a few correlation times they differ in nothing."""

WEAKEST = 3.4
"""Logarithm of `warped` beyond which a filter does nothing: a cutoff of 0.49 sample rates."""


@dataclass(frozen=True)
class LowPass:
    """
    A digital Butterworth filter of unit gain.

    Attributes
    ----------
    warped : float
        ln tan(π f_c τ0), by which the bilinear transform stretches the axis of frequencies, for
        a cutoff (−3 dB) f_c and a sample period τ0.
    order : int
        1 or 2.
    period : float
        Sample period τ0 in s.
    """

    warped: float
    order: int
    period: float

    @property
    def cutoff(self) -> float:
        """Frequency in Hz at which the density has fallen to one half."""
        return math.atan(math.exp(self.warped)) / (math.pi * self.period)

    def gain(self, frequency: npt.ArrayLike) -> Floats:
        """
        Return the density that is left, shape (k,): 1/(1 + (tan(πfτ0)/tan(πf_cτ0))^(2 order)).

        A. V. Oppenheim and R. W. Schafer, Discrete-Time Signal Processing (3rd ed. 2010),
        sections 7.2.2 and 7.3.
        """
        angle = np.minimum(np.pi * np.asarray(frequency, np.float64) * self.period, 1.5707)
        stretched = np.log(np.tan(angle)) - self.warped
        result: Floats = 1.0 / (1.0 + np.exp(np.minimum(2.0 * self.order * stretched, 700.0)))
        return result

    def variance(self, tau: npt.ArrayLike) -> Floats:
        """
        Return the Allan variance of filtered white noise with N = 1, shape (k,).

        Examples
        --------
        >>> LowPass(math.log(0.1), 1, 0.01).variance([0.01, 100.0]).round(4).tolist()
        [0.8264, 0.01]
        """
        t = np.asarray(tau, np.float64)
        result: Floats = (1.0 - deficit(t / self.period, self.warped, self.order)) / t
        return result


def deficit(m: npt.ArrayLike, warped: npt.ArrayLike, order: int) -> Floats:
    """
    Return the share of the Allan variance of white noise that a filter takes.

    A pole p of the filter adds Re(A p^(k−1)) to the autocovariance at lag k > 0, and summed over
    windows of m samples that gives Re(A (3 − 4 p^m + p^2m)/(1 − p)²)/m; for p → 1 it is the
    T/2τ (3 − 4 e^(−τ/T) + e^(−2τ/T)) of a continuous filter (IEEE Std 952-1997 annex C).

    Parameters
    ----------
    m : array_like
        Averaging factors, at least 1.
    warped : array_like
        `LowPass.warped`, of a shape that broadcasts with `m`.
    order : int
        1 or 2.

    Examples
    --------
    >>> deficit([1.0, 1e4], [math.log(0.1)], 1).round(5).tolist()
    [0.99174, 0.00075]
    """
    factors, w = np.asarray(m, np.float64), np.exp(np.asarray(warped, np.float64))
    pole, weight = _first_order(w) if order == 1 else _second_order(w)
    power = np.exp(factors * np.log(pole))
    return np.asarray((weight * (3.0 - 4.0 * power + power**2)).real / factors, np.float64)


def _first_order(w: Floats) -> tuple[npt.NDArray[np.complex128], npt.NDArray[np.complex128]]:
    """Return pole and A/(1 − p)²: the autocovariance is (1 − p²)/4 p^(k−1), p = (1−w)/(1+w)."""
    pole = (1.0 - w) / (1.0 + w)
    pole = np.where(np.abs(pole) < 1e-9, 1e-9, pole)
    return pole.astype(np.complex128), (0.25 / w).astype(np.complex128)


def _second_order(w: Floats) -> tuple[npt.NDArray[np.complex128], npt.NDArray[np.complex128]]:
    """Return one pole of the pair, and A/(1 − p)² for both, A by the residue at the pole."""
    s = w * np.exp(0.75j * np.pi)
    pole = (1.0 + s) / (1.0 - s)
    gain = (np.abs(1.0 - pole) ** 2 / 4.0) ** 2
    others = (pole - pole.conj()) * (1.0 - pole**2) * (1.0 - np.abs(pole) ** 2)
    return pole, 2.0 * gain * (1.0 + pole) ** 4 / (others * (1.0 - pole) ** 2)


def bend(tau: Floats, low_pass: LowPass) -> Floats:
    """Return the derivative of `LowPass.variance` by `warped`, shape (k,)."""
    m, step = tau / low_pass.period, 1e-3
    above, below = (deficit(m, low_pass.warped + s, low_pass.order) for s in (step, -step))
    return np.asarray((below - above) / (2.0 * step * tau), np.float64)
