# SPDX-License-Identifier: Apache-2.0
"""
What an overlapped Allan variance sees of a spectrum: its mean, its scatter, its correlations.

An Allan variance at τ is the spectrum weighted with H(f) = 2 sin⁴(πfτ)/(m sin(πfτ0))², so its
scatter over records of length T is that of a periodogram weighted the same way: cumulant p of
Σ g_i s_i is (p−1)! ∫ (S Σ g_i H_i)^p df / T^(p−1).  That holds for any mixture of noises, which
tables of degrees of freedom for one power law do not, and gives the correlations between
averaging times for free.  Near the end of the record T shrinks to T − 1.5 τ: found against
Greenhall and Riley (35th PTTI, 2003) for white, flicker and random walk noise, with which the
degrees of freedom then agree within 8 % for 10 ≤ m ≤ n/4.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
import math

from imu_bench.metrology.curve import Floats, Integers
from imu_bench.metrology.fitting.noise_model import density_basis, TERMS
import numpy as np

_STEP = 0.05
"""Largest spacing of ln f: 20 points per factor e resolve the main lobe of H."""

_LOWEST = 0.005
"""Lowest frequency times the longest τ: what lies below adds under 1 % to any scatter."""

_END_LOSS = 1.5
"""Record lost to the end effect, in units of τ (module docstring)."""


@dataclass(frozen=True, eq=False)
class Transfer:
    """The weights H of a set of averaging times on a grid of frequencies."""

    # frequency, width: frequencies in Hz, and the part of the axis in Hz each stands for
    frequency: Floats
    width: Floats
    power: Floats  # H of each averaging time
    densities: Floats  # one-sided densities of Q, N, B, K and R with coefficient one
    cross: Floats  # ∫ D_a D_b H² df for every pair of densities: the scatter of every mixture


@lru_cache(maxsize=32)
def _cached(m: tuple[int, ...], period: float) -> Transfer:
    factors = np.array(m, dtype=np.float64)
    low, high = _LOWEST / (factors[-1] * period), 0.5 / period
    edges = np.geomspace(low, high, math.ceil(math.log(high / low) / _STEP) + 1)
    frequency, width = np.sqrt(edges[1:] * edges[:-1]), np.diff(edges)
    x = np.pi * frequency * period
    power = 2.0 * np.sin(factors[:, None] * x) ** 4 / (factors[:, None] * np.sin(x)) ** 2
    densities = density_basis(frequency, period, TERMS)
    pairs = densities[:, None, :] * densities[None, :, :] * width
    cross = pairs @ (power**2).T
    return Transfer(frequency, width, power, densities, cross)


def transfer(m: Integers, period: float) -> Transfer:
    """
    Return the weights of the averaging factors `m`, ascending, at sample period `period`.

    The result is kept, because a live analysis asks for the same factors again and again.
    """
    return _cached(tuple(int(v) for v in m), float(period))


def record_share(m: Integers, span: int) -> Floats:
    """Return the part of a record of `span` samples that each averaging factor can use."""
    share: Floats = np.clip(1.0 - _END_LOSS * m / span, 0.05, 1.0)
    return share


def overlapped_degrees(alpha: Integers, m: Integers, period: float, span: int) -> Floats:
    """
    Return the degrees of freedom of overlapped Allan variances of single power laws f^alpha.

    Parameters
    ----------
    alpha : ndarray of int, shape (k,)
        Exponent at each point; below −2 taken as −2, where the estimate still converges.
    m : ndarray of int64, shape (k,)
        Averaging factors, ascending.
    period : float
        Sample period in s.
    span : int
        Samples of a record without gaps.
    """
    seen = transfer(m, period)
    exponent = np.maximum(np.asarray(alpha, np.float64), -2.0)[:, None]
    # relative to the frequency that matters, 1/2τ, so that no power leaves the float range
    weighted = seen.power * (2.0 * seen.frequency * (m * period)[:, None]) ** exponent
    mean = weighted @ seen.width
    scatter = weighted**2 @ seen.width / (span * period * record_share(m, span))
    return np.asarray(2.0 * mean**2 / scatter, np.float64)
