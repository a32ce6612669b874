# SPDX-License-Identifier: Apache-2.0
"""Numbers, long lists and the words of others as people read them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import io
import math

# exponents between which a number is written without a power of ten beside its uncertainty
_SMALLEST, _LARGEST = -3, 7
_SUPERSCRIPT = str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹')

SPACES = '\u00a0\u2009\u202f'
"""Those that stand between digits, and before a unit."""


class Silence(io.TextIOBase):
    """Stands in for stdout where nothing is to be told (``--quiet``)."""

    def write(self, text: str) -> int:
        """Take a text and leave it at that."""
        return len(text)


def count(things: int, name: str) -> str:
    """
    Return how many, with the plural where it belongs.

    Examples
    --------
    >>> count(1, 'gap'), count(345, 'sample')
    ('1 gap', '345 samples')
    """
    return f'{grouped(things)} {name}{"" if things == 1 else "s"}'


def grouped(things: int) -> str:
    r"""
    Return a whole number in groups of three digits.

    Examples
    --------
    >>> grouped(2880028)
    '2\u202f880\u202f028'
    """
    return f'{things:,}'.replace(',', '\u202f')


def listed(things: Sequence[object], most: int, between: str = ', ', last: str = ' and ') -> str:
    """
    Return the first things of a list, and how many more there are.

    Examples
    --------
    >>> listed(['a', 'b', 'c', 'd'], 2), listed(['a', 'b'], 2)
    ('a, b and 2 more', 'a, b')
    """
    left = len(things) - most
    more = f'{last}{left} more' if left > 0 else ''
    return between.join(map(str, things[:most])) + more


def number(value: float, digits: int = 4, power: int | None = None) -> str:
    """Return a number with this many significant digits, perhaps with a given power of ten."""
    if value == 0.0:
        return '0'
    exponent = _exponent(value, digits)
    if power == 0 or (power is None and -4 <= exponent < 7):
        return _fixed(value, digits - 1 - exponent)
    if power is not None:
        return f'{_fixed(value / 10.0**power, digits - 1 - exponent + power)}{_power(power)}'
    mantissa = f'{value:.{digits - 1}e}'.partition('e')[0]  # dividing would not reach 1e-310
    return f'{mantissa}{_power(exponent)}'


def common_power(values: Iterable[float]) -> int:
    """
    Return the power of ten with which numbers that stand below one another are written.

    Examples
    --------
    >>> common_power([-2.3e-3, 9.3e-4]), common_power([2e-5, 3e-6])
    (0, -5)
    """
    scale = _exponent(max(map(abs, values), default=0.0), 2)
    return 0 if _SMALLEST <= scale < _LARGEST else scale


def power_of_ten(exponent: int) -> str:
    """Return a power of ten."""
    return f'10{str(exponent).translate(_SUPERSCRIPT)}'


_ROUNDING = 1e-12
"""Relative width of an interval that is no more than what the sums of its mean were rounded to."""


def with_uncertainty(
    value: float, low: float | None, high: float | None, power: int | None = None
) -> str:
    """
    Return a value and its interval.

    The uncertainty has two digits, and the value as many decimals.  An interval that is not
    symmetric about the value is written as an interval.  The power of ten is that of the number,
    or a given one.

    Examples
    --------
    >>> with_uncertainty(243.123, 242.7, 243.5), with_uncertainty(1.0, 0.8, 1.9)
    ('243.12 ± 0.40', '1.0 (0.8 to 1.9)')
    >>> with_uncertainty(46.54667297, 46.54667297 - 7e-15, 46.54667297 + 7e-15)
    '46.547'
    """
    if low is None or high is None or high - low <= _ROUNDING * abs(value):
        return number(value, 5, power)
    down, up = value - low, high - value
    half = 0.5 * (high - low)
    if min(down, up) < 0.6 * max(down, up):
        return _interval(value, low, high, power)
    scale = common_power((value, half)) if power is None else power
    if scale == 0:
        decimals = 1 - _exponent(half, 2)
        return f'{_fixed(value, decimals)} ± {_fixed(half, decimals)}'
    factor = 10.0**scale
    decimals = 1 - _exponent(half / factor, 2)
    return (
        f'({_fixed(value / factor, decimals)} ± {_fixed(half / factor, decimals)}){_power(scale)}'
    )


def _interval(value: float, low: float, high: float, power: int | None) -> str:
    step = min(abs(value - low) or math.inf, abs(high - value) or math.inf)
    scale = common_power((low, high)) if power is None else power
    factor, suffix = (10.0**scale, _power(scale)) if scale else (1.0, '')
    decimals = 1 if math.isinf(step) else -_exponent(step / factor, 1)
    if value != 0.0:  # two digits at least, or 5.3 would read as 5
        decimals = max(decimals, 1 - _exponent(value / factor, 2))
    shown = (_fixed(v / factor, decimals) for v in (value, low, high))
    return '{} ({} to {}){}'.format(*shown, suffix)


def _exponent(value: float, digits: int) -> int:
    """Return the decimal exponent after rounding to this many digits: 9.99 has 1 for two."""
    return int(f'{abs(value):.{digits - 1}e}'.partition('e')[2])


def _fixed(value: float, decimals: int) -> str:
    rounded = round(value, decimals) + 0.0  # no minus before zeros
    return f'{rounded:.{max(decimals, 0)}f}'


def _power(exponent: int) -> str:
    return f'×{power_of_ten(exponent)}'


def clean(words: str) -> str:
    r"""
    Return text, perhaps of somebody else, without characters that would steer the terminal.

    Examples
    --------
    >>> clean('\x1b[31m3\u202f600 samples') == '\\x1b[31m3\u202f600 samples'
    True
    """
    return ''.join(c if c.isprintable() or c in SPACES else f'\\x{ord(c):02x}' for c in words)
