# SPDX-License-Identifier: Apache-2.0
"""Pins of an emulated chip on GPIO lines of an emulated computer."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Any

from imu_bench.bus.interface import Clock
import numpy as np

KEPT = 16
"""The kernel keeps so many events of a line: uapi/linux/gpio.h, event_buffer_size."""

FASTEST_NS, MEAN_NS = 3_000, 8_000
"""How late the interrupt handler is: assumed, 3 µs at least and an exponential tail."""


class EmulatedPin:
    """An EdgeLine."""

    def __init__(self, name: str, seed: int = 0) -> None:
        self.name = name
        self._noise = np.random.default_rng(seed)
        self._edges: deque[int] = deque(maxlen=KEPT)

    def rose(self, times_ns: Iterable[int]) -> None:
        """Interrupt the computer at these times."""
        for t in times_ns:
            late = FASTEST_NS + self._noise.exponential(MEAN_NS - FASTEST_NS)
            self._edges.append(int(t) + round(late))

    def edges(self) -> list[int]:
        """Return when it rose since the last call, ns."""
        found = sorted(self._edges)
        self._edges.clear()
        return found

    def close(self) -> None:
        """Do nothing: the pin stays where it is."""


class EmulatedReset:
    """An OutputLine at the reset pin of a chip, which begins anew when the line rises."""

    def __init__(self, name: str, chip: Any, clock: Clock) -> None:
        self.name = name
        self._chip = chip
        self._clock = clock
        self._high = True

    def drive(self, high: bool) -> None:
        """Set the level."""
        if high and not self._high:
            self._chip.power_up(self._clock.now_ns())
        self._high = high

    def close(self) -> None:
        """Do nothing: the pin stays where it is."""
