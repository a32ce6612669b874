# SPDX-License-Identifier: Apache-2.0
"""Accelerometer and gyroscope in two streams: measured apart, shown as one sensor."""

from __future__ import annotations

from dataclasses import replace
import json

from imu_bench.errors import RecordingError
from imu_bench.offline.analysis.pairing import halves, joined
from imu_bench.offline.analysis.recording import analyse
from imu_bench.offline.analysis.results import RecordingResult
from imu_bench.offline.analysis.settings import Settings
from imu_bench.offline.comparing.sensors import labels
from imu_bench.offline.notation import rate_text
import numpy as np
import pytest

ACCEL, GYRO = '/camera/accel/sample', '/camera/gyro/sample'


@pytest.fixture(scope='module')
def streams(recording_of, noise):
    """Return two recordings as a camera makes them: each message has zeros for the other half."""
    first, second = noise(1, n=3000, rate=63.0), noise(2, n=9000, rate=200.0)
    zeros = np.zeros_like
    return (
        recording_of(replace(first, angular_velocity=zeros(first.acceleration)), topic=ACCEL),
        recording_of(replace(second, acceleration=zeros(second.acceleration)), topic=GYRO),
    )


def measured(recordings):
    return [analyse(recording, Settings()) for recording in halves(recordings)]


@pytest.mark.slow
def test_two_topics_are_one_sensor_and_it_is_said(streams):
    [one] = joined(measured(streams))
    assert one.topic == f'{ACCEL} + {GYRO}'
    assert len(one.axes) == 6
    for name, rate in (('linear_acceleration.x', 63), ('angular_velocity.x', 200)):
        assert one.axes[name].allan.tau[0] == pytest.approx(1 / rate, rel=1e-6)
    assert one.rate_of('linear_acceleration').value == pytest.approx(63, rel=1e-3)
    assert one.rate_of('angular_velocity').value == pytest.approx(200, rel=1e-3)
    again = RecordingResult.from_json(json.loads(json.dumps(one.to_json())))
    assert again.rates == one.rates
    [told] = [f for f in one.health.findings if f.code == 'paired']
    first, second = (result.health.rate for result in measured(streams))
    expected = (
        f'{ACCEL} ({rate_text(first)}) and {GYRO} ({rate_text(second)}) are one sensor here.'
    )
    assert told.text == expected
    zero = [f.text for f in one.health.findings if 'is zero: it comes from' in f.text]
    assert len(zero) == 2
    assert not [f for f in one.health.findings if f.code == 'constant']


@pytest.mark.slow
def test_measuring_apart_changes_no_number(streams):
    [one] = joined(measured(streams))
    apart = measured(streams)
    for result in apart:
        for name, axis in result.axes.items():
            assert one.axes[name].to_json() == axis.to_json()


def test_zeros_are_left_in_where_nobody_has_the_other_half(streams):
    accelerometer, _ = streams
    [alone] = halves([accelerometer])
    assert alone.samples.angular_velocity is not None
    other = replace(accelerometer, topic=GYRO)  # zero on both: a broken gyroscope
    assert all(r.samples.angular_velocity is not None for r in halves([accelerometer, other]))


def test_topics_that_both_measure_everything_stay_two(recording_of, noise):
    both = [recording_of(noise(n=3000), topic=name) for name in (ACCEL, GYRO)]
    assert len(joined(measured(both))) == 2


@pytest.mark.parametrize('topic', ['/vaccum', '/gyroid/gyr', '/imu'])
def test_names_that_are_no_pair(streams, topic):
    accelerometer, gyroscope = (
        replace(recording, topic=name)
        for recording, name in zip(streams, ('/vaccum', topic), strict=True)
    )
    assert len(joined(measured([accelerometer, gyroscope]))) == 2


def without(recording, **changes):
    return replace(recording, samples=replace(recording.samples, **changes))


@pytest.fixture
def files(streams):
    """Return both halves as two files of one folder."""
    accelerometer = without(streams[0], angular_velocity=None)
    gyroscope = without(streams[1], acceleration=None)
    return [
        replace(accelerometer, source='log/Accelerometer.csv', topic='Accelerometer'),
        replace(gyroscope, source='log/Gyroscope.csv', topic='Gyroscope'),
    ]


def test_two_files_of_one_folder_are_one_sensor(files):
    [one] = joined(measured(files))
    assert one.topic == 'Accelerometer + Gyroscope'
    assert labels([one]) == ['Accelerometer + Gyroscope'], 'not named after one of the two'


def test_files_of_two_folders_are_not_paired_unless_named(files):
    apart = measured([files[0], replace(files[1], source='other/Gyroscope.csv')])
    assert len(joined(apart)) == 2
    assert len(joined(apart, [('Accelerometer.csv', 'Gyroscope.csv')])) == 1


def test_named_pairs(files):
    one, two = (replace(f, topic=name) for f, name in zip(files, ('/a', '/b'), strict=True))
    results = measured([one, two])
    assert len(joined(results)) == 2
    assert [result.topic for result in joined(results, [('a', '/b')])] == ['/a + /b']
    with pytest.raises(RecordingError, match="no stream is called '/c'; there are /a, /b"):
        joined(results, [('/a', '/c')])
    with pytest.raises(RecordingError, match='/b does not measure linear_acceleration: name the'):
        joined(results, [('/b', '/a')])


def test_an_ambiguous_name_is_refused(files):
    results = measured([files[0], replace(files[0], source='elsewhere/x.csv'), files[1]])
    with pytest.raises(RecordingError, match="several streams are called 'Accelerometer'"):
        joined(results, [('Accelerometer', 'Gyroscope')])


@pytest.mark.slow
def test_a_stream_is_half_of_one_pair_only(recording_of, noise):
    results = measured([recording_of(noise(n=3000), topic=name) for name in ('/a', '/b')])
    for pairs in ([('/a', '/a')], [('/a', '/b'), ('/b', '/a')]):
        with pytest.raises(RecordingError, match='a stream can be half of one pair only'):
            joined(results, pairs)
