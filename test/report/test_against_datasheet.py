# SPDX-License-Identifier: Apache-2.0
"""The table of measured against typical says of every axis what is so."""

from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.comparing.sensors import Comparison, Verdict
from imu_bench.offline.presentation import sensor_tables


def verdicts(label, quantity, unit, measured, kinds, parameter='noise density', typical=1e-3):
    estimates = [
        Estimate.not_observable(unit, 'too short', high=1.0) if value is None
        else Estimate(value, 0.9 * value, 1.1 * value, unit)
        for value in measured
    ]  # fmt: skip
    return [
        Verdict(label, f'{quantity}.{letter}', parameter, estimate, typical, 'DS 1', kind)
        for letter, estimate, kind in zip('xyz', estimates, kinds, strict=False)
    ]


def table(found, doubtful=()):
    compared = Comparison(tuple({v.label: 0 for v in found}), '', {}, tuple(found))
    (made,) = sensor_tables.against_datasheets(compared, doubtful)
    return made


SAME = ('as specified',) * 3
DENSITY = 'm/s²/√Hz'


def test_axes_share_a_line():
    found = verdicts('a', 'linear_acceleration', DENSITY, (1e-3, 1.1e-3, 0.9e-3), SAME)
    found += verdicts('b', 'angular_velocity', 'rad/s/√Hz', (1e-3, 1e-3, 1e-3), SAME)
    made = table(found, {'b'})
    first, second = made.rows
    assert made.columns[3].unit == 'x / y / z'
    assert first[:2] == ('a', 'acceleration, noise density')
    assert [cell.text for cell in first[3:]] == ['102 / 112 / 91.8', '102', 'µg/√Hz',
                                                 '1.0 / 1.1 / 0.90']  # fmt: skip
    assert (first[2].text, first[2].kind) == ('as specified', 'verdict-as-specified')
    assert second[1] == 'angular velocity, noise density'
    assert second[2].text == 'as specified *'
    assert '* This sensor has findings' in made.note


def test_the_worst_axis_is_named_first():
    kinds = ('as specified', 'worse', 'better')
    (line,) = table(
        verdicts('a', 'linear_acceleration', DENSITY, (1e-3, 2e-3, 0.5e-3), kinds)
    ).rows
    assert line[2].text == 'worse y; better z; as specified x'
    assert line[2].kind == 'verdict-worse'


def test_what_cannot_be_seen_has_no_ratio():
    kinds = ('not observable', 'as specified')
    made = table(
        verdicts('a', 'linear_acceleration', 'm/s²', (None, 1e-3), kinds, 'bias instability')
    )
    ((*_, verdict, measured, _, _, ratio),) = made.rows
    assert made.columns[3].unit == 'x / y'
    assert ratio.text == '– / 1.0'
    assert measured.text.startswith('< ')
    assert verdict.text == 'as specified y; not observable x'


def test_one_sentence_on_all_of_it():
    good = verdicts('a', 'linear_acceleration', DENSITY, (1e-3,) * 3, SAME)
    kinds = ('worse', 'worse', 'better')
    bad = verdicts('b', 'linear_acceleration', DENSITY, (2e-3, 2e-3, 0.5e-3), kinds)
    assert sensor_tables.datasheet_sentence([]) == []
    assert sensor_tables.datasheet_sentence(good) == [
        '3 of 3 numbers are as the datasheets say, or better.'
    ]
    (line,) = sensor_tables.datasheet_sentence(good + bad)
    assert line == (
        '4 of 6 numbers are as the datasheets say, or better; '
        'worse: b (acceleration, noise density x, y).'
    )


def test_numbers_that_could_not_be_observed_are_counted():
    kinds = ('not observable', 'as specified')
    found = verdicts('a', 'linear_acceleration', 'm/s²', (None, 1e-3), kinds, 'bias instability')
    assert sensor_tables.datasheet_sentence(found) == [
        '1 of 2 numbers are as the datasheets say, or better; 1 could not be observed.'
    ]


def test_the_sources_of_typical_values_are_named_once():
    found = verdicts('a', 'linear_acceleration', DENSITY, (1e-3,) * 3, SAME)
    assert table(found).note.endswith(' Typical values: a: DS 1.')
