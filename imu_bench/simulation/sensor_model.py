# SPDX-License-Identifier: Apache-2.0
"""How a sensor errs: from the true motion to the values the chip digitises."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
import math
from typing import Any

from imu_bench.errors import ConfigError
from imu_bench.simulation.noise import Array, Flicker, Noise, Quantisation, RandomWalk, White
import numpy as np
from scipy.linalg import expm
from scipy.signal import lfilter

QUANTITIES = ('acceleration', 'angular_velocity', 'magnetic_field', 'temperature')
"""Fields of `imu_bench.samples.Samples`, in the order in which they draw their seeds."""

Axes = Any  # a number, three of them, or an array: always an array of three once it is made


@dataclass(frozen=True, eq=False)
class Errors:
    """
    The errors of one quantity of a sensor, in SI units; a number, or one per axis.

    Attributes
    ----------
    noise_density : float or array
        White noise, one-sided density in unit/√Hz as datasheets print it; the
        Allan coefficient N is this divided by √2.
    bias_instability : float or array
        B in the unit of the signal; the floor of the Allan deviation is 0.664 B.
    random_walk : float or array
        K in unit/√s.
    quantisation : float or array
        Q in unit·s.
    bias : float or array
        Constant offset.
    scale_factor : float or array
        Relative error of the scale: 0.01 shows one percent too much.
    misalignment : float or array
        Rotation vector from the true axes to those of the sensor, rad.
    high_pass : float or array
        Corner frequency in Hz of a sensor that does not pass constant values, such
        as a piezoelectric one; zero for none.
    range : float or array
        Largest magnitude; beyond it the output saturates.
    resolution : float or array
        Smallest step; zero for none.
    axes : str
        Which axes the sensor has; the others are NaN.

    Examples
    --------
    >>> Errors(noise_density=1.5e-3, axes='z').noise_density
    array([0.0015, 0.0015, 0.0015])
    """

    noise_density: Axes = 0.0
    bias_instability: Axes = 0.0
    random_walk: Axes = 0.0
    quantisation: Axes = 0.0
    bias: Axes = 0.0
    scale_factor: Axes = 0.0
    misalignment: Axes = 0.0
    high_pass: Axes = 0.0
    range: Axes = math.inf
    resolution: Axes = 0.0
    axes: str = 'xyz'

    def __post_init__(self) -> None:
        for field in fields(self):
            if field.name != 'axes':
                object.__setattr__(
                    self, field.name, _per_axis(field.name, getattr(self, field.name))
                )
        if not self.axes or any(axis not in 'xyz' for axis in self.axes):
            raise ConfigError(f'axes {self.axes!r} are not allowed; name some of x, y and z')


def _per_axis(name: str, value: Any) -> Array:
    numbers = np.asarray(value, dtype=float).ravel()
    if numbers.size not in (1, 3) or np.isnan(numbers).any():
        raise ConfigError(f'{name} {value!r} is not allowed; give one number, or one per axis')
    if name not in ('bias', 'scale_factor', 'misalignment') and (numbers < 0).any():
        raise ConfigError(f'{name} {value!r} is negative; it must be zero or more')
    return np.broadcast_to(numbers, (3,))


class _QuantityModel:
    """The errors of one quantity, with the state of its noise."""

    def __init__(self, errors: Errors, columns: int, seed: np.random.SeedSequence) -> None:
        self._errors = errors
        self._columns = columns
        streams = [np.random.default_rng(child) for child in seed.spawn(4)]
        processes: tuple[tuple[type[Noise], Array], ...] = (
            (White, errors.noise_density),
            (Flicker, errors.bias_instability),
            (RandomWalk, errors.random_walk),
            (Quantisation, errors.quantisation),
        )
        self._noises: list[Noise] = [
            process(np.asarray(coefficient)[:columns], stream)
            for (process, coefficient), stream in zip(processes, streams, strict=True)
            if np.any(coefficient)
        ]
        x, y, z = errors.misalignment
        self._rotation = expm(np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]))
        self._settled: Array | None = None
        self._missing = [i for i, axis in enumerate('xyz'[:columns]) if axis not in errors.axes]

    def sample(self, truth: Array, period_s: float) -> Array:
        errors = self._errors
        columns = slice(self._columns)
        values = truth.reshape(len(truth), self._columns)
        if np.any(errors.misalignment) and self._columns == 3:
            # components along rotated axes: the inverse rotation, so row vectors times R
            values = values @ self._rotation
        values = values * (1.0 + errors.scale_factor[columns]) + errors.bias[columns]
        for noise in self._noises:
            values = values + noise.sample(len(truth), period_s)
        if np.any(errors.high_pass) and len(values):
            values = self._ac_coupled(values, period_s)
        values = np.clip(values, -errors.range[columns], errors.range[columns])
        for i in np.flatnonzero(errors.resolution[columns]):
            values[:, i] = np.round(values[:, i] / errors.resolution[i]) * errors.resolution[i]
        values[:, self._missing] = np.nan
        return np.asarray(values.reshape(truth.shape))

    def _ac_coupled(self, values: Array, period_s: float) -> Array:
        """Return what passes a first-order high-pass that was settled when it all began."""
        if self._settled is None:
            self._settled = values[:1].copy()
        passed = np.empty_like(values)
        for i in range(self._columns):
            decay = math.exp(-2.0 * math.pi * self._errors.high_pass[i] * period_s)
            constant, state = lfilter(
                [1.0 - decay], [1.0, -decay], values[:, i], zi=decay * self._settled[:, i]
            )
            self._settled[:, i] = state / decay
            corner = self._errors.high_pass[i] > 0.0
            passed[:, i] = values[:, i] - constant if corner else values[:, i]
        return passed


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

    Examples
    --------
    >>> model = ErrorModel({'acceleration': Errors(bias=(0.1, 0.0, 0.0))}, seed=1)
    >>> model.sample({'acceleration': np.array([[0.0, 0.0, 9.8]])}, 1e-3)['acceleration']
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
            quantity: _QuantityModel(
                errors[quantity], 1 if quantity == 'temperature' else 3, seeds[quantity]
            )
            for quantity in QUANTITIES
            if quantity in errors
        }

    @property
    def quantities(self) -> tuple[str, ...]:
        """The quantities this sensor has."""
        return tuple(self._models)

    def sample(self, truth: Mapping[str, Array], period_s: float) -> dict[str, Array]:
        """
        Return what the sensor makes of the truth; each call continues the last.

        Parameters
        ----------
        truth : mapping of str to ndarray
            Per quantity shape (n, 3), temperature (n,), SI units.
        period_s : float
            Sample period; it may change from call to call.

        Returns
        -------
        dict of str to ndarray
            The same shapes and units, NaN where the sensor lacks an axis.
        """
        return {
            quantity: model.sample(truth[quantity], period_s)
            for quantity, model in self._models.items()
        }
