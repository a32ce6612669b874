# SPDX-License-Identifier: Apache-2.0
"""Numbers keep their value and their uncertainty when they are written down."""

import re

from hypothesis import given
from hypothesis import strategies as st
from imu_bench.metrology.estimate import Estimate
from imu_bench.offline import notation
from imu_bench.offline.presentation.tables import cells, Column, Table
import pytest

NUMBERS = st.floats(min_value=-1e12, max_value=1e12, allow_nan=False).filter(
    lambda x: x == 0 or abs(x) > 1e-15
)
RATIOS = st.floats(min_value=1e-9, max_value=1e9)


def plain(text):
    """Return a number as Python reads it."""
    power = re.search(r'×10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)', text)
    digits = '⁻⁰¹²³⁴⁵⁶⁷⁸⁹'
    exponent = ''.join('-0123456789'[digits.index(c)] for c in power[1]) if power else '0'
    return [
        float(n) * 10.0 ** int(exponent) for n in re.findall(r'-?\d+\.?\d*', text.split('×')[0])
    ]


@given(NUMBERS)
def test_four_digits_are_kept(value):
    assert plain(notation.number(value)) == [pytest.approx(value, rel=6e-4)]


@given(NUMBERS, RATIOS)
def test_value_and_half_width(value, ratio):
    half = ratio * (abs(value) or 1.0)
    shown = notation.value_text(Estimate(value, value - half, value + half, 'g'))
    assert shown.count('±') == 1
    assert plain(shown) == [
        pytest.approx(value, abs=0.06 * half),
        pytest.approx(half, rel=0.06),
    ]


def test_an_interval_that_is_not_symmetric_is_written_out():
    shown = notation.value_text(Estimate(3.0e-4, 1.0e-4, 9.0e-4, 'g'))
    assert plain(shown) == pytest.approx([3e-4, 1e-4, 9e-4], rel=0.01)
    assert 'to' in shown


@pytest.mark.parametrize(
    ('sizes', 'powers'),
    [
        ([-9.3e-4, -2.33e-3, -5.2e-3], []),
        ([1.2e-6, 250.0], []),
        ([4e-5, 3.1e-6], ['⁻⁵'] * 2),
        ([3e8, 2e5, 1.0], ['⁸'] * 3),
    ],
)
@pytest.mark.parametrize('kind', ['interval', 'bound', 'lopsided', 'plain'])
def test_powers_of_ten_are_written_one_way_in_a_column(sizes, powers, kind):
    """Beside one another (-9.3 ± 5.8)×10⁻⁴ and -0.00233 are read as if the first were larger."""
    made = {
        'interval': lambda v: Estimate(v, v - 0.2 * abs(v), v + 0.2 * abs(v), '°'),
        'bound': lambda v: Estimate.not_observable('°', 'short', high=v),
        'lopsided': lambda v: Estimate(v, v - 0.1 * abs(v), v + 0.9 * abs(v), '°'),
        'plain': float,
    }[kind]
    rows = tuple((made(size),) for size in sizes)
    shown = [row[0].text for row in cells(Table('', (Column('angle', '°'),), rows))]
    assert [m[1] for one in shown if (m := re.search('×10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)', one))] == powers
    for size, words in zip(sizes, shown, strict=True):
        assert plain(words)[0] == pytest.approx(size, rel=0.06)


@pytest.mark.parametrize(
    ('unit', 'role', 'value', 'expected'),
    [
        ('m/s²', 'level', 0.03, 'mg'),
        ('m/s²', 'level', 3e-4, 'µg'),
        ('rad/s', 'level', 1e-3, 'm°/s'),
        ('rad/s', 'level', 0.1, '°/s'),
        ('rad/s/√Hz', 'density', 1e-4, 'm°/s/√Hz'),
        ('rad/s/√Hz', 'N', 1e-4, '°/√h'),
        ('rad/s', 'B', 1e-5, '°/h'),
        ('m/s³/√Hz', 'K', 1e-5, 'µg/√h'),
        ('°C', 'level', 20.0, '°C'),
    ],
)
def test_units_are_those_of_datasheets(unit, role, value, expected):
    assert notation.readable_unit(unit, role, [value, None]) == expected
