# SPDX-License-Identifier: Apache-2.0
"""The twin of a measured sensor: a sensor file that makes what an analysis found."""

from __future__ import annotations

from collections.abc import Mapping
import math
from pathlib import Path
import re
from typing import Any

from imu_bench.config.files import PARAMETERS
from imu_bench.config.json_file import read_json
from imu_bench.errors import ConfigError, RecordingError
from imu_bench.units import STANDARD_GRAVITY
from msg_conversions.quantities import AXES, IMU_QUANTITIES, LINEAR_ACCELERATION, Quantity
import yaml

SCHEMA = 'imu_bench.analysis/1'

_TOLD = 200
"""Characters of a damaged document that an error text repeats."""

_HOW = 'make one with imu-bench analyze RECORDING --json FILE'

AC_CORNER = '1.0 Hz'
"""Assumed of a sensor that does not see gravity: an analysis does not give it."""

_TERMS = {'B': 'bias_instability', 'K': 'random_walk', 'Q': 'quantisation'}
_ATTITUDES = {
    ('z', 1): (0.0, 0.0),
    ('z', -1): (180.0, 0.0),
    ('y', 1): (90.0, 0.0),
    ('y', -1): (-90.0, 0.0),
    ('x', 1): (0.0, -90.0),
    ('x', -1): (0.0, 90.0),
}
"""Roll and pitch in degrees that bring an axis, or its opposite, upwards."""


def twins(path: Path) -> dict[str, dict[str, Any]]:
    """
    Return the parameters of a twin of each sensor in the result of an analysis, by its name.

    White noise, bias instability, random walk, quantisation, offset, resolution and rate are
    those found; a coefficient that could not be observed is left out.  Which way is up is
    taken from the largest mean; what is left of gravity after that is offset.

    Parameters
    ----------
    path : Path
        JSON file of `imu-bench analyze`.

    Raises
    ------
    RecordingError
        If it is no such file, or holds no sensor.
    """
    try:
        document = read_json(path)
    except IsADirectoryError as error:
        raise RecordingError(f'{path}: a folder, no result: {_HOW}') from error
    except OSError as error:
        raise RecordingError(f'{path}: cannot be read: {error.strerror}') from error
    except ValueError as error:
        raise RecordingError(f'{path}: not a JSON document, no result: {_HOW}') from error
    schema = document.get('schema') if isinstance(document, Mapping) else None
    if schema != SCHEMA:
        raise RecordingError(f'{path}: not a result of an analysis: schema {schema!r}')
    made: dict[str, dict[str, Any]] = {}
    try:
        for recording in document['recordings']:
            name = _free(_name(recording['topic']), made)
            made[name] = _parameters(recording, name)
    except (KeyError, TypeError, AttributeError, ValueError, ArithmeticError) as error:
        told = ' '.join(repr(error).split())[:_TOLD]
        raise RecordingError(f'{path}: an entry is missing or misplaced: {told}') from error
    if not made:
        raise RecordingError(f'{path}: holds no recording to make a twin of')
    return made


def write_twins(folder: Path, made: Mapping[str, Mapping[str, Any]], source: str) -> None:
    """
    Write a sensor file for each twin and a bench of them all, to be simulated or run live.

    Raises
    ------
    ConfigError
        If the files cannot be written.
    """
    try:
        folder.mkdir(parents=True)
        for name, parameters in made.items():
            text = _yaml({'/**': {PARAMETERS: dict(parameters)}})
            comment = f'# Twin of {name} as analysed in {source}.\n'
            (folder / f'{name}.yaml').write_text(comment + text, encoding='utf-8')
        bench = {
            'name': 'twin',
            'title': f'Twins of the sensors in {source}',
            'sensors': [{'file': f'{name}.yaml'} for name in made],
        }
        (folder / 'bench.yaml').write_text(_yaml(bench), encoding='utf-8')
    except OSError as error:
        raise ConfigError(f'{folder}: cannot be written: {error.strerror}') from error


def _yaml(document: Mapping[str, Any]) -> str:
    return yaml.safe_dump(dict(document), sort_keys=False, allow_unicode=True)


def _name(topic: str) -> str:
    """Return a short name for the sensor of a topic."""
    match = re.fullmatch(r'/bench/([^/]+)/imu/data_raw', topic)
    words = match[1] if match else topic
    name = re.sub(r'\W+', '_', words, flags=re.ASCII).strip('_') or 'imu'
    return f's_{name}' if name[0].isdigit() else name


def _free(name: str, taken: Mapping[str, Any]) -> str:
    names = [name, *(f'{name}_{number}' for number in range(2, len(taken) + 3))]
    return next(candidate for candidate in names if candidate not in taken)


def _parameters(recording: Mapping[str, Any], name: str) -> dict[str, Any]:
    axes, health = recording['axes'], recording['health']
    rate = float(health['rate']['value'])
    simulation: dict[str, Any] = {}
    for quantity in IMU_QUANTITIES:
        found = {letter: axes.get(f'{quantity.name}.{letter}') for letter in AXES}
        if not any(found.values()):
            continue
        steps = {
            letter: _number(health.get('resolution', {}).get(f'{quantity.name}.{letter}'))
            for letter in AXES
        }
        up = _upwards(found) if quantity is LINEAR_ACCELERATION else None
        coupled = quantity is LINEAR_ACCELERATION and up is None
        if up is not None:
            simulation['roll'], simulation['pitch'] = (f'{a} °' for a in _ATTITUDES[up])
        simulation[quantity.field] = _errors(quantity, found, steps, rate, up, coupled)
    return {
        'driver': 'generic',
        'backend': 'emulated',
        'frame_id': recording.get('frame_id') or f'{name}_link',
        'title': f'twin of {name}',
        'rate_hz': rate,
        'simulation': simulation,
    }


def _errors(
    quantity: Quantity,
    found: Mapping[str, Any],
    steps: Mapping[str, float],
    rate: float,
    up: tuple[str, int] | None,
    coupled: bool,
) -> dict[str, Any]:
    """Return the settings of one quantity."""
    unit = quantity.unit
    values: dict[str, list[float]] = {'noise_density': []}
    values |= {name: [] for name in (*_TERMS.values(), 'bias')}
    for letter in AXES:
        axis = found[letter] or {}
        terms = {t: _number(e) for t, e in axis.get('coefficients', {}).items()}
        values['noise_density'].append(_density(axis, terms, steps[letter], rate, coupled))
        for term, name in _TERMS.items():
            values[name].append(0.0 if coupled else terms.get(term, 0.0))
        gravity = up[1] * STANDARD_GRAVITY if up is not None and up[0] == letter else 0.0
        values['bias'].append(0.0 if coupled else _number(axis.get('mean'), gravity) - gravity)
    values['resolution'] = list(steps.values())
    units = {
        'noise_density': f'{unit}/√Hz',
        'random_walk': f'{unit}/√s',
        'quantisation': 'm/s' if unit == 'm/s²' else 'rad',
    }
    made: dict[str, Any] = {'axes': ''.join(letter for letter in AXES if found[letter])}
    for name, numbers in values.items():
        if any(numbers):
            made[name] = [f'{number!r} {units.get(name, unit)}' for number in numbers]
    return {**made, 'high_pass': AC_CORNER} if coupled else made


def _density(
    axis: Mapping[str, Any],
    terms: Mapping[str, float],
    step: float,
    rate: float,
    coupled: bool,
) -> float:
    """Return the one-sided density before rounding to the resolution, which adds its own."""
    if coupled:
        # without constant values the Allan deviation shows no white noise
        return _number(axis.get('noise_density_methods', {}).get('plateau'))
    n = terms.get('N', 0.0)
    return math.sqrt(max(2.0 * n**2 - step**2 / 6.0 / rate, 0.0))


def _upwards(found: Mapping[str, Any]) -> tuple[str, int] | None:
    """Return the axis that gravity's reaction is along, and its sign; None without gravity."""
    means = {letter: _number(axis.get('mean')) for letter, axis in found.items() if axis}
    letter = max(means, key=lambda one: abs(means[one]))
    if abs(means[letter]) < STANDARD_GRAVITY / 2.0:
        return None
    return letter, 1 if means[letter] > 0.0 else -1


def _number(estimate: Any, default: float = 0.0) -> float:
    """Return the value of an estimate in JSON; the default if there is none."""
    value = estimate.get('value') if isinstance(estimate, Mapping) else None
    return default if value is None else float(value)
