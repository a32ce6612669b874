# SPDX-License-Identifier: Apache-2.0
"""`imu-bench record` as a user runs it: bench or topics, signals, nodes that die, refusals."""

from contextlib import closing, contextmanager
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import threading

from imu_bench.bags import metadata
from imu_bench.offline.recordings.loading import load
from imu_bench.offline.recordings.opening import open_source
import pytest
import rosbags  # noqa: F401, without it nothing is recorded
import yaml

pytestmark = [pytest.mark.ros, pytest.mark.slow]

SENSORS = Path(__file__).resolve().parents[2] / 'config' / 'sensors'


def small_bench(folder, *names, **overrides):
    """Write a bench of some of the package's sensors, with a test."""
    entries = [{'file': str(SENSORS / f'{name}.yaml'), 'overrides': overrides} for name in names]
    static = {'name': 'static', 'scenarios': ['still'], 'duration': '2 s', 'plan': 'static'}
    path = folder / 'small.yaml'
    document = {'name': 'small', 'sensors': entries, 'tests': [static]}
    path.write_text(yaml.safe_dump(document), encoding='utf-8')
    return path


class Recording:
    """A running `imu-bench record`, read line by line."""

    def __init__(self, process):
        self.process = process
        self.said = []

    def until(self, pattern):
        """Read until a line matches."""
        for line in self.process.stderr:
            self.said.append(line)
            if re.search(pattern, line):
                return line
        raise AssertionError(f'{pattern!r} is not in {"".join(self.said)}')

    def end(self):
        """Return exit code, output and complaints."""
        output, rest = self.process.communicate()
        return self.process.returncode, output.replace('\u202f', ''), ''.join(self.said) + rest


@pytest.fixture
def record():
    """Return a context manager that runs the verb."""

    @contextmanager
    def run(*arguments):
        command = [sys.executable, '-m', 'imu_bench.cli.main', 'record', *map(str, arguments)]
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            start_new_session=True, env={**os.environ, 'IMU_BENCH_LINE_EVERY_S': '0.5'},
        ) as process:  # fmt: skip
            try:
                yield Recording(process)
            finally:
                if process.poll() is None:
                    process.terminate()  # it stops its nodes

    return run


def messages(bag):
    """Return the counts of a bag that was finished, by topic."""
    return metadata.read(bag / 'metadata.yaml').counts


def kept(code, output, complaints):
    """
    Whether all kept their rate; a machine with too much to do need not, but has to say so.

    On the way from a sensor to the bag nothing is lost, whatever else the machine does.
    """
    assert (code == 0) == ('imu-bench: error: ' not in complaints), output + complaints
    assert 'on the way' not in output, output
    assert 'before the recorder heard' not in output, output
    return code == 0


def test_the_sensors_of_a_bench_for_a_while(record, tmp_path):
    bag = tmp_path / 'night'
    bench = small_bench(tmp_path, 'mpu9250', 'scl3300')
    with record(bench, '--duration', '2s', '-o', bag) as running:
        code, output, complaints = running.end()
    counts = messages(bag)
    assert counts['/bench/scl3300/inclination'] > 0
    assert counts['/diagnostics'] > 0
    rate = 'kept its rate (' if kept(code, output, complaints) else ''
    for name in ('mpu9250', 'scl3300'):
        stored = counts[f'/bench/{name}/imu/data_raw']
        assert stored > 0
        assert f'\n{name}: {stored} messages, {rate}' in output
    assert 'emulated, these are not measurements: all of them\n' in complaints
    assert f'next: imu-bench analyze {bag} --html {bag}/report.html\n' in output
    # the logs are in the folder of the bag, and nothing is left beside it
    assert {'sensors.log', 'recorder.log'} <= {p.name for p in bag.glob('log/*')}
    assert {path.name for path in tmp_path.iterdir()} == {'small.yaml', 'night'}


def test_ctrl_c_twice_ends_it_once_with_a_bag_that_is_finished(record, tmp_path):
    bag = tmp_path / 'bag'
    # the file of a sensor is a bench of one
    with record(SENSORS / 'scl3300.yaml', '-o', bag, '--storage', 'sqlite3') as running:
        assert 'Ctrl-C ends it' in running.until(r'^\d+:\d\d:\d\d, ')
        running.process.send_signal(signal.SIGINT)
        running.process.send_signal(signal.SIGINT)
        code, output, complaints = running.end()
    kept(code, output, complaints)
    assert messages(bag)['/bench/scl3300/imu/data_raw'] > 0
    assert not re.search('Traceback|did not stop|rcl', complaints), complaints
    assert (bag / 'bag_0.db3').is_file()


def child(process, module):
    """Return the process id of a child that runs a module."""
    found = subprocess.run(
        ['pgrep', '-P', str(process.pid), '-f', module],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return int(found.stdout)


def test_sensors_that_die_are_started_again_and_that_is_a_fault(record, tmp_path):
    bag = tmp_path / 'bag'
    bench = small_bench(tmp_path, 'mpu9250', 'scl3300')
    with record(bench, '-o', bag) as running:
        running.until(
            r'^(?!0:00:0[0-2])\d+:\d\d:\d\d, '
        )  # its first life has more to tell than the second has
        os.kill(child(running.process, 'imu_bench.nodes.bench_node'), signal.SIGKILL)
        line = running.until('WARNING: sensors')
        assert 'sensors ended with exit code -9: ' in line
        assert line.endswith('; started again (1 of 5)\n')
        log = bag / 'log' / 'sensors.log'
        while log.read_text(encoding='utf-8').count('SCL3300') < 2:
            running.until('mpu9250 ')  # it says so twice a second
        for _ in range(6):
            running.until('mpu9250 ')
        running.process.terminate()
        code, output, complaints = running.end()
    assert code == 1
    assert 'sensors ended by itself and was started again 1 time' in complaints
    assert 'on the way' not in output
    with closing(open_source(bag)) as source:
        recording = load(source, '/bench/mpu9250/imu/data_raw')
    assert recording.delivery.restarts == 1
    assert recording.delivery.missing == 0


def test_a_recorder_that_dies_ends_it_with_what_there_is(record, tmp_path):
    bag = tmp_path / 'bag'
    with record(SENSORS / 'scl3300.yaml', '-o', bag) as running:
        running.until(r'^(?!0:00:0[01])\d+:\d\d:\d\d, ')
        os.kill(child(running.process, 'imu_bench.nodes.recorder_node'), signal.SIGKILL)
        code, output, complaints = running.end()
    assert code == 1
    assert 'recorder ended with exit code -9' in complaints
    assert 'the bag was not finished, analyze reads it as it is' in complaints
    assert 'on the way' not in output  # what came afterwards is in no bag, and nobody says so
    with closing(open_source(bag)) as source:
        assert len(load(source, '/bench/scl3300/imu/data_raw')) > 0


def test_a_run_goes_into_the_folder_where_its_campaign_looks(record, tmp_path):
    bench = small_bench(tmp_path, 'scl3300')
    with record(bench, '--into', tmp_path / 'campaign', '--test', 'static') as running:
        code, output, complaints = running.end()
    kept(code, output, complaints)
    following = re.search('next: imu-bench (.*)\n', output).group(1).split()
    assert following[:2] == ['campaign', str(bench)]
    assert messages(tmp_path / 'campaign/static/still')['/bench/scl3300/imu/data_raw'] > 0
    command = [sys.executable, '-m', 'imu_bench.cli.main', *following, '--jobs', '1']
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert (tmp_path / 'campaign/static/report.html').is_file()


def test_who_changes_his_mind_before_it_begins_finds_nothing(record, tmp_path):
    # a sensor that does not answer keeps it from beginning
    bench = small_bench(tmp_path, 'scl3300', **{'simulation.faults': ['unplugged 0 600']})
    with record(bench, '-o', tmp_path / 'bag') as running:
        running.until('scl3300 -/')
        running.process.terminate()
        code, _, complaints = running.end()
    assert (code, complaints.splitlines()[-1]) == (130, 'imu-bench: stopped')
    assert [path.name for path in tmp_path.iterdir()] == ['small.yaml']


def test_a_job_in_the_background_can_be_interrupted_from_its_beginning(tmp_path):
    bench = small_bench(tmp_path, 'scl3300')
    command = [sys.executable, '-m', 'imu_bench.cli.main', 'record', bench, '-o', tmp_path / 'bag']
    with subprocess.Popen(
        list(map(str, command)), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),  # as a shell does
    ) as process:  # fmt: skip
        try:
            while 'recording into' not in process.stdout.readline():
                assert process.poll() is None
            process.send_signal(signal.SIGINT)
            _, complaints = process.communicate()
        finally:
            process.terminate()
    assert (process.returncode, complaints.splitlines()[-1]) == (130, 'imu-bench: stopped')
    assert not (tmp_path / 'bag').exists()


def test_a_sensor_that_is_not_there_is_one_line_and_no_bag(record, tmp_path):
    bench = small_bench(tmp_path, 'scl3300', backend='hardware', bus='spidev9.9')
    with record(bench, '-o', tmp_path / 'bag', '--duration', '1h') as running:
        code, _, complaints = running.end()
    assert code == 1
    (line,) = [line for line in complaints.splitlines() if not line.startswith('starting')]
    assert 'error: sensors ended with exit code 1: ' in line
    assert '/dev/spidev9.9: there is no such device' in line
    assert line.endswith(f'(its log: {tmp_path}/bag.log/sensors.log)')
    assert (tmp_path / 'bag.log/sensors.log').is_file()
    assert not (tmp_path / 'bag').exists()


@pytest.fixture
def vendor():
    """Publish an Imu topic and a magnetic field at 100 Hz, as any driver may."""
    from rclpy.context import Context
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node
    from rclpy.task import Future
    from sensor_msgs.msg import Imu, MagneticField
    from std_msgs.msg import String

    context = Context()
    context.init(args=[])
    node = Node('vendor', context=context)
    topics = [('/camera/imu', Imu), ('/camera/field', MagneticField), ('/chatter', String)]
    publishers = [(node.create_publisher(kind, name, 100), kind) for name, kind in topics]

    def publish():
        for publisher, kind in publishers:
            publisher.publish(kind())

    node.create_timer(0.01, publish)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    over = Future()
    thread = threading.Thread(target=executor.spin_until_future_complete, args=(over, 60.0))
    thread.start()
    yield
    over.set_result(None)
    executor.wake()
    thread.join()
    executor.shutdown()
    node.destroy_node()
    context.try_shutdown()


def test_what_others_publish_is_recorded_without_a_bench(record, vendor, tmp_path):
    bag = tmp_path / 'bag'
    with record('-o', bag, '--duration', '2s') as running:
        code, output, complaints = running.end()
    kept(code, output, complaints)
    counts = messages(bag)
    assert set(counts) == {'/camera/imu', '/camera/field'}
    assert counts['/camera/imu'] > 0
    assert f'\n/camera/imu: {counts["/camera/imu"]} messages, ' in output
    assert 'topics: /camera/imu\n' in complaints


def test_one_topic_alone(record, vendor, tmp_path):
    with record('-o', tmp_path / 'a', '--duration', '1s', '--topic', 'camera/field') as running:
        code, output, complaints = running.end()
    kept(code, output, complaints)
    assert set(messages(tmp_path / 'a')) == {'/camera/field'}
