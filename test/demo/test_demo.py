# SPDX-License-Identifier: Apache-2.0
"""The demo from end to end, as a user runs it: live nodes, bag, table, report."""

from collections import defaultdict
import json
import os
from pathlib import Path
import re
import signal
import struct
import subprocess
import sys
from xml.etree import ElementTree

from msg_conversions.reading import allan_from_message
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
import yaml

pytestmark = [pytest.mark.ros, pytest.mark.slow]

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


def ended_well(code, output, complaints):
    """
    Check that a demo did what it should, and lost nothing between sensors and bag.

    A machine with too much to do may keep sensors from their rate; it has to say so.
    """
    assert (code == 0) == ('imu-bench: error: ' not in complaints), output + complaints
    assert 'report: ' in output, output + complaints
    assert 'on the way to the recorder' not in output, output + complaints
    assert 'before the recorder heard' not in output, output + complaints


@pytest.fixture(scope='module')
def demo(tmp_path_factory):
    # a short window, so that it has left the start of the recording behind
    bench = yaml.safe_load((BENCHES / 'machine_vibration.yaml').read_text(encoding='utf-8'))
    bench['analysis']['window_s'] = 5.0
    path = tmp_path_factory.mktemp('demo') / 'short_window.yaml'
    path.write_text(yaml.safe_dump(bench), encoding='utf-8')
    folder = path.parent / 'run'
    result = subprocess.run(
        command('demo', path, '--duration', 12, '-o', folder),
        capture_output=True, text=True,
    )  # fmt: skip
    ended_well(result.returncode, result.stdout, result.stderr)
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
    said = result.stdout.replace('\u202f', '')  # between thousands
    for name, nominal in SENSORS.items():
        verdict = next(line for line in said.splitlines() if line.startswith(f'{name}: '))
        health = recordings[name]['health']
        assert health['rate']['value'] == pytest.approx(nominal, rel=0.03)
        lost = re.search(r'(\d+) lost in the sensor', verdict)
        assert ('nothing lost' in verdict or 'no loss counted' in verdict) != bool(lost)
        # the health of the bag counts the same samples
        counts = {each['code']: each['count'] for each in health['findings'] if 'count' in each}
        assert counts == ({'lost_in_sensor': int(lost[1])} if lost else {})


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


def complete_windows(bag):
    """
    Return per sensor the last Allan message of the bag that missed nothing, and all vectors.

    A machine with too much to do lets the analysis miss messages that the recorder got.
    """
    windows, stamps, vectors = defaultdict(list), defaultdict(list), {}
    with AnyReader([bag]) as reader:
        for connection, _, data in reader.messages():
            sensor, _, metric = connection.topic.removeprefix('/bench/').partition('/imu/')
            if metric == 'allan_deviation':
                message = reader.deserialize(data, connection.msgtype)
                windows[sensor].append(allan_from_message(message))
            elif metric == 'data_raw':
                sec, nanosec = struct.unpack_from('<iI', data, 4)
                stamps[sensor].append(sec * 10**9 + nanosec)
            elif metric.startswith(('rms/', 'noise_density/')):
                message = reader.deserialize(data, connection.msgtype)
                stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
                vector = (message.vector.x, message.vector.y, message.vector.z)
                vectors[sensor, metric, stamp] = vector
    complete = {}
    for sensor, each in windows.items():
        recorded = np.array(stamps[sensor])
        for window in each:
            inside = (window.start_ns <= recorded) & (recorded <= window.end_ns)
            pairs = window.curves['linear_acceleration.z']['terms'][0]
            steps = np.diff(recorded[inside])
            # where the sensor itself lost samples, the two sides of the hole are no pair
            if pairs and pairs == np.count_nonzero(steps < 1.5 * np.median(steps)):
                complete[sensor] = window
    return complete, vectors


@pytest.mark.parametrize('sensor', ['mpu9250', 'bno055'])
def test_live_metrics_equal_the_offline_ones_of_the_same_window(demo, tmp_path, sensor):
    folder, _ = demo
    windows, vectors = complete_windows(folder / 'bag')
    live = windows[sensor]
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
        check=True, capture_output=True,
    )  # fmt: skip
    (recording,) = json.loads(output.read_text(encoding='utf-8'))['recordings']
    for name, axis in recording['axes'].items():
        count = len(axis['allan']['tau'])
        for field in ('tau', 'deviation', 'low', 'high'):
            np.testing.assert_allclose(
                axes[name][field][:count], axis['allan'][field], rtol=1e-9, err_msg=name + field
            )
        quantity, _, letter = name.partition('.')
        # the likelihood of the samples, which is asked offline alone, overrules the fit at times
        overruled = any('not from the fit' in flag for flag in axis['model']['flags'])
        for metric in ('rms',) if overruled else ('rms', 'noise_density'):
            value = vectors[sensor, f'{metric}/{quantity}', live.end_ns]['xyz'.index(letter)]
            offline = axis[metric]['value']
            if offline is None:
                assert np.isnan(value), (name, metric)
            else:
                assert value == pytest.approx(offline, rel=1e-9), (name, metric)


def small_bench(path, sensors, **more):
    """Write a bench of some of the package's sensors."""
    entries = [{'file': str(BENCHES.parent / 'sensors' / f'{name}.yaml')} for name in sensors]
    text = yaml.safe_dump({'name': 'small', 'sensors': entries, **more}, allow_unicode=True)
    path.write_text(text, encoding='utf-8')
    return path


@pytest.fixture
def interruptible():
    """Let SIGINT reach children: a shell that starts the tests in the background ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures('interruptible')
def test_interrupt_stops_cleanly_and_still_analyses(tmp_path):
    folder, sensors = tmp_path / 'run', ('mpu9250', 'scl3300')
    bench = small_bench(tmp_path / 'small.yaml', sensors)
    with subprocess.Popen(
        command('demo', bench, '--duration', 600, '-o', folder),
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True, env={**os.environ, 'IMU_BENCH_LINE_EVERY_S': '1'},
    ) as process:  # fmt: skip
        said = []
        for line in process.stderr:
            said.append(line)
            if ' of 0:10:00' in line:  # all sensors are up
                break
        assert process.poll() is None, said
        os.killpg(process.pid, signal.SIGINT)
        output, complaints = process.communicate()
    ended_well(process.returncode, output, complaints)
    # whatever else is said is a fault: of a thread, of ROS 2, or of a process that was killed
    rest = [line for line in complaints.splitlines() if ' of 0:10:00, ' not in line]
    assert rest[0] == 'stopping', complaints
    assert not re.search('Traceback|Exception|did not stop|rcl', complaints), complaints
    assert (folder / 'bag' / 'metadata.yaml').is_file()
    assert (folder / 'report.html').is_file()
    assert len(json.loads((folder / 'results.json').read_text())['recordings']) == len(sensors)
    for log in (folder / 'log').glob('*.log'):
        assert 'Traceback' not in log.read_text(encoding='utf-8'), log


def test_a_test_of_the_bench_runs_live_on_all_sensors_at_once_and_is_analysed(tmp_path):
    tilt = {
        'name': 'tilt',
        'scenarios': ['tilt_steps'],
        'plan': 'inclination',
        'settings': {'step': '0.58139 °', 'dwell': '1 s', 'settle': '0.2 s'},
        'live': {'set': ['tilt_steps.steps=1', 'tilt_steps.dwell=2 s', 'tilt_steps.move=0.5 s']},
    }
    bench = small_bench(tmp_path / 'tilt.yaml', ('scl3300', 'iim42652'), demo='tilt', tests=[tilt])
    folder = tmp_path / 'run'
    result = subprocess.run(
        command('demo', bench, '--duration', 8, '-o', folder),
        capture_output=True, text=True,
    )  # fmt: skip
    ended_well(result.returncode, result.stdout, result.stderr)
    assert 'test tilt: scenario tilt_steps for 7 s; made short with ' in result.stdout
    found = json.loads((folder / 'results.json').read_text(encoding='utf-8'))
    assert found['plan'] == 'inclination'
    (steps, *_) = [table for table in found['tables'] if 'step by step' in table['title']]
    # the same three angles in both, although one came up before the other
    assert len(steps['rows']) == 3
    assert (folder / 'report.html').is_file()
    truth = json.loads((folder / 'truth.json').read_text(encoding='utf-8'))
    assert set(truth['sensors']) == {'scl3300', 'iim42652'}
    assert truth['scenario']['motions'][0]['steps'] == 1


def test_an_unknown_test_is_one_line_with_those_there_are(tmp_path):
    result = subprocess.run(
        command('demo', 'mast_inclination', '--test', 'tolt', '-o', tmp_path / 'run'),
        capture_output=True, text=True,
    )  # fmt: skip
    assert result.returncode == 1
    assert result.stderr == (
        'imu-bench: error: --test tolt: bench mast_inclination has: '
        'static, tilt, tilt_fine, heat\n'
    )
    assert not (tmp_path / 'run').exists()


def test_a_folder_that_is_not_empty_is_left_alone(tmp_path):
    (tmp_path / 'mine.txt').write_text('precious')
    result = subprocess.run(command('demo', '-o', tmp_path), capture_output=True, text=True)
    assert result.returncode == 1
    assert result.stderr.startswith('imu-bench: error:')
    assert 'not empty' in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ['mine.txt']


def test_an_unknown_bench_lists_those_there_are():
    result = subprocess.run(command('demo', 'no_such_bench'), capture_output=True, text=True)
    assert result.returncode == 1
    assert 'machine_vibration.yaml' in result.stderr


LAYOUTS = BENCHES.parent / 'layouts'


@pytest.fixture(scope='module')
def published(demo):
    """Return type and a message of each topic of the demo, and the names of all statuses."""
    found, names = {}, set()
    with AnyReader([demo[0] / 'bag']) as reader:
        for connection, _, blob in reader.messages():
            if connection.topic in found and connection.topic != '/diagnostics':
                continue
            message = reader.deserialize(blob, connection.msgtype)
            found[connection.topic] = connection.msgtype, message
            if connection.topic == '/diagnostics':
                names |= {status.name for status in message.status}
    return found, names


def value(message, path):
    """Return what a path such as 'vector/z' leads to."""
    for name in re.split(r'[./]', path):
        message = getattr(message, name)
    return message


def test_the_layout_of_plotjuggler_shows_what_there_is(published):
    found, _ = published
    layout = ElementTree.parse(LAYOUTS / 'machine_vibration.plotjuggler.xml').getroot()
    curves = [curve.get('name') for curve in layout.iter('curve')]
    assert len(curves) == len(set(curves)) > 20
    for curve in curves:
        (topic,) = [topic for topic in found if curve.startswith(f'{topic}/')]
        assert isinstance(value(found[topic][1], curve.removeprefix(f'{topic}/')), float)
    for split in layout.iter('DockSplitter'):
        assert int(split.get('count')) == len(split) == len(split.get('sizes').split(';'))


def test_the_layout_of_foxglove_shows_what_there_is(published):
    found, _ = published
    text = (LAYOUTS / 'machine_vibration.foxglove.json').read_text(encoding='utf-8')
    layout = json.loads(text)
    panels = layout['configById']
    assert set(panels) == set(re.findall(r'"(\w+!\w+)"', json.dumps(layout['layout'])))
    for name, panel in panels.items():
        if name.startswith('DiagnosticSummary!'):
            assert found[panel['topicToRender']][0] == 'diagnostic_msgs/msg/DiagnosticArray'
        for path in panel.get('paths', ()):
            topic, _, rest = path['value'].partition('.')
            assert isinstance(value(found[topic][1], rest), float)
            assert found[topic][1].header.stamp.sec > 0  # timestampMethod: headerStamp


def test_the_layout_of_rviz_shows_what_there_is(published):
    found, _ = published
    text = (LAYOUTS / 'machine_vibration.rviz').read_text(encoding='utf-8')
    layout = yaml.safe_load(text)['Visualization Manager']
    topics = [each['Topic']['Value'] for each in layout['Displays'] if 'Topic' in each]
    assert len(topics) == 2
    frames = set()
    for topic in topics:
        kind, message = found[topic]
        assert kind == 'sensor_msgs/msg/Imu'
        assert message.orientation_covariance[0] >= 0.0
        frames.add(message.header.frame_id)
    assert layout['Global Options']['Fixed Frame'] in frames
    assert '<<' not in text  # yaml-cpp has no merge keys


def test_the_analyzers_group_everything_that_is_said(published):
    _, names = published
    file = yaml.safe_load((LAYOUTS / 'analyzers.yaml').read_text(encoding='utf-8'))
    groups = [g for g in file['analyzers']['ros__parameters'].values() if isinstance(g, dict)]
    assert {group['type'] for group in groups} == {'diagnostic_aggregator/GenericAnalyzer'}
    for name in names:
        in_it = [g['path'] for g in groups if any(part in name for part in g['contains'])]
        assert len(in_it) == 1, name
