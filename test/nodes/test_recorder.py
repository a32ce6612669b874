# SPDX-License-Identifier: Apache-2.0
"""The recorder: which topics, which bytes, which quality of service; health; refusals."""

import threading
import time

from geometry_msgs.msg import Vector3Stamped
from imu_bench.errors import ConfigError, RecordingError
from imu_bench.nodes.recorder import message_class, RecorderNode
from imu_bench.offline.recordings import load, open_source
from msg_conversions import blocks
import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import Reader
from sensor_msgs.msg import Imu, Temperature
from std_msgs.msg import Float64MultiArray, String, UInt8MultiArray

pytestmark = pytest.mark.ros


@pytest.fixture
def talker(ros):
    """Return a node to publish with."""
    from rclpy.node import Node

    return ros.add(Node, 'talker')


@pytest.fixture
def record(ros, tmp_path):
    """Return a maker of recorders into tmp_path/bag."""

    def make(**parameters):
        settings = {'output': str(tmp_path / 'bag'), **parameters}
        return ros.add(RecorderNode, parameters=settings)

    return make


def stored(path) -> dict[str, list[bytes]]:
    found: dict[str, list[bytes]] = {}
    with Reader(path) as bag:
        for connection, _, data in bag.messages():
            found.setdefault(connection.topic, []).append(bytes(data))
    return found


def imu(x: float) -> Imu:
    message = Imu()
    message.header.frame_id = 'imu_link_ab'  # no padding behind it: its bytes would be undefined
    message.header.stamp.sec = 1
    message.linear_acceleration.x = x
    return message


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_the_bytes_of_the_wire_are_in_the_bag(ros, talker, record, storage):
    publisher = talker.create_publisher(Imu, '/bench/a/imu/data_raw', 100)
    node = record(storage=storage)
    ros.spin_until(publisher.get_subscription_count, 'the recorder subscribes')
    sent = [imu(float(index)) for index in range(50)]
    for message in sent:
        publisher.publish(message)
    ros.spin_until(lambda: node.received['/bench/a/imu/data_raw'] == 50, 'all received')
    node.close()
    assert stored(node.path)['/bench/a/imu/data_raw'] == [serialize_message(m) for m in sent]
    with open_source(node.path) as source:
        recording = load(source, '/bench/a/imu/data_raw')
        assert source.problems == []
    assert recording.samples.acceleration[:, 0].tolist() == list(range(50))


def test_the_topics_of_the_bench_are_recorded_in_every_namespace(ros, talker, record):
    wanted = {
        '/bench/a/imu/data_raw': Imu,
        '/bench/b/imu/data_raw': Imu,
        '/elsewhere/c/temperature': Temperature,
        '/bench/a/inclination': Vector3Stamped,
        '/bench/a/imu/allan_deviation': Float64MultiArray,
    }
    others = {'/chatter': String, '/bench/a/imu/other': Imu, '/bench/not_imu/data_raw': Imu}
    publishers = {
        name: talker.create_publisher(kind, name, 10)
        for name, kind in {**wanted, **others}.items()
    }
    record()
    ros.spin_until(
        lambda: all(publishers[name].get_subscription_count() for name in wanted), 'subscribed'
    )
    assert not any(publishers[name].get_subscription_count() for name in others)


def test_topics_can_be_chosen(ros, talker, record):
    chosen = talker.create_publisher(String, '/chatter', 10)
    other = talker.create_publisher(Imu, '/bench/a/imu/data_raw', 10)
    record(topics=['chatter'])
    ros.spin_until(chosen.get_subscription_count, 'subscribed')
    assert other.get_subscription_count() == 0


def test_everything_can_be_recorded(ros, talker, record):
    publishers = [
        talker.create_publisher(String, '/chatter', 10),
        talker.create_publisher(Imu, '/bench/a/imu/data_raw', 10),
    ]
    record(all_topics=True)
    ros.spin_until(lambda: all(p.get_subscription_count() for p in publishers), 'subscribed')


def test_a_topic_that_comes_later_is_recorded(ros, talker, record):
    node = record()
    ros.spin_until(lambda: '/diagnostics' in node._known, 'the first look')
    publisher = talker.create_publisher(Imu, '/bench/late/imu/data_raw', 10)
    ros.spin_until(publisher.get_subscription_count, 'subscribed')
    publisher.publish(imu(1.0))
    ros.spin_until(lambda: node.received['/bench/late/imu/data_raw'], 'received')


def test_the_quality_of_service_follows_the_publisher_and_is_noted(ros, talker, record):
    latched = QoSProfile(
        depth=5,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )
    loose = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    first = talker.create_publisher(Imu, '/bench/latched/imu/data_raw', latched)
    first.publish(imu(3.0))  # before anybody listens
    talker.create_publisher(Imu, '/bench/loose/imu/data_raw', loose)
    node = record()
    ros.spin_until(lambda: node.received['/bench/latched/imu/data_raw'] == 1, 'the old message')
    ros.spin_until(lambda: '/bench/loose/imu/data_raw' in node._known, 'the other topic')
    node.close()
    with Reader(node.path) as bag:
        noted = {c.topic: c for c in bag.connections}
    qos = noted['/bench/latched/imu/data_raw'].ext.offered_qos_profiles[0]
    assert (qos.reliability.name, qos.durability.name) == ('RELIABLE', 'TRANSIENT_LOCAL')
    qos = noted['/bench/loose/imu/data_raw'].ext.offered_qos_profiles[0]
    assert (qos.reliability.name, qos.durability.name) == ('BEST_EFFORT', 'VOLATILE')
    # the hash that ROS announces is the one computed from the definition
    assert {connection.digest for name, connection in noted.items() if 'imu' in name} == {
        'RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b'
    }


def test_health_counts_what_is_in_the_bag(ros, talker, record):
    publisher = talker.create_publisher(Imu, '/bench/a/imu/data_raw', 100)
    node = record()
    ros.spin_until(publisher.get_subscription_count, 'subscribed')
    for index in range(20):
        publisher.publish(imu(float(index)))

    def status():
        (found,) = node._statuses()
        values = {pair.key: pair.value for pair in found.values}
        return found if values.get('stored./bench/a/imu/data_raw') == '20' else None

    found = ros.spin_until(status, 'everything is on disk')
    assert found.name == 'recorder: recording'
    assert found.level == b'\0'
    assert found.message.startswith('recording ')
    values = {pair.key: pair.value for pair in found.values}
    assert (values['dropped'], values['spilled'], values['waiting']) == ('0', '0', '0')
    assert values['missed./bench/a/imu/data_raw'] == '0'


class BlockSensor:
    """A sensor as the bench has them: blocks beside standard topics."""

    def __init__(self, talker, namespace='/bench/a'):
        self.number = 5
        self.plain = {
            name: talker.create_publisher(kind, f'{namespace}/{name}', 7)
            for name, kind in (('imu/data_raw', Imu), ('temperature', Temperature))
        }
        self.blocks = talker.create_publisher(UInt8MultiArray, f'{namespace}/_blocks', 1000)

    def publish(self, sequence, messages, topic='imu/data_raw', published_ns=1):
        rows = np.frombuffer(b''.join(messages), np.uint8).reshape(len(messages), -1)
        part = blocks.Part(topic, sequence, published_ns, rows)
        self.blocks.publish(blocks.encode(self.number, [part]))


def status_of(node):
    (found,) = node._statuses()
    return found, {pair.key: pair.value for pair in found.values}


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('which', [{}, {'all_topics': True}])
def test_what_comes_in_blocks_is_stored_as_the_messages_it_holds(
    ros, talker, record, storage, which
):
    sensor = BlockSensor(talker)
    node = record(storage=storage, **which)
    ros.spin_until(sensor.blocks.get_subscription_count, 'the recorder subscribes')
    sent = [serialize_message(imu(float(index))) for index in range(100)]
    sensor.publish(0, sent[:60], published_ns=1_000)
    sensor.publish(60, sent[60:], published_ns=2_000)
    warm = serialize_message(Temperature(temperature=20.0))
    sensor.publish(0, [warm], 'temperature', published_ns=1_500)
    ros.spin_until(lambda: node.received.total() >= 101, 'all received')
    assert not any(each.get_subscription_count() for each in sensor.plain.values())
    node.close()
    with Reader(node.path) as bag:
        found = [(c.topic, stamp, bytes(data)) for c, stamp, data in bag.messages()]
        noted = {c.topic: c for c in bag.connections}
    name = '/bench/a/imu/data_raw'
    assert [data for topic, _, data in found if topic == name] == sent
    assert [stamp for topic, stamp, _ in found if topic == name] == [1_000] * 60 + [2_000] * 40
    assert [each for each in found if each[0] == '/bench/a/temperature'] == [
        ('/bench/a/temperature', 1_500, warm)
    ]
    # described as the topic that it is, not as blocks
    assert noted[name].msgtype == 'sensor_msgs/msg/Imu'
    assert noted[name].ext.offered_qos_profiles[0].reliability.name == 'RELIABLE'
    assert noted[name].digest.startswith('RIHS01_7d9a00ff')
    assert not any('_blocks' in topic for topic in noted)


def test_of_blocks_only_what_is_chosen_is_stored(ros, talker, record):
    sensor = BlockSensor(talker)
    node = record(topics=['/bench/a/temperature', '/bench/a/_blocks'])
    ros.spin_until(sensor.blocks.get_subscription_count, 'the recorder subscribes')
    sensor.publish(0, [serialize_message(imu(1.0))])
    sensor.publish(0, [serialize_message(Temperature())], 'temperature')
    ros.spin_until(lambda: node.received['/bench/a/temperature'], 'received')
    node.close()
    assert list(stored(node.path)) == ['/bench/a/temperature']


def test_what_never_came_is_counted_and_named(ros, talker, record):
    sensor = BlockSensor(talker)
    node = record()
    ros.spin_until(sensor.blocks.get_subscription_count, 'the recorder subscribes')
    blob = serialize_message(imu(1.0))
    sensor.publish(30, [blob] * 10)
    sensor.publish(43, [blob] * 10)
    name = '/bench/a/imu/data_raw'
    ros.spin_until(lambda: node.received[name] == 20, 'received')
    found, values = status_of(node)
    assert found.level == b'\2'
    assert found.message == f'3 messages missed: {name}'
    assert values[f'missed.{name}'] == '3'
    assert values[f'first_sequence.{name}'] == '30'
    assert values[f'publishers.{name}'] == '1'
    assert values['received'] == '20'


def test_a_sensor_that_was_started_again_lost_nothing_on_the_way(ros, talker, record):
    sensor = BlockSensor(talker)
    node = record()
    ros.spin_until(sensor.blocks.get_subscription_count, 'the recorder subscribes')
    blob = serialize_message(imu(1.0))
    sensor.publish(0, [blob] * 10)
    sensor.number = 6
    sensor.publish(0, [blob] * 10)
    name = '/bench/a/imu/data_raw'
    ros.spin_until(lambda: node.received[name] == 20, 'received')
    found, values = status_of(node)
    assert found.level == b'\0'
    assert values[f'missed.{name}'] == '0'
    assert values[f'publishers.{name}'] == '2'


def test_damaged_blocks_are_said(ros, talker, record):
    sensor = BlockSensor(talker)
    node = record()
    ros.spin_until(sensor.blocks.get_subscription_count, 'the recorder subscribes')
    sensor.blocks.publish(UInt8MultiArray(data=[1, 2, 3]))
    ros.spin_until(lambda: status_of(node)[0].level == b'\2', 'noticed')
    assert status_of(node)[0].message == '1 blocks of messages damaged'


def test_what_is_on_its_way_when_it_is_closed_is_stored(ros, talker, record, monkeypatch):
    # a machine with much else to do keeps the talking thread waiting
    monkeypatch.setattr('imu_bench.nodes.intake.QUIET_S', 2.0)
    monkeypatch.setattr('imu_bench.nodes.intake.LINGER_S', 60.0)
    sensor = BlockSensor(talker)
    node = record()
    ros.spin_until(sensor.blocks.get_subscription_count, 'the recorder subscribes')
    blob = serialize_message(imu(1.0))

    def last_words():
        for index in range(20):
            sensor.publish(10 * index, [blob] * 10)
            time.sleep(0.02)

    talking = threading.Thread(target=last_words)
    talking.start()
    node.close()
    talking.join()
    assert len(stored(node.path)['/bench/a/imu/data_raw']) == 200


def test_a_disk_that_is_full_ends_the_recording(ros, talker, record, monkeypatch):
    publisher = talker.create_publisher(Imu, '/bench/a/imu/data_raw', 100)
    node = record()

    def fail(*_message):
        raise RecordingError('bag: the disk is full; recording ended, 7 messages are kept')

    monkeypatch.setattr(node._writer._bag, 'write_many', fail)
    ros.spin_until(publisher.get_subscription_count, 'subscribed')
    publisher.publish(imu(1.0))
    ros.spin_until(node.ended.done, 'the failure is noticed')
    with pytest.raises(RecordingError, match='the disk is full; recording ended'):
        node.ended.result()
    (status,) = node._statuses()
    assert status.level == b'\2'
    assert 'the disk is full' in status.message


def test_a_bag_that_exists_is_not_touched(record, tmp_path):
    (tmp_path / 'bag').mkdir()
    with pytest.raises(RecordingError, match='exists already; a bag is never overwritten'):
        record()


@pytest.mark.parametrize(
    ('parameters', 'message'),
    [
        ({'storage': 'leveldb'}, 'storage: leveldb is not allowed'),
        ({'topic': ['/imu']}, 'topic'),
        ({'max_bytes': -1}, 'max_bytes: -1 is not allowed'),
    ],
)
def test_wrong_parameters_are_refused(record, parameters, message):
    with pytest.raises(ConfigError, match=message):
        record(**parameters)


def test_types_that_are_not_installed_are_known_as_such():
    assert message_class('sensor_msgs/msg/Imu') is Imu
    assert message_class('sensor_msgs/msg/NotThere') is None
    assert message_class('not_there_msgs/msg/Own') is None
