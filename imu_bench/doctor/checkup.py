# SPDX-License-Identifier: Apache-2.0
"""Everything about a machine and, if one is given, about a bench on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
import math
from pathlib import PurePosixPath
from typing import Any

from imu_bench import bench, drivers, wires
from imu_bench.bus.iio import devices, IioDevice
from imu_bench.config import BenchConfig, SensorConfig
from imu_bench.doctor import machine, probing
from imu_bench.doctor.load import BenchBus, BusLoad, predict
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
    'wrongly: bytes get corrupted. Use its serial line, or a software bus: '
    'dtoverlay=i2c-gpio,bus=3 in /boot/firmware/config.txt'
)


@dataclass(frozen=True)
class SensorCheck:
    """One sensor of a bench."""

    # name, label: the label says what stands behind it
    name: str
    label: str
    ok: bool  # nothing is missing
    found: str  # what it is, or what is missing and what to do
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Checkup:
    """What was found."""

    model: str
    # scheduling, scheduling_advice: how the threads that read will be treated; what to do
    scheduling: str
    scheduling_advice: str
    buses: tuple[Bus, ...]
    lacking: tuple[str, ...] = ()  # what to do about kinds of bus that are switched off
    asked: bool = False  # whether anybody was asked who he is
    answers: tuple[Answer, ...] = ()
    sensors: tuple[SensorCheck, ...] = ()
    loads: tuple[BusLoad, ...] = field(default=())
    # devices that drivers of the kernel have bound (Industrial I/O), by what they are called
    kernel: dict[str, str] = field(default_factory=dict)

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
        A bench; without one the machine alone is examined.
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
    loads = tuple(predict(wire) for wire in _bench_buses(config, buses, i2c_hz)) if config else ()
    return Checkup(
        machine.model(), *machine.scheduling(), buses, machine.lacking(buses), bool(asked),
        answers, sensors, loads, devices(),
    )  # fmt: skip


def _checks(sensors: tuple[SensorConfig, ...]) -> tuple[SensorCheck, ...]:
    places: dict[tuple[str, int | None], str] = {}
    checks = []
    for sensor in sensors:
        if sensor.backend not in ('hardware', 'emulated') or not wires.wire_of(sensor):
            checks.append(_check(sensor))
            continue
        bus = PurePosixPath(sensor.bus).name
        addresses = tuple(wires.addresses_of(sensor).values()) or (None,)
        owners = [places.setdefault((bus, address), sensor.name) for address in addresses]
        others = ' and '.join(dict.fromkeys(owner for owner in owners if owner != sensor.name))
        if not others:
            checks.append(_check(sensor))
        else:
            taken = f'{others} is at the same place; give one of them another bus or address'
            checks.append(SensorCheck(sensor.name, bench.label(sensor), False, taken))
    return tuple(checks)


def _check(sensor: SensorConfig) -> SensorCheck:
    label = bench.label(sensor)
    if sensor.backend == 'recorded':
        return SensorCheck(sensor.name, label, True, f'plays {sensor.wire_recording}')
    if sensor.backend == 'iio':
        return _check_iio(sensor, label)
    if sensor.backend != 'hardware':
        return SensorCheck(sensor.name, label, True, f'{sensor.backend}: needs no hardware')
    try:
        return SensorCheck(sensor.name, label, True, probing.check(sensor), _warnings(sensor))
    except NotReady as error:
        return SensorCheck(sensor.name, label, True, str(error), _warnings(sensor))
    except BenchError as error:
        return SensorCheck(sensor.name, label, False, str(error), _warnings(sensor))


def _check_iio(sensor: SensorConfig, label: str) -> SensorCheck:
    """Look whether the kernel has bound such a device, and what it can buffer."""
    try:
        device = IioDevice(sensor.bus)
        channels = ', '.join(device.channels())
    except BenchError as error:
        return SensorCheck(sensor.name, label, False, str(error))
    return SensorCheck(sensor.name, label, True, f'{device.name} {device.called}: {channels}')


def _warnings(sensor: SensorConfig) -> tuple[str, ...]:
    wiring = drivers.load(sensor.driver).wiring['']
    stretches = wiring.i2c_stretch_s and wires.kind_of_bus(sensor) == 'i2c'
    return (CLOCK_STRETCHING,) if stretches and machine.mishandles_stretching() else ()


def _bench_buses(config: BenchConfig, buses: tuple[Bus, ...], i2c_hz: float) -> list[BenchBus]:
    """Return the buses of a bench; an emulated sensor that names none has one of its own."""
    shared: dict[str, dict[str, SensorConfig]] = {}
    for sensor in config.sensors:
        if sensor.driver in (bench.GENERIC, bench.IIO) or sensor.backend == 'recorded':
            continue  # no wire at all
        if wires.kind_of_bus(sensor) == 'daqhat':
            continue  # None that anybody knows
        kind = wires.kind_of_bus(sensor)
        name = wires.wire_of(sensor) or f'emulated {kind} of {sensor.name}'
        shared.setdefault(name, {})[sensor.name] = sensor
    known = {PurePosixPath(bus.device).name: bus for bus in buses}
    return [_wire(name, sensors, known, i2c_hz) for name, sensors in shared.items()]


def _wire(
    name: str, sensors: Mapping[str, SensorConfig], known: Mapping[str, Bus], i2c_hz: float
) -> BenchBus:
    kind = wires.kind_of_bus(next(iter(sensors.values())))
    if kind == 'i2c':
        speed_hz, source = _i2c_speed(name, sensors, known, i2c_hz)
        timings = dict.fromkeys(sensors, Timing.i2c(speed_hz))
        return BenchBus(name, kind, speed_hz, source, sensors, timings)
    timings = {key: _timing(sensor) for key, sensor in sensors.items()}
    if kind == 'serial':
        baud = round(10e9 / next(iter(timings.values())).byte_ns)
        source = 'USB' if baud == USB_HZ else 'as set'
        return BenchBus(name, kind, float(baud), source, sensors, timings)
    fastest = max(_spi_hz(one) for one in sensors.values())
    source = 'as set' if any(one.spi_hz for one in sensors.values()) else 'usual'
    return BenchBus(name, 'spi', float(fastest), source, sensors, timings)


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
    kind, wiring = wires.kind_of_bus(sensor), drivers.load(sensor.driver).wiring['']
    if kind == 'serial':
        baud = sensor.settings.get('baud', wiring.serial_baud)
        return Timing.serial(float(baud or USB_HZ))
    make = Timing.frames if kind == 'frame' else Timing.spi
    return make(float(_spi_hz(sensor)))


def _spi_hz(sensor: SensorConfig) -> int:
    return sensor.spi_hz or drivers.load(sensor.driver).wiring[''].spi_clock_hz
