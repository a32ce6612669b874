# SPDX-License-Identifier: Apache-2.0
"""
Where everything is put together: from a configuration to a sensor that delivers.

Nothing below this floor knows whether a sensor is real; nothing above it has to.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, TYPE_CHECKING

from imu_bench import config, drivers
from imu_bench.acquisition import Acquisition, AcquisitionStats, Device, Tape
from imu_bench.acquisition.correction import correction
from imu_bench.bus.clock import SystemClock
from imu_bench.bus.iio import IioDevice, IioSensor
from imu_bench.bus.interface import Clock
from imu_bench.bus.opening import open_bus
from imu_bench.bus.recording import Played, Player, read_head, Recorder
from imu_bench.config import BenchConfig, SensorConfig
from imu_bench.config.beginning import Beginning
from imu_bench.config.campaign import BenchTest
from imu_bench.config.faults import Fault, script
from imu_bench.config.schema import Checkable
from imu_bench.drivers.driver import Driver
from imu_bench.errors import ConfigError, RecordingError
from imu_bench.samples import Samples
from imu_bench.wires import addresses_of, kind_of_bus, shared_wire

if TYPE_CHECKING:
    from imu_bench.emulators.line import Line, Wire
    from imu_bench.simulation.scenario import Scenario
    from imu_bench.simulation.simulated import SimulatedSensor

GENERIC, IIO = 'generic', 'iio'
"""Names of the drivers of sensors that have none: simulated, and read by the Linux kernel."""

_WITHOUT_CHIP = {GENERIC: 'imu_bench.simulation.generic', IIO: 'imu_bench.bus.iio'}

_NO_LIMIT = 1 << 62


def driver_names() -> list[str]:
    """Return everything a sensor's `driver` may be."""
    return sorted([*drivers.names(), *_WITHOUT_CHIP])


def settings_of(driver: str) -> Iterable[Checkable]:
    """
    Return the settings of a driver.

    Raises
    ------
    ConfigError
        If there is no such driver, or none is named, with the names there are.
    """
    if not driver:
        raise ConfigError(f'missing; allowed: {", ".join(driver_names())}')
    if driver in _WITHOUT_CHIP:
        return tuple(import_module(_WITHOUT_CHIP[driver]).SETTINGS)
    if driver not in drivers.names():
        raise ConfigError(f'no driver {driver!r}; {config.suggestion(driver, driver_names())}')
    return drivers.load(driver).settings


def load_sensor(
    path: str | Path, *, name: str = '', overrides: Mapping[str, Any] | None = None
) -> SensorConfig:
    """
    Return the sensor of a file, checked against the settings of its driver.

    Raises
    ------
    ConfigError
        With every problem of the file, one line each.
    """
    sensor = config.load_sensor(
        path, name=name, overrides=overrides, settings_of=settings_of, recorded_in=read_head
    )
    _check(sensor)
    return sensor


def load_bench(path: str | Path) -> BenchConfig:
    """
    Return the bench of a file with its sensors, checked against the settings of their drivers.

    Raises
    ------
    ConfigError
        With every problem of all files, one line each.
    """
    loaded = config.load_bench(path, settings_of=settings_of, recorded_in=read_head)
    for sensor in loaded.sensors:
        _check(sensor)
    for test in loaded.tests:
        as_tested(loaded, test)
    return loaded


def _check(sensor: SensorConfig) -> None:
    faults_of(sensor)
    drivers.check_lines(sensor.driver, sensor.lines, sensor.source)


def as_tested(loaded: BenchConfig, test: BenchTest) -> BenchConfig:
    """Return a bench with its sensors set as one of its tests wants them, or raise ConfigError."""
    return config.as_tested(loaded, test, load_sensor)


def faults_of(sensor: SensorConfig) -> tuple[Fault, ...]:
    """
    Return what will go wrong on the wire of an emulated sensor, in the order in which it begins.

    Raises
    ------
    ConfigError
        If a fault cannot happen to this sensor, with those that can.

    Examples
    --------
    >>> scripted = {'faults': ('unplugged 10 2',)}
    >>> faults_of(SensorConfig('left', 'mpu9250', 'emulated', simulation=scripted))
    (Fault(kind='unplugged', at_s=10.0, for_s=2.0),)
    """
    planned = script(sensor.simulation.get('faults', ()))
    if not planned or sensor.backend != 'emulated':
        return ()
    where = f'{sensor.source}.simulation.faults'.lstrip('.')
    if sensor.driver == GENERIC:
        raise ConfigError(f'{where}: a generic source has no wire; give a driver, or no faults')
    from imu_bench.emulators.faults import possible

    kind = kind_of_bus(sensor)
    allowed = possible(drivers.load(sensor.driver), kind)
    for fault in planned:
        if fault.kind not in allowed:
            raise ConfigError(
                f'{where}: {fault.kind} cannot happen to a {sensor.driver} on {kind}; '
                f'allowed: {", ".join(allowed)}'
            )
    return planned


def label(sensor: SensorConfig) -> str:
    """
    Return what stands behind a sensor, for logs.

    Examples
    --------
    >>> label(SensorConfig('left', 'mpu9250', 'hardware', bus='i2c-1', address=0x69))
    'hardware mpu9250 i2c-1 0x69'
    >>> label(SensorConfig('left', 'mpu9250', 'recorded', recorded_from='emulated mpu9250'))
    'recorded emulated mpu9250'
    """
    if sensor.backend == 'recorded':
        return f'recorded {sensor.recorded_from or sensor.driver}'
    address = '' if sensor.address is None else f'0x{sensor.address:02X}'
    if sensor.backend == IIO:
        return f'{IIO} {sensor.bus}'
    place = (sensor.bus, address) if sensor.backend == 'hardware' else ()
    return ' '.join(filter(None, (sensor.backend, sensor.driver, *place)))


def hardware_id(sensor: SensorConfig) -> str:
    """
    Return what tells a sensor from all others of a bench, for diagnostics.

    Examples
    --------
    >>> hardware_id(SensorConfig('left', 'mpu9250', 'emulated'))
    'emulated mpu9250 as left'
    """
    # no wire tells apart twins of which none is on one
    alone = sensor.backend in ('hardware', IIO) or sensor.name == sensor.driver
    return label(sensor) if alone else f'{label(sensor)} as {sensor.name}'


def import_all(sensor: SensorConfig) -> None:
    """Import what `build` will need for this sensor, for those who want it to be quick."""
    if sensor.driver in drivers.names():
        drivers.load(sensor.driver)
    if sensor.backend == 'emulated':
        import_module('imu_bench.simulation.world')
        import_module('imu_bench.emulators.faults')


def build(
    sensor: SensorConfig,
    clock: Clock | None = None,
    *,
    capacity_samples: int | None = None,
    on_data: Callable[[], None] | None = None,
    switched_on_ns: int | None = None,
    beginning: Beginning | None = None,
) -> Acquisition:
    """
    Return the acquisition of a sensor, not started yet.

    Parameters
    ----------
    clock : Clock, optional
        The computer's own by default.
    capacity_samples, on_data
        As in `imu_bench.acquisition.Acquisition`.
    switched_on_ns : int, optional
        From when on the scripted faults of an emulated sensor count; now by default.
    beginning : Beginning, optional
        When the scenario of an emulated sensor begins; as its file says by default.

    Raises
    ------
    ConfigError
        If driver, settings and backend do not go together.
    BusError
        If the bus of a hardware sensor cannot be opened.
    RecordingError
        If a wire recording cannot be begun, or cannot be played.
    """
    device, clock, tape = _assembled(sensor, clock or SystemClock(), switched_on_ns, beginning)
    return Acquisition(
        device,
        clock,
        capacity_samples=capacity_samples,
        on_data=on_data,
        correct=correction(sensor.calibration),
        tape=tape,
        name=sensor.name,
    )


def play(path: str | Path) -> tuple[list[Samples], AcquisitionStats]:
    """Return everything that a wire recording gives, as fast as possible, and how it went."""
    from imu_bench.simulation.clock import SimulatedClock

    given = {'backend': 'recorded', 'wire_recording': str(path)}
    sensor = config.sensor_from_parameters(
        Path(path).stem, given, settings_of=settings_of, recorded_in=read_head, source='recording'
    )
    acquisition = build(sensor, SimulatedClock(), capacity_samples=_NO_LIMIT)
    acquisition.advance(_NO_LIMIT)
    acquisition.finish()
    if isinstance(acquisition.error, RecordingError):
        raise acquisition.error
    return acquisition.drain(), acquisition.stats


def simulate(sensor: SensorConfig, scenario: Scenario, *, run: int = 0) -> SimulatedSensor:
    """
    Return a sensor that is only computed: no wire, and no clock that anybody waits for.

    A sensor with a driver has its typical values, with range, resolution and filter as set.

    Parameters
    ----------
    sensor : SensorConfig
        Whatever its backend.
    scenario : Scenario
        How the bench moves, the same one for all of its sensors.
    run : int
        Another run gives other noise of the same sensor.

    Raises
    ------
    ConfigError
        If settings or errors make no sense.
    """
    from imu_bench.simulation.clock import SimulatedClock, START_NS
    from imu_bench.simulation.simulated import SimulatedSensor
    from imu_bench.simulation.world import as_set, errors_of, sensor_source

    plain = replace(sensor, backend='emulated', wire_recording='')
    device, _, _ = _assembled(plain, SimulatedClock(), None, None)
    typical: Mapping[str, Any] = as_set(device) if isinstance(device, Driver) else {}
    rates = {
        quantity: device.rates_hz.get(quantity, device.rate_hz)
        for quantity in errors_of(sensor, typical)
    }
    sources = [
        sensor_source(
            sensor, typical, rate, START_NS, tuple(q for q in rates if rates[q] == rate),
            scenario=scenario, run=run,
        )
        for rate in dict.fromkeys(rates.values())
    ]  # fmt: skip
    angle = typical.get('inclination')
    return SimulatedSensor(sensor, tuple(sources), angle.resolution if angle else None)


def _assembled(
    sensor: SensorConfig,
    clock: Clock,
    switched_on_ns: int | None,
    beginning: Beginning | None,
) -> tuple[Device, Clock, Tape | None]:
    """Return the device, the clock it shares with its acquisition, and what records or plays."""
    if sensor.driver == IIO:
        return IioSensor(IioDevice(sensor.bus), clock, sensor.settings), clock, None
    if sensor.driver == GENERIC:
        return _generic(sensor, clock, beginning), clock, None
    driver = drivers.load(sensor.driver)
    if sensor.backend == 'recorded':
        values = driver.check_settings(sensor.settings)
        read_head(sensor.wire_recording).check(sensor.driver, values)
        player = Player(sensor.wire_recording, clock)
        return Played(driver(player.wires, player, sensor.settings)), player, player
    if sensor.backend == 'hardware':
        buses: Mapping[str, Any] = open_bus(
            sensor.bus, driver.wiring, driver.bus_kinds, clock=clock, **sensor.place
        )
    else:
        wire = shared_wire(sensor, clock)
        if isinstance(clock, SystemClock):
            from imu_bench.emulators.line import Waiting

            clock = Waiting(clock)
        buses = _switched_on(sensor, clock, switched_on_ns, beginning, wire)
    if not sensor.wire_recording:
        return driver(buses, clock, sensor.settings), clock, None
    values = driver.check_settings(sensor.settings)
    what = sensor.driver, values, label(sensor)
    recorder = Recorder(sensor.wire_recording, buses, clock, *what)
    return driver(recorder.wires, recorder, sensor.settings), recorder, recorder


def _generic(sensor: SensorConfig, clock: Clock, beginning: Beginning | None) -> Device:
    # late: real sensors start without the libraries that simulation needs
    from imu_bench.simulation import generic
    from imu_bench.simulation.world import sensor_source

    where = f'{sensor.source}.'.lstrip('.')
    if sensor.backend != 'emulated':
        raise ConfigError(f'{where}backend: a generic source has no hardware; allowed: emulated')
    if sensor.wire_recording:
        raise ConfigError(f'{where}wire_recording: a generic source has no wire; give a driver')
    faults_of(sensor)  # it cannot have any
    rate_hz = sensor.settings['rate_hz']
    source = sensor_source(sensor, {}, rate_hz, clock.now_ns(), beginning=beginning)
    return generic.GenericSensor(source, clock, sensor.settings)


def _switched_on(
    sensor: SensorConfig,
    clock: Clock,
    switched_on_ns: int | None,
    beginning: Beginning | None,
    wire: Wire | None,
) -> Mapping[str, Any]:
    """Return the buses of an emulated chip that has just started, with its faults."""
    faults = faults_of(sensor)
    buses = emulated_buses(sensor, clock, beginning=beginning, wire=wire)
    driver = drivers.load(sensor.driver)
    if faults:
        from imu_bench.emulators.faults import wrap

        buses = wrap(buses, driver, clock, faults, start_ns=switched_on_ns)
    # the emulated chip is switched on here, a real one was long ago
    clock.sleep(driver.start_up_s)
    return buses


def emulated_buses(
    sensor: SensorConfig,
    clock: Clock,
    line: Line | None = None,
    beginning: Beginning | None = None,
    wire: Wire | None = None,
) -> Mapping[str, Any]:
    """
    Return the emulated buses of a sensor, switched on now, on a line or wire to share.

    On a wire its dies are at their addresses; on a line, which is for finding out how much time
    sensors need on it, nobody is at the address of another.
    """
    from imu_bench import emulators
    from imu_bench.simulation.world import sensor_source

    driver = drivers.load(sensor.driver)
    # the emulated chip restarts the source at the rate its registers ask for
    source = sensor_source(
        sensor, driver.typical, 1.0, clock.now_ns(), on_wire=True, beginning=beginning
    )
    options = {name: sensor.settings[name] for name in driver.described if name in sensor.settings}
    if (kind := kind_of_bus(sensor)) in ('spi', 'frame'):
        options['speed_hz'] = sensor.spi_hz
    return emulators.create(
        sensor.driver, kind, source, clock, line=line, wire=wire, lines=sensor.lines,
        addresses=addresses_of(sensor) if wire is not None else None, **options,
    )  # fmt: skip
