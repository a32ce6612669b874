# SPDX-License-Identifier: Apache-2.0
"""
What a sensor with fusion of its own takes for its orientation.

Up is where the specific force points, north where the magnetic field does: the TRIAD method
(H. D. Black, A passive system for determining the attitude of a satellite, AIAA Journal 2
(1964), p. 1350), on smoothed vectors.  The makers' filters are secret; at rest all agree.
"""

from __future__ import annotations

from typing import Any

from imu_bench.emulators.low_pass import LowPass
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

Array = npt.NDArray[np.float64]

SMOOTHING_HZ = 0.5


class Attitude:
    """Orientation from east, north and up to the sensor's frame, sample by sample."""

    def __init__(self, rate_hz: float) -> None:
        self._force = LowPass(SMOOTHING_HZ, rate_hz)
        self._field = LowPass(SMOOTHING_HZ, rate_hz)

    @property
    def state(self) -> tuple[Any, Any]:
        """What is left of the vectors so far; put back, others follow it again."""
        return self._force.state, self._field.state

    @state.setter
    def state(self, state: tuple[Any, Any]) -> None:
        self._force.state, self._field.state = state

    def follow(self, force: Array, field: Array | None = None) -> Array:
        """Return quaternions x, y, z, w, shape (n, 4), from the sensor to east, north, up."""
        up = _unit(self._force.filter(force))
        if field is None:
            north = np.cross(up, np.array([1.0, 0.0, 0.0]))
        else:
            north = _unit(self._field.filter(field))
        east = _unit(np.cross(north, up))
        axes = np.stack([east, np.cross(up, east), up], axis=1)
        # falling freely, or with the field along gravity, nothing tells the orientation
        axes[~east.any(axis=1)] = np.eye(3)
        return np.asarray(Rotation.from_matrix(axes).as_quat(canonical=True))


def _unit(vectors: Array) -> Array:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0, vectors / np.where(length > 0, length, 1.0), 0.0)
