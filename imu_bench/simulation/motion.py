# SPDX-License-Identifier: Apache-2.0
"""
How the bench truly moves, as functions of continuous time.

Every function takes times in seconds since the scenario began, shape (n,), and returns
n rows, or a single row where nothing changes.  Nothing is sampled here: what lies above a
sensor's Nyquist frequency reaches the sensor, and aliases as it would.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math
from typing import Any, NamedTuple, Protocol

from imu_bench.errors import ConfigError
from imu_bench.simulation.sensor_errors import Array
from imu_bench.units import STANDARD_GRAVITY
from msg_conversions.quantities import AXES
import numpy as np

Seed = int | tuple[int, ...]
"""What numpy's generators take as a seed."""

NOTHING = np.zeros((1, len(AXES)))
NOTHING.flags.writeable = False
_NO_CHANGE = np.zeros(1)


class Band(NamedTuple):
    """What a motion contains between two frequencies in Hz."""

    name: str
    low_hz: float
    high_hz: float


class Motion(Protocol):
    """True motion and surroundings of the bench."""

    @property
    def bands(self) -> Sequence[Band]:
        """Every frequency range with something in it."""
        ...

    @property
    def duration_s(self) -> float | None:
        """Time after which nothing happens any more; None if it goes on for ever."""
        ...

    @property
    def events(self) -> Sequence[dict[str, Any]]:
        """What happens when, for the truth file."""
        ...

    def specific_force(self, t: Array) -> Array:
        """Return m/s², shape (n, 3) or (1, 3): +g on z at rest."""
        ...

    def angular_velocity(self, t: Array) -> Array:
        """Return rad/s, shape (n, 3) or (1, 3)."""
        ...

    def magnetic_field(self, t: Array) -> Array:
        """Return T, shape (n, 3) or (1, 3)."""
        ...

    def temperature(self, t: Array) -> Array:
        """Return °C, shape (n,) or (1,)."""
        ...


class Part:
    """A part of a motion that adds nothing; its children override what they add."""

    @property
    def bands(self) -> Sequence[Band]:
        """Nothing moves."""
        return ()

    @property
    def duration_s(self) -> float | None:
        """It goes on for ever."""
        return None

    @property
    def events(self) -> Sequence[dict[str, Any]]:
        """Nothing happens."""
        return ()

    def specific_force(self, t: Array) -> Array:
        """Return one row of zeros."""
        return NOTHING

    def angular_velocity(self, t: Array) -> Array:
        """Return one row of zeros."""
        return NOTHING

    def magnetic_field(self, t: Array) -> Array:
        """Return one row of zeros."""
        return NOTHING

    def temperature(self, t: Array) -> Array:
        """Return one zero."""
        return _NO_CHANGE


@dataclass(frozen=True)
class Still(Part):
    """The bench stands on a table that is almost level."""

    # roll, pitch: tilt about x, then about y, rad
    roll: float = 0.0
    pitch: float = 0.0
    temperature_c: float = 25.0  # °C
    # magnetic field in T; the default is about that of Finland, with x to the north (IGRF-13 near
    # Tampere: 15 µT horizontal, 50 µT down)
    field: tuple[float, float, float] = (15e-6, 0.0, -50e-6)

    def specific_force(self, t: Array) -> Array:
        """Return gravity's reaction in the tilted frame, m/s², shape (1, 3)."""
        return np.asarray(STANDARD_GRAVITY * attitude(self.roll, self.pitch)[:, 2:].T)

    def magnetic_field(self, t: Array) -> Array:
        """Return the constant field in the tilted frame, T, shape (1, 3)."""
        return np.array([self.field]) @ attitude(self.roll, self.pitch).T

    def temperature(self, t: Array) -> Array:
        """Return the constant temperature, °C, shape (1,)."""
        return np.full(1, self.temperature_c)


@dataclass(frozen=True)
class Sum:
    """Several motions at once, such as a machine's vibration on a still table."""

    parts: tuple[Motion, ...]

    @property
    def bands(self) -> Sequence[Band]:
        """Those of all parts."""
        return [band for part in self.parts for band in part.bands]

    @property
    def duration_s(self) -> float | None:
        """Until the last part that ends has ended; None if none does."""
        return max((part.duration_s for part in self.parts if part.duration_s), default=None)

    @property
    def events(self) -> Sequence[dict[str, Any]]:
        """Those of all parts, in their order."""
        return [event for part in self.parts for event in part.events]

    def specific_force(self, t: Array) -> Array:
        """Return the sum of the parts, m/s²."""
        return _total(part.specific_force(t) for part in self.parts)

    def angular_velocity(self, t: Array) -> Array:
        """Return the sum of the parts, rad/s."""
        return _total(part.angular_velocity(t) for part in self.parts)

    def magnetic_field(self, t: Array) -> Array:
        """Return the sum of the parts, T."""
        return _total(part.magnetic_field(t) for part in self.parts)

    def temperature(self, t: Array) -> Array:
        """Return the sum of the parts, °C."""
        return _total(part.temperature(t) for part in self.parts)


@dataclass(frozen=True)
class During:
    """A vibration that is there in some time spans only, faded in and out."""

    part: Motion
    spans: tuple[tuple[float, float], ...]  # begin and end in s, in order
    fade_s: float = 0.1  # within the span, raised cosine
    anew: bool = True  # whether the times of the part count from the beginning of each span

    @property
    def bands(self) -> Sequence[Band]:
        """Those of the part."""
        return self.part.bands

    @property
    def duration_s(self) -> float | None:
        """Until the end of the last span."""
        return self.spans[-1][1]

    @property
    def events(self) -> Sequence[dict[str, Any]]:
        """Those of the part."""
        return self.part.events

    def specific_force(self, t: Array) -> Array:
        """Return what the part adds within its spans, m/s²."""
        return self._within(self.part.specific_force, t)

    def angular_velocity(self, t: Array) -> Array:
        """Return what the part adds within its spans, rad/s."""
        return self._within(self.part.angular_velocity, t)

    def magnetic_field(self, t: Array) -> Array:
        """Return what the part adds within its spans, T."""
        return self._within(self.part.magnetic_field, t)

    def temperature(self, t: Array) -> Array:
        """Return nothing: temperatures do not come and go."""
        return _NO_CHANGE

    def _within(self, of_part: Callable[[Array], Array], t: Array) -> Array:
        total = NOTHING
        for begin, end in self.spans:
            if not t.size or t[-1] < begin or t[0] > end:
                continue
            edge = np.minimum(t - begin, end - t) / max(self.fade_s, 1e-9)
            share = 0.5 - 0.5 * np.cos(np.pi * np.clip(edge, 0.0, 1.0))
            total = total + share[:, None] * of_part(t - begin if self.anew else t)
        return np.asarray(total)


@dataclass(frozen=True, eq=False)
class Changed:
    """What is made of another motion, whose frequencies, length and events it keeps."""

    motion: Motion

    @property
    def bands(self) -> Sequence[Band]:
        """Those of the motion."""
        return self.motion.bands

    @property
    def duration_s(self) -> float | None:
        """That of the motion."""
        return self.motion.duration_s

    @property
    def events(self) -> Sequence[dict[str, Any]]:
        """Those of the motion."""
        return self.motion.events


@dataclass(frozen=True, eq=False)
class Mounted(Changed):
    """A motion as a sensor on the bench has it: along its own axes, and warmer."""

    rotation: Array  # from the axes of the bench to those of the sensor
    # how much warmer than its surroundings the chip becomes when it is switched on, K
    heating_k: float = 0.0
    warm_up_s: float = 60.0  # time constant of that, s

    def specific_force(self, t: Array) -> Array:
        """Return m/s² along the sensor's axes."""
        return np.asarray(self.motion.specific_force(t) @ self.rotation.T)

    def angular_velocity(self, t: Array) -> Array:
        """Return rad/s along the sensor's axes."""
        return np.asarray(self.motion.angular_velocity(t) @ self.rotation.T)

    def magnetic_field(self, t: Array) -> Array:
        """Return T along the sensor's axes."""
        return np.asarray(self.motion.magnetic_field(t) @ self.rotation.T)

    def temperature(self, t: Array) -> Array:
        """Return °C of the chip."""
        outside = self.motion.temperature(t)
        if not self.heating_k:
            return outside
        return np.asarray(outside - self.heating_k * np.expm1(-t / self.warm_up_s))


def attitude(roll: float, pitch: float) -> Array:
    """Return the rotation from level axes to those of something tilted about x, then about y."""
    sr, cr, sp, cp = math.sin(roll), math.cos(roll), math.sin(pitch), math.cos(pitch)
    # the inverse of Ry(pitch) Rx(roll); + 0.0 keeps a level bench from showing -0.0
    rows = [[cp, 0.0, -sp], [sr * sp, cr, sr * cp], [cr * sp, -sr, cr * cp]]
    return np.array(rows) + 0.0


def along(axis: str) -> Array:
    """Return the unit vector of an axis, shape (3,)."""
    if axis not in AXES:
        raise ConfigError(f'axis {axis!r} is not allowed; allowed: {", ".join(AXES)}')
    return np.asarray(np.eye(len(AXES))[AXES.index(axis)])


def highest_hz(motion: Motion) -> float:
    """Return the highest frequency in a motion; zero for one that is slow or still."""
    return max((band.high_hz for band in motion.bands), default=0.0)


def _total(contributions: Any) -> Array:
    first, *others = contributions
    total = first
    for other in others:
        if other is not NOTHING and other is not _NO_CHANGE:
            total = total + other
    return np.asarray(total)
