# SPDX-License-Identifier: Apache-2.0
"""A bench: its sensors, and how they are analysed and recorded."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
import math
from pathlib import Path
from typing import Any

from imu_bench.config.campaign import BenchTest, read_tests
from imu_bench.config.files import PARAMETERS, read_parameters, read_yaml
from imu_bench.config.location import named_in
from imu_bench.config.schema import check_all, flatten, raise_if_any, REQUIRED, Setting
from imu_bench.config.sensor import load_sensor, RecordedIn, SensorConfig, SettingsOf
from imu_bench.errors import ConfigError
from msg_conversions.quantities import AXES

ANALYSIS_SETTINGS = (
    Setting('window_s', 600.0, 'Length of the sliding window.', bounds=(1.0, 86400.0), unit='s'),
    Setting('confidence', 0.95, 'Confidence level of every interval.', bounds=(0.5, 0.999)),
)
"""What the analysis of a bench may set; the node's file has the same names."""

RECORDER_SETTINGS = (
    Setting('storage', 'mcap', 'Format of the bag.', allowed=('mcap', 'sqlite3')),
)
"""What the recording of a bench may set."""

UPRIGHT = math.cos(math.radians(45.0))
"""An axis that is farther than that from the vertical is not the one that points up."""

UP = ('', 'x', 'y', 'z', '-x', '-y', '-z')

_BENCH = (
    Setting('name', REQUIRED, 'Short name of the bench.'),
    Setting('title', '', 'What the bench is, in one line.'),
    Setting('demo', '', 'Test that `imu-bench demo` shows; at rest if none.'),
)
_ENTRY = (
    Setting(
        'file', REQUIRED, "The sensor's file, relative to the bench's; or one of the package."
    ),
    Setting('name', '', "Name of the sensor; the file's by default."),
    Setting('up', '', 'Axis of the sensor that points up on the bench at rest.', allowed=UP),
)


@dataclass(frozen=True)
class AnalysisConfig:
    """How the bench is analysed; see `ANALYSIS_SETTINGS`."""

    window_s: float = 600.0
    confidence: float = 0.95


@dataclass(frozen=True)
class RecorderConfig:
    """How the bench is recorded; see `RECORDER_SETTINGS`."""

    storage: str = 'mcap'


@dataclass(frozen=True)
class BenchConfig:
    """A bench, checked."""

    name: str
    title: str = ''
    sensors: tuple[SensorConfig, ...] = ()  # in the order of the file, with different names
    files: Mapping[str, Path] = field(default_factory=dict)  # per sensor its parameter file
    # per sensor what the bench sets differently, with dotted names
    overrides: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    # per sensor which of its axes points up at rest, such as '-x'; '' where nobody said
    up: Mapping[str, str] = field(default_factory=dict)
    analysis: AnalysisConfig = AnalysisConfig()
    recorder: RecorderConfig = RecorderConfig()
    tests: tuple[BenchTest, ...] = ()  # what is to be done with it
    demo: str = ''  # name of the test that a demo shows; empty for none

    def test(self, name: str) -> BenchTest:
        """
        Return one of the tests.

        Raises
        ------
        ConfigError
            If there is none of that name; the text lists those there are.
        """
        if not self.tests:
            raise ConfigError(
                f'bench {self.name} lists no tests; add them under tests: in its YAML file'
            )
        for test in self.tests:
            if test.name == name:
                return test
        known = ', '.join(test.name for test in self.tests)
        raise ConfigError(f'--test {name}: bench {self.name} has: {known}')


def load_analysis(path: str | Path) -> AnalysisConfig:
    """
    Return how to analyse, from the parameter file of the analysis node.

    Parameters of the node that are not about the analysis itself are left to the node.
    """
    path = Path(path)
    names = {setting.name for setting in ANALYSIS_SETTINGS}
    given = {key: value for key, value in flatten(read_parameters(path)) if key in names}
    problems: list[str] = []
    values = check_all(given, ANALYSIS_SETTINGS, f'{path}: {PARAMETERS}', problems)
    raise_if_any(problems)
    return AnalysisConfig(**values)


def load_bench(
    path: str | Path,
    *,
    settings_of: SettingsOf | None = None,
    recorded_in: RecordedIn | None = None,
) -> BenchConfig:
    """
    Return the bench that a YAML file describes, with all its sensors.

    The file of a sensor describes a bench of this one.

    Parameters
    ----------
    path : str or Path
        The file of the bench.
    settings_of, recorded_in : callable, optional
        As in `imu_bench.config.load_sensor`.

    Raises
    ------
    ConfigError
        With every problem of the bench's and the sensors' files, one line each.
    """
    path = Path(path)
    document = read_yaml(path)
    if _holds_parameters(document):
        alone = load_sensor(path, settings_of=settings_of, recorded_in=recorded_in)
        name = alone.name
        return BenchConfig(name=name, sensors=(alone,), files={name: path}, overrides={name: {}})
    problems: list[str] = []
    entries = document.pop('sensors', None)
    tests = document.pop('tests', None)
    if isinstance(tests, str):  # those of another bench, such as the emulated one
        try:
            tests = read_yaml(named_in(path.parent, 'benches', tests)).get('tests')
        except ConfigError as error:
            raise ConfigError(f'{path}: tests: {error}') from None
    tests = read_tests(tests, f'{path}: tests', problems)
    sections = {
        'analysis': _section(document, 'analysis', ANALYSIS_SETTINGS, path, problems),
        'recorder': _section(document, 'recorder', RECORDER_SETTINGS, path, problems),
    }
    top = check_all(dict(flatten(document)), _BENCH, f'{path}: bench', problems)
    sensors, files, overrides, up = [], {}, {}, {}
    if not isinstance(entries, list) or not entries:
        problems.append(f"{path}: sensors: missing; give a list of entries like '- file: x.yaml'")
        entries = []
    for index, entry in enumerate(entries):
        where = f'{path}: sensors[{index}]'
        found = _sensor(entry, where, path.parent, settings_of, recorded_in, problems)
        if found is None:
            continue
        sensor, file = found
        if sensor.name in files:
            problems.append(f'{where}.name: {sensor.name!r} is there already; give another name')
        sensors.append(sensor)
        files[sensor.name] = file
        up[sensor.name] = entry.get('up', '')
        overrides[sensor.name] = _overrides(entry)
    problems += _misplaced(sensors, up, path)
    if top.get('demo') and top['demo'] not in [test.name for test in tests]:
        problems.append(f'{path}: demo: {top["demo"]!r} is none of the tests')
    raise_if_any(problems)
    return BenchConfig(
        name=top['name'],
        title=top['title'],
        sensors=tuple(sensors),
        files=files,
        overrides=overrides,
        up=up,
        analysis=AnalysisConfig(**sections['analysis']),
        recorder=RecorderConfig(**sections['recorder']),
        tests=tests,
        demo=top['demo'],
    )


def _holds_parameters(document: Mapping[Any, Any]) -> bool:
    """Return whether a document is the parameter file of a node, as that of a sensor is."""
    return any(isinstance(node, Mapping) and PARAMETERS in node for node in document.values())


def _section(
    document: dict[Any, Any],
    name: str,
    settings: tuple[Setting, ...],
    path: Path,
    problems: list[str],
) -> dict[str, Any]:
    given = document.pop(name, None) or {}
    if not isinstance(given, Mapping):
        problems.append(f'{path}: {name}: {given!r} is no mapping of settings')
        given = {}
    return check_all(dict(flatten(given)), settings, f'{path}: {name}', problems)


def _sensor(
    entry: object,
    where: str,
    folder: Path,
    settings_of: SettingsOf | None,
    recorded_in: RecordedIn | None,
    problems: list[str],
) -> tuple[SensorConfig, Path] | None:
    """Return the sensor of an entry and its file; None if the entry is none."""
    if not isinstance(entry, Mapping):
        problems.append(f"{where}: {entry!r} is no entry like '- file: x.yaml'")
        return None
    before = len(problems)
    problems += [
        f'{where}.{name}: {entry[name]!r} is no mapping of settings'
        for name in ('overrides', 'mounting')
        if not isinstance(entry.get(name) or {}, Mapping)
    ]
    own = {key: value for key, value in entry.items() if key not in ('overrides', 'mounting')}
    values = check_all(own, _ENTRY, where, problems)
    if len(problems) > before:
        return None
    try:
        file = named_in(folder, 'sensors', values['file'])
    except ConfigError as error:
        problems.append(f'{where}.file: {error}')
        return None
    try:
        sensor = load_sensor(
            file,
            name=values['name'],
            overrides=_overrides(entry),
            settings_of=settings_of,
            recorded_in=recorded_in,
        )
    except ConfigError as error:
        problems.extend(str(error).splitlines())
        return None
    return sensor, file


def _overrides(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a bench sets of a sensor, with dotted names."""
    place = {'mounting': entry.get('mounting') or {}}
    return dict(flatten({**(entry.get('overrides') or {}), **place}))


def _misplaced(
    sensors: Iterable[SensorConfig], up: Mapping[str, str], path: Path
) -> Iterator[str]:
    """Yield what cannot be true of the places of sensors."""
    owner: dict[str, str] = {}
    for sensor in sensors:
        if sensor.mounting is None:
            continue
        first = owner.setdefault(sensor.frame_id, sensor.name)
        if first != sensor.name:
            yield (
                f'{path}: {sensor.name}: frame_id {sensor.frame_id!r} is that of {first}, which '
                'is mounted, too; give another'
            )
        axis = up[sensor.name]
        if axis:
            sign = -1.0 if axis.startswith('-') else 1.0
            if sign * sensor.mounting.up[AXES.index(axis[-1])] < UPRIGHT:
                yield (
                    f'{path}: {sensor.name}: mounting.rpy does not turn {axis} up, but the bench '
                    f'says up: {axis}; put one of them right'
                )


def as_tested(
    loaded: BenchConfig, test: BenchTest, load: Callable[..., SensorConfig]
) -> BenchConfig:
    """
    Return a bench with its sensors set as one of its tests wants them.

    Parameters
    ----------
    load : callable
        As `load_sensor`, with the settings of the drivers.

    Raises
    ------
    ConfigError
        If the test names a sensor that is not there, or a setting that it cannot have.
    """
    for name in test.sensors:
        if name not in loaded.files:
            known = ', '.join(loaded.files)
            raise ConfigError(
                f'test {test.name}: sensors.{name}: bench {loaded.name} has: {known}'
            )
    overrides = {
        name: {**given, **test.sensors.get(name, {})} for name, given in loaded.overrides.items()
    }
    sensors = tuple(
        load(loaded.files[sensor.name], name=sensor.name, overrides=overrides[sensor.name])
        if sensor.name in test.sensors
        else sensor
        for sensor in loaded.sensors
    )
    return replace(loaded, sensors=sensors, overrides=overrides)
