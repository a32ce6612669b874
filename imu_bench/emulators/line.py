# SPDX-License-Identifier: Apache-2.0
"""How long bytes take on a wire, who may talk when, and short waits put together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import threading
from typing import Any, TypeVar

from imu_bench.bus.interface import Clock

_T = TypeVar('_T')


@dataclass(frozen=True)
class Timing:
    """
    What a transfer costs.

    Examples
    --------
    14 bytes from a register at 400 kHz: three bytes of header, 9 bit per byte, 3 bit of
    conditions make 390 µs.

    >>> round(Timing.i2c(400e3).read_ns(14) / 1000)
    390
    """

    byte_ns: float  # one byte
    # read_header, write_header: bytes on the wire before the first data byte
    read_header: int
    write_header: int
    overhead_ns: float  # start, repeated start and stop, or chip select
    stretchable: bool = False  # A chip may hold the clock low: I²C

    @classmethod
    def i2c(cls, speed_hz: float = 400e3) -> Timing:
        """Return I²C: address and register, then address again to read; 8 bit and acknowledge."""
        return cls(9e9 / speed_hz, 3, 2, 3e9 / speed_hz, stretchable=True)

    @classmethod
    def spi(cls, speed_hz: float = 1e6) -> Timing:
        """Return SPI: one byte with the register; half a clock of chip select at each end."""
        return cls(8e9 / speed_hz, 1, 1, 1e9 / speed_hz)

    @classmethod
    def frames(cls, speed_hz: float = 1e6) -> Timing:
        """Return SPI frames: nothing but the bytes, and 10 µs between two of them."""
        return cls(8e9 / speed_hz, 0, 0, 10e3 + 1e9 / speed_hz)

    @classmethod
    def serial(cls, baud: float = 115200.0) -> Timing:
        """Return a serial line: start, eight data bits, stop."""
        return cls(10e9 / baud, 0, 0, 0.0)

    def read_ns(self, length: int) -> float:
        """Return how long reading takes."""
        return self.overhead_ns + (self.read_header + length) * self.byte_ns

    def write_ns(self, length: int) -> float:
        """Return how long writing takes."""
        return self.overhead_ns + (self.write_header + length) * self.byte_ns


class Wire:
    """What is held while bits travel; several lines may be one wire."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.free_ns = 0
        self._chips: dict[int, list[Any]] = {}

    def chips_at(self, address: int) -> list[Any]:
        """Return who answers at an I²C address: usually one chip; who comes adds himself."""
        return self._chips.setdefault(address, [])


class Line:
    """
    A wire as a chip on it sees it; one transfer at a time.

    Parameters
    ----------
    clock : Clock
        Waits until the last bit is through.
    wire : Wire, optional
        To share with other lines, whose clocks show the same time; one of its own by default.
    """

    def __init__(self, clock: Clock, timing: Timing, wire: Wire | None = None) -> None:
        self.clock = clock
        self.timing = timing
        self.wire = wire or Wire()

    def read(self, length: int, answer: Callable[[int, float], _T], stretch_ns: float = 0.0) -> _T:
        """
        Return what `answer` makes of the time of the first data byte and the time per byte.

        The caller waits until the transfer is over, as on a real bus; the chip holds the clock
        for `stretch_ns` after each byte of data.
        """
        header = self.timing.overhead_ns + self.timing.read_header * self.timing.byte_ns
        data = length * (self.timing.byte_ns + stretch_ns * self.timing.stretchable)
        return self._transfer(header, data, answer)

    def write(
        self, length: int, answer: Callable[[int, float], _T], stretch_ns: float = 0.0
    ) -> _T:
        """Let `answer` take the bytes when the last one is through."""
        stretched = length * stretch_ns * self.timing.stretchable
        return self._transfer(self.timing.write_ns(length) + stretched, 0.0, answer)

    def _transfer(self, before: float, after: float, answer: Callable[[int, float], _T]) -> _T:
        wire = self.wire
        with wire.lock:
            start = max(self.clock.now_ns(), wire.free_ns) + round(before)
            wire.free_ns = start
            try:
                result = answer(start, self.timing.byte_ns)
                wire.free_ns = start + round(after)
            finally:
                end = wire.free_ns
        self.clock.sleep_until(end)
        return result


SHORT_NS = 1_000_000
"""
Waits up to this are put off.  A status register on I²C takes 0.1 to 0.2 ms; to sleep and to be
woken costs as much again in CPU time, and takes longer than asked for.
"""


class Waiting(Clock):
    """
    A clock that lets a few transfers pass before it really waits for them.

    Meanwhile it shows the time as it would be if it had waited, so that it runs ahead of the
    other one, by `SHORT_NS` at most; the next longer wait ends when it should.

    Parameters
    ----------
    clock : Clock
        On which waiting takes time.

    Examples
    --------
    >>> from imu_bench.simulation.clock import SimulatedClock
    >>> real = SimulatedClock(start_ns=0)
    >>> clock = Waiting(real)
    >>> clock.sleep(0.0004)
    >>> clock.now_ns(), real.now_ns()
    (400000, 0)
    >>> clock.sleep(0.0008)
    >>> clock.now_ns(), real.now_ns()
    (1200000, 1200000)
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._shown_ns = 0

    def now_ns(self) -> int:
        """Return nanoseconds since the epoch; never steps backwards."""
        return max(self._clock.now_ns(), self._shown_ns)

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at `deadline_ns`, or up to `SHORT_NS` before and show that time."""
        if deadline_ns - self._clock.now_ns() > SHORT_NS:
            self._clock.sleep_until(deadline_ns)
        self._shown_ns = max(self._shown_ns, deadline_ns)
