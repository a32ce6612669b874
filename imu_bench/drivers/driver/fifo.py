# SPDX-License-Identifier: Apache-2.0
"""Chips that keep samples until they are read, and give them in bursts."""

from __future__ import annotations

from typing import ClassVar

from imu_bench.bus.slots import SlotFifo, Slots
from imu_bench.drivers.driver.base import Driver
from imu_bench.errors import BusError
from imu_bench.registers import Register
import numpy as np
import numpy.typing as npt


class BurstDriver(Driver):
    """
    Base for a chip that keeps samples until they are read.

    Attributes
    ----------
    depth : int
        How many samples it keeps.
    """

    depth: int
    counter_names: ClassVar[tuple[str, ...]] = ('fifo_overflows',)

    @property
    def poll_period_s(self) -> float:
        """Return a quarter of the FIFO, or what reads each field though acquisition varies it."""
        beside = (max(0.8 / r - 1 / self.rate_hz, 0.6 / r) for r in self.rates_hz.values())
        return min(self.depth / 4 / self.rate_hz, *beside, 0.25)


class FifoDriver(BurstDriver):
    """
    Base for a chip whose FIFO counts bytes or words, so that a sample may be torn.

    Attributes
    ----------
    torn : bool
        A burst was begun and not taken out whole: nobody knows where in a sample the next one
        would begin, so that the stream has to be begun anew.
    """

    torn = False

    def start(self) -> None:
        """Start the stream."""
        super().start()
        self.torn = False

    def latch(self, register: Register, length: int | None = None) -> tuple[bytes, int]:
        """Return bytes that hold the level, and the host's time when it was latched."""
        before = self.clock.now_ns()
        data = self.registers.burst(register, length)
        return data, (before + self.clock.now_ns()) // 2

    def check_level(self, register: Register, level: int, capacity: int) -> None:
        """
        Refuse a level that no FIFO of such a size can have.

        Raises
        ------
        BusError
        """
        if level > capacity:
            self.counters['bus_errors'] += 1
            where = self.registers.where(register)
            raise BusError(f'{where}: {register.name} {level} of {capacity}; check the wiring')

    def stamps(self, latched_ns: int, n: int) -> npt.NDArray[np.int64]:
        """Return the times of n samples, the last one made when the level was latched."""
        ages = np.arange(n - 1, -1, -1) * (1e9 / self.rate_hz)
        return np.asarray(latched_ns - np.rint(ages).astype(np.int64))


class SlotDriver(BurstDriver):
    """
    Base for a chip whose FIFO counts whole samples, which never tear.

    Attributes
    ----------
    fifo : SlotFifo
        The host's side of it; a driver makes it before it is used.
    """

    fifo: SlotFifo

    def start(self) -> None:
        """Empty the FIFO and start it."""
        super().start()
        self.fifo.begin()

    def take(self) -> Slots | None:
        """Return everything new, after an overrun what is left; None if it begins anew."""
        if self.fifo.torn or not self.configured:
            self.restart()
        slots = self.fifo.take()
        if slots is None:
            self.restart()
            return None
        self.counters['fifo_overflows'] += slots.overrun
        self.continuity += slots.gap
        return slots
