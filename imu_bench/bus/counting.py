# SPDX-License-Identifier: Apache-2.0
"""A bus that counts its errors before they go on: on a test bench the error rate is a result."""

from __future__ import annotations

from collections import Counter

from imu_bench.bus.interface import RegisterBus
from imu_bench.errors import BusError


class CountingBus:
    """
    A RegisterBus around another one that counts 'bus_errors'.

    Parameters
    ----------
    counters : Counter
        Receives one count per failed transfer.
    """

    def __init__(self, bus: RegisterBus, counters: Counter[str]) -> None:
        self.name = bus.name
        self._bus = bus
        self._counters = counters

    def read(self, register: int, length: int) -> bytes:
        """Return bytes from a register on, in one transaction."""
        try:
            return self._bus.read(register, length)
        except BusError:
            self._counters['bus_errors'] += 1
            raise

    def write(self, register: int, data: bytes) -> None:
        """Write bytes from a register on, in one transaction."""
        try:
            self._bus.write(register, data)
        except BusError:
            self._counters['bus_errors'] += 1
            raise

    def close(self) -> None:
        """Release the device."""
        self._bus.close()
