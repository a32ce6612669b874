# SPDX-License-Identifier: Apache-2.0
"""
Which run of a shaker campaign a recording is: service condition, axis, repetition.

In this order: what the user says (``--set``), what the recorder wrote into the bag (``ros2 bag
record --custom-data condition=SC1 axis=x repetition=2``), what a simulation wrote beside it
(truth.json), and the name of the file or folder, such as sc1_x_2 or sc1_x_sine.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import json
from pathlib import Path
import re
from typing import Any

from imu_bench.config.files import read_yaml
from imu_bench.errors import ConfigError, RecordingError
from msg_conversions.quantities import AXES

SINE_ON_RANDOM, SINE = 'sine-on-random', 'sine'
EXCITATIONS = (SINE_ON_RANDOM, SINE)

SINE_HZ = {'SC1': 5.0, 'SC2': 10.0, 'SC3': 15.0}
"""Capriglione et al. 2021, table III; the sine of SC4 is swept."""

SWEPT = ('SC4',)

_NAME = re.compile(
    r'(?<![a-z0-9])(?P<condition>sc\d+)[ _.-]*(?P<axis>[xyz])(?![a-z])'
    r'(?:[ _.-]*(?P<excitation>sine|ref(?:erence)?)(?![a-z]))?'
    r'(?:[ _.-]*(?:rep(?:etition)?|r)?[ _.-]*(?P<repetition>\d+))?',
    re.IGNORECASE,
)
_CONDITION = re.compile(r'sc[ _-]*(\d+)', re.IGNORECASE)


@dataclass(frozen=True)
class Identity:
    """What is known about a run."""

    condition: str  # service condition, such as 'SC1'
    axis: str  # axis that is excited: 'x', 'y' or 'z'
    repetition: int | None  # number of the repetition; None where nothing says it
    random: bool  # whether there is random vibration; without it, it is the reference of the SNR
    sine_hz: float | None  # frequency of the sine on the shaker; None if it is swept or not known


def identify(source: str, settings: Mapping[str, Any]) -> Identity:
    """Return which run a recording is."""
    path = Path(source)
    known: dict[str, Any] = {}
    asked = {name: settings[name] for name in _FIELDS if settings[name]}
    for told in (asked, _custom_data(path), _truth(path), _from_name(path)):
        known = {**told, **known}
    missing = ' and '.join(name for name in ('condition', 'axis') if not known.get(name))
    if missing:
        raise RecordingError(
            f'{source}: which {missing}? Name it like sc1_x_2, record it with --custom-data '
            'condition=SC1 axis=x repetition=2, or say --set condition=SC1 --set axis=x'
        )
    condition = _condition(str(known['condition']))
    frequency = settings['frequency'][0] if settings['frequency'] else known.get('frequency')
    return Identity(
        condition,
        _one_of(source, 'axis', str(known['axis']).lower(), AXES),
        _number(source, known.get('repetition')),
        _one_of(source, 'excitation', known.get('excitation') or SINE_ON_RANDOM, EXCITATIONS)
        == SINE_ON_RANDOM,
        None if condition in SWEPT else frequency or SINE_HZ.get(condition),
    )


_FIELDS = ('condition', 'axis', 'repetition', 'excitation')


def _condition(text: str) -> str:
    """Return the document's way of writing a service condition; others as they are."""
    match = _CONDITION.fullmatch(text.strip())
    return f'SC{match[1]}' if match else text.strip()


def _one_of(source: str, name: str, value: str, allowed: tuple[str, ...]) -> str:
    if value not in allowed:
        raise RecordingError(f'{source}: {name} {value!r} is none of {", ".join(allowed)}')
    return value


def _number(source: str, value: object) -> int | None:
    if value is None or value == 0:
        return None
    try:
        return int(str(value))
    except ValueError:
        raise RecordingError(f'{source}: repetition {value!r} is no whole number') from None


def _custom_data(path: Path) -> dict[str, Any]:
    """Return what the recorder was told, from the metadata of a bag."""
    file = path / 'metadata.yaml' if path.is_dir() else path.parent / 'metadata.yaml'
    if not file.is_file():
        return {}
    try:
        bag = read_yaml(file).get('rosbag2_bagfile_information')
    except ConfigError:
        return {}  # whoever reads the bag reports it
    custom = bag.get('custom_data') if isinstance(bag, Mapping) else None
    if not isinstance(custom, Mapping):
        return {}
    return {name: custom[name] for name in _FIELDS if custom.get(name)}


def _truth(path: Path) -> dict[str, Any]:
    """Return what a simulation wrote beside its recording."""
    file = next(
        (p for p in (path / 'truth.json', path.parent / 'truth.json') if p.is_file()), None
    )
    if file is None:
        return {}
    try:
        document = json.loads(file.read_text(encoding='utf-8'))
        scenario = document['scenario']
        motions = scenario['motions']
        name = _CONDITION.search(scenario['name'])
        excitation = SINE_ON_RANDOM if any(map(_is_random, motions)) else SINE
        axis = scenario['axis'] or next((m.get('axis', '') for m in motions), '')
        run = int(document['run'])
        sines = [m['frequency']['value'] for m in motions if m['kind'] == 'sine']
    except (OSError, ValueError, KeyError, IndexError, TypeError) as error:
        raise RecordingError(f'{file}: not as imu-bench simulate writes it ({error!r})') from error
    known: dict[str, Any] = {'axis': axis, 'excitation': excitation, 'repetition': run}
    known |= {'frequency': sines[0]} if len(sines) == 1 else {}
    return {**known, 'condition': name[0]} if name else known


def _is_random(motion: Mapping[str, Any]) -> bool:
    return bool(motion['kind'] == 'random' and motion['density']['value'] > 0.0)


def _from_name(path: Path) -> dict[str, Any]:
    match = _NAME.search(path.stem if path.suffix else path.name) or _NAME.search(path.parent.name)
    if match is None:
        return {}
    known: dict[str, Any] = {name: match[name] for name in ('condition', 'axis', 'repetition')}
    known['excitation'] = SINE if match['excitation'] else SINE_ON_RANDOM
    return {name: value for name, value in known.items() if value}
