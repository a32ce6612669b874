# SPDX-License-Identifier: Apache-2.0
"""
How the bench truly moves, as functions of continuous time.

Every function takes times in seconds since the scenario began, shape (n,).
Nothing is sampled here: what lies above a sensor's Nyquist frequency reaches
the sensor, and aliases as it would.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Protocol

from imu_bench.errors import ConfigError
from imu_bench.samples import AXES
from imu_bench.simulation.noise import Array
from imu_bench.units import STANDARD_GRAVITY
import numpy as np


class Motion(Protocol):
    """True motion and surroundings of the sensor."""

    def specific_force(self, t: Array) -> Array:
        """Return m/s², shape (n, 3): +g on z at rest."""
        ...

    def angular_velocity(self, t: Array) -> Array:
        """Return rad/s, shape (n, 3)."""
        ...

    def magnetic_field(self, t: Array) -> Array:
        """Return T, shape (n, 3)."""
        ...

    def temperature(self, t: Array) -> Array:
        """Return °C, shape (n,)."""
        ...


@dataclass(frozen=True)
class Still:
    """
    The bench stands on a table that is almost level.

    Attributes
    ----------
    roll, pitch : float
        Tilt about x, then about y, rad.
    temperature_c : float
        °C.
    field : tuple of float
        Magnetic field in T; the default is about that of Finland, with x to the north
        (IGRF-13 near Tampere: 15 µT horizontal, 50 µT down).

    Examples
    --------
    >>> Still(pitch=math.pi / 6).specific_force(np.zeros(1)).round(4)
    array([[-4.9033,  0.    ,  8.4928]])
    """

    roll: float = 0.0
    pitch: float = 0.0
    temperature_c: float = 25.0
    field: tuple[float, float, float] = (15e-6, 0.0, -50e-6)

    def specific_force(self, t: Array) -> Array:
        """Return gravity's reaction in the tilted frame, m/s², shape (n, 3)."""
        gravity = STANDARD_GRAVITY * np.array(
            [
                math.sin(-self.pitch) + 0.0,  # + 0.0 keeps a level bench from showing -0.0
                math.sin(self.roll) * math.cos(self.pitch),
                math.cos(self.roll) * math.cos(self.pitch),
            ]
        )
        return np.tile(gravity, (t.size, 1))

    def angular_velocity(self, t: Array) -> Array:
        """Return zeros: the Earth's 7.3e-5 rad/s belongs to a scenario that is about it."""
        return np.zeros((t.size, 3))

    def magnetic_field(self, t: Array) -> Array:
        """Return the constant field, T, shape (n, 3)."""
        return np.tile(np.array(self.field), (t.size, 1))

    def temperature(self, t: Array) -> Array:
        """Return the constant temperature, °C, shape (n,)."""
        return np.full(t.size, self.temperature_c)


@dataclass(frozen=True)
class Sine:
    """
    A sinusoidal acceleration along one axis, to be added to a motion with gravity.

    Attributes
    ----------
    amplitude : float
        Peak, m/s².
    frequency_hz : float
        Hz; it may lie above the Nyquist frequency of a sensor.
    axis : str
        'x', 'y' or 'z'.

    Examples
    --------
    >>> Sine(amplitude=2.0, frequency_hz=10.0, axis='x').specific_force(np.array([0.025]))
    array([[2., 0., 0.]])
    """

    amplitude: float
    frequency_hz: float
    axis: str = 'z'

    def __post_init__(self) -> None:
        if self.axis not in AXES:
            raise ConfigError(f'axis {self.axis!r} is not allowed; allowed: {", ".join(AXES)}')

    def specific_force(self, t: Array) -> Array:
        """Return m/s², shape (n, 3)."""
        force = np.zeros((t.size, 3))
        force[:, AXES.index(self.axis)] = self.amplitude * np.sin(
            2.0 * np.pi * self.frequency_hz * t
        )
        return force

    def angular_velocity(self, t: Array) -> Array:
        """Return zeros: the motion is straight."""
        return np.zeros((t.size, 3))

    def magnetic_field(self, t: Array) -> Array:
        """Return zeros: it adds nothing to the field."""
        return np.zeros((t.size, 3))

    def temperature(self, t: Array) -> Array:
        """Return zeros: it adds nothing to the temperature."""
        return np.zeros(t.size)


@dataclass(frozen=True)
class Sum:
    """
    Several motions at once, such as a machine's vibration on a still table.

    Examples
    --------
    >>> moving = Sum((Still(), Sine(1.0, 50.0)))
    >>> moving.specific_force(np.array([0.005])).round(5)
    array([[ 0.     ,  0.     , 10.80665]])
    """

    parts: tuple[Motion, ...]

    def specific_force(self, t: Array) -> Array:
        """Return the sum of the parts, m/s², shape (n, 3)."""
        return np.asarray(np.sum([part.specific_force(t) for part in self.parts], axis=0))

    def angular_velocity(self, t: Array) -> Array:
        """Return the sum of the parts, rad/s, shape (n, 3)."""
        return np.asarray(np.sum([part.angular_velocity(t) for part in self.parts], axis=0))

    def magnetic_field(self, t: Array) -> Array:
        """Return the sum of the parts, T, shape (n, 3)."""
        return np.asarray(np.sum([part.magnetic_field(t) for part in self.parts], axis=0))

    def temperature(self, t: Array) -> Array:
        """Return the sum of the parts, °C, shape (n,)."""
        return np.asarray(np.sum([part.temperature(t) for part in self.parts], axis=0))
