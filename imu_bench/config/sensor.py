# SPDX-License-Identifier: Apache-2.0
"""One sensor: the settings every sensor has, and its file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any, Protocol

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
from imu_bench.errors import ConfigError, RecordingError

BACKENDS = ('hardware', 'emulated', 'recorded')

STDDEVS = ('linear_acceleration', 'angular_velocity', 'magnetic_field', 'orientation')

_POSITIVE = (0.0, inf)
_STDDEV = 'Standard deviation to publish; 0 for unknown (REP-145).'

SENSOR_SETTINGS = (
    Setting('driver', REQUIRED, "Driver of the sensor, or 'generic' for a simulated source."),
    Setting('backend', REQUIRED, 'Where the data come from.', allowed=BACKENDS),
    Setting('bus', '', "Bus of the hardware, such as 'i2c-1', 'spidev0.0' or '/dev/ttyUSB0'."),
    Setting('address', -1, 'I²C address; -1 for the usual one.', bounds=(-1, 0x77)),
    Setting('wire_recording', '', 'File to record the wire to; with backend recorded to play.'),
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


class Recorded(Protocol):
    """The head of a wire recording: `imu_bench.bus.recording.Head`."""

    @property
    def driver(self) -> str: ...
    @property
    def settings(self) -> Mapping[str, Any]: ...
    @property
    def origin(self) -> str: ...
    def differences(self, driver: str, settings: Mapping[str, Any]) -> dict[str, str]: ...


RecordedIn = Callable[[str], Recorded]


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
        One of `BACKENDS`.
    bus : str
        May be empty for a sensor that is not hardware.
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
    wire_recording : str
        File to which the wire is recorded, or from which it is played; empty for none.
    recorded_from : str
        What stood behind a sensor that is played, and when.
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
    wire_recording: str = ''
    recorded_from: str = ''
    source: str = ''

    @property
    def namespace(self) -> str:
        """Namespace of the sensor's node."""
        return f'/bench/{self.name}'

    @property
    def measured(self) -> bool:
        """
        Whether its data are measured, or were when they were recorded.

        Examples
        --------
        >>> SensorConfig('a', 'mpu9250', 'recorded', recorded_from='emulated mpu9250').measured
        False
        """
        return 'hardware' in (self.backend, self.recorded_from.partition(' ')[0])


def load_sensor(
    path: str | Path,
    *,
    name: str = '',
    overrides: Mapping[str, Any] | None = None,
    settings_of: SettingsOf | None = None,
    recorded_in: RecordedIn | None = None,
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
    recorded_in : callable, optional
        Gives the head of a wire recording (`imu_bench.bus.recording.read_head`): driver and
        settings that are not given come from there, those that are given have to agree.

    Raises
    ------
    ConfigError
        With every problem of the file, one line each.
    """
    path = Path(path)
    parameters = dict(flatten(read_parameters(path)))
    parameters.update(flatten(overrides or {}))
    return sensor_from_parameters(
        name or path.stem,
        parameters,
        settings_of=settings_of,
        recorded_in=recorded_in,
        source=f'{path}: {PARAMETERS}',
    )


def sensor_from_parameters(
    name: str,
    parameters: Mapping[str, Any],
    *,
    settings_of: SettingsOf | None = None,
    recorded_in: RecordedIn | None = None,
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
    head = _head(given, recorded_in, source)
    if head is not None and given.setdefault('driver', head.driver) == head.driver:
        given = {**head.settings, **given}
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
    settings = {setting.name: values[setting.name] for setting in own}
    if head is not None:
        differences = head.differences(values['driver'], settings)
        raise_if_any(
            [
                f'{source}.{key}: {text}; leave it out to play what was recorded'
                for key, text in differences.items()
            ]
        )
    prefix = 'simulation.'
    return SensorConfig(
        name=name,
        driver=values['driver'],
        backend=values['backend'],
        bus=values['bus'],
        address=None if values['address'] < 0 else values['address'],
        frame_id=values['frame_id'] or f'{name}_link',
        autostart=values['autostart'],
        settings=settings,
        stddevs={quantity: values[f'{quantity}_stddev'] for quantity in STDDEVS},
        calibration=calibration,
        simulation={
            key.removeprefix(prefix): value
            for key, value in values.items()
            if key.startswith(prefix) and value is not None and _wanted(key, given)
        },
        wire_recording=values['wire_recording'],
        recorded_from='' if head is None else head.origin,
        source=source,
    )


def _head(
    given: Mapping[str, Any], recorded_in: RecordedIn | None, source: str
) -> Recorded | None:
    """Return the head of the recording that is to be played, if one is; all follows from it."""
    if given.get('backend') != 'recorded' or recorded_in is None:
        return None
    path = given.get('wire_recording')
    if not path or not isinstance(path, str):
        raise ConfigError(f'{source}.wire_recording: missing; name the file to play')
    try:
        return recorded_in(path)
    except RecordingError as error:
        raise ConfigError(f'{source}.wire_recording: {error}') from error


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
