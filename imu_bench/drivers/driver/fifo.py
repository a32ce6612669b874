# SPDX-License-Identifier: Apache-2.0
"""Chips that keep samples until they are read, and give them in bursts."""

from __future__ import annotations

from typing import ClassVar

from imu_bench.bus.edges import Edge, Edges
from imu_bench.bus.slots import SlotFifo, Slots
from imu_bench.drivers.driver.base import Driver
from imu_bench.errors import BusError
from imu_bench.registers import Field, Register
import numpy as np
import numpy.typing as npt


class BurstDriver(Driver):
    """Base for a chip that keeps samples until they are read."""

    depth: int  # how many samples it keeps
    counter_names: ClassVar[tuple[str, ...]] = ('fifo_overflows',)

    @property
    def poll_period_s(self) -> float:
        """Return a quarter of the FIFO, or what reads each field though acquisition varies it."""
        beside = (max(0.8 / r - 1 / self.rate_hz, 0.6 / r) for r in self.rates_hz.values())
        return min(self.depth / 4 / self.rate_hz, *beside, 0.25)

    def watermark(self) -> int:
        """Return a level that is reached shortly before each reading; 0 without a line."""
        if self.edges is None:
            return 0
        return max(2, int(0.75 * self.poll_period_s * self.rate_hz))


class FifoDriver(BurstDriver):
    """Base for a chip whose FIFO counts bytes or words, so that a sample may be torn."""

    # a burst was begun and not taken out whole: nobody knows where in a sample the next one would
    # begin, so that the stream has to be begun anew
    torn = False
    rises_at_watermark: ClassVar[bool] = False
    """The data-ready line rises when the level reaches a watermark, not with each sample."""
    _ages: npt.NDArray[np.int64] = np.zeros(0, np.int64)
    _latched = 0, 0

    def start(self) -> None:
        """Start the stream."""
        super().start()
        self.torn = False

    def latch(self, register: Register, length: int | None = None) -> tuple[bytes, int]:
        """Return bytes that hold the level, and the host's time when it was latched."""
        before = self.clock.now_ns()
        data = self.registers.burst(register, length)
        self._latched = before, self.clock.now_ns()
        self.latch_ns = self._latched[1] - before
        return data, sum(self._latched) // 2

    def check_level(self, register: Register, level: int, capacity: int) -> None:
        """Refuse a level that no FIFO of such a size can have."""
        if level > capacity:
            self.counters['bus_errors'] += 1
            where = self.registers.where(register)
            raise BusError(f'{where}: {register.name} {level} of {capacity}; check the wiring')

    def stamps(self, latched_ns: int, n: int) -> npt.NDArray[np.int64]:
        """Return the times of n samples, the last one made when the level was latched."""
        if n > len(self._ages):
            ages = np.arange(max(n, self.depth) - 1, -1, -1) * (1e9 / self.rate_hz)
            self._ages = np.rint(ages).astype(np.int64)
        if self.edges is not None:
            self.edge = self._edge_of(self.edges, n)
        return latched_ns - self._ages[len(self._ages) - n :]

    def _edge_of(self, edges: Edges, n: int) -> Edge | None:
        """Return the edge that belongs to one of n samples, all that there were."""
        period_ns = 1e9 / self.rate_hz
        if not self.rises_at_watermark:
            return edges.newest(*self._latched, period_ns)
        edge = edges.reached(n, *self._latched, period_ns)
        edges.drained(self.clock.now_ns())
        return edge


class SlotDriver(BurstDriver):
    """Base for a chip whose FIFO counts whole samples, which never tear."""

    fifo: SlotFifo  # the host's side of it; a driver makes it before it is used
    fifo_threshold: ClassVar[Field]

    def start(self) -> None:
        """Empty the FIFO and start it."""
        super().start()
        if self.fifo.watermark:
            self.registers.write({self.fifo_threshold: self.fifo.watermark})
        self.fifo.begin()

    def take(self) -> Slots | None:
        """Return everything new, after an overrun what is left; None if it begins anew."""
        if self.fifo.torn or not self.configured:
            self.restart()
        slots = self.fifo.take()
        if slots is None:
            self.restart()
            return None
        self.latch_ns, self.edge = slots.latch_ns, slots.edge
        self.counters['fifo_overflows'] += slots.overrun
        self.continuity += slots.gap
        return slots
