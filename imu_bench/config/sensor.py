# SPDX-License-Identifier: Apache-2.0
"""One sensor: the settings every sensor has, and its file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any

from imu_bench.config.files import PARAMETERS, read_parameters
from imu_bench.config.schema import (
    check_all,
    Checkable,
    flatten,
    raise_if_any,
    REQUIRED,
    Setting,
)
from imu_bench.errors import ConfigError

BACKENDS = ('hardware', 'emulated', 'recorded')

STDDEVS = ('linear_acceleration', 'angular_velocity', 'magnetic_field', 'orientation')

_POSITIVE = (0.0, inf)
_STDDEV = 'Standard deviation to publish; 0 for unknown (REP-145).'

SENSOR_SETTINGS = (
    Setting('driver', REQUIRED, "Driver of the sensor, or 'generic' for a simulated source."),
    Setting('backend', REQUIRED, 'Where the data come from.', allowed=BACKENDS),
    Setting('bus', '', "Bus of the hardware, such as 'i2c-1', 'spidev0.0' or '/dev/ttyUSB0'."),
    Setting('address', -1, 'I²C address; -1 for the usual one.', bounds=(-1, 0x77)),
    Setting('frame_id', '', 'Frame of the data; empty for <name>_link.'),
    Setting('linear_acceleration_stddev', 0.0, _STDDEV, bounds=_POSITIVE, unit='m/s²'),
    Setting('angular_velocity_stddev', 0.0, _STDDEV, bounds=_POSITIVE, unit='rad/s'),
    Setting('magnetic_field_stddev', 0.0, _STDDEV, bounds=_POSITIVE, unit='T'),
    Setting('orientation_stddev', 0.0, _STDDEV, bounds=_POSITIVE, unit='rad'),
    Setting('autostart', True, 'The node configures and activates itself.'),
)
"""What every sensor's file may set."""

ROS_OWN = ('use_sim_time', 'start_type_description_service', 'qos_overrides')
"""Parameters that ROS itself reads from the same file; a name or the part before its dot."""


def _quantity(
    name: str,
    default: tuple[float, ...] | None,
    description: str,
    unit: str,
    bounds: tuple[float, float] | None = None,
) -> Setting:
    return Setting(f'simulation.{name}', default, description, (), bounds, unit, 'quantity')


def _errors_of(quantity: str, unit: str, walk: str, quantisation: str) -> Iterator[Setting]:
    """Yield the settings of the error model of one quantity, all optional."""
    some = _POSITIVE
    density = f'{unit}/√Hz'
    yield _quantity(f'{quantity}.noise_density', None, 'White, one-sided.', density, some)
    yield _quantity(f'{quantity}.bias_instability', None, 'Allan floor / 0.664.', unit, some)
    yield _quantity(f'{quantity}.bias', None, 'Constant offset.', unit)
    yield _quantity(f'{quantity}.scale_factor', None, 'Relative error of the scale.', '1')
    yield _quantity(f'{quantity}.misalignment', None, 'Rotation of the axes.', 'rad')
    yield _quantity(f'{quantity}.high_pass', None, 'No constant below this.', 'Hz', some)
    yield _quantity(f'{quantity}.range', None, 'Saturation.', unit, some)
    yield _quantity(f'{quantity}.resolution', None, 'Smallest step.', unit, some)
    if walk:
        yield _quantity(f'{quantity}.random_walk', None, 'Rate random walk K.', walk, some)
    if quantisation:
        yield _quantity(f'{quantity}.quantisation', None, 'Q.', quantisation, some)
    yield Setting(f'simulation.{quantity}.axes', 'xyz', 'Axes there are; the others are NaN.')


SIMULATION_SETTINGS = (
    Setting('simulation.seed', 0, 'Seed; each sensor draws a stream.', bounds=(0, 2**31 - 1)),
    _quantity('rate_error', (0.0,), "Error of the chip's oscillator.", '1', (-0.2, 0.2)),
    _quantity('roll', (0.0,), 'Tilt of the bench about x.', 'rad'),
    _quantity('pitch', (0.0,), 'Tilt of the bench about y.', 'rad'),
    _quantity('temperature', (25.0,), 'Temperature of the chip.', '°C'),
    Setting('simulation.scenario', 'still', 'How the bench moves.', allowed=('still', 'sine')),
    Setting('simulation.sine.axis', 'z', 'Axis of the sine.', allowed=('x', 'y', 'z')),
    _quantity('sine.amplitude', (1.0,), 'Peak of the sine.', 'm/s²', _POSITIVE),
    _quantity('sine.frequency', (10.0,), 'Frequency of the sine.', 'Hz', _POSITIVE),
    *_errors_of('acceleration', 'm/s²', 'm/s²/√s', 'm/s'),
    *_errors_of('angular_velocity', 'rad/s', 'rad/s/√s', 'rad'),
    *_errors_of('magnetic_field', 'T', '', ''),
)
"""What an emulated sensor's file may set; errors not given are the driver's typical values."""

SettingsOf = Callable[[str], Iterable[Checkable]]


@dataclass(frozen=True)
class SensorConfig:
    """
    One sensor of the bench, checked.

    Attributes
    ----------
    name : str
        Short name, last part of the namespace: 'mpu9250'.
    driver : str
        Name of the driver, or 'generic'.
    backend : str
        'hardware', 'emulated' or 'recorded'.
    bus : str
        Empty for an emulated sensor.
    address : int or None
        None for the driver's usual one.
    frame_id : str
    autostart : bool
    settings : mapping
        The driver's own settings, by name.
    stddevs : mapping of str to float
        Per quantity of `STDDEVS`, SI units; 0 for unknown.
    simulation : mapping
        Settings of the simulated world under their names without 'simulation.';
        quantities are tuples in SI units.  Errors that were not given are absent.
    source : str
        File it came from, for error texts.
    """

    name: str
    driver: str
    backend: str
    bus: str = ''
    address: int | None = None
    frame_id: str = 'imu_link'
    autostart: bool = True
    settings: Mapping[str, Any] = field(default_factory=dict)
    stddevs: Mapping[str, float] = field(default_factory=dict)
    simulation: Mapping[str, Any] = field(default_factory=dict)
    source: str = ''

    @property
    def namespace(self) -> str:
        """Namespace of the sensor's node."""
        return f'/bench/{self.name}'


def load_sensor(
    path: str | Path,
    *,
    name: str = '',
    overrides: Mapping[str, Any] | None = None,
    settings_of: SettingsOf | None = None,
) -> SensorConfig:
    """
    Return the sensor that a ROS parameter file describes.

    Parameters
    ----------
    path : str or Path
    name : str
        Name of the sensor; the file's by default.
    overrides : mapping, optional
        Settings that replace those of the file, nested or with dotted names.
    settings_of : callable, optional
        Gives the settings of a driver by its name (`imu_bench.bench.settings_of`);
        without it the driver's settings are taken over unchecked.

    Raises
    ------
    ConfigError
        With every problem of the file, one line each.
    """
    path = Path(path)
    parameters = dict(flatten(read_parameters(path)))
    parameters.update(flatten(overrides or {}))
    return sensor_from_parameters(
        name or path.stem, parameters, settings_of=settings_of, source=f'{path}: {PARAMETERS}'
    )


def sensor_from_parameters(
    name: str,
    parameters: Mapping[str, Any],
    *,
    settings_of: SettingsOf | None = None,
    source: str = PARAMETERS,
) -> SensorConfig:
    """
    Return the sensor that parameters describe, nested or with dotted names.

    Raises
    ------
    ConfigError
        With every problem, one line each, each with its path.

    Examples
    --------
    >>> mine = sensor_from_parameters('left', {'driver': 'mpu9250', 'backend': 'emulated'})
    >>> mine.namespace, mine.frame_id
    ('/bench/left', 'left_link')
    """
    given = {
        key: value
        for key, value in flatten(parameters)
        if key not in ROS_OWN and key.partition('.')[0] not in ROS_OWN
    }
    common = {setting.name for setting in (*SENSOR_SETTINGS, *SIMULATION_SETTINGS)}
    problems: list[str] = []
    own: tuple[Checkable, ...] = ()
    if settings_of is not None and isinstance(given.get('driver'), str):
        try:
            own = tuple(settings_of(given['driver']))
        except ConfigError as error:
            problems.append(f'{source}.driver: {error}')
            own = _unchecked(given, common)
    else:
        own = _unchecked(given, common)
    values = check_all(given, (*SENSOR_SETTINGS, *SIMULATION_SETTINGS, *own), source, problems)
    if values.get('backend') == 'hardware' and not values.get('bus'):
        problems.append(f"{source}.bus: missing; a hardware sensor needs one, such as 'i2c-1'")
    raise_if_any(problems)
    prefix = 'simulation.'
    return SensorConfig(
        name=name,
        driver=values['driver'],
        backend=values['backend'],
        bus=values['bus'],
        address=None if values['address'] < 0 else values['address'],
        frame_id=values['frame_id'] or f'{name}_link',
        autostart=values['autostart'],
        settings={setting.name: values[setting.name] for setting in own},
        stddevs={quantity: values[f'{quantity}_stddev'] for quantity in STDDEVS},
        simulation={
            key.removeprefix(prefix): value
            for key, value in values.items()
            if key.startswith(prefix) and value is not None and _wanted(key, given)
        },
        source=source,
    )


class _Unchecked(Setting):
    """A setting of a driver nobody has described: any value will do for now."""

    def check(self, value: object) -> Any:
        return value


def _unchecked(given: Mapping[str, Any], common: set[str]) -> tuple[Checkable, ...]:
    return tuple(
        _Unchecked(key, None, '')
        for key in given
        if key not in common and not key.startswith('simulation.')
    )


def _wanted(key: str, given: Mapping[str, Any]) -> bool:
    """Leave out the axes of a quantity about which nothing is said."""
    quantity, _, name = key.rpartition('.')
    return name != 'axes' or any(other.startswith(f'{quantity}.') for other in given)
