# SPDX-License-Identifier: Apache-2.0
"""What a bus makes of the sensors on it: bytes, time per second, and the rates that come out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from imu_bench import drivers
from imu_bench.config import SensorConfig
from imu_bench.doctor.demand import Demand, demand_of
from imu_bench.doctor.metering import seconds, wire_bytes
from imu_bench.doctor.rehearsal import rehearse
from imu_bench.emulators.line import Timing

SURELY_FITS = 0.25
"""A bus that is busy for less of its time delivers everything; above it is tried out."""

KEPT = 0.98
"""A rate below this part of what is set is not kept."""


@dataclass(frozen=True)
class Share:
    """What one sensor gets and costs on its bus."""

    name: str
    nominal_hz: float
    predicted_hz: float
    look_period_s: float  # how often its driver wants to read
    bytes_per_s: float  # on the wire, with addresses and register numbers
    busy: float  # seconds of bus time per second, if everything fits
    depth_s: float  # how long the FIFO, or the register, holds out
    has_fifo: bool

    @property
    def keeps_rate(self) -> bool:
        """Whether it delivers what is set."""
        return self.predicted_hz >= KEPT * self.nominal_hz


@dataclass(frozen=True)
class BusLoad:
    """One bus with its sensors."""

    name: str
    kind: str
    speed_hz: float  # 0 where that means nothing
    speed_source: str  # how it is known
    shares: tuple[Share, ...]

    @property
    def busy(self) -> float:
        """Seconds of bus time that are asked for per second; more than 1 is too much."""
        return sum(share.busy for share in self.shares)

    @property
    def bytes_per_s(self) -> float:
        """Bytes per second on the wire."""
        return sum(share.bytes_per_s for share in self.shares)


@dataclass(frozen=True)
class Wire:
    """A bus of a bench before anything is known about its load."""

    name: str
    kind: str
    speed_hz: float
    speed_source: str
    sensors: Mapping[str, SensorConfig]
    timings: Mapping[str, Timing]  # by sensor: chips on one SPI bus have clocks of their own


def predict(wire: Wire) -> BusLoad:
    """Return what a bus makes of its sensors."""
    demands: dict[str, Demand] = {}
    for name, sensor in wire.sensors.items():
        if (demand := demand_of(sensor)) is not None:
            demands[name] = demand
    busy = {
        name: seconds(one.per_second, wire.timings[name], _stretch_s(wire, name))
        for name, one in demands.items()
    }
    rates = {name: demand.rate_hz for name, demand in demands.items()}
    shared = {'i2c', 'spi', 'frame'}
    if wire.kind in shared and sum(busy.values()) > SURELY_FITS:
        rates = rehearse({name: wire.sensors[name] for name in demands}, wire.timings)
    shares = tuple(
        Share(
            name,
            demand.rate_hz,
            min(rates[name], demand.rate_hz),
            demand.look_period_s,
            wire_bytes(demand.per_second, wire.timings[name]),
            busy[name],
            demand.depth_s,
            demand.has_fifo,
        )
        for name, demand in demands.items()
    )
    return BusLoad(wire.name, wire.kind, wire.speed_hz, wire.speed_source, shares)


def _stretch_s(wire: Wire, name: str) -> float:
    """Return for how long a chip holds the clock after each byte of data."""
    wiring = drivers.load(wire.sensors[name].driver).wiring['']
    return wiring.i2c_stretch_s if wire.timings[name].stretchable else 0.0
