# SPDX-License-Identifier: Apache-2.0
"""The recorder: which topics, which bytes, which quality of service; health; refusals."""

from geometry_msgs.msg import Vector3Stamped
from imu_bench.errors import ConfigError, RecordingError
from imu_bench.nodes.recorder import message_class, RecorderNode, requested_qos
from imu_bench.offline.recordings import load, open_source
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import Reader
from sensor_msgs.msg import Imu, Temperature
from std_msgs.msg import Float64MultiArray, String

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
    ros.spin_until(lambda: '/diagnostics' in node._recorded, 'the first look')
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
    ros.spin_until(lambda: '/bench/loose/imu/data_raw' in node._recorded, 'the other topic')
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


def test_publishers_that_differ_are_asked_for_the_least():
    reliable = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
    loose = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    assert requested_qos([reliable, reliable]).reliability == ReliabilityPolicy.RELIABLE
    assert requested_qos([reliable, loose]).reliability == ReliabilityPolicy.BEST_EFFORT


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
    assert {pair.key: pair.value for pair in found.values}['dropped'] == '0'


def test_a_disk_that_is_full_ends_the_recording(ros, talker, record, monkeypatch):
    publisher = talker.create_publisher(Imu, '/bench/a/imu/data_raw', 100)
    node = record()

    def fail(*_message):
        raise RecordingError('bag: the disk is full; recording ended, 7 messages are kept')

    monkeypatch.setattr(node._writer._bag, 'write', fail)
    ros.spin_until(publisher.get_subscription_count, 'subscribed')
    publisher.publish(imu(1.0))
    with pytest.raises(RecordingError, match='the disk is full; recording ended'):
        ros.spin_until(lambda: False, 'the failure is noticed')
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
