# SPDX-License-Identifier: Apache-2.0
"""What a driver may ask of the outside world: three kinds of wire, and a clock."""

from __future__ import annotations

from typing import Protocol


class Clock(Protocol):
    """Time as the bench sees it; real on hardware, simulated in tests."""

    def now_ns(self) -> int:
        """Return nanoseconds since the epoch; never steps backwards."""
        ...

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at `deadline_ns`, or at once when that has passed."""
        ...

    def sleep(self, seconds: float) -> None:
        """Let `seconds` pass."""
        ...


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


class ByteStream(Protocol):
    """A serial line."""

    name: str

    def read(self, timeout_s: float) -> bytes:
        """Return what has arrived, waiting up to `timeout_s` for the first byte."""
        ...

    def write(self, data: bytes) -> None:
        """Send bytes."""
        ...

    def close(self) -> None:
        """Release the device."""
        ...
