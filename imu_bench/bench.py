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
from imu_bench.acquisition import Acquisition, Device
from imu_bench.acquisition.correction import correction
from imu_bench.bus.clock import SystemClock
from imu_bench.bus.interface import Clock
from imu_bench.bus.opening import kind_among, open_bus
from imu_bench.config import BenchConfig, SensorConfig
from imu_bench.config.beginning import Beginning
from imu_bench.config.faults import Fault, script
from imu_bench.config.schema import Checkable
from imu_bench.drivers.driver import Driver
from imu_bench.errors import ConfigError
from imu_bench.registers import Channel, Field, Fifo, Typical
from imu_bench.units import convert

if TYPE_CHECKING:
    from imu_bench.emulators.line import Line
    from imu_bench.simulation.scenario import Scenario
    from imu_bench.simulation.simulated import SimulatedSensor

GENERIC = 'generic'
"""Name of the driver that stands in for a sensor that has none yet."""


def driver_names() -> list[str]:
    """
    Return everything a sensor's `driver` may be.

    Examples
    --------
    >>> 'generic' in driver_names()
    True
    """
    return sorted([*drivers.names(), GENERIC])


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
    if driver == GENERIC:
        from imu_bench.simulation import generic

        return generic.SETTINGS
    if driver not in drivers.names():
        hint = config.suggestion(driver, driver_names())
        raise ConfigError(f'no driver {driver!r}; {hint}')
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
    sensor = config.load_sensor(path, name=name, overrides=overrides, settings_of=settings_of)
    faults_of(sensor)
    return sensor


def load_bench(path: str | Path) -> BenchConfig:
    """
    Return the bench of a file with its sensors, checked against the settings of their drivers.

    Raises
    ------
    ConfigError
        With every problem of all files, one line each.
    """
    loaded = config.load_bench(path, settings_of=settings_of)
    for sensor in loaded.sensors:
        faults_of(sensor)
    return loaded


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
    Return what stands behind a sensor, for logs and the hardware id of diagnostics.

    Examples
    --------
    >>> label(SensorConfig('left', 'mpu9250', 'emulated'))
    'emulated mpu9250'
    >>> label(SensorConfig('left', 'mpu9250', 'hardware', bus='i2c-1', address=0x69))
    'hardware mpu9250 i2c-1 0x69'
    """
    address = '' if sensor.address is None else f'0x{sensor.address:02X}'
    place = (sensor.bus, address) if sensor.backend == 'hardware' else ()
    return ' '.join(filter(None, (sensor.backend, sensor.driver, *place)))


def import_all(sensor: SensorConfig) -> None:
    """Import what `build` will need for this sensor, for those who want it to be quick."""
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
    sensor : SensorConfig
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
    """
    clock = clock or SystemClock()
    make = _BACKENDS[sensor.backend]
    return Acquisition(
        make(sensor, clock, switched_on_ns, beginning),
        clock,
        capacity_samples=capacity_samples,
        on_data=on_data,
        correct=correction(sensor.calibration),
        name=sensor.name,
    )


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
    from imu_bench.simulation.world import errors_of, sensor_source

    device = _emulated(sensor, SimulatedClock())
    typical: Mapping[str, Any] = _typical_as_set(device) if isinstance(device, Driver) else {}
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


def _typical_as_set(driver: Driver) -> dict[str, Typical]:
    """Return the typical values of a driver, with range, resolution and filter as it is set."""
    found = dict(driver.typical)
    names = {id(field): name for name, field in driver.declared(Field).items()}
    channels: list[Channel] = list(driver.declared(Channel).values())  # type: ignore[type-abstract]
    quantities = [channel.quantity for channel in channels]
    for channel in channels:
        # of a quantity with words of several lengths the document's own values are kept
        if channel.quantity not in found or quantities.count(channel.quantity) > 1:
            continue
        setting = names.get(id(channel.scaled_by), '')
        full_scale = driver.values.get(setting)
        changed: dict[str, Any] = {}
        if channel.quantised:
            changed['resolution'] = tuple(channel.resolution(full_scale))
        if channel.scaled_by is not None and isinstance(full_scale, float):
            changed['range'] = convert(full_scale, channel.scaled_by.unit, channel.unit)
        bandwidth = driver.values.get(setting.replace('_range', '_bandwidth'))
        if setting and isinstance(bandwidth, float) and bandwidth > 0.0:
            changed['bandwidth'] = bandwidth
        found[channel.quantity] = replace(found[channel.quantity], **changed)
    for fifo in driver.declared(Fifo).values():
        for quantity in set(fifo.frame.dtype.names or ()) & set(found):
            corner = fifo.low_pass * driver.rate_hz
            found[quantity] = replace(found[quantity], bandwidth=corner)
    return found


def _hardware(
    sensor: SensorConfig,
    clock: Clock,
    switched_on_ns: int | None = None,
    beginning: Beginning | None = None,
) -> Device:
    if sensor.driver == GENERIC:
        raise ConfigError(
            f'{sensor.source}.backend: a generic source has no hardware; allowed: emulated'
        )
    driver = drivers.load(sensor.driver)
    buses = open_bus(sensor.bus, driver.wiring, driver.bus_kinds, sensor.address)
    return driver(buses, clock, sensor.settings)


def _emulated(
    sensor: SensorConfig,
    clock: Clock,
    switched_on_ns: int | None = None,
    beginning: Beginning | None = None,
) -> Device:
    # late: real sensors start without the libraries that simulation needs
    from imu_bench.simulation import generic
    from imu_bench.simulation.world import sensor_source

    faults = faults_of(sensor)
    if sensor.driver == GENERIC:
        source = sensor_source(
            sensor, {}, sensor.settings['rate_hz'], clock.now_ns(), beginning=beginning
        )
        return generic.GenericSensor(source, clock, sensor.settings)
    buses = emulated_buses(sensor, clock, beginning=beginning)
    driver = drivers.load(sensor.driver)
    if faults:
        from imu_bench.emulators.faults import wrap

        buses = wrap(buses, driver, clock, faults, start_ns=switched_on_ns)
    # the emulated chip is switched on here, a real one was long ago
    clock.sleep(driver.start_up_s)
    return driver(buses, clock, sensor.settings)


def kind_of_bus(sensor: SensorConfig) -> str:
    """
    Return by which of its driver's kinds of bus a sensor is reached.

    Raises
    ------
    ConfigError
        If the name of its bus tells none.

    Examples
    --------
    >>> kind_of_bus(SensorConfig('tilt', 'scl3300', 'hardware', bus='spidev0.0'))
    'frame'
    """
    kinds = drivers.load(sensor.driver).bus_kinds
    kind = sensor.bus if sensor.bus in ('', *kinds) else kind_among(sensor.bus, kinds)
    return kind or kinds[0]


def emulated_buses(
    sensor: SensorConfig,
    clock: Clock,
    line: Line | None = None,
    beginning: Beginning | None = None,
) -> Mapping[str, Any]:
    """
    Return the emulated buses of a sensor that has a driver; the chip is switched on now.

    Parameters
    ----------
    sensor : SensorConfig
    clock : Clock
    line : Line, optional
        A wire to share; one of its own by default.
    beginning : Beginning, optional
        When its scenario begins; as its file says by default.
    """
    from imu_bench import emulators
    from imu_bench.simulation.world import sensor_source

    driver = drivers.load(sensor.driver)
    # the emulated chip restarts the source at the rate its registers ask for
    source = sensor_source(
        sensor, driver.typical, 1.0, clock.now_ns(), on_wire=True, beginning=beginning
    )
    # a device on a serial line of its own speed was brought to it when it was first used
    options = {'baud': sensor.settings['baud']} if 'baud' in sensor.settings else {}
    kind = kind_of_bus(sensor)
    return emulators.create(sensor.driver, kind, source, clock, line=line, **options)


_BACKENDS = {'hardware': _hardware, 'emulated': _emulated}
