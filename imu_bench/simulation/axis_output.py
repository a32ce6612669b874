# SPDX-License-Identifier: Apache-2.0
"""One axis of a sensor from its undisturbed value to the number it puts out."""

from __future__ import annotations

import math

from imu_bench.simulation.low_pass import LowPass, NOISE_FILTERS
from imu_bench.simulation.noise import Flicker, Noise, Quantisation, RandomWalk, White
from imu_bench.simulation.sensor_errors import Array, Errors
import numpy as np
from scipy.signal import lfilter


class AxisOutput:
    """
    Noise, AC coupling, faults, range and resolution of one axis, in the order of the signal.

    Parameters
    ----------
    errors : Errors
    axis : int
        Which element of each parameter.
    seed : numpy.random.SeedSequence
        Every process draws a stream of its own, present or not.
    """

    def __init__(self, errors: Errors, axis: int, seed: np.random.SeedSequence) -> None:
        streams = [np.random.default_rng(child) for child in seed.spawn(6)]
        self._noise = _Noise(errors, axis, streams[:4])
        self._faults = _Faults(errors, axis, streams[4])
        self.turn_on = float(errors.turn_on_bias[axis] * streams[5].standard_normal())
        self._high_pass_hz = float(errors.high_pass[axis])
        self._settled: float | None = None
        self._range = float(errors.range[axis])
        self._resolution = float(errors.resolution[axis])

    def sample(self, value: Array | float, n: int, period_s: float) -> Array:
        """
        Return the next n outputs, shape (n,).

        Parameters
        ----------
        value : float or ndarray, shape (n,)
            What the axis would put out without noise.
        n : int
        period_s : float
        """
        values = self._noise.sample(n, period_s)
        values += value
        if self._high_pass_hz:
            values = self._ac_coupled(values, value, period_s)
        values = self._faults.spikes(values, period_s)
        if self._range < math.inf:
            np.clip(values, -self._range, self._range, out=values)
        if self._resolution:
            values /= self._resolution
            np.rint(values, out=values)
            values *= self._resolution
        return self._faults.digital(values, period_s)

    def _ac_coupled(self, values: Array, noiseless: Array | float, period_s: float) -> Array:
        """Return what passes a first-order high-pass that was settled when it all began."""
        if not values.size:
            return values
        if self._settled is None:
            # on the signal: settled on its first noise it would begin with a transient
            self._settled = float(np.ravel(noiseless)[0])
        decay = math.exp(-2.0 * math.pi * self._high_pass_hz * period_s)
        constant, state = lfilter([1.0 - decay], [1.0, -decay], values, zi=[decay * self._settled])
        self._settled = float(state[0]) / decay
        return np.asarray(values - constant)


class _Noise:
    """The sum of the processes, behind the sensor's low-pass."""

    def __init__(self, errors: Errors, axis: int, streams: list[np.random.Generator]) -> None:
        made: tuple[tuple[type[Noise], Array], ...] = (
            (White, errors.white_density),
            (Flicker, errors.bias_instability),
            (RandomWalk, errors.random_walk),
            (Quantisation, errors.quantisation),
        )
        self._processes = [
            process(float(coefficient[axis]), stream)
            for (process, coefficient), stream in zip(made, streams, strict=True)
            if coefficient[axis]
        ]
        corner = float(errors.low_pass[axis])
        filtered = bool(self._processes) and corner < math.inf
        self._low_pass: LowPass | None = None
        if filtered:
            self._low_pass = LowPass(
                corner, errors.low_pass_order, NOISE_FILTERS[errors.low_pass_kind]
            )
        self._begun = False

    def sample(self, n: int, period_s: float) -> Array:
        if not n:
            return np.empty(0)
        if not self._begun and self._low_pass is not None:
            self._sum(self._low_pass.settling(1.0 / period_s), period_s)
        self._begun = True
        return self._sum(n, period_s)

    def _sum(self, n: int, period_s: float) -> Array:
        if not self._processes:
            return np.zeros(n)
        values = self._processes[0].sample(n, period_s)
        for process in self._processes[1:]:
            values += process.sample(n, period_s)
        return values if self._low_pass is None else self._low_pass.apply(values, 1.0 / period_s)


class _Faults:
    """What a defective sensor does: spikes, zeros, values that stand still."""

    def __init__(self, errors: Errors, axis: int, rng: np.random.Generator) -> None:
        self._outlier_hz = float(errors.outlier_rate[axis])
        self._outlier_size = float(errors.outlier_size[axis])
        self._zeros = float(errors.zeros[axis])
        self._stuck_hz = float(errors.stuck_rate[axis])
        self._stuck_s = float(errors.stuck_time[axis])
        # one stream per fault: none depends on which others there are
        self._spiking, self._dropping, self._sticking = rng.spawn(3)
        self._held, self._left = 0.0, 0

    def spikes(self, values: Array, period_s: float) -> Array:
        """Add spikes, of any size up to the largest, before the sensor's range limits them."""
        if self._outlier_hz:
            chance, size = self._spiking.random((values.size, 2)).T
            hit = chance < -math.expm1(-self._outlier_hz * period_s)
            values[hit] += self._outlier_size * (2.0 * size[hit] - 1.0)
        return values

    def digital(self, values: Array, period_s: float) -> Array:
        """Replace output words: zeros first, then a word that is repeated."""
        if self._zeros:
            values[self._dropping.random(values.size) < self._zeros] = 0.0
        if self._stuck_hz:
            begins = self._sticking.random(values.size) < -math.expm1(-self._stuck_hz * period_s)
            self._hold(values, np.flatnonzero(begins), max(1, round(self._stuck_s / period_s)))
        return values

    def _hold(self, values: Array, begins: np.ndarray, length: int) -> None:
        """Repeat the word at each beginning; one that falls into a hold does not count."""
        first = min(self._left, values.size)
        values[:first] = self._held
        self._left -= first
        free = first
        for begin in begins.tolist():
            if begin < free:
                continue
            self._held = float(values[begin])
            free = min(begin + length, values.size)
            self._left = begin + length - free
            values[begin:free] = self._held
