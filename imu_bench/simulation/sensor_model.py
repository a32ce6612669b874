# SPDX-License-Identifier: Apache-2.0
"""How a sensor errs: from the true motion to the values the chip digitises."""

from __future__ import annotations

from collections.abc import Mapping
import math

from imu_bench.errors import ConfigError
from imu_bench.simulation.low_pass import LowPass, motion_sections, NOISE_FILTERS
from imu_bench.simulation.noise import Flicker, Noise, Quantisation, RandomWalk, White
from imu_bench.simulation.sensor_errors import Array, Errors, REFERENCE_C
from msg_conversions.quantities import AXES, BY_FIELD, IMU_QUANTITIES, MAGNETIC_FIELD, TEMPERATURE
import numpy as np
from scipy.linalg import expm
from scipy.signal import lfilter


class AxisOutput:
    """Noise, AC coupling, faults, range and resolution of one axis, in the order of the signal."""

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
        """Return the next n outputs, shape (n,)."""
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


QUANTITIES = tuple(q.field for q in (*IMU_QUANTITIES, MAGNETIC_FIELD, TEMPERATURE))
"""Fields of `imu_bench.samples.Samples`, in the order in which they draw their seeds."""


class _QuantityModel:
    """The errors of one quantity, with the state of its filter and its noise."""

    def __init__(self, name: str, errors: Errors, seed: np.random.SeedSequence) -> None:
        self.errors = errors
        self._name = name
        self.columns = len(BY_FIELD[name].columns)
        present = [i for i in range(self.columns) if errors.has(i) or self.columns == 1]
        # every axis draws a seed, present or not
        seeds = seed.spawn(self.columns)
        self._outputs = {i: AxisOutput(errors, i, seeds[i]) for i in present}
        self.turn_on = np.array(
            [self._outputs[i].turn_on if i in self._outputs else 0.0 for i in range(self.columns)]
        )
        x, y, z = errors.misalignment
        rotation = expm(np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]))
        # components along rotated axes: the inverse rotation, so row vectors times R
        self._mixing = rotation @ (np.eye(len(AXES)) + errors.cross_axis).T
        self._mixes = self.columns > 1 and not np.array_equal(self._mixing, np.eye(len(AXES)))
        self._low_passes = [
            LowPass(float(corner), errors.low_pass_order, motion_sections)
            if np.isfinite(corner)
            else None
            for corner in errors.low_pass[: self.columns]
        ]
        corners = errors.low_pass[: self.columns]
        self.corner_hz = float(max(corners[np.isfinite(corners)], default=0.0))

    def ideal(self, truth: Mapping[str, Array]) -> Array:
        """Return what the axes would show of constant truths for ever, shape (rows, columns)."""
        return self._with_offsets(self._seen(truth), truth['temperature'])

    def sample(
        self, truth: Mapping[str, Array], n: int, period_s: float, oversampling: int, moves: bool
    ) -> Array:
        """Return the next n values, shape (n, columns)."""
        seen = self._seen(truth)
        if moves and self.corner_hz:
            seen = self._filtered(seen, n * oversampling, oversampling / period_s)
        if len(seen) > 1:
            seen = seen[oversampling - 1 :: oversampling]
        temperature = truth['temperature']
        if len(temperature) > 1:
            temperature = temperature[oversampling - 1 :: oversampling]
        ideal = self._with_offsets(seen, temperature)
        values = np.empty((n, self.columns))
        for i in range(self.columns):
            if i in self._outputs:
                column = float(ideal[0, i]) if len(ideal) == 1 else ideal[:, i]
                values[:, i] = self._outputs[i].sample(column, n, period_s)
            else:
                values[:, i] = np.nan
        return values

    def _seen(self, truth: Mapping[str, Array]) -> Array:
        """Return what reaches the axes before any filter."""
        own = truth[self._name].reshape(-1, self.columns)
        force = truth['acceleration']
        if self._mixes:
            own = own @ self._mixing
        if np.any(self.errors.acceleration_bias):
            own = own + force @ self.errors.acceleration_bias.T
        if np.any(self.errors.vibration_rectification):
            own = own + self.errors.vibration_rectification * force**2
        return own

    def _filtered(self, seen: Array, n: int, rate_hz: float) -> Array:
        filtered = np.empty((n, self.columns))
        filtered[:] = seen
        for i, low_pass in enumerate(self._low_passes):
            if low_pass is not None and i in self._outputs:
                filtered[:, i] = low_pass.apply(filtered[:, i], rate_hz)
        return filtered

    def _with_offsets(self, seen: Array, temperature: Array) -> Array:
        errors, columns = self.errors, slice(self.columns)
        scale = 1.0 + errors.scale_factor[columns]
        offset = errors.bias[columns] + self.turn_on
        if np.any(errors.temperature_bias) or np.any(errors.temperature_scale):
            off = (temperature - REFERENCE_C)[:, None]
            scale = scale + off * errors.temperature_scale[columns]
            offset = offset + off * errors.temperature_bias[columns]
        return np.asarray(seen * scale + offset)


class ErrorModel:
    """The errors of one sensor."""

    def __init__(
        self, errors: Mapping[str, Errors], seed: int | np.random.SeedSequence = 0
    ) -> None:
        unknown = sorted(set(errors) - set(QUANTITIES))
        if unknown:
            raise ConfigError(f'quantities {unknown} are not known; name some of {QUANTITIES}')
        if not errors:
            raise ConfigError(
                'the sensor measures nothing: give simulation.acceleration.noise_density, or '
                'another error of what it measures'
            )
        sequence = (
            seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
        )
        # every quantity draws a seed, present or not: adding one leaves the others as they were
        seeds = dict(zip(QUANTITIES, sequence.spawn(len(QUANTITIES)), strict=True))
        self._models = {
            quantity: _QuantityModel(quantity, errors[quantity], seeds[quantity])
            for quantity in QUANTITIES
            if quantity in errors
        }
        # per quantity the sensor has: 'acceleration', 'angular_velocity', 'magnetic_field',
        # 'temperature'
        self.errors = {quantity: model.errors for quantity, model in self._models.items()}
        # the offset that each quantity was switched on with, per axis
        self.turn_on = {quantity: model.turn_on for quantity, model in self._models.items()}

    @property
    def quantities(self) -> tuple[str, ...]:
        """The quantities this sensor has."""
        return tuple(self._models)

    @property
    def corner_hz(self) -> float:
        """Highest corner of the sensor's own low-passes; zero if it has none."""
        return max(model.corner_hz for model in self._models.values())

    def ideal(self, truth: Mapping[str, Array]) -> dict[str, Array]:
        """Return what the sensor would show without noise, filters, range and resolution."""
        complete = _complete(truth)
        return {quantity: model.ideal(complete) for quantity, model in self._models.items()}

    def sample(
        self,
        truth: Mapping[str, Array],
        n: int,
        period_s: float,
        *,
        oversampling: int = 1,
        moves: bool = True,
    ) -> dict[str, Array]:
        """
        Return what the sensor makes of the truth; each call continues the last.

        Parameters
        ----------
        truth : mapping of str to ndarray
            Per quantity shape (n · oversampling, 3), temperature (n · oversampling,), SI
            units; or a single row where nothing changes.  The last of each group of
            `oversampling` rows is the time of the sample.  What is left out is zero, the
            temperature 25 °C.
        n : int
            Samples.
        period_s : float
            Sample period; it may change from call to call.
        moves : bool
            False for a truth too slow for the sensor's low-pass to matter.
        """
        complete = _complete(truth)
        made = {
            quantity: model.sample(complete, n, period_s, oversampling, moves)
            for quantity, model in self._models.items()
        }
        if 'temperature' in made:
            made['temperature'] = made['temperature'][:, 0]
        return made


def _complete(truth: Mapping[str, Array]) -> dict[str, Array]:
    nothing = np.zeros((1, len(AXES)))
    still = dict.fromkeys(QUANTITIES, nothing)
    return {**still, 'temperature': np.full(1, REFERENCE_C), **truth}
