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
"""

from __future__ import annotations

import math
from typing import Protocol

from imu_bench.simulation.flicker_filter import Array, flicker_filter
import numpy as np
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
