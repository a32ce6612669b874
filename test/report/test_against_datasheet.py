# SPDX-License-Identifier: Apache-2.0
"""The table of measured against typical says of every axis what is so."""

from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.comparison import Verdict
from imu_bench.offline.report import against_datasheet


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


SAME = ('as specified',) * 3
DENSITY = 'm/s²/√Hz'


def test_axes_share_a_line():
    found = verdicts('a', 'linear_acceleration', DENSITY, (1e-3, 1.1e-3, 0.9e-3), SAME)
    found += verdicts('b', 'angular_velocity', 'rad/s/√Hz', (1e-3, 1e-3, 1e-3), SAME)
    first, second = against_datasheet.lines(found, {'b'})
    assert first.parameter == 'acceleration, noise density'
    assert (first.axes, first.unit, first.typical) == ('x / y / z', 'µg/√Hz', '102')
    assert first.measured == '102 / 112 / 91.8'
    assert first.ratio == '1.0 / 1.1 / 0.90'
    assert (first.verdict, first.kind, first.doubtful) == ('as specified', 'as-specified', False)
    assert second.parameter == 'angular velocity, noise density'
    assert second.doubtful


def test_the_worst_axis_is_named_first():
    kinds = ('as specified', 'worse', 'better')
    (line,) = against_datasheet.lines(
        verdicts('a', 'linear_acceleration', DENSITY, (1e-3, 2e-3, 0.5e-3), kinds)
    )
    assert line.verdict == 'worse y; better z; as specified x'
    assert line.kind == 'worse'


def test_what_cannot_be_seen_has_no_ratio():
    kinds = ('not observable', 'as specified')
    (line,) = against_datasheet.lines(
        verdicts('a', 'linear_acceleration', 'm/s²', (None, 1e-3), kinds, 'bias instability')
    )
    assert line.axes == 'x / y'
    assert line.ratio == '– / 1.0'
    assert line.measured.startswith('< ')
    assert line.verdict == 'as specified y; not observable x'


def test_one_sentence_on_all_of_it():
    good = verdicts('a', 'linear_acceleration', DENSITY, (1e-3,) * 3, SAME)
    kinds = ('worse', 'worse', 'better')
    bad = verdicts('b', 'linear_acceleration', DENSITY, (2e-3, 2e-3, 0.5e-3), kinds)
    assert against_datasheet.summary([]) == []
    assert against_datasheet.summary(good) == [
        '3 of 3 numbers are as the datasheets say, or better.'
    ]
    (line,) = against_datasheet.summary(good + bad)
    assert line == (
        '4 of 6 numbers are as the datasheets say, or better; '
        'worse: b (acceleration, noise density x, y).'
    )


def test_numbers_that_could_not_be_observed_are_counted():
    kinds = ('not observable', 'as specified')
    found = verdicts('a', 'linear_acceleration', 'm/s²', (None, 1e-3), kinds, 'bias instability')
    assert against_datasheet.summary(found) == [
        '1 of 2 numbers are as the datasheets say, or better; 1 could not be observed.'
    ]


def test_the_sources_of_typical_values_are_named_once():
    found = verdicts('a', 'linear_acceleration', DENSITY, (1e-3,) * 3, SAME)
    assert against_datasheet.sources(found) == ['a: DS 1']
