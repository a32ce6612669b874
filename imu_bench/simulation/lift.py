# SPDX-License-Identifier: Apache-2.0
"""A ride in a lift: limited jerk, doors, and rails that are not smooth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
import math
from typing import Any, NamedTuple

from imu_bench.errors import ConfigError
from imu_bench.simulation.motion import Band, Part, Seed
from imu_bench.simulation.random_vibration import RandomVibration
from imu_bench.simulation.sensor_errors import Array
import numpy as np

THUD_HZ = 12.0
THUD_DECAY_S = 0.15
"""
A thud rings at this frequency and fades with this time constant: a cabin on its isolation
(assumed, as are the next two).
"""

DOORS_S = 2.0
"""From the thud of the closing doors to the start, and from the stop to that of the opening."""

GUIDES_HZ = (2.0, 30.0)
"""Band of the vibration that the guide rails cause."""


class Profile(NamedTuple):
    """Piecewise constant jerk: times, and acceleration, velocity and position at them."""

    times: Array
    acceleration: Array
    velocity: Array
    position: Array


def jerk_limited(distance: float, speed: float, acceleration: float, jerk: float) -> Profile:
    """
    Return the fastest way from rest to rest within limits of speed, acceleration and jerk.

    Parameters
    ----------
    distance : float
        m, negative for downwards.
    speed, acceleration, jerk : float
        Limits in m/s, m/s², m/s³; a short way reaches only some of them.
    """
    if not distance or min(speed, acceleration, jerk) <= 0.0:
        raise ConfigError('lift_ride: distance must not be zero; its limits must be above zero')
    # what the way allows: only jerk limited, then also by acceleration
    reach = min(acceleration, (abs(distance) * jerk**2 / 2.0) ** (1.0 / 3.0))
    ramp = reach / jerk
    fastest = (math.sqrt(ramp**2 + 4.0 * abs(distance) / reach) - ramp) * reach / 2.0
    top = min(speed, fastest)
    reach = min(reach, math.sqrt(top * jerk))
    ramp = reach / jerk
    flat = top / reach - ramp
    cruise = abs(distance) / top - (flat + 2.0 * ramp)
    steps = [ramp, flat, ramp, max(cruise, 0.0), ramp, flat, ramp]
    jerks = math.copysign(jerk, distance) * np.array([1, 0, -1, 0, -1, 0, 1])
    states = [(0.0, 0.0, 0.0)]
    for step, j in zip(steps, jerks.tolist(), strict=True):
        states.append(_after(states[-1], j, step))
    times = np.concatenate([[0.0], np.cumsum(steps)])
    return Profile(times, *np.array(states).T)


def _after(state: tuple[Any, Any, Any], jerk: Any, dt: Any) -> tuple[Any, Any, Any]:
    """Return acceleration, velocity and position after a time of constant jerk."""
    a, v, x = state
    return (
        a + jerk * dt,
        v + a * dt + jerk * dt**2 / 2.0,
        x + v * dt + a * dt**2 / 2.0 + jerk * dt**3 / 6.0,
    )


@dataclass(frozen=True, eq=False)
class LiftRide(Part):
    """What a lift adds to a still bench on its floor."""

    # distance, speed, acceleration, jerk: as in `jerk_limited`
    distance: float
    speed: float
    acceleration: float
    jerk: float
    wait_s: float = 20.0  # time before the start, and again after the stop
    # peak of the vibration when the doors have closed and when they begin to open, m/s²
    door_thud: float = 0.0
    # acceleration spectral density across the rails at full speed, (m/s²)²/Hz; along them it is a
    # quarter
    guide_vibration: float = 0.0
    rail_length: float = 5.0  # m; passing a joint is a thud
    joint_thud: float = 0.0  # peak of it across the rails, m/s²
    seed: Seed = 0

    def __post_init__(self) -> None:
        if self.wait_s <= DOORS_S or not self.rail_length > 0.0:
            raise ConfigError(
                f'lift_ride: wait must be above {DOORS_S:g} s, for the doors; rail_length above 0'
            )
        _ = self._profile

    @cached_property
    def _profile(self) -> Profile:
        return jerk_limited(self.distance, self.speed, self.acceleration, self.jerk)

    @cached_property
    def _rails(self) -> RandomVibration:
        density = (self.guide_vibration, self.guide_vibration, self.guide_vibration / 4.0)
        return RandomVibration(density, *GUIDES_HZ, seed=self.seed, name='guide rails')

    @property
    def _stop_s(self) -> float:
        return self.wait_s + float(self._profile.times[-1])

    @cached_property
    def _thuds(self) -> list[tuple[float, Array]]:
        """When it thuds, and the peak along each axis."""
        rng = np.random.default_rng(self.seed)
        doors = np.array([0.5, 1.0, 0.3]) * self.door_thud
        thuds = [(self.wait_s - DOORS_S, doors), (self._stop_s + DOORS_S, doors)]
        if self.joint_thud:
            t = np.arange(0.0, float(self._profile.times[-1]), 1e-3)
            joints = np.abs(self._state(t)[2]) // self.rail_length
            for passed in t[1:][np.diff(joints) > 0]:
                across = self.joint_thud * rng.uniform(-1.0, 1.0, 2)
                thuds.append((self.wait_s + float(passed), np.append(across, 0.0)))
        return thuds

    @property
    def bands(self) -> Sequence[Band]:
        """Thuds and rails."""
        thud = [Band('thuds', THUD_HZ, THUD_HZ)] if self.door_thud or self.joint_thud else []
        return [*thud, *(self._rails.bands if self.guide_vibration else ())]

    @property
    def duration_s(self) -> float | None:
        """Until the end of the second wait."""
        return self._stop_s + self.wait_s

    @property
    def events(self) -> Sequence[dict[str, Any]]:
        """The phases of the ride, and what a recording of it must give."""
        profile = self._profile
        phases = ('jerk', 'accelerate', 'jerk', 'cruise', 'jerk', 'brake', 'jerk')
        spans = zip(phases, profile.times[:-1], profile.times[1:], strict=True)
        return [
            {
                'height': {'value': float(profile.position[-1]), 'unit': 'm'},
                'highest_speed': {'value': _largest(profile.velocity), 'unit': 'm/s'},
                'highest_acceleration': {'value': _largest(profile.acceleration), 'unit': 'm/s²'},
            },
            {'phase': 'doors closed', 'begin_s': self.wait_s - DOORS_S},
            *(
                {
                    'phase': phase,
                    'begin_s': self.wait_s + float(begin),
                    'end_s': self.wait_s + float(end),
                }
                for phase, begin, end in spans
                if end > begin
            ),
            {'phase': 'doors open', 'begin_s': self._stop_s + DOORS_S},
        ]

    def specific_force(self, t: Array) -> Array:
        """Return m/s², shape (n, 3)."""
        acceleration, velocity, _ = self._state(t - self.wait_s)
        force = np.zeros((t.size, 3))
        if self.guide_vibration and velocity.any():
            share = np.abs(velocity) / _largest(self._profile.velocity)
            force += share[:, None] * self._rails.specific_force(t)
        force[:, 2] += acceleration
        for begin, peak in self._thuds:
            ringing = np.flatnonzero((t >= begin) & (t < begin + 12.0 * THUD_DECAY_S))
            if ringing.size and peak.any():
                since = t[ringing] - begin
                wave = np.exp(-since / THUD_DECAY_S) * np.sin(2.0 * np.pi * THUD_HZ * since)
                force[ringing] += np.multiply.outer(wave, peak)
        return force

    def _state(self, t: Array) -> tuple[Array, Array, Array]:
        """Return acceleration, velocity and position at times since the start."""
        times, *states = self._profile
        within = np.clip(t, 0.0, times[-1])
        piece = np.clip(np.searchsorted(times, within, side='right') - 1, 0, times.size - 2)
        steps = np.diff(times)
        jerk = np.diff(states[0]) / np.where(steps > 0.0, steps, 1.0)
        a, v, x = (state[piece] for state in states)
        return _after((a, v, x), jerk[piece], within - times[piece])


def _largest(values: Array) -> float:
    return float(np.abs(values).max())
