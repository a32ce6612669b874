# SPDX-License-Identifier: Apache-2.0
"""Sensors that compute an orientation, as nodes: imu/data beside imu/data_raw."""

from imu_bench.nodes.sensor import SensorNode
import numpy as np
import pytest
from rclpy.node import Node
from sensor_msgs.msg import Imu, MagneticField, Temperature

pytestmark = pytest.mark.ros

TOPICS = {
    'imu/data_raw': Imu,
    'imu/data': Imu,
    'imu/mag': MagneticField,
    'temperature': Temperature,
}
LEVEL = {
    'backend': 'emulated',
    'orientation_stddev': 0.01,
    'simulation.acceleration.bias': '0 mg',
    'simulation.magnetic_field.bias': '0 µT',
}


def stamp(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


@pytest.fixture
def listen(ros):
    """Return what starts a sensor and returns the messages it publishes, by topic."""

    def heard(count, *topics, **parameters):
        listener = ros.add(Node, 'listener')
        received = {topic: [] for topic in TOPICS}
        for topic, kind in TOPICS.items():
            listener.create_subscription(
                kind, f'/bench/left/{topic}', received[topic].append, 10_000
            )
        ros.add(SensorNode, 'left', parameters=LEVEL | parameters)
        awaited = [received[topic] for topic in ('imu/data_raw', *topics)]
        ros.spin_until(lambda: min(map(len, awaited)) >= count, f'{count} messages')
        return received

    return heard


@pytest.mark.slow
@pytest.mark.parametrize(
    ('driver', 'bus', 'rate'),
    [('mti300', '', 400.0), ('bno055', 'i2c', 100.0), ('bno055', 'serial', 100.0)],
)
def test_the_orientation_is_published_beside_what_is_measured(listen, ros, driver, bus, rate):
    received = listen(round(2.5 * rate), 'imu/data', driver=driver, bus=bus)
    ros.spin_until(lambda: received['imu/mag'] and received['temperature'], 'field, temperature')
    raw = {stamp(message): message for message in received['imu/data_raw']}
    # either topic may be heard of first, and be ahead of the other
    first, last = min(raw), max(raw)
    data = [message for message in received['imu/data'] if first <= stamp(message) <= last]
    assert len(data) > 50
    assert {stamp(message) for message in data} <= set(raw)
    assert all(message.orientation_covariance[0] == -1.0 for message in raw.values())
    for message in data[-50:]:
        twin = raw[stamp(message)]
        assert message.linear_acceleration == twin.linear_acceleration
        assert message.angular_velocity == twin.angular_velocity
        assert message.orientation_covariance[0] == pytest.approx(1e-4)
    q = data[-1].orientation
    x, y, z, w = quaternion = np.array([q.x, q.y, q.z, q.w])
    assert np.linalg.norm(quaternion) == pytest.approx(1.0, abs=1e-3)
    # level: up is up
    assert 1 - 2 * (x * x + y * y) == pytest.approx(1.0, abs=2e-3)
    assert abs(z) > 0.1
    assert abs(w) > 0.1
    stamps = np.array(sorted(raw))[-round(rate) :]
    # a machine that is too busy takes less from a chip that keeps no samples, never more
    assert np.median(np.diff(stamps)) > 0.98e9 / rate
    assert received['temperature'][-1].temperature == pytest.approx(25.0, abs=1.0)
    assert data[-1].header.frame_id == 'left_link'


@pytest.mark.slow
@pytest.mark.parametrize(
    'parameters',
    [
        {'driver': 'mti300', 'orientation': False},
        {'driver': 'bno055', 'mode': 'amg'},
    ],
)
def test_without_an_orientation_there_is_no_such_topic(listen, ros, parameters):
    received = listen(100, **parameters)
    assert not received['imu/data']
    names = {name for name, _ in ros.nodes[0].get_topic_names_and_types()}
    publishers = ros.nodes[0].get_publishers_info_by_topic('/bench/left/imu/data')
    assert '/bench/left/imu/data_raw' in names
    assert not publishers
