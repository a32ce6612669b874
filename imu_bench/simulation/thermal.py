# SPDX-License-Identifier: Apache-2.0
"""Temperature that rises, stays, and falls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from imu_bench.errors import ConfigError
from imu_bench.simulation.motion import Part
from imu_bench.simulation.sensor_errors import Array
import numpy as np


@dataclass(frozen=True)
class TemperatureRamp(Part):
    """What an oven adds to the temperature of the bench."""

    begin_s: float  # when the ramp begins
    # start_c, to_c: temperature before, and at the end of the ramp, °C
    start_c: float
    to_c: float
    kelvin_per_s: float  # steepness, without sign
    soak_s: float = 0.0  # time at the end of the ramp
    returns: bool = True  # whether it goes back after that, as steeply

    def __post_init__(self) -> None:
        if self.to_c == self.start_c or not self.kelvin_per_s > 0.0:
            raise ConfigError(
                f'temperature_ramp: from {self.start_c:g} °C to {self.to_c:g} °C at '
                f'{60 * self.kelvin_per_s:g} K/min is none; it must lead to another temperature'
            )

    @property
    def _corners(self) -> tuple[list[float], list[float]]:
        """Times, and how much warmer it is."""
        change = self.to_c - self.start_c
        up = self.begin_s + abs(change) / self.kelvin_per_s
        times, changes = [self.begin_s, up, up + self.soak_s], [0.0, change, change]
        if self.returns:
            times.append(times[-1] + up - self.begin_s)
            changes.append(0.0)
        return times, changes

    @property
    def duration_s(self) -> float | None:
        """Until the last corner."""
        return self._corners[0][-1]

    @property
    def events(self) -> Sequence[dict[str, Any]]:
        """The corners of the profile."""
        return [
            {'begin_s': time, 'temperature': {'value': self.start_c + change, 'unit': '°C'}}
            for time, change in zip(*self._corners, strict=True)
        ]

    def temperature(self, t: Array) -> Array:
        """Return how much warmer it is, K, shape (n,)."""
        return np.interp(t, *self._corners)
