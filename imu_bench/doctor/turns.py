# SPDX-License-Identifier: Apache-2.0
"""Sensors on a simulated clock: whoever is due reads, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import heapq

from imu_bench.acquisition import Acquisition
from imu_bench.samples import Samples
from imu_bench.simulation.clock import SimulatedClock


class Turns:
    """Acquisitions that take turns on one clock."""

    def __init__(self, acquisitions: Sequence[Acquisition], clock: SimulatedClock) -> None:
        self._acquisitions, self._clock = acquisitions, clock
        for acquisition in acquisitions:
            acquisition.advance(clock.now_ns())
        self._due = [(clock.now_ns(), k) for k in range(len(acquisitions))]

    def run(
        self, seconds: float, take: Callable[[int, list[Samples]], None] | None = None
    ) -> float:
        """Do what is due, and give what comes with the number of who read it; return how long."""
        start_ns = self._clock.now_ns()
        until_ns = start_ns + round(seconds * 1e9)
        while self._due and self._due[0][0] < until_ns:
            at_ns, k = heapq.heappop(self._due)
            self._clock.sleep_until(at_ns)
            heapq.heappush(self._due, (self._acquisitions[k].step(), k))
            runs = self._acquisitions[k].drain()
            if take is not None:
                take(k, runs)
        self._clock.sleep_until(until_ns)
        return (self._clock.now_ns() - start_ns) * 1e-9
