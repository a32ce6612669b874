# SPDX-License-Identifier: Apache-2.0
"""Every real text recording there is, against its reference values."""

from __future__ import annotations

import json
import math

from imu_bench.errors import RecordingError
from imu_bench.offline.recordings import load, open_source, ReadOptions
import numpy as np
import pytest

pytestmark = pytest.mark.data

G = 9.80665
DEGREE = math.pi / 180
COUNTS = 'linear_acceleration=g/16384,angular_velocity=deg/s/131'


def read(path, **options):
    with open_source(path, ReadOptions(**options)) as source:
        recording = load(source, source.select()[0])
        return recording, source.problems


@pytest.mark.parametrize(
    ('file', 'reference'),
    [
        ('calibration data/example_data_tinit_calc.csv', 'reference_static_449s_raw.json'),
        ('results test data/imu_static_test.csv', 'reference_static_test_100s_raw.json'),
    ],
)
def test_mpu6050_counts(shared_data, file, reference):
    folder = shared_data / 'mpu6050_static'
    expected = json.loads((folder / reference).read_text())
    recording, problems = read(folder / file, rate_hz=100, units=COUNTS)
    assert (problems, recording.notes) == ([], ())
    assert len(recording) == expected['rows']
    samples = recording.samples
    assert np.diff(samples.stamps).tolist() == [10_000_000] * (len(recording) - 1)
    scaled = np.hstack([samples.acceleration / G * 16384, samples.angular_velocity / DEGREE * 131])
    for column, name in zip(scaled.T, ('ax', 'ay', 'az', 'gx', 'gy', 'gz'), strict=True):
        channel = expected['channels'][name]
        assert column.mean() == pytest.approx(channel['mean'], rel=1e-12)
        assert column.std(ddof=1) == pytest.approx(channel['std_ddof1'], rel=1e-12)
        assert column.min() == pytest.approx(channel['min'], rel=1e-12)
        assert column.max() == pytest.approx(channel['max'], rel=1e-12)


def test_mpu6050_says_what_is_missing(shared_data):
    path = shared_data / 'mpu6050_static/calibration data/example_data_tinit_calc.csv'
    with pytest.raises(RecordingError) as caught:
        open_source(path)
    assert str(caught.value) == (
        f'{path}: the unit of linear_acceleration and angular_velocity is not known: add it, '
        'for example --units linear_acceleration=g/16384,angular_velocity=deg/s/131; '
        'there is no time column: give the sample rate with --rate 100 (a line before the table '
        'mentions 100 Hz), or name the column with --columns; '
        'the columns are ax, ay, az, gx, gy, gz'
    )
    with pytest.raises(RecordingError, match=r'--rate 100 \(a line before the table mentions'):
        open_source(path, ReadOptions(units=COUNTS))


def test_mpu6050_rotation(shared_data):
    folder = shared_data / 'mpu6050_static'
    expected = json.loads((folder / 'reference_90deg_x_rotation.json').read_text())
    recording, _ = read(folder / expected['dataset'], rate_hz=100, units=COUNTS)
    assert len(recording) == expected['rows']
    first, last = expected['motion_rows']
    bias = recording.samples.angular_velocity[:first].mean(axis=0)
    turned = (recording.samples.angular_velocity[first:last] - bias).sum(axis=0) * 0.01 / DEGREE
    assert abs(turned[0]) == pytest.approx(92.9, abs=6)  # the reference uses a calibrated scale


def test_mpu9150_five_units(shared_data):
    folder = shared_data / 'mpu9150_five_units'
    reference = json.loads((folder / 'reference.json').read_text())['imus']
    for name, expected in reference.items():
        recording, problems = read(
            folder / f'{name}.log', rate_hz=100, columns='ax,ay,az,wx,wy,wz', units='SI'
        )
        assert (recording.topic, problems) == (name, [])
        assert len(recording) == expected['rows']
        norm = np.linalg.norm(recording.samples.acceleration, axis=1)
        still = _still(recording.samples.angular_velocity)
        bias = np.median(recording.samples.angular_velocity[still], axis=0) / DEGREE
        np.testing.assert_allclose(bias, expected['gyro_bias_median_static_dps'], atol=0.05)
        assert norm.mean() == pytest.approx(expected['acc_norm_mean'], rel=0.02)


def _still(angular_velocity):
    windows = angular_velocity[: len(angular_velocity) // 50 * 50].reshape(-1, 50, 3)
    quiet = windows.std(axis=1).max(axis=1) < 0.01
    return np.repeat(quiet, 50).nonzero()[0]


def test_mpu9150_says_that_columns_have_no_names(shared_data):
    with pytest.raises(RecordingError, match='the file has 6 columns without names; name them'):
        open_source(shared_data / 'mpu9150_five_units/imu0.log')


def test_elevator_axis_that_was_published(shared_data):
    folder = shared_data / 'elevator_phone'
    expected = json.loads((folder / 'reference.json').read_text())
    recording, problems = read(
        folder / 'data/skyscrapper_up.csv',
        columns='AccX=-,AccY=-',
        units='relative_time=ms,linear_acceleration=m/s^2',
    )
    assert len(recording) == expected['rows']
    stamps = recording.samples.stamps * 1e-9
    rate = (len(recording) - 1) / (stamps[-1] - stamps[0])
    assert rate == pytest.approx(expected['rate_hz_mean'], rel=1e-12)
    assert np.diff(stamps).min() == pytest.approx(expected['dt_min'])
    assert np.diff(stamps).max() == pytest.approx(expected['dt_max'])
    up = recording.samples.acceleration[200:1700, 2]
    assert up.mean() == pytest.approx(expected['recomputed']['g'], rel=1e-4)
    joined = '2169 rows were joined into 1837 samples'
    assert problems == [f'skyscrapper_up.csv: the columns are filled in different rows: {joined}']


def test_elevator_rows_are_joined_into_samples_of_three_axes(shared_data):
    recording, _ = read(
        shared_data / 'elevator_phone/data/skyscrapper_up.csv',
        units='stamp=ms,linear_acceleration=m/s^2',
    )
    assert (recording.stored, recording.left_out) == (1837, 11)
    assert recording.samples.acceleration[0].tolist() == [
        -0.6635284423828125,
        4.20245361328125,
        11.274765014648438,
    ]


def test_ferraris_session(shared_data):
    folder = shared_data / 'ferraris_session'
    expected = json.loads((folder / 'reference.json').read_text())
    recording, problems = read(
        folder / 'example_ferraris_session.csv',
        rate_hz=102.4,
        units='linear_acceleration=m/s^2,angular_velocity=deg/s',
    )
    assert (len(recording), problems) == (expected['rows'], [])
    for section in expected['sections'].values():
        part = recording.samples[section['start'] : section['end']]
        np.testing.assert_allclose(
            part.angular_velocity.mean(axis=0) / DEGREE, section['gyr_mean_dps'], rtol=1e-10
        )
        np.testing.assert_allclose(part.acceleration.mean(axis=0), section['acc_mean'], rtol=1e-10)


def test_a_text_column_beside_the_numbers_does_no_harm(shared_data):
    recording, problems = read(
        shared_data / 'ferraris_session/annotated_session.csv',
        rate_hz=102.4,
        units='linear_acceleration=g/2048,angular_velocity=deg/s/16.4',
    )
    assert len(recording) == 9414
    assert problems == []
    assert recording.samples.acceleration[0, 0] == -2052 / 2048 * G


def test_a_single_column_is_no_imu(shared_data):
    for file in sorted((shared_data / 'nbs14').glob('*.csv')):
        with pytest.raises(RecordingError, match=r'no column with an accel|not a recording'):
            open_source(file)
