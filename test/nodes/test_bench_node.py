# SPDX-License-Identifier: Apache-2.0
"""Sensors that are recorded start when the recorder listens: nothing comes before it has heard."""

from imu_bench.nodes import bench_node
import pytest

pytestmark = pytest.mark.ros


class Node:
    """Is heard from the n-th look on."""

    def __init__(self, looks):
        self.looks = looks

    @property
    def heard(self):
        self.looks -= 1
        return self.looks <= 0


def test_they_wait_for_the_last_one_that_is_heard(monkeypatch):
    monkeypatch.setattr(bench_node, 'LOOK_S', 0.0)
    nodes = [Node(1), Node(7), Node(3)]
    bench_node._wait_for_recorder(nodes)
    assert all(node.looks <= 0 for node in nodes)


def test_without_a_recorder_they_start_all_the_same(monkeypatch):
    monkeypatch.setattr(bench_node, 'HEARD_S', 0.1)
    deaf = Node(10**9)
    bench_node._wait_for_recorder([deaf])
    assert deaf.looks < 10**9


def test_a_recorder_counts_and_an_analysis_does_not(ros):
    from imu_bench.bench import load_bench
    from imu_bench.config.location import config_file
    from imu_bench.nodes.sensor_topics import SensorTopics
    from msg_conversions import blocks
    from rclpy.node import Node as RosNode
    from std_msgs.msg import UInt8MultiArray

    node = ros.add(RosNode, 'sensor_node', namespace='/bench/left')
    sensor = load_bench(config_file('benches/machine_vibration.yaml')).sensors[0]
    topics = SensorTopics(node, sensor, 100.0, node.get_clock())
    topic = f'/bench/left/{blocks.TOPIC}'
    listeners = [ros.add(RosNode, name) for name in ('analysis', 'recorder')]
    analysis, recorder = listeners
    analysis.create_subscription(UInt8MultiArray, topic, lambda _: None, 10)
    ros.spin_until(lambda: node.count_subscribers(topic) == 1, 'the analysis')
    assert not topics.heard
    recorder.create_subscription(UInt8MultiArray, topic, lambda _: None, 10)
    ros.spin_until(lambda: topics.heard, 'the recorder')
    topics.close()


def test_a_bench_in_a_namespace_is_recorded_and_analysed_there(ros, start, tmp_path):
    from imu_bench.nodes.analysis import AnalysisNode
    from imu_bench.nodes.recorder import RecorderNode
    import rosbags  # noqa: F401, without it the recorder ends

    file = tmp_path / 'left.yaml'
    file.write_text(
        '/**:\n  ros__parameters: {driver: generic, backend: emulated, rate_hz: 200.0, '
        'simulation: {acceleration: {noise_density: 60 µg/√Hz}}}\n',
        encoding='utf-8',
    )
    space, topic = '/robot1/bench/left', '/robot1/bench/left/imu/data_raw'
    output = {'output': str(tmp_path / 'bag')}
    recorder = ros.add(RecorderNode, parameters=output | {'sensors': [space]})
    analysis = ros.add(AnalysisNode, parameters={'topics': ['/robot1/*'], 'window_s': 5.0})
    process = start(
        'imu_bench.nodes.bench_node', '--recorded', f'left={file}',
        '--ros-args', '-r', '__ns:=/robot1',
    )  # fmt: skip
    ros.spin_until(lambda: recorder.received[topic] > 200, 'a second of samples in the bag')
    ros.spin_until(lambda: topic in analysis.watches and analysis.watches[topic].result)
    process.process.terminate()
    code, output = process.finish()
    assert code == 0, output
