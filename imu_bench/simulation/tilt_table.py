# SPDX-License-Identifier: Apache-2.0
"""A tilt table that is set step by step, by a motor or by a hand on a knob."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from imu_bench.errors import ConfigError
from imu_bench.simulation.motion import Band, During, NOTHING, Part, Seed, Still
from imu_bench.simulation.random_vibration import RandomVibration
from imu_bench.simulation.sensor_errors import Array
import numpy as np

TREMOR_HZ = (2.0, 15.0)
"""Band in which a hand shakes the table: physiological tremor is at 8 to 12 Hz."""


@dataclass(frozen=True, eq=False)
class TiltSteps(Part):
    """
    What the steps of a tilt table add to a still bench.

    The angle is the inclination θ = atan2(a_axis, √(a_other² + a_z²)) that a perfect sensor on
    a level table would show.
    """

    base: Still  # the bench on the table at angle zero
    step: float  # rad
    steps: int  # number of steps away from zero
    returns: bool = True  # whether the table goes back to zero by the same steps
    # dwell_s, move_s: time at each angle, and time between two
    dwell_s: float = 60.0
    move_s: float = 3.0
    axis: str = 'x'  # 'x' or 'y': the horizontal axis that is raised
    knob_error: float = 0.0  # standard deviation of each angle set by hand, rad; zero for a motor
    # acceleration spectral density of the hand while it turns the knob, (m/s²)²/Hz
    tremor: float = 0.0
    seed: Seed = 0

    def __post_init__(self) -> None:
        if self.axis not in ('x', 'y'):
            raise ConfigError(f'tilt_steps: axis {self.axis!r} is not allowed; allowed: x, y')
        if self.steps < 1 or not self.dwell_s > 0.0 or not self.move_s > 0.0:
            raise ConfigError('tilt_steps: steps, dwell and move must be above zero')

    @cached_property
    def set_angles(self) -> Array:
        """The angles in the plan, rad."""
        rising = self.step * np.arange(self.steps + 1)
        return np.asarray(np.concatenate([rising, rising[-2::-1]]) if self.returns else rising)

    @cached_property
    def angles(self) -> Array:
        """The angles the table truly stands at, rad."""
        errors = np.random.default_rng(self.seed).standard_normal(self.set_angles.size)
        return np.asarray(self.set_angles + self.knob_error * errors)

    @cached_property
    def _moves(self) -> Array:
        """When each move begins, s."""
        begins = (self.dwell_s + self.move_s) * np.arange(1, self.angles.size) - self.move_s
        return np.asarray(begins)

    @cached_property
    def _hand(self) -> During | None:
        if not self.tremor:
            return None
        vibration = RandomVibration((self.tremor,) * 3, *TREMOR_HZ, seed=self.seed, name='tremor')
        spans = tuple((float(begin), float(begin) + self.move_s) for begin in self._moves)
        return During(vibration, spans, fade_s=self.move_s / 10.0, anew=False)

    @property
    def bands(self) -> Sequence[Band]:
        """Those of the hand: the table itself is slow."""
        return self._hand.bands if self._hand else ()

    @property
    def duration_s(self) -> float | None:
        """Until the end of the last dwell."""
        return float(self._moves[-1] + self.move_s + self.dwell_s)

    @property
    def events(self) -> Sequence[dict[str, Any]]:
        """Every angle with the time it stood."""
        begins = np.concatenate([[0.0], self._moves + self.move_s])
        return [
            {
                'step': index,
                'begin_s': float(begin),
                'end_s': float(begin + self.dwell_s),
                'set_angle': {'value': float(wanted), 'unit': 'rad'},
                'angle': {'value': float(angle), 'unit': 'rad'},
            }
            for index, (begin, wanted, angle) in enumerate(
                zip(begins, self.set_angles, self.angles, strict=True)
            )
        ]

    def angle(self, t: Array) -> Array:
        """Return the angle at each time, rad."""
        move, share = self._progress(t)
        # least jerk between two points at rest (Flash and Hogan 1985, J. Neurosci. 5(7):1688)
        smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        return np.asarray(self.angles[move] + np.diff(self.angles, append=0.0)[move] * smooth)

    def specific_force(self, t: Array) -> Array:
        """Return the change of gravity's reaction, and the hand's, m/s²."""
        upwards = self.base.specific_force(t)
        change = self._turned(upwards, self.angle(t))
        return change if self._hand is None else change + self._hand.specific_force(t)

    def angular_velocity(self, t: Array) -> Array:
        """Return rad/s: raising x turns about -y, raising y about +x."""
        move, share = self._progress(t)
        rate = 30.0 * (share * (1.0 - share)) ** 2 / self.move_s
        rate = rate * np.diff(self.angles, append=0.0)[move]
        if not rate.any():
            return NOTHING
        direction = np.array([0.0, -1.0, 0.0] if self.axis == 'x' else [1.0, 0.0, 0.0])
        return np.asarray(np.multiply.outer(rate, direction))

    def magnetic_field(self, t: Array) -> Array:
        """Return the change of the field along the turned axes, T."""
        return self._turned(self.base.magnetic_field(t), self.angle(t))

    def _progress(self, t: Array) -> tuple[np.ndarray, Array]:
        """Return which move has begun last, counted from 0 for none, and its share done."""
        begun = np.searchsorted(self._moves, t, side='right')
        last = np.maximum(begun - 1, 0)
        share = np.where(begun > 0, (t - self._moves[last]) / self.move_s, 0.0)
        return last, np.clip(share, 0.0, 1.0)

    def _turned(self, vector: Array, angle: Array) -> Array:
        """Return by how much a constant vector changes along axes that are tilted."""
        horizontal = 'xyz'.index(self.axis)
        sine, less = np.sin(angle), np.cos(angle) - 1.0
        change = np.zeros((angle.size, 3))
        change[:, horizontal] = less * vector[0, horizontal] + sine * vector[0, 2]
        change[:, 2] = less * vector[0, 2] - sine * vector[0, horizontal]
        return change
