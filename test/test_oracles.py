# SPDX-License-Identifier: Apache-2.0
"""
What the drivers declare against what others wrote about the same chips: test/oracles.

`python test/test_oracles.py` prints how many facts have a second source, and which have none.
"""

from collections.abc import Iterator
from functools import cache
import math
from pathlib import Path
import re
from typing import Any

from imu_bench import drivers
from imu_bench.drivers.driver import Driver
from imu_bench.registers import Channel, Field, Register
from imu_bench.units import DEGREE, GAUSS
from imu_bench.units import STANDARD_GRAVITY as G
import numpy as np
import pytest
import yaml

ORACLES = Path(__file__).parent / 'oracles'
TABLES = sorted(path.stem for path in ORACLES.glob('*.yaml'))
DOCUMENT = Path(__file__).parents[1] / 'docs' / 'drivers_second_sources.md'
WITHIN = 1e-4  # what rounding leaves of the figures that have four digits or more

# SI per LSB of a figure in the unit of its source; a sensor behind a converter has 100 mV/g
UNITS = {
    'LSB/g': lambda x: G / x,
    'mg/LSB': lambda x: 1e-3 * G * x,
    'µg/LSB': lambda x: 1e-6 * G * x,
    'LSB/(m/s²)': lambda x: 1 / x,
    'm/s²/LSB': lambda x: x,
    'µm/s²/LSB': lambda x: 1e-6 * x,
    'nm/s²/LSB': lambda x: 1e-9 * x,
    'LSB/(°/s)': lambda x: DEGREE / x,
    'm°/s/LSB': lambda x: 1e-3 * DEGREE * x,
    'nrad/s/LSB': lambda x: 1e-9 * x,
    '°/s/2^15': lambda x: x * DEGREE / 2**15,
    'LSB/G': lambda x: GAUSS / x,
    'mG/LSB': lambda x: 1e-3 * GAUSS * x,
    'µG/LSB': lambda x: 1e-6 * GAUSS * x,
    'LSB/µT': lambda x: 1e-6 / x,
    'µT/LSB': lambda x: 1e-6 * x,
    'LSB/K': lambda x: 1 / x,
    'K/LSB': lambda x: x,
    'mK/LSB': lambda x: 1e-3 * x,
    '°/2^14': lambda x: x * DEGREE / 2**14,
    'µ°/LSB': lambda x: 1e-6 * DEGREE * x,
    'LSB': lambda x: 1 / x,
    'SI': lambda x: x,
    'V/2^12': lambda x: x / 2**12 * G / 0.1,
    'V/2^15': lambda x: x / 2**15 * G / 0.1,
    'V/2^23': lambda x: x / 2**23 * G / 0.1,
}

# Where a source and the driver differ: why the driver stands by its figure.
DISPUTED = {
    ('lsm9ds1_st', 'scale of magnetic_field at 4'): '0.14 is 0.146 cut off, as in the sheet',
    ('lsm9ds1_st', 'scale of magnetic_field at 8'): '0.29 is 0.292 cut off',
    ('lsm9ds1_st', 'scale of magnetic_field at 12'): '0.43 is 0.438 cut off',
    ('lsm9ds1_st', 'scale of magnetic_field at 16'): '0.58 is 0.585 cut off',
    ('lsm9ds1_px4', 'scale of temperature'): 'the sheet and ST have 16 LSB/K, PX4 alone has 256',
}

# Only the data sheet says it.  What is new here has to be added by hand, knowingly.
NO_SECOND_SOURCE = {
    'bno055': {'bits of error', 'bits of state'},
    'iim42652': {
        'code of adaptive_full_scale true',
        'register FIFO_LOST_PKT',  # nothing is written to these or read from them
        'register FSYNC_CONFIG',
        'register GYRO_NOTCH',
        'register INT_SOURCE1',
        'register INT_SOURCE3',
        'register INT_SOURCE4',
        'register INT_STATUS2',
        'register INT_STATUS3',
        'register SELF_TEST_CONFIG',
        'register TMST_FSYNC',
    },
    'lsm303dlhc': {
        'code of sample_rate 0',
        'offset of temperature',  # nor does the sheet, which gives changes only
        'scale of temperature',
    },
    'lsm9ds1': {
        'axes of acceleration',
        'axes of angular_velocity',
        'identity 0x49 in WHO_AM_I_M',
        'identity 0xd4 in WHO_AM_I',
    },
    'mpu9250': {'bits of accelerometer_bandwidth', 'code of clock_source stopped'},
    'mti300': {
        'scale of acceleration',
        'scale of angular_velocity',
        'scale of magnetic_field',  # a setting: the maker gives no tesla
        'scale of orientation',
        'scale of temperature',
    },
    'mtn1100': {'register RESULT', 'register SCAN'},  # names of ours for what has none
    'scl3300': {'code of angle_outputs off'},
    'serial_bridge': {  # what lines mean is said by their sketch
        'register ACCELERATION',
        'register ANGULAR_VELOCITY',
        'register MAGNETIC_FIELD',
        'register TEMPERATURE',
        'scale of acceleration',
        'scale of angular_velocity',
        'scale of magnetic_field',
        'scale of temperature',
        'words of acceleration',
        'words of angular_velocity',
        'words of magnetic_field',
        'words of temperature',
    },
}

Facts = dict[str, Any]


def declared(driver: type[Driver]) -> Facts:
    """Return every fact of a driver by a name that tables use too."""
    facts: Facts = {}
    for name, register in driver.declared(Register).items():
        facts[f'register {name}'] = (register.bank, register.address)
        if register.reset:
            facts[f'reset of {name}'] = register.reset
    for identity in driver.identities:
        for word in (*identity.expected, *identity.others):
            facts[f'identity {word:#x} in {identity.register.name}'] = True
    for name, field in driver.declared(Field).items():
        facts[f'bits of {name}'] = field.mask
        codes = dict(field.codes or {})
        if len(codes) > 200:  # a rule, which is one fact
            facts[f'codes of {name}'] = codes
        else:
            facts |= {f'code of {name} {_key(value)}': code for value, code in codes.items()}
    for channel in driver.declared(Channel).values():
        facts |= _declared_of(channel)
    return facts


def _declared_of(channel: Channel) -> Facts:
    name = channel.name
    facts: Facts = {f'words of {name}': channel.dtype}
    for range_ in (channel.scaled_by and channel.scaled_by.codes) or (None,):
        at = '' if range_ is None else f' at {_key(range_)}'
        facts[f'scale of {name}{at}'] = channel.factor(range_)
    if channel.offset:
        facts[f'offset of {name}'] = channel.offset
    axes = np.asarray(getattr(channel, 'axes', np.eye(3)))
    if (axes != np.eye(3)).any():
        facts[f'axes of {name}'] = axes
    return facts


def _key(value: object) -> str:
    return str(value).lower() if isinstance(value, (bool, str)) else f'{value:g}'


@cache
def table(name: str) -> dict[str, Any]:
    """Return a table as it is written."""
    content: dict[str, Any] = yaml.safe_load((ORACLES / f'{name}.yaml').read_text('utf-8'))
    return content


def stated(name: str) -> Iterator[tuple[str, Any, float]]:
    """Yield what a source states: the fact, its value, and the relative error of its rounding."""
    content = table(name)
    for register, place in content.get('registers', {}).items():
        bank, address = place if isinstance(place, list) else (None, place)
        yield f'register {register}', (bank, address), 0.0
    for register, word in content.get('resets', {}).items():
        yield f'reset of {register}', word, 0.0
    for register, words in content.get('identities', {}).items():
        yield from ((f'identity {word:#x} in {register}', True, 0.0) for word in words)
    for field, mask in content.get('fields', {}).items():
        yield f'bits of {field}', mask, 0.0
    for field, codes in content.get('codes', {}).items():
        yield from _codes(field, codes)
    yield from _channels(content)


def _codes(field: str, codes: dict[Any, int]) -> Iterator[tuple[str, Any, float]]:
    if 'divides' in codes:
        rule = {round(codes['divides'] / (1 + code), 3): code for code in range(256)}
        yield f'codes of {field}', rule, 0.0
    else:
        yield from ((f'code of {field} {_key(value)}', code, 0.0) for value, code in codes.items())


def _channels(content: dict[str, Any]) -> Iterator[tuple[str, Any, float]]:
    for channel, dtype in content.get('words', {}).items():
        yield f'words of {channel}', dtype, 0.0
    for channel, scales in content.get('scales', {}).items():
        convert, within = UNITS[scales['unit']], scales.get('within', WITHIN)
        for range_, figure in scales.items():
            if range_ not in ('unit', 'within'):
                at = '' if range_ == 'all' else f' at {_key(range_)}'
                yield f'scale of {channel}{at}', convert(np.asarray(figure, float)), within
    for channel, offset in content.get('offsets', {}).items():
        if isinstance(offset, dict):  # a point of the line
            factor = drivers.load(content['driver']).channels()[channel].factor()[0]
            offset = offset['is'] - offset['word'] * factor
        yield f'offset of {channel}', offset, WITHIN
    for channel, axes in content.get('axes', {}).items():
        yield f'axes of {channel}', np.asarray(axes), 0.0


def agrees(ours: Any, theirs: Any, within: float) -> bool:
    """Return whether a driver and a source say the same."""
    if isinstance(ours, (np.ndarray, float)):
        return bool(np.allclose(ours, theirs, rtol=within, atol=0))
    return bool(ours == theirs)


def of(driver: str) -> list[str]:
    return [name for name in TABLES if table(name)['driver'] == driver]


def unwitnessed(driver: str) -> tuple[set[str], int]:
    """Return the facts of a driver that nobody else states, and how many facts it has."""
    facts = {fact for fact in declared(drivers.load(driver)) if not fact.startswith('reset')}
    known = {fact for name in of(driver) for fact, _, _ in stated(name)}
    # one code of a single bit settles the other
    for name, field in drivers.load(driver).declared(Field).items():
        codes = {f'code of {name} {_key(value)}' for value in field.codes or {}}
        if field.width == 1 and codes & known:
            known |= codes
    return facts - known, len(facts)


@pytest.mark.parametrize('name', TABLES)
def test_the_driver_says_what_the_source_says(name: str) -> None:
    ours = declared(drivers.load(table(name)['driver']))
    wrong = []
    for fact, theirs, within in stated(name):
        known = fact in ours
        agreed = known and agrees(ours[fact], theirs, within)
        if agreed is ((name, fact) in DISPUTED):
            wrong.append(f'{fact}: driver {ours.get(fact)}, source {theirs}')
    assert not wrong, '\n'.join(wrong)


@pytest.mark.parametrize('name', TABLES)
def test_every_table_names_its_source(name: str) -> None:
    content = table(name)
    assert re.fullmatch(r'[\w.-]+/[\w.-]+', content['repository']) and content['licence']
    assert content['files'] and all(
        re.fullmatch(r'[0-9a-f]{40}', commit) for commit in content['files'].values()
    )


@pytest.mark.parametrize('driver', drivers.names())
def test_what_has_no_second_source_is_listed(driver: str) -> None:
    alone, _ = unwitnessed(driver)
    assert alone == NO_SECOND_SOURCE.get(driver, set())


def report() -> Iterator[str]:
    """Yield how many facts of each driver have a second source, and which have none."""
    all_alone = all_facts = 0
    for driver in drivers.names():
        alone, count = unwitnessed(driver)
        all_alone, all_facts = all_alone + len(alone), all_facts + count
        yield f'{driver}: {count - len(alone)} of {count}'
        yield from (f'    {fact}' for fact in sorted(alone))
    share = math.floor(1000 * (1 - all_alone / all_facts)) / 10
    yield f'{all_facts - all_alone} of {all_facts} facts, {share:.1f} %'


def test_nearly_all_that_drivers_write_or_decode_has_a_second_source() -> None:
    *_, total = report()
    assert float(total.split()[-2]) >= 95.0
    assert total in DOCUMENT.read_text('utf-8')


if __name__ == '__main__':
    print('\n'.join(report()))
