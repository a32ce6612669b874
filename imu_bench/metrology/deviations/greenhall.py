# SPDX-License-Identifier: Apache-2.0
"""
Degrees of freedom of variances made of finite differences of power-law phase noise.

C. A. Greenhall and W. J. Riley, "Uncertainty of stability variances based on finite
differences", 35th PTTI Meeting (2003), pp. 267-280; equation and table numbers are those
of that paper.  Notation: d differences (2 Allan, 3 Hadamard), averaging factor m, stride
factor S (m with full overlap, 1 without), filter factor F (1 for the modified variances,
m otherwise), M differences in the estimate, ratio r = M/S.

One thing is not theirs.  For short averages they let the phase of a clock be averaged over
a sample period.  The phase of an inertial sensor is the exact sum of its samples, and white
noise means that those are uncorrelated; for m up to about 30 the covariance of such sampled
noise takes the place of theirs.  It matters below m = 10: at m = 1 white noise has 15 %
fewer degrees of freedom than their model gives, random walk 31 % more.
"""

from __future__ import annotations

from functools import lru_cache
import math

import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]

MAXIMUM_TERMS = 100
"""Terms after which the basic sum is abridged: J_max of the paper."""

_UNMODIFIED = {
    (1, 2): (790.0, 410.0), (1, 3): (9950.0, 6520.0),
    (0, 2): (2 / 3, 1 / 3), (0, 3): (7 / 9, 1 / 2),
    (-1, 2): (0.852, 0.375), (-1, 3): (0.997, 0.617),
    (-2, 2): (1.079, 0.368), (-2, 3): (1.033, 0.607),
    (-3, 3): (1.053, 0.553), (-4, 3): (1.302, 0.535),
}  # fmt: skip
"""(a0, a1) by (alpha, d): table 2."""

_MODIFIED = {
    (2, 2): (7 / 9, 1 / 2), (2, 3): (22 / 25, 2 / 3),
    (1, 2): (0.997, 0.616), (1, 3): (1.141, 0.843),
    (0, 2): (1.033, 0.607), (0, 3): (1.184, 0.848),
    (-1, 2): (1.048, 0.534), (-1, 3): (1.180, 0.816),
    (-2, 2): (1.302, 0.535), (-2, 3): (1.175, 0.777),
    (-3, 3): (1.194, 0.703), (-4, 3): (1.489, 0.702),
}  # fmt: skip
"""(a0, a1) by (alpha, d): table 1."""

_FLICKER_PHASE = {2: (15.23, 12.0), 3: (47.8, 40.0)}
"""(b0, b1) by d for alpha = 1: table 3."""


def inverse_edf(
    alpha: int, d: int, m: int, terms: int, stride: int, modified: bool, sampled: bool = True
) -> float:
    """
    Return 1/edf of a variance estimated from `terms` differences.

    Parameters
    ----------
    alpha : int
        Power law of the noise, -4 to 2.
    d : int
        Order of the phase difference: 2 of Allan, 3 of Hadamard variances.
    m : int
        Averaging factor.
    terms : int
        Number of differences.
    stride : int
        Differences per averaging time.
    modified : bool
        Whether the phase is averaged (modified variances).
    sampled : bool
        Whether noise at short averages is that of samples; without it the paper is followed.
    """
    if alpha == 2 and not modified:
        return _white_phase(d, terms, stride)
    norm = 1.0
    if alpha == 1 and not modified:
        b0, b1 = _FLICKER_PHASE[d]
        norm = (b0 + b1 * math.log(m)) ** 2
    count = min(terms, (d + 1) * stride)
    ratio = terms / stride
    short = m * (d + 1) <= MAXIMUM_TERMS
    if count <= MAXIMUM_TERMS:
        if sampled and short:
            first, second = _sampled_sum(count, m // stride, m, alpha, d, modified)
        else:
            smooth = 1.0 if modified else float(m) if alpha == 1 or short else math.inf
            first, second = _basic_sum(count, float(stride), smooth, alpha, d)
        return (first - second / terms) / terms
    if ratio > d + 1:
        a0, a1 = (_MODIFIED if modified else _UNMODIFIED)[alpha, d]
        return (a0 - a1 / ratio) / (ratio * norm)
    step = MAXIMUM_TERMS / ratio
    smooth = 1.0 if modified else step if alpha == 1 else math.inf
    first, second = _basic_sum(MAXIMUM_TERMS, step, smooth, alpha, d)
    if norm != 1.0:
        norm /= float(covariance(np.zeros(1), step, alpha, d)[0]) ** 2
    return (first - second / MAXIMUM_TERMS) / (MAXIMUM_TERMS * norm)


def _white_phase(d: int, terms: int, stride: int) -> float:
    """Return 1/edf for alpha = 2, where differences correlate at multiples of m only."""
    ratio = terms / stride
    centre = math.comb(2 * d, d)
    total = 1.0
    for k in range(1, min(d, math.ceil(ratio) - 1) + 1):
        total += 2.0 * (1.0 - k / ratio) * (math.comb(2 * d, d - k) / centre) ** 2
    return total / terms


@lru_cache(maxsize=8192)
def _basic_sum(
    count: int, stride: float, smooth: float, alpha: int, d: int
) -> tuple[float, float]:
    """Return (A, B) so that the sum (10) over M terms, over its value at lag 0, is A - B/M."""
    return _weighted(covariance(np.arange(count + 1) / stride, smooth, alpha, d))


@lru_cache(maxsize=8192)
def _sampled_sum(
    count: int, apart: int, m: int, alpha: int, d: int, modified: bool
) -> tuple[float, float]:
    """Return (A, B) of `_basic_sum` for sampled noise, differences `apart` samples apart."""
    lag = np.arange(count + 1) * apart
    # an average of the phase is one more difference of its sum
    order, delta = (d + 1, 2.0 - alpha / 2.0) if modified else (d, 1.0 - alpha / 2.0)
    steps, signs = _stencil(order)
    return _weighted(_fractional(np.abs(lag[:, None] + m * steps), delta) @ signs)


def _weighted(covariances: Floats) -> tuple[float, float]:
    squares = (covariances / covariances[0]) ** 2
    squares[1:-1] *= 2.0
    return float(squares.sum()), float(squares @ np.arange(squares.size))


def _stencil(d: int) -> tuple[Floats, Floats]:
    """Return lags and weights that turn the covariance of a phase into that of its differences."""
    steps = np.arange(-d, d + 1)
    weights = [(-1.0) ** k * math.comb(2 * d, d + k) for k in steps.tolist()]
    return steps.astype(np.float64), np.array(weights)


def covariance(lag: Floats, smooth: float, alpha: int, d: int) -> Floats:
    """
    Return the autocovariance s_z of d-th differences at lags in units of tau, equation (9).

    `smooth` is the filter factor F; infinity stands for m without limit.
    """
    steps, signs = _stencil(d)
    shifted = lag[:, None] + steps
    if math.isinf(smooth):
        filtered = _phase(shifted, alpha + 2)
    else:
        step = 1.0 / smooth
        filtered = smooth**2 * (
            2.0 * _phase(shifted, alpha)
            - _phase(shifted - step, alpha)
            - _phase(shifted + step, alpha)
        )
    return np.asarray(filtered @ signs, np.float64)


def _phase(lag: Floats, alpha: int) -> Floats:
    """Return the generalised autocovariance s_w of the phase, but for its sign: equation (7)."""
    distance = np.abs(lag)
    power = distance ** (3 - alpha)
    return (
        power if alpha % 2 == 0 else np.asarray(scipy.special.xlogy(power, distance), np.float64)
    )


def _fractional(lag: Floats, delta: float) -> Floats:
    """Return the generalised autocovariance of sampled noise summed to the order delta."""
    # Up to a factor it is Gamma(k + delta) / Gamma(k + 1 - delta) at lag k, the autocovariance
    # of fractionally integrated white noise (J. R. M. Hosking 1981, "Fractional differencing",
    # Biometrika 68(1):165), a polynomial for whole delta; for half-integers, where that is even in
    # k and differences wipe it out, what is left is its derivative by delta.
    roots = np.arange(1.0 - delta % 1.0, delta)
    product: Floats = np.prod(lag[..., None] ** 2 - roots**2, axis=-1)
    if delta % 1.0:
        product *= scipy.special.digamma(lag + delta) + scipy.special.digamma(lag + 1.0 - delta)
        return product
    product *= lag
    return product
