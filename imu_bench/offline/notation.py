# SPDX-License-Identifier: Apache-2.0
"""Numbers as people read them: sensible digits, an uncertainty, and the unit of datasheets."""

from __future__ import annotations

from collections.abc import Iterable
import math
from statistics import median

from imu_bench.metrology.estimate import Estimate
from imu_bench.units import convert

# by what a number is, because datasheets give N and a noise density in different units
_UNITS: dict[str, dict[str, tuple[str, ...]]] = {
    'level': {'m/s²': ('µg', 'mg', 'g'), 'rad/s': ('m°/s', '°/s')},
    'density': {'m/s²/√Hz': ('µg/√Hz', 'mg/√Hz'), 'rad/s/√Hz': ('m°/s/√Hz', '°/s/√Hz')},
    'N': {'m/s²/√Hz': ('m/s/√h',), 'rad/s/√Hz': ('°/√h',)},
    'B': {'m/s²': ('µg', 'mg'), 'rad/s': ('°/h', '°/s')},
    'K': {'m/s³/√Hz': ('µg/√h', 'm/s²/√h'), 'rad/s²/√Hz': ('°/h/√h', '°/s/√h')},
    'Q': {'m/s': ('mm/s', 'm/s'), 'rad': ('arcsec', '°')},
    'R': {'m/s³': ('mg/h',), 'rad/s²': ('°/h²',)},
}
_SMALLEST = -3  # exponent of what is written without a power of ten beside its uncertainty
_SUPERSCRIPT = str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹')


def readable_unit(si_unit: str, role: str, values: Iterable[float | None] = ()) -> str:
    """
    Return the unit in which datasheets give numbers of this size.

    Examples
    --------
    >>> readable_unit('m/s²/√Hz', 'density', [2e-3, 3e-3])
    'µg/√Hz'
    >>> readable_unit('m/s²/√Hz', 'N'), readable_unit('K', 'level')
    ('m/s/√h', 'K')
    """
    choices = _UNITS.get(role, {}).get(si_unit, (si_unit,))
    sizes = [abs(v) for v in values if v]
    if not sizes:
        return choices[0]
    typical = median(sizes)
    fitting = [unit for unit in choices if convert(typical, si_unit, unit) >= 1.0]
    return fitting[-1] if fitting else choices[0]


def number(value: float, digits: int = 4) -> str:
    """
    Return a number with this many significant digits.

    Examples
    --------
    >>> number(0.0123456), number(123456.0), number(1.5e-7, 2), number(0)
    ('0.01235', '123500', '1.5×10⁻⁷', '0')
    """
    if value == 0.0:
        return '0'
    exponent = _exponent(value, digits)
    if -4 <= exponent < 7:
        return _fixed(value, digits - 1 - exponent)
    mantissa = f'{value:.{digits - 1}e}'.partition('e')[0]  # dividing would not reach 1e-310
    return f'{mantissa}{_power(exponent)}'


def bare(value: float, digits: int = 5) -> str:
    """
    Return a number that has no uncertainty: zeros at its end would promise one.

    Examples
    --------
    >>> bare(150.0), bare(2.0), bare(0.58139), bare(1.2e-7), bare(123456.0)
    ('150', '2', '0.58139', '1.2×10⁻⁷', '123460')
    """
    mantissa, times, power = number(value, digits).partition('×')
    if '.' in mantissa:
        mantissa = mantissa.rstrip('0').rstrip('.')
    return f'{mantissa}{times}{power}'


def power_of_ten(exponent: int) -> str:
    """
    Return a power of ten.

    Examples
    --------
    >>> power_of_ten(-6)
    '10⁻⁶'
    """
    return f'10{str(exponent).translate(_SUPERSCRIPT)}'


def value_text(estimate: Estimate) -> str:
    """
    Return value and uncertainty without the unit; the upper bound where there is no value.

    The uncertainty has two digits, and the value as many decimals.  An
    interval that is not symmetric about the value is written as an interval.

    Examples
    --------
    >>> value_text(Estimate(243.123, 242.7, 243.5, 'µg/√Hz'))
    '243.12 ± 0.40'
    >>> value_text(Estimate(1.0, 0.8, 1.9, 'mg'))
    '1.0 (0.8 to 1.9)'
    >>> value_text(Estimate.not_observable('mg', 'record about 3 h', high=0.034))
    '< 0.034'
    """
    if estimate.value is None:
        return '–' if estimate.high is None else f'< {number(estimate.high, 2)}'
    value, low, high = estimate.value, estimate.low, estimate.high
    if low is None or high is None or low == high:
        return number(value, 5)
    down, up = value - low, high - value
    half = 0.5 * (high - low)
    if min(down, up) < 0.6 * max(down, up):
        return _interval(value, low, high)
    scale = _exponent(max(abs(value), half), 2)
    if _SMALLEST <= scale < 7:
        decimals = 1 - _exponent(half, 2)
        return f'{_fixed(value, decimals)} ± {_fixed(half, decimals)}'
    factor = 10.0**scale
    decimals = 1 - _exponent(half / factor, 2)
    return (
        f'({_fixed(value / factor, decimals)} ± {_fixed(half / factor, decimals)}){_power(scale)}'
    )


def text(estimate: Estimate, unit: str | None = None) -> str:
    """
    Return an estimate with its unit, converted if another unit is named.

    Examples
    --------
    >>> text(Estimate(2.0e-3, 1.9e-3, 2.1e-3, 'm/s²/√Hz'), 'µg/√Hz')
    '204 ± 10 µg/√Hz'
    """
    shown = estimate if unit is None or unit == estimate.unit else estimate.to(unit)
    words = value_text(shown)
    return words if words == '–' or shown.unit == '1' else f'{words} {shown.unit}'


def short(estimate: Estimate, digits: int = 3) -> str:
    """
    Return the value alone, for tables where the interval has no room.

    Examples
    --------
    >>> short(Estimate(243.123, 242.7, 243.5, 'µg/√Hz'))
    '243'
    """
    if estimate.value is None:
        return value_text(estimate)
    return number(estimate.value, digits)


def rate_text(rate: Estimate) -> str:
    """
    Return a sample rate to the digits anybody needs; the interval is often parts per billion.

    Examples
    --------
    >>> rate_text(Estimate(199.99999998, 199.99999997, 199.99999999, 'Hz'))
    '200.0000 Hz'
    >>> rate_text(Estimate(30.0133, 30.0130, 30.0136, 'Hz'))
    '30.01330 ± 0.00030 Hz'
    """
    if rate.value is None or rate.low is None or rate.high is None:
        return text(rate)
    exact = rate.high - rate.low < 1e-6 * rate.value
    return f'{number(rate.value, 7)} Hz' if exact else text(rate)


def duration(seconds: float) -> str:
    """
    Return a length of time as people say it.

    Examples
    --------
    >>> duration(0.0123), duration(12.34), duration(449.3), duration(30000.0), duration(400000.0)
    ('12.3 ms', '12.3 s', '7 min 29 s', '8 h 20 min', '4 d 15 h')
    """
    if seconds < 1.0:
        return f'{number(seconds * 1e3, 3)} ms'
    if seconds < 120.0:
        return f'{number(seconds, 3)} s'
    seconds = round(seconds)
    for large, small, size, part in (('min', 's', 60, 1), ('h', 'min', 3600, 60)):
        if seconds < size * (60 if large == 'min' else 48):
            first, rest = divmod(round(seconds / part), size // part)
            return f'{first} {large} {rest} {small}' if rest else f'{first} {large}'
    days, hours = divmod(round(seconds / 3600.0), 24)
    return f'{days} d {hours} h' if hours else f'{days} d'


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
    """
    Return a whole number in groups of three digits.

    Examples
    --------
    >>> grouped(2880028)
    '2\u202f880\u202f028'
    """
    return f'{things:,}'.replace(',', '\u202f')


def percent(share: float) -> str:
    """
    Return a share of one in per cent.

    Examples
    --------
    >>> percent(0.5), percent(0.00123), percent(2e-6)
    ('50 %', '0.12 %', '< 0.01 %')
    """
    if 0.0 < share < 1e-4:
        return '< 0.01 %'
    return f'{100.0 * share:.{2 if share < 0.1 else 3}g} %'


def _interval(value: float, low: float, high: float) -> str:
    step = min(abs(value - low) or math.inf, abs(high - value) or math.inf)
    scale = _exponent(max(abs(low), abs(high)), 2)
    factor, suffix = (1.0, '') if _SMALLEST <= scale < 7 else (10.0**scale, _power(scale))
    decimals = 1 if math.isinf(step) else -_exponent(step / factor, 1)
    if value != 0.0:  # two digits at least, or 5.3 would read as 5
        decimals = max(decimals, 1 - _exponent(value / factor, 2))
    shown = (_fixed(v / factor, decimals) for v in (value, low, high))
    return '{} ({} to {}){}'.format(*shown, suffix)


def _exponent(value: float, digits: int) -> int:
    """Return the decimal exponent after rounding to this many digits: 9.99 has 1 for two."""
    return int(f'{abs(value):.{digits - 1}e}'.partition('e')[2])


def _fixed(value: float, decimals: int) -> str:
    rounded = round(value, decimals)
    return f'{rounded:.{max(decimals, 0)}f}'


def _power(exponent: int) -> str:
    return f'×{power_of_ten(exponent)}'
