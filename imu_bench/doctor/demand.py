# SPDX-License-Identifier: Apache-2.0
"""
What a driver does on its wire, found out by letting it read an emulated chip.

Nothing is declared for this, so a new driver needs no line here.  The wire takes no time and
every transfer is counted while the driver reads at its own pace.  Then nobody looks for longer
and longer, until samples are lost: that is the depth of the FIFO.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import math
from typing import Any

from imu_bench import bench, drivers, wires
from imu_bench.config import SensorConfig
from imu_bench.drivers.driver import Driver
from imu_bench.emulators.line import Line, Timing
from imu_bench.errors import BenchError
from imu_bench.simulation.clock import SimulatedClock
import numpy as np
import numpy.typing as npt

COUNTED_S = 3.0
SETTLING_LOOKS = 20
LONGEST_AWAY_S = 2.0
RESOLUTION = 0.01
"""Relative, of the depth."""

ONE_SAMPLE = 2.5
"""Periods: a register that is overwritten lasts no longer, however the look falls."""

_FREE = Timing(byte_ns=0.0, read_header=0, write_header=0, overhead_ns=0.0)


@dataclass(frozen=True)
class Demand:
    """What one sensor asks of its wire."""

    kind: str  # kind of its bus
    rate_hz: float  # of its main stream, as set
    look_period_s: float  # how often its driver reads
    # transfers, counted as in `Meter`
    per_second: npt.NDArray[np.float64]
    depth_s: float  # for so long nobody has to look before samples are lost; `math.inf` beyond 2 s

    @property
    def has_fifo(self) -> bool:
        """Whether samples wait until somebody looks."""
        return self.depth_s * self.rate_hz > ONE_SAMPLE


class _Alone:
    """A driver on an emulated chip whose wire takes no time."""

    def __init__(self, sensor: SensorConfig) -> None:
        self.clock = SimulatedClock()
        self.meter = Meter()
        buses = bench.emulated_buses(sensor, self.clock, Line(self.clock, _FREE))
        made = drivers.load(sensor.driver)
        self.clock.sleep(made.start_up_s)
        self.driver: Driver = made(metered(buses, self.meter), self.clock, sensor.settings)
        self.driver.identify()
        self.driver.configure()
        self.driver.start()
        self.due_ns = self.clock.now_ns()

    def look(self, after_s: float) -> bool:
        """Read after a while; return whether samples were lost."""
        continuity = self.driver.continuity
        self.due_ns += round(after_s * 1e9)
        self.clock.sleep_until(self.due_ns)
        try:
            self.driver.read()
        except BenchError:
            return True  # half of a frame
        return self.driver.continuity != continuity or bool(self.driver.skipped)

    def settle(self) -> None:
        """Look for a while as the driver wants it."""
        for _ in range(SETTLING_LOOKS):
            self.look(self.driver.poll_period_s)

    def count(self) -> npt.NDArray[np.float64]:
        """Return the transfers per second at the driver's own pace."""
        self.settle()
        period_s = self.driver.poll_period_s
        looks = max(round(COUNTED_S / period_s), SETTLING_LOOKS)
        before = self.meter.counts.copy()
        for _ in range(looks):
            self.look(period_s)
        return (self.meter.counts - before) / (looks * period_s)

    def too_late(self, away_s: float) -> bool:
        """Return whether samples are lost if nobody looks for a while."""
        self.settle()
        # what a device counts itself shows when the next of it arrives
        return self.look(away_s) | self.look(self.driver.poll_period_s)


def demand_of(sensor: SensorConfig) -> Demand | None:
    """Return what a sensor asks of its wire; None for a generic source, which has none."""
    if sensor.driver in (bench.GENERIC, bench.IIO):
        return None
    alone = _Alone(sensor)
    driver = alone.driver
    per_second = alone.count()
    # what the host has to ask for is not there when it asks too late
    depth_s = driver.poll_period_s if driver.paced else _depth_s(alone)
    kind = wires.kind_of_bus(sensor)
    return Demand(kind, driver.rate_hz, driver.poll_period_s, per_second, depth_s)


def _depth_s(alone: _Alone) -> float:
    low, high = alone.driver.poll_period_s, LONGEST_AWAY_S
    if not alone.too_late(high):
        return math.inf
    while high - low > RESOLUTION * low:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if alone.too_late(middle) else (middle, high)
    return low


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
