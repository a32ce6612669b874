# SPDX-License-Identifier: Apache-2.0
"""How a sensor errs: from the true motion to the values the chip digitises."""

from __future__ import annotations

from collections.abc import Mapping

from imu_bench.errors import ConfigError
from imu_bench.samples import AXES
from imu_bench.simulation.axis_output import AxisOutput
from imu_bench.simulation.low_pass import LowPass, motion_sections
from imu_bench.simulation.sensor_errors import Array, Errors, REFERENCE_C
import numpy as np
from scipy.linalg import expm

QUANTITIES = ('acceleration', 'angular_velocity', 'magnetic_field', 'temperature')
"""Fields of `imu_bench.samples.Samples`, in the order in which they draw their seeds."""


class _QuantityModel:
    """The errors of one quantity, with the state of its filter and its noise."""

    def __init__(self, name: str, errors: Errors, seed: np.random.SeedSequence) -> None:
        self.errors = errors
        self._name = name
        self.columns = 1 if name == 'temperature' else len(AXES)
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
    """
    The errors of one sensor.

    Parameters
    ----------
    errors : mapping of str to Errors
        Per quantity the sensor has: 'acceleration', 'angular_velocity',
        'magnetic_field', 'temperature'.
    seed : int or numpy.random.SeedSequence
        The same seed gives the same noise, whatever the sizes of the blocks.

    Attributes
    ----------
    errors : mapping of str to Errors
    turn_on : mapping of str to ndarray
        The offset that each quantity was switched on with, per axis.

    Examples
    --------
    >>> model = ErrorModel({'acceleration': Errors(bias=(0.1, 0.0, 0.0))}, seed=1)
    >>> model.sample({'acceleration': np.array([[0.0, 0.0, 9.8]])}, 1, 1e-3)['acceleration']
    array([[0.1, 0. , 9.8]])
    """

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
        self.errors = {quantity: model.errors for quantity, model in self._models.items()}
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
        """
        Return what the sensor would show without noise, filters, range and resolution.

        Parameters
        ----------
        truth : mapping of str to ndarray
            As in `sample`.

        Returns
        -------
        dict of str to ndarray
            Shape (rows of the truth, 3); temperature (rows, 1).
        """
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
        oversampling : int
        moves : bool
            False for a truth too slow for the sensor's low-pass to matter.

        Returns
        -------
        dict of str to ndarray
            Shape (n, 3), temperature (n,), NaN where the sensor lacks an axis.
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
