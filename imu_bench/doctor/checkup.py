# SPDX-License-Identifier: Apache-2.0
"""Everything about a machine and, if one is given, about a bench on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
import math
from pathlib import PurePosixPath
from typing import Any

from imu_bench import bench, drivers
from imu_bench.config import BenchConfig, SensorConfig
from imu_bench.doctor import machine, probing
from imu_bench.doctor.load import BusLoad, predict, Wire
from imu_bench.doctor.machine import Bus
from imu_bench.doctor.probing import Answer
from imu_bench.emulators.line import Timing
from imu_bench.errors import BenchError, NotReady

SCHEMA = 'imu_bench.doctor/1'

FAST_I2C_HZ = 400e3
STANDARD_I2C_HZ = 100e3
"""What a bus has whose device tree says nothing; a Raspberry Pi has it by default."""

USB_HZ = 10e6
"""So that a byte takes 1 µs, as in full speed."""

CLOCK_STRETCHING = (
    'it stretches the clock, which the I²C hardware of a Raspberry Pi (before the 5) handles '
    'wrongly: bytes get corrupted. Use its serial line; or put into /boot/firmware/config.txt '
    'dtoverlay=i2c-gpio,bus=3, a software bus, or dtparam=i2c_arm_baudrate=50000'
)


@dataclass(frozen=True)
class SensorCheck:
    """
    One sensor of a bench.

    Attributes
    ----------
    name, label : str
        The label says what stands behind it.
    ok : bool
        Nothing is missing.
    found : str
        What it is, or what is missing and what to do.
    warnings : tuple of str
    """

    name: str
    label: str
    ok: bool
    found: str
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Checkup:
    """
    What was found.

    Attributes
    ----------
    model : str
    scheduling, scheduling_advice : str
        How the threads that read will be treated; what to do.
    buses : tuple of Bus
    lacking : tuple of str
        What to do about kinds of bus that are switched off.
    asked : bool
        Whether anybody was asked who he is.
    answers : tuple of Answer
    sensors : tuple of SensorCheck
    loads : tuple of BusLoad
    """

    model: str
    scheduling: str
    scheduling_advice: str
    buses: tuple[Bus, ...]
    lacking: tuple[str, ...] = ()
    asked: bool = False
    answers: tuple[Answer, ...] = ()
    sensors: tuple[SensorCheck, ...] = ()
    loads: tuple[BusLoad, ...] = field(default=())

    @property
    def ok(self) -> bool:
        """Whether the bench has everything it needs."""
        return all(sensor.ok for sensor in self.sensors)

    def as_json(self) -> dict[str, Any]:
        """Return everything for machines; what has no end is null."""
        document = {'schema': SCHEMA, 'ok': self.ok, **asdict(self)}
        for bus, one in zip(document['buses'], self.buses, strict=True):
            bus['advice'] = one.advice
        for load, whole in zip(document['loads'], self.loads, strict=True):
            load |= {'busy': whole.busy, 'bytes_per_s': whole.bytes_per_s}
            for share, each in zip(load['shares'], whole.shares, strict=True):
                share['keeps_rate'] = each.keeps_rate
                if math.isinf(each.depth_s):
                    share['depth_s'] = None
        return document


def examine(
    config: BenchConfig | None = None, *, i2c_hz: float = 0.0, probe: bool = True
) -> Checkup:
    """
    Look at this machine, and at a bench on it.

    Parameters
    ----------
    config : BenchConfig, optional
    i2c_hz : float
        Clock of every I²C bus; 0 to find it out.
    probe : bool
        Ask who answers.

    Raises
    ------
    BenchError
        If the settings of a sensor do not go together.
    """
    buses = tuple(machine.buses())
    # first the sensors of the bench: what the scan may not ask is known then
    sensors = _checks(config.sensors) if config else ()
    asked = [bus for bus in buses if probe and bus.accessible and bus.kind != 'serial']
    answers = tuple(answer for bus in asked for answer in probing.scan(bus))
    loads = tuple(predict(wire) for wire in _wires(config, buses, i2c_hz)) if config else ()
    return Checkup(
        machine.model(), *machine.scheduling(), buses, machine.lacking(buses), bool(asked),
        answers, sensors, loads,
    )  # fmt: skip


def _checks(sensors: tuple[SensorConfig, ...]) -> tuple[SensorCheck, ...]:
    places: dict[tuple[str, int | None], str] = {}
    checks = []
    for sensor in sensors:
        if sensor.backend != 'hardware':
            checks.append(_check(sensor))
            continue
        usual = drivers.load(sensor.driver).wiring[''].i2c_addresses[:1]
        on_i2c = bench.kind_of_bus(sensor) == 'i2c'
        address = (sensor.address or usual[0]) if on_i2c else None
        place = PurePosixPath(sensor.bus).name, address
        owner = places.setdefault(place, sensor.name)
        if owner == sensor.name:
            checks.append(_check(sensor))
        else:
            taken = f'{owner} is at the same place; give one of them another bus or address'
            checks.append(SensorCheck(sensor.name, bench.label(sensor), False, taken))
    return tuple(checks)


def _check(sensor: SensorConfig) -> SensorCheck:
    label = bench.label(sensor)
    if sensor.backend == 'recorded':
        return SensorCheck(sensor.name, label, True, f'plays {sensor.wire_recording}')
    if sensor.backend != 'hardware':
        return SensorCheck(sensor.name, label, True, f'{sensor.backend}: needs no hardware')
    try:
        return SensorCheck(sensor.name, label, True, probing.check(sensor), _warnings(sensor))
    except NotReady as error:
        return SensorCheck(sensor.name, label, True, str(error), _warnings(sensor))
    except BenchError as error:
        return SensorCheck(sensor.name, label, False, str(error), _warnings(sensor))


def _warnings(sensor: SensorConfig) -> tuple[str, ...]:
    wiring = drivers.load(sensor.driver).wiring['']
    stretches = wiring.i2c_stretches and bench.kind_of_bus(sensor) == 'i2c'
    return (CLOCK_STRETCHING,) if stretches and machine.mishandles_stretching() else ()


def _wires(config: BenchConfig, buses: tuple[Bus, ...], i2c_hz: float) -> list[Wire]:
    """Return the buses of a bench; an emulated sensor that names none has one of its own."""
    shared: dict[str, dict[str, SensorConfig]] = {}
    for sensor in config.sensors:
        if sensor.driver == bench.GENERIC or sensor.backend == 'recorded':
            continue  # no wire at all
        if bench.kind_of_bus(sensor) == 'daqhat':
            continue  # none that anybody knows
        shared.setdefault(_wire_name(sensor), {})[sensor.name] = sensor
    known = {PurePosixPath(bus.device).name: bus for bus in buses}
    return [_wire(name, sensors, known, i2c_hz) for name, sensors in shared.items()]


def _wire_name(sensor: SensorConfig) -> str:
    kinds = drivers.load(sensor.driver).bus_kinds
    if sensor.bus in ('', *kinds):
        return f'emulated {bench.kind_of_bus(sensor)} of {sensor.name}'
    name = PurePosixPath(sensor.bus).name
    # chip selects share the wires of one controller
    return name.partition('.')[0] if bench.kind_of_bus(sensor) in ('spi', 'frame') else name


def _wire(
    name: str, sensors: Mapping[str, SensorConfig], known: Mapping[str, Bus], i2c_hz: float
) -> Wire:
    kind = bench.kind_of_bus(next(iter(sensors.values())))
    if kind == 'i2c':
        speed_hz, source = _i2c_speed(name, sensors, known, i2c_hz)
        timings = dict.fromkeys(sensors, Timing.i2c(speed_hz))
        return Wire(name, kind, speed_hz, source, sensors, timings)
    timings = {key: _timing(sensor) for key, sensor in sensors.items()}
    if kind == 'serial':
        baud = round(10e9 / next(iter(timings.values())).byte_ns)
        source = 'USB' if baud == USB_HZ else 'as set'
        return Wire(name, kind, float(baud), source, sensors, timings)
    fastest = max(drivers.load(one.driver).wiring[''].spi_max_hz for one in sensors.values())
    return Wire(name, 'spi', float(fastest), 'of the chips', sensors, timings)


def _i2c_speed(
    name: str, sensors: Mapping[str, SensorConfig], known: Mapping[str, Bus], i2c_hz: float
) -> tuple[float, str]:
    if i2c_hz:
        return i2c_hz, 'given'
    if name in known and known[name].speed_hz:
        return known[name].speed_hz, 'device tree'
    if all(sensor.backend != 'hardware' for sensor in sensors.values()):
        return FAST_I2C_HZ, 'emulated'
    return STANDARD_I2C_HZ, 'assumed; give --i2c-hz'


def _timing(sensor: SensorConfig) -> Timing:
    kind, wiring = bench.kind_of_bus(sensor), drivers.load(sensor.driver).wiring['']
    if kind == 'serial':
        baud = sensor.settings.get('baud', wiring.serial_baud)
        return Timing.serial(float(baud or USB_HZ))
    make = Timing.frames if kind == 'frame' else Timing.spi
    return make(float(wiring.spi_max_hz))
