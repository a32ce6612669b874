# SPDX-License-Identifier: Apache-2.0
"""
A full bus tried out: the drivers on emulated chips, one wire with its speed, a simulated clock.

Who gives way when not everything fits depends on deadlines, FIFOs and what each driver does
after a loss; no formula is as right as the drivers themselves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from imu_bench import bench, drivers
from imu_bench.acquisition import Acquisition
from imu_bench.config import SensorConfig
from imu_bench.doctor.turns import Turns
from imu_bench.emulators.line import Line, Timing, Wire
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
