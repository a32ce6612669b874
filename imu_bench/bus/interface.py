# SPDX-License-Identifier: Apache-2.0
"""What a driver may ask of the outside world: three kinds of wire, a line, a board, a clock."""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

from imu_bench.errors import ConfigError
import numpy as np
import numpy.typing as npt

DATA_READY, RESET_LINE = LINES = ('data_ready', 'reset_line')
"""Among the buses of a sensor, the line that says when it has data, and that which resets it."""


class Clock(Protocol):
    """Time as the bench sees it; real on hardware, simulated in tests."""

    def now_ns(self) -> int:
        """Return nanoseconds since the epoch; never steps backwards."""
        ...

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at `deadline_ns`, or at once when that has passed."""
        ...

    def sleep(self, seconds: float) -> None:
        """Let `seconds` pass; raises ConfigError if that is less than nothing."""
        if seconds < 0:
            raise ConfigError(f'cannot sleep for {seconds} s')
        self.sleep_until(self.now_ns() + round(seconds * 1e9))


class RegisterBus(Protocol):
    """A chip with numbered registers: I²C, or SPI with an address byte."""

    name: str
    """Device and address for error texts and diagnostics, such as '/dev/i2c-1 0x68'."""

    def read(self, register: int, length: int) -> bytes:
        """Return `length` bytes from `register` on, in one transaction."""
        ...

    def write(self, register: int, data: bytes) -> None:
        """Write bytes from `register` on, in one transaction."""
        ...

    def close(self) -> None:
        """Release the device."""
        ...


class FrameBus(Protocol):
    """A chip that exchanges frames of fixed length, full duplex: SPI."""

    name: str

    def transfer(self, frame: bytes) -> bytes:
        """Send a frame; return what the chip sent meanwhile, of the same length."""
        ...

    def close(self) -> None:
        """Release the device."""
        ...


@runtime_checkable
class ByteStream(Protocol):
    """A serial line; it may fail and come back while it is open."""

    name: str
    baud: int
    """Speed in bit/s; may be set.  Of no meaning on USB."""

    def read(self, timeout_s: float) -> bytes:
        """Return what has arrived, waiting up to `timeout_s` for the first byte."""
        ...

    def write(self, data: bytes) -> None:
        """Send bytes."""
        ...

    def close(self) -> None:
        """Release the device."""
        ...


class EdgeLine(Protocol):
    """A line that rises when a chip has data."""

    name: str

    def edges(self) -> list[int]:
        """Return when it rose since the last call, ns of the bench's clock; does not wait."""
        ...

    def close(self) -> None:
        """Release the line."""
        ...


class OutputLine(Protocol):
    """A line that drives a pin of a chip."""

    name: str

    def drive(self, high: bool) -> None:
        """Set the level."""
        ...

    def close(self) -> None:
        """Release the line."""
        ...


class Scan(NamedTuple):
    """What a board has converted since it was asked last: codes, shape (n,), and its flags."""

    codes: npt.NDArray[np.float64]
    running: bool = True
    hardware_overrun: bool = False
    buffer_overrun: bool = False


class DaqBoard(Protocol):
    """A board that converts voltages at its own pace into a buffer: the MCC 172."""

    name: str

    def identity(self) -> str:
        """Return product, serial number and firmware."""
        ...

    def set_supply(self, channel: int, on: bool) -> None:
        """Switch the constant current (IEPE) that feeds a sensor."""
        ...

    def supply(self, channel: int) -> bool:
        """Return whether a sensor is fed."""
        ...

    def set_rate(self, rate_hz: float) -> None:
        """Set the rate of all channels; the converters begin to synchronise."""
        ...

    def clock(self) -> tuple[float, bool]:
        """Return the rate that is set, and whether the converters are synchronised."""
        ...

    def start(self, channel: int) -> None:
        """Convert one channel until stopped."""
        ...

    def scan(self, wait_s: float = 0.0) -> Scan:
        """Return what has been converted since the last call, waiting so long for some."""
        ...

    def stop(self) -> None:
        """Stop converting and let go of the buffer; harmless when nothing runs."""
        ...

    def close(self) -> None:
        """Release the device."""
        ...
