# SPDX-License-Identifier: Apache-2.0
"""Runs against one another: what is matched, and when a difference counts."""

from dataclasses import replace
from functools import lru_cache
import json

from imu_bench.errors import RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.analysis.recording import analyse
from imu_bench.offline.analysis.results import Analysis
from imu_bench.offline.comparing.runs import compare_runs, named
from imu_bench.offline.health import Finding
from imu_bench.offline.presentation import run_tables
from imu_bench.offline.presentation.pages import render_runs
import numpy as np
import pytest


@pytest.fixture(scope='module')
def sensor(recording_of, noise):
    """Return a function that analyses a sensor with this noise under this topic."""

    @lru_cache
    def measured(seed, topic='/bench/chip/imu/data_raw', scale=1.0):
        samples = noise(seed, n=20_000, acceleration=2e-3 * scale, angular_velocity=1e-4)
        return analyse(recording_of(samples, topic=topic))

    return measured


def runs(*recordings):
    paths = [f'run{index}.json' for index in range(len(recordings))]
    return named(paths, [Analysis(tuple(each)) for each in recordings])


def line_of(across, axis, parameter):
    [line] = [e for e in across.lines if (e.axis, e.parameter) == (axis, parameter)]
    return line


@pytest.mark.slow
def test_the_same_sensor_is_the_same_nineteen_times_in_twenty(sensor):
    verdicts = [
        line.verdict
        for seed in range(6)
        for line in compare_runs(runs([sensor(seed)], [sensor(seed + 50)])).lines
        if line.verdict != 'undecided'
    ]
    assert verdicts.count('same') / len(verdicts) > 0.85


def test_twice_the_noise_is_higher_by_its_ratio(sensor):
    across = compare_runs(runs([sensor(1)], [sensor(2, scale=2.0)]))
    for parameter in ('std', 'noise_density'):
        line = line_of(across, 'linear_acceleration.x', parameter)
        assert line.verdict == 'higher'
        assert line.ratio.low < 2.0 < line.ratio.high
        assert line.e_n > 10.0
        assert line.difference.value == pytest.approx(line.value.value - line.reference.value)
    assert line_of(across, 'angular_velocity.x', 'std').verdict == 'same'
    back = compare_runs(runs([sensor(2, scale=2.0)], [sensor(1)]))
    assert line_of(back, 'linear_acceleration.x', 'std').verdict == 'lower'


def test_uncertainties_add_as_squares(sensor):
    one, two = sensor(1), sensor(2)
    name = 'angular_velocity.y'

    def with_mean(result, estimate):
        axis = result.axes[name]
        statistics = dict(axis.statistics) | {'mean': estimate}
        axes = dict(result.axes) | {name: replace(axis, statistics=statistics)}
        return replace(result, axes=axes)

    first = with_mean(one, Estimate(1.0, 0.7, 1.3, 'rad/s'))
    second = with_mean(two, Estimate(1.4, 1.0, 1.8, 'rad/s'))
    line = line_of(compare_runs(runs([first], [second])), name, 'mean')
    assert (line.difference.low, line.difference.high) == pytest.approx((-0.1, 0.9))
    assert line.e_n == pytest.approx(0.4 / 0.5)
    assert line.verdict == 'same'
    assert not line.ratio.observable


@pytest.mark.parametrize(
    ('first', 'second', 'verdict'),
    [
        (Estimate(2.0, 1.5, 2.5, 'm/s²'), None, 'lower'),
        (None, Estimate(2.0, 1.5, 2.5, 'm/s²'), 'higher'),
        (Estimate(1.0, 0.5, 1.5, 'm/s²'), None, 'undecided'),
        (None, None, 'undecided'),
    ],
)
def test_a_value_and_an_upper_bound(sensor, first, second, verdict):
    bound = Estimate.not_observable('m/s²', 'record longer', high=1.0)

    def with_B(seed, estimate):
        result = sensor(seed)
        axis = result.axes['linear_acceleration.x']
        model = replace(axis.model, B=estimate or bound)
        return replace(result, axes={axis.name: replace(axis, model=model)})

    across = compare_runs(runs([with_B(1, first)], [with_B(2, second)]))
    line = line_of(across, 'linear_acceleration.x', 'B')
    assert line.verdict == verdict
    assert not line.ratio.observable


@pytest.mark.slow
def test_sensors_are_matched_by_topic_then_by_name(sensor):
    a, b = '/bench/a/imu/data_raw', '/bench/b/imu/data_raw'
    across = compare_runs(runs([sensor(1, a), sensor(2, b)], [sensor(3, b), sensor(4, '/other')]))
    assert {line.sensor for line in across.lines} == {'b'}
    assert set(across.unmatched) == {('run0', 'a'), ('run1', 'other')}
    assert list(across.sensors['b']) == ['run0', 'run1']


@pytest.mark.slow
def test_one_sensor_each_is_compared_whatever_its_name(sensor):
    across = compare_runs(runs([sensor(1, '/bench/a/imu/x')], [sensor(2, '/bench/b/imu/x')]))
    assert {line.sensor for line in across.lines} == {'a / b'}


def test_three_runs_are_each_held_against_the_first(sensor):
    across = compare_runs(runs([sensor(1)], [sensor(2)], [sensor(3)]))
    assert {line.run for line in across.lines} == {'run1', 'run2'}


@pytest.mark.slow
def test_nothing_to_compare_is_said(sensor):
    with pytest.raises(RecordingError, match='name two or more'):
        compare_runs(runs([sensor(1)]))
    a, b = sensor(1, '/a'), sensor(2, '/b')
    with pytest.raises(RecordingError, match=r'no sensor of run0\.json'):
        compare_runs(runs([a, replace(a, topic='/c')], [b, replace(b, topic='/d')]))


def test_the_json_document_is_strict(sensor):
    across = compare_runs(runs([sensor(1)], [sensor(2)]))
    document = json.loads(json.dumps(across.to_json(), allow_nan=False))
    assert document['schema'] == 'imu_bench.comparison/1'
    assert document['reference'] == 'run0'
    rate = document['lines'][0]
    assert (rate['parameter'], rate['value']['unit']) == ('rate', 'Hz')
    assert len(document['lines']) == 1 + 6 * 5


def test_words(sensor):
    across = compare_runs(runs([sensor(1)], [sensor(2, scale=3.0)]))
    first, chance, second = run_tables.summary(across)
    assert first.startswith('31 numbers compared: ')
    assert chance == 'Chance alone calls about 1 of these higher or lower.'
    assert 'times as large in run1' in second
    units = run_tables.units_of(across.lines)
    row = run_tables.row(line_of(across, 'linear_acceleration.z', 'noise_density'), units)
    assert row['parameter'] == 'noise density'
    assert 'µg/√Hz' in row['reference'].text and '±' in row['reference'].text
    assert (
        row['difference'].text.startswith('+') and row['change'].text == f'× {row["ratio"].text}'
    )
    bias = run_tables.row(line_of(across, 'linear_acceleration.z', 'mean'), units)
    assert bias['change'] == bias['difference']
    small = compare_runs(runs([sensor(1)], [sensor(1)]))
    assert run_tables.summary(small)[0].count('same')


@pytest.mark.parametrize(
    ('hertz', 'shown'), [(100.0 + 1e-12, '0 ppm'), (100.001, '+10 ppm'), (99.9999, '-1 ppm')]
)
def test_the_difference_of_clocks_has_no_more_digits_than_stamps(sensor, hertz, shown):
    line = line_of(compare_runs(runs([sensor(1)], [sensor(1)])), '', 'rate')
    reference = Estimate(100.0, 99.9, 100.1, 'Hz')
    difference = Estimate(hertz - 100.0, hertz - 100.2, hertz - 99.8, 'Hz')
    row = run_tables.row(replace(line, reference=reference, difference=difference), {})
    assert row['difference'].text.replace('.00', '').replace('.0', '') == shown


def test_a_parameter_has_one_unit_in_all_rows(sensor):
    """Axes whose numbers differ by a factor of 10⁵ would each get a unit of their own."""

    def spread(seed):
        found = sensor(seed)
        axes = {}
        for name, axis in found.axes.items():
            size = 1e-9 if name.endswith('x') else 1e-4
            K = Estimate(size, 0.9 * size, 1.1 * size, axis.model.K.unit)
            axes[name] = replace(axis, model=replace(axis.model, K=K))
        return replace(found, axes=axes)

    across = compare_runs(runs([spread(1)], [spread(2)]))
    rows = run_tables.table(across, across.lines[0].sensor, 'run1').rows
    shown = [(row[0].partition('.')[0], row[2].text.split()[-1]) for row in rows
             if row[1] == 'rate random walk K']  # fmt: skip
    assert len(shown) == 6 and len(set(shown)) == 2


def test_findings_are_said_first_at_each_table_and_in_the_document(sensor):
    moved = Finding('severe', 'motion', 'It moved.', 'All of it.', 'Record again.')
    bad = sensor(2)
    bad = replace(bad, health=replace(bad.health, findings=(moved,)))
    across = compare_runs(runs([sensor(1)], [bad]))
    name = across.lines[0].sensor
    first = run_tables.summary(across)[0]
    assert first == (
        f'Not to be trusted without reading the findings: {name} in run1 (severe, motion).'
    )
    note = run_tables.table(across, name, 'run1').note
    assert note == 'Findings that affect these numbers: run1: severe, motion.'
    told = {row['run']: row for row in across.to_json()['health']}
    assert told['run1']['severity'] == 'severe' and told['run0']['severity'] == 'info'
    assert told['run1']['findings'][0]['text'] == 'It moved.'
    assert 'It moved.' in render_runs(across)


def test_a_value_without_noise_is_compared(sensor):
    result = sensor(1)
    axis = result.axes['angular_velocity.x']
    still = {
        name: Estimate(0.0, 0.0, 0.0, 'rad/s') if name == 'std' else estimate
        for name, estimate in axis.statistics.items()
    }
    changed = replace(result, axes={axis.name: replace(axis, statistics=still)})
    across = compare_runs(runs([changed], [changed]))
    assert line_of(across, axis.name, 'std').verdict == 'same'
    assert np.isfinite([e.difference.value for e in across.lines if e.difference.observable]).all()
