# SPDX-License-Identifier: Apache-2.0
"""A minute at rest: what every sensor of a bench gives, and what its registers hold."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from imu_bench import bench, wires
from imu_bench.acquisition import Acquisition, AcquisitionStats
from imu_bench.bus.clock import SystemClock
from imu_bench.bus.interface import Clock
from imu_bench.config import SensorConfig
from imu_bench.doctor.turns import Turns
from imu_bench.drivers.driver import BurstDriver, Driver
from imu_bench.errors import BenchError, ConfigError
from imu_bench.registers import Frame, Register, Typical
from imu_bench.samples import Samples
from imu_bench.simulation.clock import SimulatedClock
from imu_bench.simulation.world import as_set
from msg_conversions.quantities import IMU_QUANTITIES
import numpy as np
import numpy.typing as npt

SECONDS = 60.0
SETTLING_S = 5.0
"""Left out: filters settle, and a stream's first stamps are a guess."""

READ_APART = 50
"""Samples read register by register beside the FIFO."""

Columns = Mapping[str, npt.NDArray[np.float64]]


@dataclass
class Rested:
    """What one sensor gave at rest."""

    sensor: SensorConfig
    # of its document, as it is set; empty for a generic source
    typical: Mapping[str, Typical] = field(default_factory=dict)
    runs: list[Samples] = field(default_factory=list)
    stats: AcquisitionStats | None = None  # None if it could not be prepared
    # read from the output registers, beside the FIFO; empty without a FIFO
    apart: Columns = field(default_factory=dict)
    lost: int = 0  # samples of this time that were made and never came
    problem: str = ''  # why there is nothing

    def column(self, quantity: str) -> npt.NDArray[Any] | None:
        """Return a quantity of the whole time, or None if there is none."""
        parts = [getattr(run, quantity) for run in self.runs]
        found = [part for part in parts if part is not None]
        return np.concatenate(found) if found else None


Running = list[tuple[Rested, Acquisition]]


def rest(sensors: tuple[SensorConfig, ...], seconds: float = SECONDS) -> list[Rested]:
    """
    Let the sensors of a bench stand still and return what they gave, in their order.

    Where nothing is hardware the clock of each wire is simulated, and a minute takes seconds.
    """
    found = [Rested(sensor) for sensor in sensors]
    if any(sensor.backend == 'hardware' for sensor in sensors):
        _together(found, SystemClock(), _in_time, seconds)
        return found
    shared: dict[str, list[Rested]] = {}
    for one in found:
        shared.setdefault(wires.wire_of(one.sensor) or one.sensor.name, []).append(one)
    for sharing in shared.values():
        _together(sharing, SimulatedClock(), _in_turns, seconds)
    return found


def _together(
    found: list[Rested], clock: Clock, run: Callable[[Running, Any, float], None], seconds: float
) -> None:
    running: Running = []
    try:
        for one in found:
            acquisition = _prepared(one, clock, seconds)
            if acquisition is not None:
                running.append((one, acquisition))
        run(running, clock, seconds)
        for one, acquisition in running:
            one.stats = acquisition.stats
            one.lost += one.stats.lost
            _read_apart(one, acquisition.device, clock)
    finally:
        for _, acquisition in running:
            acquisition.close()


def _prepared(one: Rested, clock: Clock, seconds: float) -> Acquisition | None:
    """Return an acquisition that is ready; None with the problem noted if there is one."""
    if one.sensor.backend == 'recorded':
        one.problem = 'it is played from a recording: nothing stands still'
        return None
    acquisition = None
    try:
        acquisition = bench.build(replace(one.sensor, wire_recording=''), clock)
        acquisition.keep(2 * seconds + SETTLING_S, 1 << 30)
        acquisition.prepare()
    except ConfigError:
        raise
    except BenchError as error:
        one.problem = str(error)
        if acquisition is not None:
            acquisition.close()
        return None
    if isinstance(acquisition.device, Driver):
        one.typical = as_set(acquisition.device)
    return acquisition


def _settled(running: Running) -> None:
    """Forget what came, and was lost, so far."""
    for one, acquisition in running:
        acquisition.drain()
        one.lost = -acquisition.stats.lost


def _in_turns(running: Running, clock: Any, seconds: float) -> None:
    turns = Turns([acquisition for _, acquisition in running], clock)
    turns.run(SETTLING_S)
    _settled(running)
    turns.run(seconds, lambda k, runs: running[k][0].runs.extend(runs))
    for one, acquisition in running:
        acquisition.finish()
        one.runs += acquisition.drain()


def _in_time(running: Running, clock: Clock, seconds: float) -> None:
    for _, acquisition in running:
        acquisition.start()
    clock.sleep(SETTLING_S)
    _settled(running)
    clock.sleep(seconds)
    for one, acquisition in running:
        acquisition.stop()
        one.runs = acquisition.drain()


def _read_apart(one: Rested, device: Any, clock: Clock) -> None:
    """Read the output registers of a chip with a FIFO, one sample at a time."""
    if not isinstance(device, BurstDriver):
        return
    channels = [
        channel
        for channel in device.channels().values()
        if channel.quantity in {quantity.field for quantity in IMU_QUANTITIES}
        and isinstance(channel.first, Register)
    ]
    rows: dict[str, list[npt.NDArray[Any]]] = {channel.quantity: [] for channel in channels}
    try:
        device.start()
        # of the first samples a chip may not have any yet, or none that is good
        clock.sleep(max(0.5, 5.0 / device.rate_hz))
        for _ in range(READ_APART):
            clock.sleep(1.0 / device.rate_hz)
            for channel in channels:
                words = Frame(channel).unpack(device.registers.burst(channel.first))
                rows[channel.quantity].append(device.decode(words, channel)[channel.quantity])
        device.stop()
    except BenchError as error:
        one.problem = f'the output registers could not be read one by one: {error}'
        return
    one.apart = {quantity: np.concatenate(found) for quantity, found in rows.items()}
