# SPDX-License-Identifier: Apache-2.0
"""A scenario: a file that says how the bench moves, warms up, and in which zones."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from imu_bench.config.files import load, read_yaml
from imu_bench.config.location import named_file
from imu_bench.config.schema import (
    check_all,
    flatten,
    parse_quantity,
    raise_if_any,
    Setting,
    stated,
    suggestion,
)
from imu_bench.errors import ConfigError
from imu_bench.simulation.motion import During, Motion, Seed, Still, Sum
from imu_bench.simulation.motion_kinds import Given, Kind, KINDS
from msg_conversions.quantities import AXES
import yaml

_TOP = (
    Setting('title', '', 'What happens, in one line.'),
    Setting('source', '', 'Document it follows.'),
    Setting('axis', '', 'Axis of the motions that do not name their own.', ('', *AXES)),
    Setting('repeat', 1, 'How often the zones follow one another.', bounds=(1, 1000)),
    Setting('temperature', (25.0,), 'At the beginning.', unit='°C', kind='quantity'),
    Setting('roll', (0.0,), 'Tilt of the bench about x.', unit='rad', kind='quantity'),
    Setting('pitch', (0.0,), 'Tilt of the bench about y.', unit='rad', kind='quantity'),
    Setting('duration', None, 'How long it is meant to last.', (), (1e-3, 1e9), 's', 'quantity'),
)
_ZONE = Setting('zone', '', 'Zone in which it happens; always, if none is named.')
_FADE = Setting('fade', (0.1,), 'Fade at the ends of a zone.', (), (0.0, 1e6), 's', 'quantity')


@dataclass(frozen=True)
class Zone:
    """A span of time with a name, s since the scenario began."""

    name: str
    begin_s: float
    end_s: float


@dataclass(frozen=True, eq=False)
class Scenario:
    """How the bench moves."""

    name: str
    motion: Motion
    title: str = ''
    source: str = ''
    duration_s: float | None = None  # how long it is meant to last; None if nothing in it ends
    zones: tuple[Zone, ...] = ()
    # every setting that went in, in SI with its unit, ready for JSON
    truth: Mapping[str, Any] | None = None
    still: Motion = field(default_factory=Still)  # the bench before it begins

    @property
    def endless(self) -> bool:
        """Whether it may be stopped at any time, and is then as good as whole."""
        return self.motion.duration_s is None and not self.zones


def load_scenario(name: str, *, seed: int = 0, overrides: Sequence[str] = ()) -> Scenario:
    """
    Return a scenario of the package, or of a user's file.

    Parameters
    ----------
    name : str
        Short name of a file in config/scenarios, or the path of a .yaml file.
    seed : int
        Of everything random in it.
    overrides : sequence of str
        Settings that replace those of the file: 'axis=y', 'sine.frequency=90 Hz'.

    Raises
    ------
    ConfigError
        If there is no such scenario, with those there are; or with every problem of the file.

    Examples
    --------
    >>> load_scenario('sine_on_random_sc1').zones[1]
    Zone(name='test', begin_s=180.0, end_s=780.0)
    """
    path = named_file('scenarios', name)
    document = scenario_document(name, overrides)
    return scenario_from(document, path.stem, seed=seed, where=f'{path}: scenario')


def scenario_document(name: str, overrides: Sequence[str] = ()) -> dict[Any, Any]:
    """
    Return what the file of a scenario says, with settings replaced; see `load_scenario`.

    Raises
    ------
    ConfigError
        If there is no such scenario, or no such motion in it.

    Examples
    --------
    >>> scenario_document('sine', ['axis=x'])['axis']
    'x'
    """
    document = read_yaml(named_file('scenarios', name))
    for override in overrides:
        _replace(document, override)
    return document


def scenario_from(
    document: Mapping[str, Any], name: str, *, seed: int = 0, where: str = 'scenario'
) -> Scenario:
    """Return the scenario that a document of a file describes."""
    problems: list[str] = []
    rest = dict(document)
    entries = rest.pop('motions', None) or []
    zones = _zones(rest.pop('zones', None) or {}, where, problems)
    top = check_all(dict(flatten(rest)), _TOP, where, problems)
    raise_if_any(problems)
    roll, pitch, temperature = (_one(top, n, where) for n in ('roll', 'pitch', 'temperature'))
    still = Still(roll, pitch, temperature)
    spans = _repeated(zones, top['repeat'])
    if not isinstance(entries, list):
        raise ConfigError(f"{where}: motions: {entries!r} is no list of entries like '- sine: …'")
    parts: list[Motion] = [still]
    truths = []
    for index, entry in enumerate(entries):
        place = f'{where}: motions[{index}]'
        made = _motion(entry, place, top['axis'], still, (seed, index), spans, problems)
        if made is not None:
            parts.append(made[0])
            truths.append(made[1])
    raise_if_any(problems)
    motion = Sum(tuple(parts))
    meant = _one(top, 'duration', where) if top['duration'] else None
    return Scenario(
        name=name,
        motion=motion,
        title=top['title'],
        source=top['source'],
        duration_s=meant or (spans[-1].end_s if spans else motion.duration_s),
        zones=spans,
        truth=_truth(name, top, seed, spans, truths),
        still=still,
    )


def _one(values: Mapping[str, Any], name: str, where: str) -> float:
    if len(values[name]) != 1:
        raise ConfigError(f'{where}: {name}: {len(values[name])} values are given; give one')
    return float(values[name][0])


def _zones(given: Any, where: str, problems: list[str]) -> list[tuple[str, float]]:
    """Return names and durations of the zones."""
    if not isinstance(given, Mapping):
        problems.append(f'{where}: zones: {given!r} is no mapping of names to durations')
        return []
    zones = []
    for name, text in given.items():
        try:
            length = parse_quantity(text, 's')
        except ConfigError as error:
            problems.append(f'{where}: zones.{name}: {error}')
            continue
        if length <= 0.0:
            problems.append(f'{where}: zones.{name}: {text!r} is no time; give more than 0 s')
        zones.append((str(name), length))
    return zones


def _repeated(zones: list[tuple[str, float]], times: int) -> tuple[Zone, ...]:
    spans, begin = [], 0.0
    for name, length in zones * times:
        spans.append(Zone(name, begin, begin + length))
        begin += length
    return tuple(spans)


def _motion(
    entry: Any,
    where: str,
    axis: str,
    still: Still,
    seed: Seed,
    spans: tuple[Zone, ...],
    problems: list[str],
) -> tuple[Motion, dict[str, Any]] | None:
    """Return a motion and what went into it; None with a problem."""
    if not isinstance(entry, Mapping) or len(entry) != 1:
        problems.append(f"{where}: {entry!r} is no entry like '- sine: {{…}}'")
        return None
    ((name, given),) = entry.items()
    if name not in KINDS:
        problems.append(f'{where}: no motion {name!r}; {suggestion(str(name), KINDS)}')
        return None
    if given is not None and not isinstance(given, Mapping):
        problems.append(f'{where}.{name}: {given!r} is no mapping of settings')
        return None
    kind = KINDS[name]
    own = kind.settings + ((_ZONE, _FADE) if kind.zoned else ())
    before = len(problems)
    values = check_all(dict(flatten(given or {})), own, f'{where}.{name}', problems)
    if len(problems) > before:
        return None
    if 'axis' in values and not values['axis']:
        values['axis'] = axis or ('x' if name == 'tilt_steps' else 'z')
    try:
        motion = kind.make(Given(values, still, seed))
    except ConfigError as error:
        problems.append(f'{where}.{name}: {error}')
        return None
    if values.get('zone'):
        chosen = [span for span in spans if span.name == values['zone']]
        if not chosen:
            known = ', '.join(dict.fromkeys(span.name for span in spans)) or 'none'
            problems.append(f'{where}.{name}.zone: no zone {values["zone"]!r}; known are {known}')
            return None
        motion = _confined(motion, kind, chosen, values['fade'][0])
    return motion, {'kind': name, **stated(values, own), 'events': list(motion.events)}


def _confined(motion: Motion, kind: Kind, spans: Iterable[Zone], fade_s: float) -> Motion:
    edges = tuple((span.begin_s, span.end_s) for span in spans)
    return During(motion, edges, fade_s, kind.anew)


def _replace(document: dict[Any, Any], override: str) -> None:
    """Put 'name=value' or 'motion.name=value' into the document of a scenario."""
    # The value is read as YAML: a number, a list, true or false, or a text.
    name, equals, text = override.partition('=')
    motion, dot, setting = name.strip().rpartition('.')
    if not equals or not setting:
        raise ConfigError(f"{override!r} is no setting like 'sine.frequency=90 Hz'")
    value = _value(text.strip())
    if not dot:
        document[setting] = value
        return
    if motion == 'zones':
        document.setdefault('zones', {})[setting] = value
        return
    entries = [e for e in document.get('motions') or [] if isinstance(e, dict) and motion in e]
    if not entries:
        known = [key for e in document.get('motions') or [] if isinstance(e, dict) for key in e]
        raise ConfigError(
            f'{override!r}: no {motion!r} in the scenario; {suggestion(motion, known)}'
        )
    for entry in entries:
        if entry[motion] is not None and not isinstance(entry[motion], dict):
            continue  # told where all motions are read
        entry[motion] = {**(entry[motion] or {}), setting: value}


def _value(text: str) -> Any:
    try:
        return load(text)
    except (yaml.YAMLError, ValueError) as error:
        raise ConfigError(f'{text!r} is no value: {" ".join(str(error).split())}') from error


def _truth(
    name: str,
    top: Mapping[str, Any],
    seed: int,
    spans: Sequence[Zone],
    motions: list[dict[str, Any]],
) -> dict[str, Any]:
    zones = [{'name': z.name, 'begin_s': z.begin_s, 'end_s': z.end_s} for z in spans]
    return {
        'name': name,
        'seed': seed,
        **stated(top, _TOP),
        'zones': zones,
        'motions': motions,
    }
