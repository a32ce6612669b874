# SPDX-License-Identifier: Apache-2.0
"""The parameters of a sensor's errors, quantity by quantity."""

from __future__ import annotations

from dataclasses import dataclass, fields
import math
from typing import Any

from imu_bench.errors import ConfigError
from imu_bench.simulation.low_pass import NOISE_FILTERS, ORDERS
from msg_conversions.quantities import AXES
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Axes = Any  # a number, three of them, or an array: always an array of three once it is made

NOISE_TYPES = ('one-sided', 'two-sided')
"""How `noise_density` counts the spectrum; 'one-sided' as datasheets do."""

REFERENCE_C = 25.0
"""Temperature at which the temperature errors are zero: that of MATLAB's imuSensor."""

_WORDS = ('noise_type', 'axes', 'low_pass_order', 'low_pass_kind')
_MATRICES = ('cross_axis', 'acceleration_bias')
_SIGNED = (
    'bias',
    'scale_factor',
    'misalignment',
    'temperature_bias',
    'temperature_scale',
    'vibration_rectification',
)


@dataclass(frozen=True, eq=False)
class Errors:
    """
    The errors of one quantity of a sensor, in SI units; a number, or one per axis.

    The parameters are those of MATLAB's `imuSensor` (accelparams, gyroparams, magparams), and
    what real sensors do besides.

    Examples
    --------
    >>> Errors(noise_density=1.5e-3, axes='z').noise_density
    array([0.0015, 0.0015, 0.0015])
    """

    noise_density: Axes = 0.0  # white noise, density in unit/√Hz
    # 'one-sided': the Allan coefficient N is the density divided by √2; 'two-sided': N is the
    # density
    noise_type: str = 'one-sided'
    # B in the unit of the signal; the floor of the Allan deviation is 0.664 B
    bias_instability: Axes = 0.0
    random_walk: Axes = 0.0  # K in unit/√s
    quantisation: Axes = 0.0  # Q in unit·s
    bias: Axes = 0.0  # constant offset
    # standard deviation of an offset that is another one each time the sensor is switched on
    turn_on_bias: Axes = 0.0
    scale_factor: Axes = 0.0  # relative error of the scale: 0.01 shows one percent too much
    # what an output (row) shows of the true value along another axis (column)
    cross_axis: Any = 0.0
    misalignment: Axes = 0.0  # rotation vector from the true axes to those of the sensor, rad
    # temperature_bias, temperature_scale: change of offset and scale per kelvin away from 25 °C
    temperature_bias: Axes = 0.0
    temperature_scale: Axes = 0.0
    # of a gyroscope: what an output (row) shows of the specific force along an axis (column),
    # (rad/s)/(m/s²)
    acceleration_bias: Any = 0.0
    # what an output shows of the squared specific force along its axis, unit/(m/s²)²: the second-
    # order term of IEEE Std 1293-2018, which makes an offset of vibration
    vibration_rectification: Axes = 0.0
    low_pass: Axes = math.inf  # -3 dB corner in Hz of the sensor's own filter, infinite for none
    low_pass_order: int = 1  # 1 or 2 (Butterworth)
    # 'analogue', before the sampling, so that noise above half the rate folds back, or 'digital',
    # of the output samples
    low_pass_kind: str = 'analogue'
    # corner frequency in Hz of a sensor that does not pass constant values, such as a
    # piezoelectric one; zero for none
    high_pass: Axes = 0.0
    range: Axes = math.inf  # largest magnitude; beyond it the output saturates
    resolution: Axes = 0.0  # smallest step; zero for none
    # outlier_rate, outlier_size: spikes per second, and up to how far they are off
    outlier_rate: Axes = 0.0
    outlier_size: Axes = 0.0
    zeros: Axes = 0.0  # share of samples that read zero although nothing is
    # stuck_rate, stuck_time: how often per second the output begins to stand still, and for how
    # many seconds
    stuck_rate: Axes = 0.0
    stuck_time: Axes = 0.0
    axes: str = 'xyz'  # which axes the sensor has; the others are NaN

    def __post_init__(self) -> None:
        for field in fields(self):
            if field.name not in _WORDS:
                check = _matrix if field.name in _MATRICES else _per_axis
                object.__setattr__(self, field.name, check(field.name, getattr(self, field.name)))
        if not self.axes or any(axis not in AXES for axis in self.axes):
            raise ConfigError(f'axes {self.axes!r} are not allowed; name some of x, y and z')
        for name, known in (
            ('noise_type', NOISE_TYPES),
            ('low_pass_order', ORDERS),
            ('low_pass_kind', tuple(NOISE_FILTERS)),
        ):
            value = getattr(self, name)
            if value not in known:
                raise ConfigError(f'{name} {value!r} is not allowed; allowed: {known}')
        if np.any(np.diag(self.cross_axis)):
            raise ConfigError('cross_axis of an axis with itself is the scale: give scale_factor')
        if np.any(self.zeros > 1.0):
            raise ConfigError('zeros: more than every sample cannot read zero; at most 1')

    @property
    def white_density(self) -> Array:
        """One-sided density of the white noise, whatever the type says, unit/√Hz."""
        factor = math.sqrt(2.0) if self.noise_type == 'two-sided' else 1.0
        return np.asarray(self.noise_density * factor)

    def has(self, axis: int) -> bool:
        """Return whether the sensor has an axis."""
        return AXES[axis] in self.axes


def _per_axis(name: str, value: Any) -> Array:
    numbers = np.asarray(value, dtype=float).ravel()
    if numbers.size not in (1, 3) or np.isnan(numbers).any():
        raise ConfigError(f'{name} {value!r} is not allowed; give one number, or one per axis')
    if name not in _SIGNED and (numbers < 0).any():
        raise ConfigError(f'{name} {value!r} is negative; it must be zero or more')
    if name == 'low_pass' and (numbers == 0).any():
        raise ConfigError('low_pass of 0 Hz lets nothing pass; leave it out for no filter')
    return np.broadcast_to(numbers, (3,))


def _matrix(name: str, value: Any) -> Array:
    numbers = np.asarray(value, dtype=float)
    if numbers.shape not in ((), (3, 3)) or not np.isfinite(numbers).all():
        raise ConfigError(f'{name} {value!r} is not allowed; give a row of three for each axis')
    return np.broadcast_to(numbers, (3, 3)) if numbers.ndim else np.diag([float(numbers)] * 3)
