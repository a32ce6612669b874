# SPDX-License-Identifier: Apache-2.0
"""The recorder as a process: signals, kill -9, a full disk."""

import resource
import signal

from diagnostic_msgs.msg import DiagnosticArray
from imu_bench.offline.recordings import load, open_source
import pytest
from rclpy.node import Node
from sensor_msgs.msg import Imu

pytestmark = pytest.mark.ros

RECORDER = 'imu_bench.nodes.recorder_node'
TOPIC = '/bench/a/imu/data_raw'


class Talker:
    """Publishes numbered messages and reads what the recorder says of itself."""

    def __init__(self, ros):
        self._ros = ros
        self._node = ros.add(Node, 'talker')
        self._publisher = self._node.create_publisher(Imu, TOPIC, 1000)
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._listen, 10)
        self.said: dict[str, str] = {}

    def _listen(self, message):
        for status in message.status:
            if status.name == 'recorder: recording':
                self.said = {pair.key: pair.value for pair in status.values}

    def publish(self, first, last):
        """Publish when somebody listens, a few at a time."""
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


def read(path):
    with open_source(path) as source:
        recording = load(source, TOPIC)
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
