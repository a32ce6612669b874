# SPDX-License-Identifier: Apache-2.0
"""Sensors against each other and against their datasheets."""

from dataclasses import replace

from imu_bench import drivers
from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.analysis.recording import analyse
from imu_bench.offline.comparing.sensors import compare, labels, ratio
import pytest


@pytest.fixture(scope='module')
def two(recording_of, noise):
    loud = noise(1, n=20_000, acceleration=4e-3)
    quiet = noise(2, n=20_000)
    return [
        analyse(recording_of(loud, topic='/bench/loud/imu/data_raw')),
        analyse(recording_of(quiet, topic='/bench/quiet/imu/data_raw')),
    ]


@pytest.mark.slow
def test_the_quietest_comes_first(two):
    standing = compare(two).standings['linear_acceleration']
    assert [row.label for row in standing] == ['quiet', 'loud']
    assert standing[0].ratio.value == 1.0
    assert standing[1].ratio.low <= 2.0 <= standing[1].ratio.high


def test_a_reference_by_name(two):
    standing = compare(two, 'loud').standings['linear_acceleration']
    assert standing[1].ratio.value == 1.0
    assert standing[0].ratio.low <= 0.5 <= standing[0].ratio.high


@pytest.mark.parametrize(
    ('sources', 'expected'),
    [
        ([('a.mcap', '/bench/mpu/imu/data_raw')], ['mpu']),
        ([('a.bag', '/imu/data'), ('b.bag', '/imu/data')], ['a imu/data', 'b imu/data']),
        ([('d/imu0.log', 'imu0.log'), ('d/imu1.log', 'imu1.log')], ['imu0', 'imu1']),
        ([('d/x.csv', 'x.csv'), ('e/x.csv', 'x.csv')], ['x (1)', 'x (2)']),
    ],
)
def test_labels_are_short_and_unique(two, sources, expected):
    named = [replace(two[0], source=source, topic=topic) for source, topic in sources]
    assert labels(named) == expected


def test_the_driver_named_in_the_topic_gives_the_datasheet(two):
    sheet = drivers.load('mpu9250').typical['acceleration']
    axes = {}
    for axis in two[0].of('linear_acceleration'):
        value = 3e-4 if axis.letter == 'x' else 1.0
        density = Estimate(value, 0.9 * value, 1.1 * value, 'm/s²/√Hz')
        axes[axis.name] = replace(axis, noise_density=density)
    measured = replace(two[0], topic='/bench/mpu9250/imu/data_raw', axes=axes)
    lines = [v for v in compare([measured]).verdicts if v.parameter == 'noise density']
    assert [v.verdict for v in lines] == ['better', 'worse', 'worse']
    assert lines[0].source == sheet.source


def test_json_has_ranking_and_verdicts(two):
    document = compare(two).to_json()
    assert [row['label'] for row in document['ranking']['angular_velocity']]
    assert document['datasheet'] == []


def test_a_sensor_that_blocks_slow_signals_is_ranked_by_its_plateau(two):
    bound = Estimate.not_observable('m/s²/√Hz', 'no white noise', high=1e-6)
    plateau = Estimate(3e-3, 2.9e-3, 3.1e-3, 'm/s²/√Hz')
    axes = {
        axis.name: replace(axis, noise_density=bound, noise_density_methods={'plateau': plateau})
        for axis in two[0].of('linear_acceleration')
    }
    blocked = replace(two[0], topic='/bench/mpu9250/imu/data_raw', axes=axes)
    compared = compare([blocked])
    [standing] = compared.standings['linear_acceleration']
    assert standing.noise_density.value == pytest.approx(3e-3)
    # 306 µg/√Hz against 300 of the datasheet, and not "better" for a bound of 0.1
    assert {v.verdict for v in compared.verdicts} == {'as specified'}


def test_the_ratio_to_nothing_is_not_observable():
    one = Estimate(1.0, 0.9, 1.1, 'm/s²')
    found = ratio(one, Estimate(0.0, 0.0, 0.0, 'm/s²'))
    assert not found.observable
    assert found.reason == 'one of the two is zero'
