# SPDX-License-Identifier: Apache-2.0
"""Wires that pass everything through and count what went over them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from imu_bench.emulators.line import Timing


class Meter:
    """How many transfers, and of how many bytes."""

    def __init__(self) -> None:
        # reads, bytes read, writes, bytes written; headers are not among the bytes
        self.counts = np.zeros(4)

    def read(self, length: int) -> None:
        """Count a read."""
        self.counts[:2] += 1, length

    def wrote(self, length: int) -> None:
        """Count a write."""
        self.counts[2:] += 1, length


def seconds(counts: npt.NDArray[np.float64], timing: Timing, stretch_s: float = 0.0) -> float:
    """Return how long transfers keep a wire busy, with a chip that stretches each byte of data."""
    reads, bytes_read, writes, bytes_written = counts
    ns = reads * timing.read_ns(0) + writes * timing.write_ns(0)
    data = bytes_read + bytes_written
    return float(ns + data * timing.byte_ns) * 1e-9 + float(data) * stretch_s


def wire_bytes(counts: npt.NDArray[np.float64], timing: Timing) -> float:
    """Return how many bytes travel, with addresses and register numbers."""
    reads, bytes_read, writes, bytes_written = counts
    headers = reads * timing.read_header + writes * timing.write_header
    return float(headers + bytes_read + bytes_written)


class _Metered:
    """A wire of any kind that counts."""

    def __init__(self, wire: Any, meter: Meter) -> None:
        self.name = wire.name
        self._wire = wire
        self._meter = meter

    def close(self) -> None:
        """Release the device."""
        self._wire.close()


class MeteredRegisters(_Metered):
    """A RegisterBus that counts."""

    def read(self, register: int, length: int) -> bytes:
        """Return bytes from a register on."""
        self._meter.read(length)
        return bytes(self._wire.read(register, length))

    def write(self, register: int, data: bytes) -> None:
        """Write bytes from a register on."""
        self._meter.wrote(len(data))
        self._wire.write(register, data)


class MeteredFrames(_Metered):
    """A FrameBus that counts; a frame is read and written at once."""

    def transfer(self, frame: bytes) -> bytes:
        """Send a frame; return what the chip sent meanwhile."""
        self._meter.read(len(frame))
        return bytes(self._wire.transfer(frame))


class MeteredStream(_Metered):
    """A ByteStream that counts."""

    @property
    def baud(self) -> int:
        """Speed in bit/s."""
        return int(self._wire.baud)

    @baud.setter
    def baud(self, baud: int) -> None:
        self._wire.baud = baud

    def read(self, timeout_s: float) -> bytes:
        """Return what has arrived."""
        data = bytes(self._wire.read(timeout_s))
        self._meter.read(len(data))
        return data

    def write(self, data: bytes) -> None:
        """Send bytes."""
        self._meter.wrote(len(data))
        self._wire.write(data)


def metered(buses: Mapping[str, Any], meter: Meter) -> dict[str, Any]:
    """Return buses that count; a board hides its wire, and a line is on none."""
    return {part: _kind(wire)(wire, meter) for part, wire in buses.items()}


def _kind(wire: Any) -> Any:
    if any(hasattr(wire, of_no_wire) for of_no_wire in ('scan', 'edges', 'drive')):
        return lambda apart, meter: apart
    if hasattr(wire, 'baud'):
        return MeteredStream
    return MeteredFrames if hasattr(wire, 'transfer') else MeteredRegisters
