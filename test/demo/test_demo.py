# SPDX-License-Identifier: Apache-2.0
"""The demo from end to end, as a user runs it: live nodes, bag, table, report."""

import json
import os
from pathlib import Path
import signal
import subprocess
import sys

from msg_conversions.reading import allan_from_message
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
import yaml

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.timeout(240)]

BENCHES = Path(__file__).resolve().parents[2] / 'config' / 'benches'

SENSORS = {
    'mti300': 400.0,
    'mpu9250': 1000.0,
    'lsm9ds1': 952.0,
    'bno055': 100.0,
    'lsm303dlhc': 1344.0,
    'mtn1100': 1003.92,
}
# one-sided accelerometer noise density of the emulated sensors, µg/√Hz, mean of the axes:
# config/sensors/*.yaml, typical values of drivers/mpu9250.py
DENSITY = {'mti300': 60.0, 'mpu9250': 300.0, 'bno055': 160.0, 'mtn1100': 29.0}


def command(*arguments):
    return [sys.executable, '-m', 'imu_bench.cli.main', *map(str, arguments)]


@pytest.fixture(scope='module')
def demo(tmp_path_factory):
    # a short window, so that it has left the start of the recording behind
    bench = yaml.safe_load((BENCHES / 'machine_vibration.yaml').read_text(encoding='utf-8'))
    bench['analysis']['window_s'] = 5.0
    for sensor in bench['sensors']:
        sensor['file'] = str((BENCHES / sensor['file']).resolve())
    path = tmp_path_factory.mktemp('demo') / 'short_window.yaml'
    path.write_text(yaml.safe_dump(bench), encoding='utf-8')
    folder = path.parent / 'run'
    result = subprocess.run(
        command('demo', path, '--duration', 12, '-o', folder),
        capture_output=True, text=True, timeout=200,
    )  # fmt: skip
    assert result.returncode == 0, result.stdout + result.stderr
    return folder, result


@pytest.fixture(scope='module')
def recordings(demo):
    document = json.loads((demo[0] / 'results.json').read_text(encoding='utf-8'))
    assert document['schema'] == 'imu_bench.analysis/1'
    return {entry['topic'].split('/')[2]: entry for entry in document['recordings']}


def test_every_sensor_is_in_the_table_and_the_report(demo, recordings):
    folder, result = demo
    assert set(recordings) == set(SENSORS)
    report = (folder / 'report.html').read_text(encoding='utf-8')
    assert f'report: {folder / "report.html"}' in result.stdout
    for name in SENSORS:
        assert name in result.stdout
        assert name in report


def test_each_sensor_kept_its_rate_or_is_reported(demo, recordings):
    _, result = demo
    for name, nominal in SENSORS.items():
        verdict = next(line for line in result.stdout.splitlines() if line.startswith(f'{name}: '))
        health = recordings[name]['health']
        assert health['rate']['value'] == pytest.approx(nominal, rel=0.03)
        assert ('nothing lost' in verdict) != ('did NOT keep' in verdict)
        if health['missing']:
            assert (
                'did NOT keep' in verdict
                or f'{health["missing"]} samples missing' in result.stdout
            )


def test_noise_that_went_in_comes_out(recordings):
    for name, density in DENSITY.items():
        axes = recordings[name]['axes']
        found = [
            axis['noise_density']['value'] / (9.80665e-6)
            for key, axis in axes.items()
            if key.startswith('linear')
        ]
        assert np.mean(found) == pytest.approx(density, rel=0.06), name
    assert 'angular_velocity.x' not in recordings['mtn1100']['axes']
    assert set(recordings['mtn1100']['axes']) == {'linear_acceleration.z'}


def last_windows(bag):
    """Return per sensor the last Allan message of the bag and the RMS vectors that go with it."""
    curves, vectors = {}, {}
    with AnyReader([bag]) as reader:
        for connection, _, data in reader.messages():
            sensor, _, metric = connection.topic.removeprefix('/bench/').partition('/imu/')
            if metric == 'allan_deviation':
                curves[sensor] = allan_from_message(reader.deserialize(data, connection.msgtype))
            elif metric.startswith(('rms/', 'noise_density/')):
                message = reader.deserialize(data, connection.msgtype)
                stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
                vector = (message.vector.x, message.vector.y, message.vector.z)
                vectors[sensor, metric, stamp] = vector
    return curves, vectors


@pytest.mark.parametrize('sensor', ['mpu9250', 'bno055'])
def test_live_metrics_equal_the_offline_ones_of_the_same_window(demo, tmp_path, sensor):
    folder, _ = demo
    curves, vectors = last_windows(folder / 'bag')
    live = curves[sensor]
    axes = live.curves
    taus = axes['linear_acceleration.x']['tau']
    taus = taus[np.isfinite(taus)]
    output = tmp_path / 'window.json'
    subprocess.run(
        command(
            'analyze', folder / 'bag', '--topic', f'/bench/{sensor}/imu/data_raw',
            '--window', f'{live.start_ns}:{live.end_ns}',
            '--tau', ','.join(repr(float(tau)) for tau in taus), '--json', output,
        ),
        check=True, capture_output=True, timeout=100,
    )  # fmt: skip
    (recording,) = json.loads(output.read_text(encoding='utf-8'))['recordings']
    for name, axis in recording['axes'].items():
        count = len(axis['allan']['tau'])
        for field in ('tau', 'deviation', 'low', 'high'):
            np.testing.assert_allclose(
                axes[name][field][:count], axis['allan'][field], rtol=1e-9, err_msg=name + field
            )
        quantity, _, letter = name.partition('.')
        for metric in ('rms', 'noise_density'):
            value = vectors[sensor, f'{metric}/{quantity}', live.end_ns]['xyz'.index(letter)]
            offline = axis[metric]['value']
            if offline is None:
                assert np.isnan(value), (name, metric)
            else:
                assert value == pytest.approx(offline, rel=1e-9), (name, metric)


def test_interrupt_stops_cleanly_and_still_analyses(tmp_path):
    folder = tmp_path / 'run'
    with subprocess.Popen(
        command('demo', '--duration', 600, '-o', folder),
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True, env={**os.environ, 'IMU_BENCH_LINE_EVERY_S': '1'},
    ) as process:  # fmt: skip
        for line in process.stderr:
            if ' of 600 s' in line and 'mtn1100 100' in line:
                break
        os.killpg(process.pid, signal.SIGINT)
        output, complaints = process.communicate(timeout=150)
    assert process.returncode == 0, output + complaints
    assert (folder / 'bag' / 'metadata.yaml').is_file()
    assert (folder / 'report.html').is_file()
    assert len(json.loads((folder / 'results.json').read_text())['recordings']) == len(SENSORS)
    for log in (folder / 'log').glob('*.log'):
        assert 'Traceback' not in log.read_text(encoding='utf-8'), log


def test_a_folder_that_is_not_empty_is_left_alone(tmp_path):
    (tmp_path / 'mine.txt').write_text('precious')
    result = subprocess.run(
        command('demo', '-o', tmp_path), capture_output=True, text=True, timeout=60
    )
    assert result.returncode == 1
    assert result.stderr.startswith('imu-bench: error:')
    assert 'not empty' in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ['mine.txt']


def test_an_unknown_bench_lists_those_there_are():
    result = subprocess.run(
        command('demo', 'no_such_bench'), capture_output=True, text=True, timeout=60
    )
    assert result.returncode == 1
    assert 'machine_vibration.yaml' in result.stderr
