# SPDX-License-Identifier: Apache-2.0
"""
Constants and unit conversions, in one place.

Everything inside the bench is SI.  Other units exist at the edges only:
in tables, reports, exports and the datasheet numbers of configuration files.
"""

from __future__ import annotations

import math

from imu_bench.errors import UnitError

STANDARD_GRAVITY = 9.80665
"""m/s², exact: 3rd CGPM (1901)."""

DEGREE = math.pi / 180.0
"""rad."""

GAUSS = 1e-4
"""T, exact."""

HOUR = 3600.0
"""s."""

_ACCELERATION = {
    'm/s²': 1.0,
    'g': STANDARD_GRAVITY,
    'mg': 1e-3 * STANDARD_GRAVITY,
    'µg': 1e-6 * STANDARD_GRAVITY,
}
_RATE = {'rad/s': 1.0, 'mrad/s': 1e-3, '°/s': DEGREE, 'm°/s': 1e-3 * DEGREE, '°/h': DEGREE / HOUR}
_ROOT_HOUR = math.sqrt(HOUR)
_DIMENSIONS: dict[str, dict[str, float]] = {
    'number': {'1': 1.0, '%': 1e-2, 'ppm': 1e-6},
    'level': {'dB': 1.0},
    'acceleration': _ACCELERATION | {'mm/s²': 1e-3},
    'angular velocity': _RATE,
    'velocity': {'m/s': 1.0, 'mm/s': 1e-3},
    'angle': {'rad': 1.0, '°': DEGREE, 'arcsec': DEGREE / 3600.0},
    'length': {'m': 1.0, 'mm': 1e-3, 'µm': 1e-6},
    'time': {'s': 1.0, 'ms': 1e-3, 'µs': 1e-6, 'ns': 1e-9, 'min': 60.0, 'h': HOUR},
    'frequency': {'Hz': 1.0, 'kHz': 1e3, 'rpm': 1.0 / 60.0},
    'sweep rate': {'oct/s': 1.0, 'oct/min': 1.0 / 60.0},
    'temperature': {'°C': 1.0},
    'temperature difference': {'K': 1.0, 'mK': 1e-3},
    'temperature density': {'K/√Hz': 1.0, 'mK/√Hz': 1e-3},
    'temperature rate': {'K/s': 1.0, 'K/min': 1.0 / 60.0, 'K/h': 1.0 / HOUR},
    'magnetic field': {'T': 1.0, 'µT': 1e-6, 'G': GAUSS, 'mG': 1e-3 * GAUSS},
    # N: white noise, angle and velocity random walk
    'acceleration density': {f'{unit}/√Hz': f for unit, f in _ACCELERATION.items()}
    | {'m/s/√s': 1.0, 'm/s/√h': 1.0 / _ROOT_HOUR},
    'angular velocity density': {f'{unit}/√Hz': f for unit, f in _RATE.items()}
    | {'rad/√s': 1.0, '°/√s': DEGREE, '°/√h': DEGREE / _ROOT_HOUR},
    'magnetic field density': {'T/√Hz': 1.0, 'µT/√Hz': 1e-6, 'mG/√Hz': 1e-3 * GAUSS},
    # K: rate random walk
    'acceleration walk': {
        'm/s³/√Hz': 1.0,
        'm/s²/√s': 1.0,
        'm/s²/√h': 1.0 / _ROOT_HOUR,
        'µg/√s': 1e-6 * STANDARD_GRAVITY,
        'µg/√h': 1e-6 * STANDARD_GRAVITY / _ROOT_HOUR,
    },
    'angular velocity walk': {
        'rad/s²/√Hz': 1.0,
        'rad/s/√s': 1.0,
        '°/h/√h': DEGREE / HOUR / _ROOT_HOUR,
        '°/s/√h': DEGREE / _ROOT_HOUR,
    },
    # R: ramp
    'acceleration ramp': {'m/s³': 1.0, 'mg/h': 1e-3 * STANDARD_GRAVITY / HOUR},
    'angular velocity ramp': {'rad/s²': 1.0, '°/h²': DEGREE / HOUR**2},
    # power spectral density, one-sided where the caller says so
    'acceleration power density': {'(m/s²)²/Hz': 1.0, 'g²/Hz': STANDARD_GRAVITY**2},
    'angular velocity power density': {'(rad/s)²/Hz': 1.0, '(°/s)²/Hz': DEGREE**2},
    'acceleration temperature coefficient': {'m/s²/K': 1.0, 'mg/K': 1e-3 * STANDARD_GRAVITY},
    'angular velocity temperature coefficient': {
        'rad/s/K': 1.0,
        '°/s/K': DEGREE,
        'm°/s/K': 1e-3 * DEGREE,
    },
    'magnetic field temperature coefficient': {'T/K': 1.0, 'µT/K': 1e-6},
    'relative temperature coefficient': {'1/K': 1.0, '%/K': 1e-2, 'ppm/K': 1e-6},
    'sensitivity of angular velocity to acceleration': {
        'rad/s/(m/s²)': 1.0,
        '°/s/g': DEGREE / STANDARD_GRAVITY,
        'm°/s/g': 1e-3 * DEGREE / STANDARD_GRAVITY,
        '°/h/g': DEGREE / HOUR / STANDARD_GRAVITY,
    },
    'vibration rectification of acceleration': {
        'm/s²/(m/s²)²': 1.0,
        'mg/g²': 1e-3 / STANDARD_GRAVITY,
        'µg/g²': 1e-6 / STANDARD_GRAVITY,
    },
    'vibration rectification of angular velocity': {
        'rad/s/(m/s²)²': 1.0,
        'm°/s/g²': 1e-3 * DEGREE / STANDARD_GRAVITY**2,
        '°/h/g²': DEGREE / HOUR / STANDARD_GRAVITY**2,
    },
    'acceleration squared': {'(m/s²)²': 1.0, 'g²': STANDARD_GRAVITY**2},
    'angular velocity squared': {'(rad/s)²': 1.0, '(°/s)²': DEGREE**2},
}

_TABLE = {
    unit: (dimension, factor)
    for dimension, units in _DIMENSIONS.items()
    for unit, factor in units.items()
}

_RESPELLED = (
    ('dps', '°/s'),
    ('degC', '°C'),
    ('deg', '°'),
    ('ug', 'µg'),
    ('uT', 'µT'),
    ('um', 'µm'),
    ('us', 'µs'),
    ('μ', 'µ'),
    ('sqrt(Hz)', '√Hz'),
    ('rtHz', '√Hz'),
    ('sqrt(h)', '√h'),
    ('sqrt(s)', '√s'),
    ('^2', '²'),
    ('^3', '³'),
    ('**2', '²'),
    ('**3', '³'),
    ('s2', 's²'),
    ('s3', 's³'),
    ('°/hr', '°/h'),
    ('gauss', 'G'),
    ('tesla', 'T'),
)


def canonical(unit: str) -> str:
    """
    Return a unit in the spelling of the bench; ASCII spellings are understood.

    Raises
    ------
    UnitError
        If the unit is not known.

    Examples
    --------
    >>> canonical('m/s^2'), canonical('deg/s/sqrt(Hz)'), canonical('mdps')
    ('m/s²', '°/s/√Hz', 'm°/s')
    """
    spelled = unit.strip()
    if spelled not in _TABLE:
        for old, new in _RESPELLED:
            spelled = spelled.replace(old, new)
    if spelled not in _TABLE:
        raise UnitError(f'unknown unit {unit!r}; known are {", ".join(sorted(_TABLE))}')
    return spelled


def dimension(unit: str) -> str:
    """Return what a unit measures, for example 'angular velocity'."""
    return _TABLE[canonical(unit)][0]


def units_like(unit: str) -> list[str]:
    """
    Return every unit that measures the same quantity.

    Examples
    --------
    >>> units_like('rad')
    ['rad', '°', 'arcsec']
    """
    wanted = dimension(unit)
    return [known for known, (measures, _) in _TABLE.items() if measures == wanted]


def convert(value: float, unit: str, to: str) -> float:
    """
    Return a value of one unit in another.

    Raises
    ------
    UnitError
        If a unit is not known or the two do not measure the same quantity.

    Examples
    --------
    >>> convert(1.0, 'g', 'm/s²')
    9.80665
    >>> round(convert(1.0, '°/√h', 'rad/√s'), 12)
    0.000290888209
    """
    dimension_from, factor_from = _TABLE[canonical(unit)]
    dimension_to, factor_to = _TABLE[canonical(to)]
    if dimension_from != dimension_to:
        raise UnitError(
            f'{unit!r} measures {dimension_from} and cannot be given in {to!r} ({dimension_to})'
        )
    return value if factor_from == factor_to else value * factor_from / factor_to


_SI_OF_TERM = {
    'm/s²': {'Q': 'm/s', 'N': 'm/s²/√Hz', 'B': 'm/s²', 'K': 'm/s³/√Hz', 'R': 'm/s³'},
    'rad/s': {'Q': 'rad', 'N': 'rad/s/√Hz', 'B': 'rad/s', 'K': 'rad/s²/√Hz', 'R': 'rad/s²'},
}


def term_unit(unit: str, term: str) -> str:
    """
    Return the SI unit of the noise coefficient Q, N, B, K or R of a signal.

    Raises
    ------
    UnitError
        If the signal is neither an acceleration nor an angular velocity.

    Examples
    --------
    >>> term_unit('rad/s', 'N')
    'rad/s/√Hz'
    """
    try:
        return _SI_OF_TERM[canonical(unit)][term]
    except KeyError:
        raise UnitError(
            f'no unit for coefficient {term!r} of a signal in {unit!r}; '
            'signals are m/s² or rad/s, coefficients Q, N, B, K, R'
        ) from None
