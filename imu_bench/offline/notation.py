# SPDX-License-Identifier: Apache-2.0
"""Numbers as people read them: sensible digits, an uncertainty, and the unit of datasheets."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import datetime, timezone
from statistics import median

from imu_bench.counting import count as count
from imu_bench.counting import grouped as grouped
from imu_bench.counting import number as number
from imu_bench.counting import power_of_ten as power_of_ten
from imu_bench.counting import with_uncertainty
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
    'per kelvin': {'m/s²/K': ('mg/K',), 'rad/s/K': ('m°/s/K', '°/s/K')},
    'R': {'m/s³': ('mg/h',), 'rad/s²': ('°/h²',)},
}
_BEFORE_CLOCKS = 2000  # year; earlier stamps are no date


def readable_unit(si_unit: str, role: str, values: Iterable[float | None] = ()) -> str:
    """Return the unit in which datasheets give numbers of this size."""
    choices = _UNITS.get(role, {}).get(si_unit, (si_unit,))
    sizes = [abs(v) for v in values if v]
    if not sizes:
        return choices[0]
    typical = median(sizes)
    fitting = [unit for unit in choices if convert(typical, si_unit, unit) >= 1.0]
    return fitting[-1] if fitting else choices[0]


def unit_of(estimates: Sequence[Estimate], role: str) -> str:
    """Return the unit in which datasheets give these, by their values or their upper bounds."""
    sizes = [e.value if e.value is not None else e.high for e in estimates]
    return readable_unit(estimates[0].unit, role, sizes)


def bare(value: float, digits: int = 5, power: int | None = None) -> str:
    """Return a number that has no uncertainty: zeros at its end would promise one."""
    mantissa, times, raised = number(value, digits, power).partition('×')
    if '.' in mantissa:
        mantissa = mantissa.rstrip('0').rstrip('.')
    return f'{mantissa}{times}{raised}'


def value_text(estimate: Estimate, power: int | None = None) -> str:
    """
    Return value and uncertainty without the unit; the upper bound where there is no value.

    The power of ten is that of the number, or one that a whole column has.

    Examples
    --------
    >>> value_text(Estimate(243.123, 242.7, 243.5, 'µg/√Hz'))
    '243.12 ± 0.40'
    >>> value_text(Estimate.not_observable('mg', 'record about 3 h', high=0.034))
    '< 0.034'
    """
    if estimate.value is None:
        return '–' if estimate.high is None else f'< {number(estimate.high, 2, power)}'
    return with_uncertainty(estimate.value, estimate.low, estimate.high, power)


def text(estimate: Estimate, unit: str | None = None, power: int | None = None) -> str:
    """
    Return an estimate with its unit, converted if another unit is named.

    Examples
    --------
    >>> text(Estimate(2.0e-3, 1.9e-3, 2.1e-3, 'm/s²/√Hz'), 'µg/√Hz')
    '204 ± 10 µg/√Hz'
    """
    shown = estimate if unit is None or unit == estimate.unit else estimate.to(unit)
    words = value_text(shown, power)
    return words if words == '–' or shown.unit == '1' else f'{words} {shown.unit}'


def short(estimate: Estimate, digits: int = 3) -> str:
    """Return the value alone, for tables where the interval has no room."""
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


def date(stamp_ns: int) -> str:
    """
    Return date and time of a stamp; nothing where stamps are seconds since power-up.

    Examples
    --------
    >>> date(1_700_000_000_000_000_000), date(60_000_000_000)
    ('2023-11-14 22:13 UTC', '')
    """
    try:
        moment = datetime.fromtimestamp(stamp_ns * 1e-9, tz=timezone.utc)
    except (OverflowError, OSError, ValueError):
        return ''
    return f'{moment:%Y-%m-%d %H:%M} UTC' if moment.year >= _BEFORE_CLOCKS else ''


def percent(share: float) -> str:
    """Return a share of one in per cent."""
    if 0.0 < share < 1e-4:
        return '< 0.01 %'
    return f'{100.0 * share:.{2 if share < 0.1 else 3}g} %'
