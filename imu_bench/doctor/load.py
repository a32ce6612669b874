# SPDX-License-Identifier: Apache-2.0
"""
What a bus makes of the sensors on it: bytes, time per second, and the rates that come out.

A bus that may be full is tried out: the drivers on emulated chips, one wire with its speed, a
simulated clock.  Who gives way when not everything fits depends on deadlines, FIFOs and what each
driver does after a loss; no formula is as right as the drivers themselves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from imu_bench import bench, drivers
from imu_bench.acquisition import Acquisition
from imu_bench.config import SensorConfig
from imu_bench.doctor.demand import Demand, demand_of, seconds, wire_bytes
from imu_bench.doctor.turns import Turns
from imu_bench.emulators.line import Line, Timing, Wire
from imu_bench.samples import Samples
from imu_bench.simulation.clock import SimulatedClock

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
class BenchBus:
    """A bus of a bench before anything is known about its load."""

    name: str
    kind: str
    speed_hz: float
    speed_source: str
    sensors: Mapping[str, SensorConfig]
    timings: Mapping[str, Timing]  # by sensor: chips on one SPI bus have clocks of their own


def predict(wire: BenchBus) -> BusLoad:
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


def _stretch_s(wire: BenchBus, name: str) -> float:
    """Return for how long a chip holds the clock after each byte of data."""
    wiring = drivers.load(wire.sensors[name].driver).wiring['']
    return wiring.i2c_stretch_s if wire.timings[name].stretchable else 0.0


SETTLING_S = 3.0
REHEARSED_S = 8.0


class _Counted:
    """A driver that counts the samples of its main stream."""

    def __init__(self, driver: Any) -> None:
        self._driver = driver
        self.samples = 0

    def __getattr__(self, name: str) -> Any:
        """Return whatever the driver has."""
        return getattr(self._driver, name)

    def read(self) -> list[Samples]:
        """Return everything new."""
        runs: list[Samples] = self._driver.read()
        beside = self._driver.rates_hz
        for run in runs:
            if not any(getattr(run, quantity) is not None for quantity in beside):
                self.samples += len(run)
        return runs


class _Bus:
    """Sensors on one wire; each reads when it is due, one after the other."""

    def __init__(self, sensors: Mapping[str, SensorConfig], timings: Mapping[str, Timing]) -> None:
        self.clock = SimulatedClock()
        self.drivers: dict[str, _Counted] = {}
        acquisitions: list[Acquisition] = []
        wire = Wire()
        for name, sensor in sensors.items():
            own = Line(self.clock, timings[name], wire)
            exact = {key: v for key, v in sensor.simulation.items() if key != 'rate_error'}
            buses = bench.emulated_buses(replace(sensor, simulation=exact), self.clock, own)
            made = drivers.load(sensor.driver)
            self.clock.sleep(made.start_up_s)
            driver = _Counted(made(buses, self.clock, sensor.settings))
            self.drivers[name] = driver
            acquisitions.append(Acquisition(driver, self.clock, name=name))
        for acquisition in acquisitions:
            acquisition.prepare()
        self.run = Turns(acquisitions, self.clock).run


def rehearse(
    sensors: Mapping[str, SensorConfig], timings: Mapping[str, Timing]
) -> dict[str, float]:
    """Return the samples per second that each sensor of a bus delivers, by its name."""
    bus = _Bus(sensors, timings)
    bus.run(SETTLING_S)
    before = {name: driver.samples for name, driver in bus.drivers.items()}
    seconds = bus.run(REHEARSED_S)
    return {name: (d.samples - before[name]) / seconds for name, d in bus.drivers.items()}
