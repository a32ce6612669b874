# SPDX-License-Identifier: Apache-2.0
"""The recorder as a process: signals, kill -9, a full disk."""

import resource
import signal
import subprocess
import sys
import threading
import time

from diagnostic_msgs.msg import DiagnosticArray
from imu_bench.nodes import qos
from imu_bench.offline import recordings
from msg_conversions import blocks, covariance
from msg_conversions.encoding import ImuTemplate
import numpy as np
import pytest
from rclpy.node import Node
import rosbags  # noqa: F401, without it nothing is recorded
from sensor_msgs.msg import Imu
from std_msgs.msg import UInt8MultiArray

pytestmark = pytest.mark.ros

RECORDER = 'imu_bench.nodes.recorder_node'
TOPIC = '/bench/a/imu/data_raw'


class Talker:
    """Publishes numbered messages and reads what the recorder says of itself."""

    def __init__(self, ros):
        self._ros = ros
        self._node = ros.add(Node, 'talker')
        self._publisher = None
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._listen, 10)
        self.said: dict[str, str] = {}

    def _listen(self, message):
        for status in message.status:
            if status.name == 'recorder: recording':
                self.said = {pair.key: pair.value for pair in status.values}

    def publish(self, first, last):
        """Publish when somebody listens, a few at a time."""
        if self._publisher is None:
            # as many as a test publishes: none is overwritten before it is acknowledged
            self._publisher = self._node.create_publisher(Imu, TOPIC, 4000)
        self._ros.spin_until(self._publisher.get_subscription_count, 'the recorder subscribes')
        message = Imu()
        for index in range(first, last):
            message.header.stamp.sec = 1 + index
            message.linear_acceleration.x = float(index)
            self._publisher.publish(message)
            if index % 100 == 99:
                self._ros.executor.spin_once(timeout_sec=0.01)

    def wait_until_stored(self, count):
        """Wait until the recorder says that so many messages are in the bag."""
        key = f'stored.{TOPIC}'
        self._ros.spin_until(lambda: int(self.said.get(key, '0')) >= count, f'{count} stored')


@pytest.fixture
def talker(ros):
    return Talker(ros)


class Stream:
    """Publishes numbered messages at 1 kHz from a thread, in blocks or one by one."""

    RATE_HZ = 1000
    BLOCK = 50

    def __init__(self, talker, in_blocks):
        self._plain = talker.create_publisher(Imu, TOPIC, qos.keep_last(20_000, 'reliable'))
        self._blocks = None
        if in_blocks:
            self._blocks = talker.create_publisher(UInt8MultiArray, '/bench/a/_blocks', 2048)
        self._template = ImuTemplate('imu', acceleration_covariance=covariance.UNKNOWN)
        self.sent = 0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    @property
    def heard(self):
        return (self._blocks or self._plain).get_subscription_count()

    def start(self):
        self._thread.start()

    def stop(self):
        self._over.set()
        self._thread.join()

    def _run(self):
        began = time.monotonic()
        while not self._over.wait(self.BLOCK / self.RATE_HZ):
            due = int((time.monotonic() - began) * self.RATE_HZ)
            numbers = np.arange(self.sent, due)
            values = np.stack([numbers] * 3, axis=1)
            rows = self._template.imu_rows(numbers + 10**9, values)
            if self._blocks is not None:
                part = blocks.Part('imu/data_raw', self.sent, time.time_ns(), rows)
                self._blocks.publish(blocks.encode(9, [part]))
            else:
                for row in rows:
                    self._plain.publish(row.tobytes())
            self.sent = due


def busy(start_time_s=60):
    """Return a process that takes all of a core that it gets, and ends by itself."""
    program = (
        f'import time\nend = time.monotonic() + {start_time_s}\nwhile time.monotonic() < end: pass'
    )
    return subprocess.Popen([sys.executable, '-c', program])


@pytest.fixture
def load():
    """Four busy processes."""
    running = [busy() for _ in range(4)]
    yield running
    for each in running:
        each.kill()
        each.wait()


def read(path):
    with recordings.open_source(path) as source:
        recording = recordings.load(source, TOPIC)
        return recording.samples.acceleration[:, 0].tolist(), source.problems


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_signal_ends_it_with_everything_in_the_bag(start, talker, tmp_path, number, storage):
    bag = tmp_path / 'bag'
    recorder = start(RECORDER, '--ros-args', '-p', f'output:={bag}', '-p', f'storage:={storage}')
    talker.publish(0, 1000)
    talker.wait_until_stored(1000)
    recorder.process.send_signal(number)
    recorder.process.send_signal(number)
    code, output = recorder.finish()
    assert code == 0, output
    assert 'messages on' in output
    assert 'Traceback' not in output
    assert read(bag) == ([float(index) for index in range(1000)], [])
    assert (bag / 'metadata.yaml').is_file()


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_killed_recorder_leaves_everything_that_was_on_disk(start, talker, tmp_path, storage):
    bag = tmp_path / 'bag'
    recorder = start(RECORDER, '--ros-args', '-p', f'output:={bag}', '-p', f'storage:={storage}')
    talker.publish(0, 1000)
    talker.wait_until_stored(1000)
    talker.publish(1000, 1500)
    recorder.process.kill()
    recorder.finish()
    values, problems = read(bag)
    assert values[:1000] == [float(index) for index in range(1000)]
    assert values == sorted(values)
    assert any('no metadata.yaml' in problem for problem in problems)


@pytest.mark.slow
def test_a_full_disk_ends_it_with_what_it_has(start, talker, tmp_path):
    bag = tmp_path / 'bag'
    recorder = start(RECORDER, '--ros-args', '-p', f'output:={bag}', '-p', 'storage:=sqlite3')
    recorder.wait_for('recording into')
    # python ignores SIGXFSZ, so that a write beyond the limit fails as one to a full disk does
    resource.prlimit(recorder.process.pid, resource.RLIMIT_FSIZE, (400_000, 400_000))
    talker.publish(0, 500)
    talker.wait_until_stored(500)
    talker.publish(500, 4000)
    code, output = recorder.finish()
    assert code == 1, output
    assert 'recording ended' in output
    assert 'Traceback' not in output
    values, _ = read(bag)
    assert values == [float(index) for index in range(len(values))]
    assert len(values) >= 500


def test_a_bag_that_exists_ends_it_with_one_clear_line(start, tmp_path):
    (tmp_path / 'bag').mkdir()
    code, output = start(RECORDER, '--ros-args', '-p', f'output:={tmp_path / "bag"}').finish()
    assert code == 1
    assert output.count('\n') == 1, output
    assert 'exists already; a bag is never overwritten, choose another name' in output


@pytest.mark.slow
@pytest.mark.parametrize('away_s', [3.0, 10.0])
def test_a_recorder_that_was_stopped_for_a_while_has_everything_afterwards(
    ros, start, tmp_path, away_s
):
    talker = Talker(ros)
    stream = Stream(ros.add(Node, 'stream'), in_blocks=True)
    recorder = start(RECORDER, '--ros-args', '-p', f'output:={tmp_path / "bag"}')
    ros.spin_until(lambda: stream.heard, 'the recorder subscribes')
    stream.start()
    ros.spin_until(lambda: stream.sent > 1000, 'the first second')
    recorder.process.send_signal(signal.SIGSTOP)
    until = stream.sent + away_s * stream.RATE_HZ
    ros.spin_until(lambda: stream.sent > until, 'it was away')
    recorder.process.send_signal(signal.SIGCONT)
    stream.stop()
    talker.wait_until_stored(stream.sent)
    recorder.process.send_signal(signal.SIGINT)
    code, output = recorder.finish()
    assert code == 0, output
    assert read(tmp_path / 'bag') == ([float(index) for index in range(stream.sent)], [])


@pytest.mark.slow
def test_single_messages_of_others_are_all_taken_beside_busy_programs(ros, start, tmp_path, load):
    talker = Talker(ros)
    stream = Stream(ros.add(Node, 'stream'), in_blocks=False)
    recorder = start(RECORDER, '--ros-args', '-p', f'output:={tmp_path / "bag"}')
    ros.spin_until(lambda: stream.heard, 'the recorder subscribes')
    stream.start()
    ros.spin_until(lambda: stream.sent > 5000, 'five seconds')
    stream.stop()
    talker.wait_until_stored(stream.sent)
    assert talker.said[f'missed.{TOPIC}'] == '0'
    recorder.process.send_signal(signal.SIGINT)
    code, output = recorder.finish()
    assert code == 0, output
    assert read(tmp_path / 'bag') == ([float(index) for index in range(stream.sent)], [])


@pytest.mark.slow
def test_single_messages_that_a_stopped_recorder_did_not_get_are_counted(ros, start, tmp_path):
    talker = Talker(ros)
    stream = Stream(ros.add(Node, 'stream'), in_blocks=False)
    recorder = start(
        RECORDER, '--ros-args', '-p', f'output:={tmp_path / "bag"}',
        '-p', f'qos_overrides.{TOPIC}.subscription.depth:=100',
        '-p', f'qos_overrides.{TOPIC}.subscription.reliability:=best_effort',
    )  # fmt: skip
    ros.spin_until(lambda: stream.heard, 'the recorder subscribes')
    stream.start()
    ros.spin_until(lambda: talker.said.get(f'stored.{TOPIC}', '0') != '0', 'something is stored')
    recorder.process.send_signal(signal.SIGSTOP)
    until = stream.sent + 3000
    ros.spin_until(lambda: stream.sent > until, 'it was away')
    recorder.process.send_signal(signal.SIGCONT)
    until = stream.sent + 1000
    ros.spin_until(lambda: stream.sent > until, 'it is back')
    stream.stop()

    def accounted():
        names = (f'{each}.{TOPIC}' for each in ('stored', 'missed', 'first_sequence'))
        return sum(int(talker.said.get(name, '0')) for name in names) == stream.sent

    ros.spin_until(accounted, 'every message is accounted for')
    recorder.process.send_signal(signal.SIGINT)
    code, output = recorder.finish()
    assert code == 0, output
    values, _ = read(tmp_path / 'bag')
    assert len(values) == int(talker.said[f'stored.{TOPIC}'])
    missed, before = (int(talker.said[f'{name}.{TOPIC}']) for name in ('missed', 'first_sequence'))
    # what was sent before a slow recorder took its first message is told apart
    assert stream.sent - len(values) == missed + before
    assert missed > 2000
