# SPDX-License-Identifier: Apache-2.0
"""`imu-bench analyze` on what people have beside bags and tables with names."""

from __future__ import annotations

from imu_bench.bags.topic_info import describe
from imu_bench.bags.writer import BagWriter
from imu_bench.offline.analysis import results
from msg_conversions import covariance
from msg_conversions.encoding import ImuTemplate
import numpy as np
import pytest
from scipy.io import savemat

START = 1_700_000_000_000_000_000
ACCEL, GYRO = '/camera/accel/sample', '/camera/gyro/sample'
UNITS = 'stamp=ns,linear_acceleration=m/s^2,angular_velocity=rad/s'
N = 2000


def still(seed, n=N):
    rng = np.random.default_rng(seed)
    return rng.normal([0.0, 0.0, 9.80665], 0.02, (n, 3)), rng.normal(0.0, 1e-3, (n, 3))


@pytest.fixture
def analysed(imu_bench, tmp_path, monkeypatch):
    """Return a function that runs the command and returns its recordings, stdout and stderr."""

    monkeypatch.setenv('COLUMNS', '120')

    def run(*arguments, code=0):
        document = tmp_path / 'r.json'
        ended, out, err = imu_bench('analyze', *arguments, '--full', '--json', document)
        assert (ended, err) == (code, '')
        return results.read(document).recordings, out

    return run


def camera(path, storage):
    """Write a bag as a depth camera does: two topics of Imu, half of each message zero."""
    acceleration, rates = still(1)
    template = ImuTemplate(
        'camera',
        acceleration_covariance=covariance.UNKNOWN,
        angular_velocity_covariance=covariance.UNKNOWN,
    )
    with BagWriter(path, storage) as bag:
        for topic in (ACCEL, GYRO):
            bag.add_topic(describe(topic, 'sensor_msgs/msg/Imu'))
        slow = START + 16_000_000 * np.arange(N // 4)
        fast = START + 5_000_000 * np.arange(N)
        for stamp, blob in zip(slow, template.encode_imu(slow, acceleration[::4]), strict=True):
            bag.write(ACCEL, int(stamp), blob)
        for stamp, blob in zip(fast, template.encode_imu(fast, None, rates), strict=True):
            bag.write(GYRO, int(stamp), blob)
    return path


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_the_two_topics_of_a_camera(analysed, tmp_path, storage):
    [recording], out = analysed(camera(tmp_path / 'bag', storage))
    assert recording.topic == f'{ACCEL} + {GYRO}'
    assert len(recording.axes) == 6
    assert 'are one sensor here' in out
    assert '62.5' in out
    assert '200.00' in out
    assert not [f for f in recording.health.findings if f.severity == 'severe']


def sensor_logger(folder):
    """Write files as a phone does: one per sensor, columns x, y, z, stamps in ns."""
    for name, values, period in zip(
        ('Accelerometer', 'Gyroscope'), still(2), (10_000_000, 5_000_000), strict=True
    ):
        stamps = START + period * np.arange(N)
        rows = [
            f'{t},{z:.9f},{y:.9f},{x:.9f}' for t, (x, y, z) in zip(stamps, values, strict=True)
        ]
        (folder / f'{name}.csv').write_text('\n'.join(['time,z,y,x', *rows, '']))
    return folder


def test_one_file_per_sensor(analysed, tmp_path):
    folder = tmp_path / 'phone'
    folder.mkdir()
    [recording], _ = analysed(sensor_logger(folder), '--units', UNITS)
    assert recording.topic == 'Accelerometer + Gyroscope'
    mean = recording.axes['linear_acceleration.z'].statistics['mean'].value
    assert mean == pytest.approx(9.80665, abs=0.01)
    assert recording.health.rate.value == pytest.approx(200.0)


def test_arrays_in_two_files(analysed, tmp_path):
    for name, values in zip(('accel', 'gyro'), still(3), strict=True):
        np.save(tmp_path / f'{name}.npy', values)
    given = ('--rate', '100', '--units', 'SI')
    [recording], _ = analysed(tmp_path / 'accel.npy', tmp_path / 'gyro.npy', *given)
    assert recording.topic == 'accel + gyro'


@pytest.mark.slow
def test_files_are_paired_by_name(analysed, imu_bench, tmp_path):
    header = 'stamp_s,{0}.x,{0}.y,{0}.z'
    files = []
    for name, quantity, values in zip(
        ('left.csv', 'right.csv'), ('linear_acceleration', 'angular_velocity'), still(4),
        strict=True,
    ):  # fmt: skip
        table = np.column_stack([np.arange(N) / 100, values])
        np.savetxt(
            tmp_path / name, table, delimiter=',', header=header.format(quantity), comments=''
        )
        files.append(tmp_path / name)
    assert len(analysed(*files)[0]) == 2
    [recording], _ = analysed(*files, '--pair', 'left.csv', 'right.csv')
    assert recording.topic == 'left + right'
    code, _, err = imu_bench('analyze', *files, '--pair', 'right.csv', 'left.csv')
    assert (code, len(err.splitlines())) == (1, 1)
    assert '--pair: right.csv does not measure linear_acceleration: name the' in err


def test_a_murata_log_in_several_files(analysed, tmp_path):
    xyz = np.array([0.1, -0.2, 0.97]) + still(5)[1]
    others = np.sqrt((xyz**2).sum(axis=1, keepdims=True) - xyz**2)
    angles = np.degrees(np.arctan2(xyz, others))
    time = np.arange(N) / 100
    table = np.column_stack([time, 0 * time, xyz[:, ::-1], angles[:, ::-1], 0 * time])
    folder = tmp_path / 'long time test'
    folder.mkdir()
    for number, part in enumerate(np.split(table, 4), 1):
        np.savetxt(folder / f'log{number}.txt', part, fmt='%.7g', delimiter='\t')
    [recording], out = analysed(folder)
    assert recording.health.samples == N
    assert 'read as a log of Murata MEMS Demo' in ' '.join(out.split())
    assert '4 files that continue each other' in ' '.join(out.split())


@pytest.mark.slow
def test_matlab_and_its_bad_input(analysed, imu_bench, tmp_path):
    acceleration, rates = still(6)
    path = tmp_path / 'log.mat'
    savemat(path, {'time_s': np.arange(N) / 100, 'accel': acceleration, 'gyro': rates})
    code, _, err = imu_bench('analyze', path)
    assert (code, len(err.splitlines())) == (1, 1)
    assert 'the unit of linear_acceleration and angular_velocity is not known: add it' in err
    [recording], _ = analysed(path, '--units', 'linear_acceleration=m/s^2,angular_velocity=rad/s')
    assert len(recording.axes) == 6
