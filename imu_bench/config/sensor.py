# SPDX-License-Identifier: Apache-2.0
"""One sensor: the settings every sensor has, and its file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any

from imu_bench.config.calibration import Affine, CALIBRATION_SETTINGS, corrections
from imu_bench.config.files import PARAMETERS, read_parameters
from imu_bench.config.schema import (
    check_all,
    Checkable,
    flatten,
    raise_if_any,
    REQUIRED,
    Setting,
)
from imu_bench.config.simulated import SIMULATION_SETTINGS
from imu_bench.errors import ConfigError

BACKENDS = ('hardware', 'emulated')

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
    *CALIBRATION_SETTINGS,
)
"""What every sensor's file may set."""

ROS_OWN = ('use_sim_time', 'start_type_description_service', 'qos_overrides')
"""Parameters that ROS itself reads from the same file; a name or the part before its dot."""


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
        'hardware' or 'emulated'.
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
    calibration : mapping of str to Affine
        Correction of each quantity that has one.
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
    calibration: Mapping[str, Affine] = field(default_factory=dict)
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
    if settings_of is not None:
        # the drivers there are, not 'a text', is what helps whoever left it out
        given.setdefault('driver', '')
    if settings_of is not None and isinstance(given['driver'], str):
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
    calibration = corrections(values, source, problems)
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
        calibration=calibration,
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
    """Leave out what has a default, of a quantity about which nothing is said."""
    quantity = '.'.join(key.split('.')[:2])
    return key.count('.') == 1 or any(other.startswith(f'{quantity}.') for other in given)
