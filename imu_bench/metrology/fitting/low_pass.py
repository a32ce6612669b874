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

Complex = npt.NDArray[np.complex128]

KINDS = ('analogue 1', 'analogue 2', 'digital 1', 'digital 2')
"""
Butterworth filters of first and second order that are tried; after a few correlation times they
differ in nothing.  An analogue one is in front of the sampling, and what it leaves of the noise
above half the rate folds back; so does what a chip filters at a higher rate, and an exponential
average is the same as 'analogue 1'.  A digital one lets nothing of half the rate through.
"""

WEAKEST = 3.4
"""
`LowPass.warped` beyond which a filter does nothing: a digital one of 0.49 sample rates, or an
analogue one of 9.5.
"""


@dataclass(frozen=True)
class LowPass:
    """A filter of unit gain at low frequencies."""

    # ln tan(π f_c τ0), by which the bilinear transform stretches the axis of frequencies, for a
    # cutoff (−3 dB) f_c and a sample period τ0; of an analogue filter ln(π f_c τ0)
    warped: float
    kind: str  # one of `KINDS`
    period: float  # sample period τ0 in s
    # share of the white noise that joins behind the filter, as that of rounding does
    floor: float = 0.0

    @property
    def cutoff(self) -> float:
        """Frequency in Hz at which the density has fallen to one half, but for what folds back."""
        w = math.exp(self.warped)
        return (w if self._analogue else math.atan(w)) / (math.pi * self.period)

    def gain(self, frequency: npt.ArrayLike) -> Floats:
        """
        Return the density that is left, shape (k,).

        Of a digital filter 1/(1 + (f/f_c)^(2 order)) with the frequencies that the bilinear
        transform s = (2/τ0) (z − 1)/(z + 1) gives at z = e^(2πifτ0): s = (2i/τ0) tan(πfτ0).
        Behind an analogue one it is the transform of the sampled autocovariance.
        """
        angle = np.minimum(np.pi * np.asarray(frequency, np.float64) * self.period, 1.5707)
        left = self._folded(2.0 * angle) if self._analogue else self._stretched(angle)
        result: Floats = self.floor + (1.0 - self.floor) * left
        return result

    @property
    def _analogue(self) -> bool:
        return self.kind.startswith('analogue')

    def _stretched(self, angle: Floats) -> Floats:
        """Return 1/(1 + (f/f_c)^(2 order)) at frequencies that the transform has stretched."""
        stretched = np.log(np.tan(angle)) - self.warped
        order = int(self.kind[-1])
        left: Floats = 1.0 / (1.0 + np.exp(np.minimum(2.0 * order * stretched, 700.0)))
        return left

    def _folded(self, angle: Floats) -> Floats:
        """Return 1 − 2 Re(A/(1 − p)) + 2 Re Σ A p^(k−1) cos(k angle), k from 1 on."""
        pole, weight = _OF_KIND[self.kind](np.exp(np.array(self.warped)))
        first, turn = weight * (1.0 - pole) ** 2, np.exp(1j * angle)
        waves = turn / (1.0 - pole * turn) + turn.conj() / (1.0 - pole * turn.conj())
        constant = 1.0 - 2.0 * (first / (1.0 - pole)).real
        folded: Floats = np.maximum(constant + (first * waves).real, 0.0)
        return folded

    def variance(self, tau: npt.ArrayLike) -> Floats:
        """
        Return the Allan variance of filtered white noise with N = 1, shape (k,).

        Examples
        --------
        >>> LowPass(math.log(0.1), 'digital 1', 0.01).variance([0.01, 100.0]).round(4).tolist()
        [0.8264, 0.01]
        """
        t = np.asarray(tau, np.float64)
        taken = deficit(t / self.period, self.warped, self.kind)
        result: Floats = (1.0 - (1.0 - self.floor) * taken) / t
        return result


def deficit(m: npt.ArrayLike, warped: npt.ArrayLike, kind: str) -> Floats:
    """
    Return the share of the Allan variance of white noise that a filter takes.

    A pole p of the filter adds Re(A p^(k−1)) to the autocovariance at lag k > 0, and summed over
    windows of m samples that gives Re(A (3 − 4 p^m + p^2m)/(1 − p)²)/m; for p → 1 it is the
    T/2τ (3 − 4 e^(−τ/T) + e^(−2τ/T)) of a continuous filter (IEEE Std 952-1997 annex C).
    """
    factors, w = np.asarray(m, np.float64), np.exp(np.asarray(warped, np.float64))
    pole, weight = _OF_KIND[kind](w)
    power = np.exp(factors * np.log(pole))
    return np.asarray((weight * (3.0 - 4.0 * power + power**2)).real / factors, np.float64)


def _analogue_1(w: Floats) -> tuple[Complex, Complex]:
    """Return pole and A/(1 − p)²: the autocovariance is (1 − p)/(1 + p) p^k, p = e^(−2w)."""
    pole = np.exp(-2.0 * w)
    return pole.astype(np.complex128), (pole / -np.expm1(-4.0 * w)).astype(np.complex128)


def _analogue_2(w: Floats) -> tuple[Complex, Complex]:
    """Return one pole of the pair, and A/(1 − p)² for both."""
    # The autocovariance is r e^(−ak) (cos ak + sin ak) = Re(r (1 − i) p^k), a = √2 w, and its
    # sum over all k is one.
    pole = np.exp((1j - 1.0) * math.sqrt(2.0) * w)
    rest = 1.0 - pole
    zeroth = 1.0 / (1.0 + 2.0 * ((1.0 - 1j) * pole / rest).real)
    return pole, zeroth * (1.0 - 1j) * pole / rest**2


def _digital_1(w: Floats) -> tuple[Complex, Complex]:
    """Return pole and A/(1 − p)²: the autocovariance is (1 − p²)/4 p^(k−1), p = (1−w)/(1+w)."""
    pole = (1.0 - w) / (1.0 + w)
    pole = np.where(np.abs(pole) < 1e-9, 1e-9, pole)
    return pole.astype(np.complex128), (0.25 / w).astype(np.complex128)


def _digital_2(w: Floats) -> tuple[Complex, Complex]:
    """Return one pole of the pair, and A/(1 − p)² for both, A by the residue at the pole."""
    s = w * np.exp(0.75j * np.pi)
    pole = (1.0 + s) / (1.0 - s)
    gain = (np.abs(1.0 - pole) ** 2 / 4.0) ** 2
    others = (pole - pole.conj()) * (1.0 - pole**2) * (1.0 - np.abs(pole) ** 2)
    return pole, 2.0 * gain * (1.0 + pole) ** 4 / (others * (1.0 - pole) ** 2)


_OF_KIND = dict(zip(KINDS, (_analogue_1, _analogue_2, _digital_1, _digital_2), strict=True))


def bends(tau: Floats, low_pass: LowPass) -> Floats:
    """
    Return the derivatives of `LowPass.variance`, shape (2, k).

    By `warped` and by `floor`.
    """
    m, step = tau / low_pass.period, 1e-3
    below, at, above = (deficit(m, low_pass.warped + s, low_pass.kind) for s in (-step, 0.0, step))
    by_cutoff = (1.0 - low_pass.floor) * (below - above) / (2.0 * step)
    return np.asarray(np.stack([by_cutoff, at]) / tau, np.float64)
