# SPDX-License-Identifier: Apache-2.0
"""
The noise processes of one axis of an inertial sensor, one class each.

Every process is stable in rate: its coefficient describes the continuous
process, and the sample period only says where that process is read.  Every
process carries its state from block to block and owns its random generator,
drawing sample by sample, so that the stream does not depend on how it is cut
into blocks, nor on which other processes are switched on.

Definitions and Allan variances follow IEEE Std 952-1997, annex C: white noise
N²/τ, flicker 2 ln2/π·B², rate random walk K²τ/3, quantisation 3Q²/τ².

Flicker noise is approximated by a sum of independent first-order Gauss-Markov
processes, one per decade of correlation time.  Their sum has a rational spectrum,
so one white noise through one filter of the same order has the same distribution
as all of them: the filter is the minimum-phase factor of the spectrum (spectral
factorisation, derived in `_minimum_phase`): a constant cost per sample.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
import math
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq
from scipy.signal import sosfilt


class Noise(Protocol):
    """One process: made of its coefficient and its own generator."""

    def __init__(self, coefficient: float, rng: np.random.Generator) -> None: ...

    def sample(self, n: int, period_s: float) -> Array:
        """Return the next n samples at this period, shape (n,)."""
        ...


def white_sigma(density: float, period_s: float) -> float:
    """
    Return the standard deviation per sample of white noise of a one-sided density.

    A one-sided density S in unit/√Hz, flat up to the Nyquist frequency 1/(2T),
    has the variance S²/(2T).  The Allan coefficient is N = S/√2.
    """
    return density / math.sqrt(2.0 * period_s)


class White:
    """White noise of a one-sided density in unit/√Hz."""

    def __init__(self, coefficient: float, rng: np.random.Generator) -> None:
        self._density = coefficient
        self._rng = rng

    def sample(self, n: int, period_s: float) -> Array:
        """Return the next n samples, shape (n,)."""
        values = self._rng.standard_normal(n)
        values *= white_sigma(self._density, period_s)
        return values


class Flicker:
    """
    Flicker noise (bias instability) of coefficient B in the unit of the signal.

    The two-sided density of flicker noise is B²/(2πf) (IEEE Std 952-1997
    annex C).  Independent first-order Gauss-Markov processes of equal variance
    σ² whose correlation times are spaced by the ratio r have together the
    density σ²/(2 f ln r) between their corner frequencies: the sum of
    2σ²T/(1 + (2πfT)²) becomes an integral over dT/(T ln r).  Hence σ² = B² ln r/π.
    `flicker_filter` makes the sum of one white noise.  It starts in its stationary state.
    """

    def __init__(self, coefficient: float, rng: np.random.Generator) -> None:
        self._coefficient = coefficient
        self._rng = rng
        self._period_s = 0.0
        self._state = np.empty((0, 2))

    def sample(self, n: int, period_s: float) -> Array:
        """Return the next n samples, shape (n,)."""
        if period_s != self._period_s:
            self._adopt(period_s)
        if n == 0:
            return np.empty(0)
        drive = self._rng.standard_normal(n)
        drive *= self._coefficient
        sections = flicker_filter(period_s).sections
        values, self._state = sosfilt(sections, drive, zi=self._state)
        return np.asarray(values)

    def _adopt(self, period_s: float) -> None:
        """Begin at a rate; components slow enough to be there before and after go on."""
        new = flicker_filter(period_s)
        components = new.correlation @ self._rng.standard_normal(new.shares.size)
        if self._period_s:
            old = flicker_filter(self._period_s)
            state = self._state.ravel() / self._coefficient
            before = np.linalg.lstsq(old.modes, state, rcond=None)[0]
            kept = min(before.size, components.size)
            components[:kept] = (before * old.shares)[:kept] / new.shares[:kept]
        self._period_s = period_s
        self._state = (new.modes @ components * self._coefficient).reshape(-1, 2)


class RandomWalk:
    """Rate random walk of coefficient K in unit/√s; starts at zero."""

    def __init__(self, coefficient: float, rng: np.random.Generator) -> None:
        self._coefficient = coefficient
        self._rng = rng
        self._state = 0.0

    def sample(self, n: int, period_s: float) -> Array:
        """Return the next n samples, shape (n,)."""
        if n == 0:
            return np.empty(0)
        steps = self._rng.standard_normal(n)
        steps *= self._coefficient * math.sqrt(period_s)
        steps[0] += self._state
        path = np.cumsum(steps, out=steps)
        self._state = float(path[-1])
        return path


class Quantisation:
    """
    Quantisation noise of coefficient Q, in the unit of the integrated signal.

    The integral of the signal carries white noise of standard deviation Q, so
    the signal carries its difference over the sample period.
    """

    def __init__(self, coefficient: float, rng: np.random.Generator) -> None:
        self._coefficient = coefficient
        self._rng = rng
        self._state = float(rng.standard_normal())

    def sample(self, n: int, period_s: float) -> Array:
        """Return the next n samples, shape (n,)."""
        if n == 0:
            return np.empty(0)
        angles = self._rng.standard_normal(n)
        steps = np.diff(angles, prepend=self._state)
        self._state = float(angles[-1])
        steps *= self._coefficient / period_s
        return steps


Array = npt.NDArray[np.float64]

LONGEST_CORRELATION_S = 1e6
"""Correlation time of the slowest component: 11 days, beyond any recording here."""

RATIO = 10.0
"""Spacing of the correlation times: one component per decade keeps the floor within 1 %."""


def correlation_times(period_s: float) -> Array:
    """Return the correlation times of the components, from the longest to about the period."""
    count = max(1, 1 + round(math.log(LONGEST_CORRELATION_S / period_s, RATIO)))
    return LONGEST_CORRELATION_S * RATIO ** -np.arange(count, dtype=float)


@dataclass(frozen=True, eq=False)
class FlickerFilter:
    """Second-order sections for `scipy.signal.sosfilt`, and how to start them."""

    sections: Array  # driven by white noise of variance one, they give flicker noise of B = 1
    modes: Array  # states of the sections for one standard deviation of each of the n components
    # times n independent normal numbers: components as they are after a long time
    correlation: Array
    shares: Array  # what one standard deviation of a component adds to the output


@lru_cache(maxsize=64)
def flicker_filter(period_s: float) -> FlickerFilter:
    """Return the filter for a sample period."""
    # 1 - pole and 1 - zero, without cancellation
    poles = -np.expm1(-period_s / correlation_times(period_s))
    zeros, gain = _minimum_phase(poles)
    # sigma² = B² ln r / π: IEEE Std 952-1997 annex C, see `noise.Flicker`
    gain *= math.sqrt(math.log(RATIO) / math.pi)
    # the slowest with the fastest, so that no polynomial has two roots close to one
    last = len(poles) - 1
    pairs = [sorted({k, last - k}) for k in range(last // 2 + 1)]
    sections = np.array([[*_polynomial(zeros[own]), *_polynomial(poles[own])] for own in pairs])
    sections[0, :3] *= gain
    # states x' = a x + e of the sum of partial fractions have the covariance 1/(1 - a_k a_l)
    covariance = 1.0 / (poles[:, None] + poles - np.outer(poles, poles))
    sigma = np.sqrt(np.diag(covariance))
    modes, leaving = _modes(sections, pairs, zeros, poles)
    return FlickerFilter(
        sections,
        modes * sigma,
        np.linalg.cholesky(covariance / np.outer(sigma, sigma)),
        leaving * sigma,
    )


def _minimum_phase(gaps: Array) -> tuple[Array, float]:
    """Return 1 - zero of the minimum-phase factor, and its gain, for unit variances."""
    # With v = (1 - z)²/z, the density of a process of pole a = 1 - g and unit variance is
    # (1 - a²)/a / (v_a - v), v_a = g²/a.  The sum has one zero between neighbouring poles,
    # and one at z = 0.
    poles = 1.0 - gaps
    places = gaps**2 / poles
    weights = gaps * (2.0 - gaps) / poles

    def density(log_v: float) -> float:
        return float(np.sum(weights / (places - math.exp(log_v))))

    edges = np.log(places)
    v = np.exp(
        [brentq(density, low + 1e-9, high - 1e-9, xtol=1e-14) for low, high in pairwise(edges)]
    )
    zeros = np.sqrt(v + v**2 / 4.0) - v / 2.0
    gain = math.sqrt(weights.sum() * np.prod(poles) / np.prod(1.0 - zeros))
    return np.append(zeros, 1.0), gain


def _polynomial(gaps: Array) -> Array:
    """Return the coefficients of up to two roots, given as 1 - root."""
    numbers = np.poly(1.0 - gaps)
    return np.concatenate([numbers, np.zeros(3 - numbers.size)])


def _modes(
    sections: Array, pairs: list[list[int]], zeros: Array, poles: Array
) -> tuple[Array, Array]:
    """
    Return states of the sections (direct form II transposed) and output for each pole's mode.

    A mode's share of a state is the residue of the transfer function up to there.
    """
    states = np.zeros((2 * len(sections), len(poles)))
    done: list[int] = []
    entering = np.zeros(len(poles))
    gain = 1.0
    for j, (own, (b0, _, b2, _, _, a2)) in enumerate(zip(pairs, sections, strict=True)):
        done += own
        gain *= b0
        leaving = gain * _residues(done, zeros, poles)
        states[2 * j] = leaving - b0 * entering
        states[2 * j + 1] = (b2 * entering - a2 * leaving) / (1.0 - poles)
        entering = leaving
    return states, entering


def _residues(which: list[int], zeros: Array, poles: Array) -> Array:
    """Return the residue at each pole of the product of some (z - zero)/(z - pole)."""
    found = np.zeros(len(poles))
    for k in which:
        others = [i for i in which if i != k]
        found[k] = np.prod(zeros[which] - poles[k]) / np.prod(poles[others] - poles[k])
    return found
