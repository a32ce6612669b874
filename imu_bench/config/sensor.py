# SPDX-License-Identifier: Apache-2.0
"""One sensor: the settings every sensor has, and its file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
import re
from typing import Any, Protocol

from imu_bench.config.calibration import Affine, CALIBRATION_SETTINGS, corrections
from imu_bench.config.files import PARAMETERS, read_parameters
from imu_bench.config.lines import LineSetting
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
from msg_conversions import covariance
from msg_conversions.quantities import AXES, QUANTITIES
from msg_conversions.transforms import Mounting

BACKENDS = ('hardware', 'emulated', 'recorded', 'iio')

STDDEVS = tuple(
    q.name for q in QUANTITIES if q.covariance.stop - q.covariance.start == covariance.SIZE
)

_POSITIVE = (0.0, inf)
_STDDEV = 'Standard deviation to publish; 0 for unknown (REP-145).'

_FRAME = re.compile(r'[A-Za-z0-9_][\w./-]*')
"""tf2, BufferCore: no slash at the beginning, and not empty."""

# fmt: off
SENSOR_SETTINGS = (
    Setting('driver', REQUIRED, "Driver of the sensor, 'generic' for a simulated source, 'iio' "
            'for a driver of the kernel.'),
    Setting('backend', REQUIRED, 'Where the data come from.', allowed=BACKENDS),
    Setting('bus', '', "Bus of the hardware, such as 'i2c-1', 'spidev0.0' or '/dev/ttyUSB0'; with "
            "backend iio the kernel's device, such as 'iio:device0' or 'mpu9250'."),
    Setting('address', -1, 'I²C address; -1 for the usual one.', bounds=(-1, 0x77)),
    Setting('second_address', -1, 'I²C address of the second die, where it is strapped '
            'otherwise; -1 for like the first.', bounds=(-1, 0x77)),
    Setting('spi_hz', 0, 'Clock of SPI; 0 for one that loose wires carry.',
            bounds=(0, 50_000_000), unit='Hz'),
    LineSetting('data_ready', '', "GPIO line at the sensor's data-ready pin, such as "
                "'gpiochip0:17'; empty for none: samples are dated by when they are read."),
    LineSetting('reset_line', '', 'GPIO line at the reset pin of a BNO055; empty for none.'),
    Setting('wire_recording', '', 'File to record the wire to; with backend recorded to play.'),
    Setting('frame_id', '', 'Frame of the data; empty for <name>_link.'),
    Setting('linear_acceleration_stddev', 0.0, _STDDEV, bounds=_POSITIVE, unit='m/s²'),
    Setting('angular_velocity_stddev', 0.0, _STDDEV, bounds=_POSITIVE, unit='rad/s'),
    Setting('magnetic_field_stddev', 0.0, _STDDEV, bounds=_POSITIVE, unit='T'),
    Setting('orientation_stddev', 0.0, _STDDEV, bounds=_POSITIVE, unit='rad'),
    Setting('autostart', True, 'The node configures and activates itself.'),
    *CALIBRATION_SETTINGS,
    Setting('mounting.parent', 'base_link', 'Frame in which the sensor has its place (REP-105).'),
    Setting(
        'mounting.xyz', None, 'Its place: three lengths; published on /tf_static.',
        unit='m', kind='quantity',
    ),
    Setting(
        'mounting.rpy', None, 'Roll, pitch, yaw about the fixed axes x, y, z (REP-103).',
        unit='rad', kind='quantity',
    ),
)
# fmt: on
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
    """One sensor of the bench, checked."""

    name: str  # short name, last part of the namespace: 'mpu9250'
    driver: str  # name of the driver, 'generic', or 'iio'
    backend: str  # one of `BACKENDS`
    bus: str = ''  # may be empty for a sensor that is not hardware
    address: int | None = None  # None for the driver's usual one
    second_address: int | None = None  # that of the second die; None for strapped like the first
    spi_hz: int | None = None  # None for the driver's usual one
    data_ready: str = ''  # GPIO chip and line of the data-ready pin; empty for none
    reset_line: str = ''  # that of the reset pin
    frame_id: str = 'imu_link'
    autostart: bool = True
    settings: Mapping[str, Any] = field(default_factory=dict)  # the driver's own settings, by name
    # per quantity of `STDDEVS`, SI units; 0 for unknown
    stddevs: Mapping[str, float] = field(default_factory=dict)
    # correction of each quantity that has one
    calibration: Mapping[str, Affine] = field(default_factory=dict)
    mounting: Mounting | None = None  # None where nobody says
    # settings of the simulated world under their names without 'simulation.'; quantities are
    # tuples in SI units.  Errors that were not given are absent
    simulation: Mapping[str, Any] = field(default_factory=dict)
    # file to which the wire is recorded, or from which it is played; empty for none
    wire_recording: str = ''
    recorded_from: str = ''  # what stood behind a sensor that is played, and when
    source: str = ''  # file it came from, for error texts

    @property
    def namespace(self) -> str:
        """Namespace of the sensor's node."""
        return f'/bench/{self.name}'

    @property
    def place(self) -> dict[str, Any]:
        """
        What `imu_bench.bus.opening.open_bus` has to know beside the bus.

        Examples
        --------
        >>> SensorConfig('a', 'lsm9ds1', 'hardware', 'i2c-1', second_address=0x1E).place
        {'address': None, 'second_address': 30, 'spi_hz': None}
        """
        return {
            'address': self.address,
            'second_address': self.second_address,
            'spi_hz': self.spi_hz,
            **{line: getattr(self, line) for line in self.lines},
        }

    @property
    def lines(self) -> tuple[str, ...]:
        """Which of the settings that name a line do so."""
        return tuple(line for line in ('data_ready', 'reset_line') if getattr(self, line))

    @property
    def measured(self) -> bool:
        """
        Whether its data are measured, or were when they were recorded.

        Examples
        --------
        >>> SensorConfig('a', 'mpu9250', 'recorded', recorded_from='emulated mpu9250').measured
        False
        """
        measured = {self.backend, self.recorded_from.partition(' ')[0]}
        return not measured.isdisjoint({'hardware', 'iio'})


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
        The file of the sensor.
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
    problems += _mismatches(values, source)
    calibration = corrections(values, source, problems)
    place = mounting(values, source, problems)
    raise_if_any(problems)
    settings = {setting.name: values[setting.name] for setting in own}
    if settings.get('calibration_file') and values['backend'] == 'emulated':
        # what an emulated chip has found is never restored to a real one
        settings['calibration_file'] += '.emulated'
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
        second_address=None if values['second_address'] < 0 else values['second_address'],
        spi_hz=values['spi_hz'] or None,
        data_ready=values['data_ready'],
        reset_line=values['reset_line'],
        frame_id=values['frame_id'] or f'{name}_link',
        autostart=values['autostart'],
        settings=settings,
        stddevs={quantity: values[f'{quantity}_stddev'] for quantity in STDDEVS},
        calibration=calibration,
        mounting=place,
        simulation={
            key.removeprefix(prefix): value
            for key, value in values.items()
            if key.startswith(prefix) and value is not None and _wanted(key, given)
        },
        wire_recording=values['wire_recording'],
        recorded_from='' if head is None else head.origin,
        source=source,
    )


def _mismatches(values: Mapping[str, Any], source: str) -> list[str]:
    """Return what does not go with the backend."""
    backend, found = values.get('backend', ''), []
    example = {'hardware': 'i2c-1', 'iio': 'iio:device0'}.get(backend)
    if example and not values.get('bus'):
        found.append(f'{source}.bus: missing; a {backend} sensor needs one, such as {example!r}')
    if 'iio' in (values.get('driver'), backend):
        if values.get('driver') != backend:
            found.append(f'{source}.backend: the kernel reads it: backend: iio, driver: iio')
        if values.get('wire_recording'):
            found.append(f"{source}.wire_recording: the wire is the kernel's; leave it out")
    if values.get('calibration_file') and values.get('wire_recording'):
        why = 'what it holds is not in a wire recording, which could not be played'
        found.append(f'{source}.calibration_file: {why}; leave one of them out')
    return found


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


def mounting(values: Mapping[str, Any], source: str, problems: list[str]) -> Mounting | None:
    """Return where a sensor is mounted, None if nobody says."""
    both = {name: values.get(f'mounting.{name}') for name in ('xyz', 'rpy')}
    given: dict[str, tuple[float, ...]] = {k: v for k, v in both.items() if v is not None}
    if not given:
        return None
    parent = values.get('mounting.parent', '')
    if not _FRAME.fullmatch(parent):
        problems.append(f'{source}.mounting.parent: {parent!r} is no frame; give base_link')
    for name, value in given.items():
        if len(value) != len(AXES):
            problems.append(f'{source}.mounting.{name}: one value; give three')
    return Mounting(parent, **given)
