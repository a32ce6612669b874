# SPDX-License-Identifier: Apache-2.0
"""
The noise processes of an inertial sensor, one class each.

Every process is stable in rate: its coefficient describes the continuous
process, and the sample period only says where that process is read.  Every
process carries its state from block to block and owns its random generator,
drawing sample by sample, so that the stream does not depend on how it is cut
into blocks, nor on which other processes are switched on.

Definitions and Allan variances follow IEEE Std 952-1997, annex C: white noise
N²/τ (C.1.1), flicker 2 ln2/π·B² (C.1.3), rate random walk K²τ/3 (C.1.2),
quantisation 3Q²/τ² (C.1.5).
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

Array = npt.NDArray[np.float64]

LONGEST_CORRELATION_S = 1e6
"""Correlation time of the slowest flicker component: 11 days, beyond any recording here."""

RATIO = 10.0
"""Spacing of the correlation times: one component per decade keeps the floor within 1 %."""


class Noise(Protocol):
    """One process: made of its coefficient per axis and its own generator."""

    def __init__(self, coefficient: Array, rng: np.random.Generator) -> None: ...

    def sample(self, n: int, period_s: float) -> Array:
        """Return the next n samples at this period, shape (n, axes)."""
        ...


def white_sigma(density: Array, period_s: float) -> Array:
    """
    Return the standard deviation per sample of white noise of a one-sided density.

    A one-sided density S in unit/√Hz, flat up to the Nyquist frequency 1/(2T),
    has the variance S²/(2T).  The Allan coefficient is N = S/√2.

    Parameters
    ----------
    density : ndarray, shape (axes,)
        One-sided noise density as datasheets print it, unit/√Hz.
    period_s : float
        Sample period T in seconds.

    Returns
    -------
    ndarray, shape (axes,)
        In the unit of the signal.

    Examples
    --------
    >>> white_sigma(np.array([300e-6]), 1e-3).round(6)
    array([0.006708])
    """
    return np.asarray(density / math.sqrt(2.0 * period_s))


class White:
    """White noise of a one-sided density in unit/√Hz."""

    def __init__(self, coefficient: Array, rng: np.random.Generator) -> None:
        self._density = coefficient
        self._rng = rng

    def sample(self, n: int, period_s: float) -> Array:
        """Return the next n samples, shape (n, axes)."""
        return self._rng.standard_normal((n, self._density.size)) * white_sigma(
            self._density, period_s
        )


class Flicker:
    """
    Flicker noise (bias instability) as a sum of first-order Gauss-Markov processes.

    The two-sided density of flicker noise is B²/(2πf) (IEEE Std 952-1997,
    eq. C.5).  Independent first-order Gauss-Markov processes of equal variance
    σ² whose correlation times are spaced by the ratio r have together the
    density σ²/(2 f ln r) between their corner frequencies: the sum of
    2σ²T/(1 + (2πfT)²) becomes an integral over dT/(T ln r).  Hence σ² = B² ln r/π.
    The correlation times start at `LONGEST_CORRELATION_S` and go down to
    about the sample period, which fixes the cost per sample however long the recording.
    Each process is discretised exactly and starts in its stationary state.
    """

    def __init__(self, coefficient: Array, rng: np.random.Generator) -> None:
        self._sigma = coefficient * math.sqrt(math.log(RATIO) / math.pi)
        self._rng = rng
        self._period_s = 0.0
        self._times = np.empty(0)
        self._state = np.empty((0, coefficient.size))

    def _adopt(self, period_s: float) -> None:
        """Choose the correlation times for a rate; those that go on keep their state."""
        self._period_s = period_s
        count = max(1, 1 + round(math.log(LONGEST_CORRELATION_S / period_s, RATIO)))
        kept = self._state[:count]
        fresh = self._rng.standard_normal((count - len(kept), self._sigma.size)) * self._sigma
        self._state = np.concatenate([kept, fresh])
        self._times = LONGEST_CORRELATION_S * RATIO ** -np.arange(count, dtype=float)

    def sample(self, n: int, period_s: float) -> Array:
        """Return the next n samples, shape (n, axes)."""
        if period_s != self._period_s:
            self._adopt(period_s)
        total = np.zeros((n, self._sigma.size))
        if n == 0:
            return total
        drive = self._rng.standard_normal((n, *self._state.shape))
        for i, correlation_s in enumerate(self._times):
            decay = math.exp(-period_s / correlation_s)
            step = math.sqrt(-math.expm1(-2.0 * period_s / correlation_s))
            path, _ = lfilter(
                [step], [1.0, -decay], drive[:, i] * self._sigma, axis=0,
                zi=decay * self._state[i : i + 1],
            )  # fmt: skip
            self._state[i] = path[-1]
            total += path
        return total


class RandomWalk:
    """Rate random walk of coefficient K in unit/√s; starts at zero."""

    def __init__(self, coefficient: Array, rng: np.random.Generator) -> None:
        self._coefficient = coefficient
        self._rng = rng
        self._state = np.zeros((1, coefficient.size))

    def sample(self, n: int, period_s: float) -> Array:
        """Return the next n samples, shape (n, axes)."""
        steps = self._rng.standard_normal((n, self._coefficient.size))
        steps *= self._coefficient * math.sqrt(period_s)
        path = np.cumsum(np.concatenate([self._state, steps]), axis=0)
        self._state = path[-1:]
        return path[1:]


class Quantisation:
    """
    Quantisation noise of coefficient Q, in the unit of the integrated signal.

    The integral of the signal carries white noise of standard deviation Q, so
    the signal carries its difference over the sample period.
    """

    def __init__(self, coefficient: Array, rng: np.random.Generator) -> None:
        self._coefficient = coefficient
        self._rng = rng
        self._state = rng.standard_normal((1, coefficient.size))

    def sample(self, n: int, period_s: float) -> Array:
        """Return the next n samples, shape (n, axes)."""
        angles = np.concatenate(
            [self._state, self._rng.standard_normal((n, self._coefficient.size))]
        )
        self._state = angles[-1:]
        return np.diff(angles, axis=0) * (self._coefficient / period_s)
