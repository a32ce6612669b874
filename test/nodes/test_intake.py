# SPDX-License-Identifier: Apache-2.0
"""The way in of recorder and analysis: from blocks, from single messages, and what is missing."""

from contextlib import contextmanager
import queue
import threading

from imu_bench.nodes import qos
from imu_bench.nodes.intake import Intake
from msg_conversions import blocks
from msg_conversions.blocks import Part
import numpy as np
import pytest
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu, Temperature
from std_msgs.msg import Float64MultiArray, String, UInt8MultiArray

pytestmark = pytest.mark.ros

IMU = '/bench/a/imu/data_raw'
PATIENCE_S = 300.0
T0 = 1_790_000_000_000_000_000


def rows(first, count, size=324):
    """Return messages that begin with their number."""
    made = np.zeros((count, size), np.uint8)
    made[:, :8] = np.arange(first, first + count)[:, None].view(np.uint8)
    return made


class Listener:
    """An intake that follows topics when asked, and what it has delivered."""

    def __init__(self, ros, *topics, **options):
        self.node = ros.add(Node, f'listener_{len(ros.nodes)}', **options)
        self.got = {}
        self.stamps = {}
        self._todo = queue.SimpleQueue()
        self.intake = Intake(self.node, lambda name: name in topics, self._deliver, self._tend)
        self.node.close = self.intake.close
        self.intake.start()

    def _deliver(self, topic, stamps, messages):
        assert stamps.shape == messages.shape[:1]
        self.got.setdefault(topic, []).extend(row.tobytes() for row in messages)
        self.stamps.setdefault(topic, []).extend(stamps.tolist())

    def _tend(self):
        while not self._todo.empty():
            self._todo.get()()

    def follow(self, topic, message=Imu):
        publishers = self.node.get_publishers_info_by_topic(topic)
        self._todo.put(lambda: self.intake.follow(topic, message, publishers))

    @contextmanager
    def held_up(self):
        """Keep the thread from taking anything."""
        held, free = threading.Event(), threading.Event()
        self._todo.put(lambda: (held.set(), free.wait(PATIENCE_S)))
        assert held.wait(PATIENCE_S)
        yield
        free.set()

    def numbers(self, topic=IMU):
        return [int.from_bytes(blob[:8], 'little') for blob in self.got.get(topic, [])]


class Sensor:
    """Publishes blocks, and has the standard topics that go with them."""

    def __init__(self, ros, namespace='/bench/a', number=77, topics=(('imu/data_raw', Imu),)):
        self.node = ros.add(Node, f'sensor_{len(ros.nodes)}', namespace=namespace)
        self.number = number
        profile = qos.keep_last(1000, 'reliable')
        self.blocks = self.node.create_publisher(UInt8MultiArray, blocks.TOPIC, profile)
        self.plain = {name: self.node.create_publisher(kind, name, 100) for name, kind in topics}

    def publish(self, *parts):
        self.blocks.publish(blocks.encode(self.number, [Part(*part) for part in parts]))


def seen(ros, node, *topics):
    ros.spin_until(lambda: all(node.count_publishers(each) for each in topics), f'{topics} seen')


@pytest.fixture
def sensor(ros):
    return Sensor(ros)


@pytest.fixture
def listener(ros):
    return Listener(ros, IMU, '/bench/a/temperature')


def followed(ros, listener, sensor):
    """Follow the sensor's topic, and wait until its blocks are heard."""
    seen(ros, listener.node, IMU, '/bench/a/_blocks')
    listener.follow(IMU)
    ros.spin_until(sensor.blocks.get_subscription_count, 'the blocks are heard')


def test_where_there_are_blocks_messages_come_from_them(ros, sensor, listener):
    followed(ros, listener, sensor)
    sensor.publish(('imu/data_raw', 0, T0, rows(0, 50)))
    sensor.publish(('imu/data_raw', 50, T0 + 1, rows(50, 1)), ('other', 0, T0, rows(0, 5)))
    ros.spin_until(lambda: len(listener.numbers()) == 51, 'all there')
    assert listener.numbers() == list(range(51))
    assert listener.stamps[IMU] == [T0] * 50 + [T0 + 1]
    assert list(listener.got) == [IMU]
    # nobody pays for single messages
    assert sensor.plain['imu/data_raw'].get_subscription_count() == 0


def test_a_large_block_comes_through(ros, sensor, listener):
    followed(ros, listener, sensor)
    sensor.publish(('imu/data_raw', 0, T0, rows(0, 5000)))
    ros.spin_until(lambda: len(listener.numbers()) == 5000, 'all there')
    assert listener.numbers() == list(range(5000))


def test_what_comes_before_the_graph_shows_its_topic_is_kept(ros, sensor, listener):
    followed(ros, listener, sensor)
    name = '/bench/a/temperature'
    sensor.publish(('temperature', 0, T0, rows(0, 3)), ('not_wanted', 0, T0, rows(0, 3)))
    sensor.publish(('temperature', 3, T0, rows(3, 3)), ('imu/data_raw', 0, T0, rows(0, 1)))
    ros.spin_until(listener.numbers, 'the blocks are there')
    assert listener.numbers(name) == []
    publisher = sensor.node.create_publisher(Temperature, 'temperature', 10)
    seen(ros, listener.node, name)
    listener.follow(name, Temperature)
    ros.spin_until(lambda: listener.numbers(name), 'followed')
    sensor.publish(('temperature', 6, T0, rows(6, 2)))
    ros.spin_until(lambda: len(listener.numbers(name)) == 8, 'all there')
    assert listener.numbers(name) == list(range(8))
    assert listener.intake.sequences[name].missed == 0
    assert publisher.get_subscription_count() == 0
    assert list(listener.got) == [IMU, name]


def test_gaps_restarts_and_second_publishers_are_counted(ros, sensor, listener):
    followed(ros, listener, sensor)
    found = listener.intake.sequences
    sensor.publish(('imu/data_raw', 40, T0, rows(0, 10)))
    sensor.publish(('imu/data_raw', 57, T0, rows(0, 3)))
    ros.spin_until(lambda: len(listener.numbers()) == 13, 'two blocks')
    assert (found[IMU].missed, found[IMU].before, found[IMU].publishers) == (7, 40, 1)
    sensor.number = 78
    sensor.publish(('imu/data_raw', 5, T0, rows(0, 10)))
    sensor.number = 9 << 32  # of another process, while the sensor still speaks
    sensor.publish(('imu/data_raw', 60, T0, rows(0, 10)))
    sensor.number = 78
    sensor.publish(('imu/data_raw', 15, T0, rows(0, 10)))
    ros.spin_until(lambda: len(listener.numbers()) == 33, 'four blocks')
    assert (found[IMU].missed, found[IMU].before, found[IMU].publishers) == (7, 45, 2)
    assert found[IMU].received == 33
    assert listener.intake.foreign == {IMU: 10}
    # a second after its last word one of another process is the sensor, started again
    sensor.number = 8 << 32
    sensor.publish(('imu/data_raw', 0, T0 + 2 * 10**9, rows(0, 5)))
    ros.spin_until(lambda: len(listener.numbers()) == 38, 'five blocks')
    assert listener.intake.foreign == {IMU: 10}


def test_a_damaged_block_is_counted_and_the_next_one_read(ros, sensor, listener, capfd):
    followed(ros, listener, sensor)
    good = blocks.encode(77, [Part('imu/data_raw', 0, T0, rows(0, 2))])
    sensor.blocks.publish(good[:-1] + b'')
    sensor.blocks.publish(serialize_message(String(data='no block at all')))
    sensor.blocks.publish(good)
    ros.spin_until(listener.numbers, 'the good one')
    assert listener.intake.damaged == 2
    assert capfd.readouterr().err.count('/bench/a/_blocks: not a block of messages') == 1


def test_a_stranger_on_the_topic_is_kept_out(ros, sensor, listener):
    # in a process of its own as far as ROS is concerned
    from rclpy.context import Context

    elsewhere = Context()
    elsewhere.init(args=[])
    stranger = Node('stranger', context=elsewhere)
    try:
        publisher = stranger.create_publisher(Imu, IMU, 100)
        ros.spin_until(lambda: listener.node.count_publishers(IMU) == 2, 'both are seen')
        seen(ros, listener.node, '/bench/a/_blocks')
        listener.follow(IMU)
        ros.spin_until(sensor.blocks.get_subscription_count, 'the sensor is heard')
        names = [f'/bench/a/{sensor.node.get_name()}', '/stranger']
        ros.spin_until(lambda: listener.intake.several(IMU, Imu)[0] == names, 'he is named')
        ros.spin_until(publisher.get_subscription_count, 'he is counted')
        for number in range(3):
            publisher.publish(rows(number, 1).tobytes())
        sensor.publish(('imu/data_raw', 0, T0, rows(7, 1)))
        sensor.plain['imu/data_raw'].publish(rows(7, 1).tobytes())
        ros.spin_until(lambda: listener.intake.several(IMU, Imu)[1] == 3, 'his are counted')
        assert listener.numbers() == [7]
    finally:
        stranger.destroy_node()
        elsewhere.try_shutdown()


def test_single_messages_keep_their_order_whatever_their_length(ros):
    listener = Listener(ros, '/text')
    talker = ros.add(Node, 'talker')
    publisher = talker.create_publisher(String, '/text', 1000)
    seen(ros, listener.node, '/text')
    listener.follow('/text', String)
    ros.spin_until(publisher.get_subscription_count, 'subscribed')
    sent = [serialize_message(String(data='x' * (index % 3))) for index in range(100)]
    for blob in sent:
        publisher.publish(blob)
    ros.spin_until(lambda: len(listener.got.get('/text', [])) == 100, 'all there')
    assert listener.got['/text'] == sent
    assert listener.stamps['/text'] == sorted(listener.stamps['/text'])
    sequences = listener.intake.sequences['/text']
    assert (sequences.missed, sequences.before, sequences.publishers) == (0, 0, 1)


def test_single_messages_that_were_overwritten_are_counted(ros):
    listener = Listener(
        ros,
        IMU,
        automatically_declare_parameters_from_overrides=True,
        parameters={f'qos_overrides.{IMU}.subscription.depth': 5},
    )
    talker = ros.add(Node, 'talker')
    publisher = talker.create_publisher(Imu, IMU, qos.keep_last(1000, 'reliable'))
    for index in range(3):  # before anybody listens
        publisher.publish(rows(index, 1).tobytes())
    seen(ros, listener.node, IMU)
    listener.follow(IMU)
    ros.spin_until(publisher.get_subscription_count, 'subscribed')
    publisher.publish(rows(3, 1).tobytes())
    ros.spin_until(lambda: listener.numbers() == [3], 'the first')
    with listener.held_up():
        for index in range(100):
            publisher.publish(rows(4 + index, 1).tobytes())
        assert publisher.wait_for_all_acked()
    ros.spin_until(lambda: len(listener.numbers()) == 6, 'the rest')
    assert listener.numbers() == [3, *range(99, 104)]
    found = listener.intake.sequences[IMU]
    assert (found.missed, found.before, found.publishers) == (95, 3, 1)


def test_nobody_is_called_back_by_an_executor(ros, sensor, listener):
    followed(ros, listener, sensor)
    with listener.held_up():
        sensor.publish(('imu/data_raw', 0, T0, rows(0, 50)))
        assert sensor.blocks.wait_for_all_acked()
        for _ in range(20):
            ros.executor.spin_once(timeout_sec=0.0)
    ros.spin_until(listener.numbers, 'taken by the thread')
    assert listener.numbers() == list(range(50))


def test_what_goes_wrong_in_the_thread_ends_it_and_is_known(ros, sensor, listener, monkeypatch):
    followed(ros, listener, sensor)

    def fail(*_):
        raise RuntimeError('no room')

    monkeypatch.setattr(listener.intake, '_deliver', fail)
    sensor.publish(('imu/data_raw', 0, T0, rows(0, 50)))
    ros.spin_until(listener.intake.ended.done, 'the failure')
    with pytest.raises(RuntimeError, match='no room'):
        listener.intake.ended.result()


def test_publishers_that_differ_are_asked_for_the_least():
    reliable = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
    loose = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    assert qos.requested([reliable, reliable], 5).reliability == ReliabilityPolicy.RELIABLE
    assert qos.requested([reliable, loose], 5).reliability == ReliabilityPolicy.BEST_EFFORT


def test_a_history_holds_so_much_that_its_memory_is_bounded():
    assert qos.depth(Imu) == qos.MOST
    assert qos.depth(Float64MultiArray) * qos.LARGE == qos.MEMORY
