# SPDX-License-Identifier: Apache-2.0
"""A scenario that begins for all sensors of a live bench at once, after they have come up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from imu_bench.config.beginning import Beginning
from imu_bench.simulation.motion import Changed, Motion
from imu_bench.simulation.sensor_errors import Array
import numpy as np


@dataclass(frozen=True, eq=False)
class Later(Changed):
    """
    A still bench that begins to move at some time.

    Attributes
    ----------
    motion : Motion
        Its times count from the beginning.
    still : Motion
        The bench before that.
    switched_on_ns : int
        Unix time from which the times given to this motion count.
    beginning : Beginning

    Examples
    --------
    >>> from imu_bench.simulation.motion import Still, Sum
    >>> fallen = Later(Sum((Still(), Still())), Still(), 5_000_000_000, Beginning(15.0))
    >>> fallen.specific_force(np.array([9.0, 10.0]))[:, 2]
    array([ 9.80665, 19.6133 ])
    """

    still: Motion
    switched_on_ns: int
    beginning: Beginning

    def specific_force(self, t: Array) -> Array:
        """Return m/s²."""
        return self._of(t, self.still.specific_force, self.motion.specific_force)

    def angular_velocity(self, t: Array) -> Array:
        """Return rad/s."""
        return self._of(t, self.still.angular_velocity, self.motion.angular_velocity)

    def magnetic_field(self, t: Array) -> Array:
        """Return T."""
        return self._of(t, self.still.magnetic_field, self.motion.magnetic_field)

    def temperature(self, t: Array) -> Array:
        """Return °C."""
        return self._of(t, self.still.temperature, self.motion.temperature)

    def _of(
        self, t: Array, before: Callable[[Array], Array], after: Callable[[Array], Array]
    ) -> Array:
        since = t + (self.switched_on_ns * 1e-9 - self.beginning.at_s)
        begun = since >= 0.0
        if not begun.any():
            return before(t)
        moved = after(np.maximum(since, 0.0))
        if begun.all():
            return moved
        mask = begun if moved.ndim == 1 else begun[:, None]
        return np.asarray(np.where(mask, moved, before(t)))
