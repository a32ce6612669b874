# SPDX-License-Identifier: Apache-2.0
"""Units of the columns of a text file: given, named by the file, or refused; never guessed."""

from __future__ import annotations

from dataclasses import dataclass, replace
import re

from imu_bench import units
from imu_bench.errors import RecordingError, UnitError
from msg_conversions.quantities import QUANTITIES

SI = {
    'stamp': 's',
    'index': '1',
    'nanoseconds': 's',
    **{quantity.name: quantity.unit for quantity in QUANTITIES},
}
"""SI unit by quantity; the bench's own for the temperature."""

EXAMPLES = {
    'stamp': 'stamp=ms',
    'linear_acceleration': 'linear_acceleration=g/16384',
    'angular_velocity': 'angular_velocity=deg/s/131',
    'magnetic_field': 'magnetic_field=uT',
    'temperature': 'temperature=degC',
    'inclination': 'inclination=deg',
    'orientation': 'orientation=1',
}

_SCALED = re.compile(r'^(?P<unit>.+?)(?P<sign>[/*])(?P<number>\d+(?:\.\d*)?(?:[eE][+-]?\d+)?)$')
_OFFSET = re.compile(r'^\(\s*counts?\s*(?P<offset>[+-]\s*\d+(?:\.\d*)?)\s*\)\s*\*\s*(?P<unit>.+)$')
"""As of an analog converter whose zero is half of its range: (count-32768)*g/16384."""

_RESPELLED = (
    ('m s^-2', 'm/s²'),
    ('m s-2', 'm/s²'),
    ('m/s/s', 'm/s²'),
    ('rad s^-1', 'rad/s'),
    ('rad s-1', 'rad/s'),
    ('deg s^-1', '°/s'),
    ('deg/sec', '°/s'),
    ('deg/h', '°/h'),
    ('sec', 's'),
    ('C', '°C'),
)


@dataclass(frozen=True)
class Scale:
    """How the numbers of a column become SI."""

    unit: str  # as the bench spells it
    factor: float  # SI per number in the file
    offset: float = 0.0  # to be added to the number before


def parse_units(text: str | None) -> dict[str, str]:
    """Return unit by name from ``name=unit,name=unit``; ``SI`` alone names every quantity."""
    if text is None:
        return {}
    if text.strip().upper() == 'SI':
        return dict(SI)
    found: dict[str, str] = {}
    for part in text.split(','):
        name, equals, unit = (piece.strip() for piece in part.partition('='))
        if not (name and equals and unit):
            raise RecordingError(
                f'--units: {part.strip()!r} is not of the form name=unit; write for example '
                '--units linear_acceleration=g/16384,angular_velocity=deg/s/131'
            )
        if name in found:
            raise RecordingError(f'--units: {name!r} is given twice')
        found[name] = unit
    return found


def scale(quantity: str, text: str) -> Scale:
    """Return how numbers in a unit become SI."""
    if shifted := _OFFSET.match(text):
        offset = float(shifted['offset'].replace(' ', ''))
        return replace(scale(quantity, shifted['unit']), offset=offset)
    match = _SCALED.match(text)
    number = float(match['number']) if match else 1.0
    unit = match['unit'] if match else text
    if number == 0:
        raise RecordingError(f'--units: {text!r} for {quantity}: the number must not be 0')
    try:
        spelled = units.canonical(_respelled(unit))
        factor = units.convert(1.0, spelled, SI[quantity])
    except UnitError as problem:
        known = ', '.join(units.units_like(SI[quantity]))
        what = str(problem).partition('; known are')[0]  # those of every quantity
        raise RecordingError(
            f'--units: {quantity}={text}: {what}; use one of {known}'
        ) from problem
    if match is None:
        return Scale(spelled, factor)
    return Scale(spelled, factor * number if match['sign'] == '*' else factor / number)


def named_unit(quantity: str, text: str) -> str | None:
    """Return a unit that a column name carries, None if it is none of the quantity's."""
    try:
        scale(quantity, text)
    except RecordingError:
        return None
    return text


def _respelled(unit: str) -> str:
    plain = ' '.join(unit.split())
    for old, new in _RESPELLED:
        if plain == old:
            return new
    return plain


def missing(lacking: list[str], known: dict[str, str]) -> str:
    """Return the option that would complete the units, for an error message."""
    given = [f'{name}={unit}' for name, unit in known.items()]
    return '--units ' + ','.join(given + [EXAMPLES[quantity] for quantity in lacking])
