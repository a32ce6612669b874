# SPDX-License-Identifier: Apache-2.0
"""
A full bus tried out: the drivers on emulated chips, one wire with its speed, a simulated clock.

Who gives way when not everything fits depends on deadlines, FIFOs and what each driver does
after a loss; no formula is as right as the drivers themselves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
import heapq
from typing import Any

from imu_bench import bench, drivers
from imu_bench.acquisition import Acquisition
from imu_bench.config import SensorConfig
from imu_bench.emulators.line import Line, Timing
from imu_bench.samples import Samples
from imu_bench.simulation.clock import SimulatedClock

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
        self._acquisitions: list[Acquisition] = []
        line = Line(self.clock, next(iter(timings.values())))
        for name, sensor in sensors.items():
            # on one SPI bus each chip has its own clock; one reads after the other all the same
            own = line if timings[name] == line.timing else Line(self.clock, timings[name])
            exact = {key: v for key, v in sensor.simulation.items() if key != 'rate_error'}
            buses = bench.emulated_buses(replace(sensor, simulation=exact), self.clock, own)
            made = drivers.load(sensor.driver)
            self.clock.sleep(made.start_up_s)
            driver = _Counted(made(buses, self.clock, sensor.settings))
            self.drivers[name] = driver
            self._acquisitions.append(Acquisition(driver, self.clock, name=name))
        for acquisition in self._acquisitions:
            acquisition.prepare()
        for acquisition in self._acquisitions:
            acquisition.advance(self.clock.now_ns())
        self._due = [(self.clock.now_ns(), k) for k in range(len(self._acquisitions))]

    def run(self, seconds: float) -> float:
        """Do what is due; return how long it was."""
        start_ns = self.clock.now_ns()
        until_ns = start_ns + round(seconds * 1e9)
        while self._due[0][0] < until_ns:
            at_ns, k = heapq.heappop(self._due)
            self.clock.sleep_until(at_ns)
            heapq.heappush(self._due, (self._acquisitions[k].step(), k))
            self._acquisitions[k].drain()
        self.clock.sleep_until(until_ns)
        return (self.clock.now_ns() - start_ns) * 1e-9


def rehearse(
    sensors: Mapping[str, SensorConfig], timings: Mapping[str, Timing]
) -> dict[str, float]:
    """
    Return the samples per second that each sensor of a bus delivers, by its name.

    Parameters
    ----------
    sensors : mapping of str to SensorConfig
    timings : mapping of str to Timing

    Raises
    ------
    BenchError
        If driver and settings do not go together.
    """
    bus = _Bus(sensors, timings)
    bus.run(SETTLING_S)
    before = {name: driver.samples for name, driver in bus.drivers.items()}
    seconds = bus.run(REHEARSED_S)
    return {name: (d.samples - before[name]) / seconds for name, d in bus.drivers.items()}
