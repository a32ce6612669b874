# SPDX-License-Identifier: Apache-2.0
"""An inclinometer as a node: acceleration without angular velocity, angles, temperature."""

from geometry_msgs.msg import Vector3Stamped
from imu_bench.nodes.sensor import SensorNode
import numpy as np
import pytest
from rclpy.node import Node
from sensor_msgs.msg import Imu, Temperature

pytestmark = pytest.mark.ros

TILTED = {
    'driver': 'scl3300',
    'backend': 'emulated',
    'mode': 4,
    'simulation.pitch': '-10 °',
    'simulation.acceleration.bias': '0 mg',
    'simulation.acceleration.scale_factor': '0',
    'simulation.temperature.bias': '0 K',
}


def stamp(message):
    return message.header.stamp.sec, message.header.stamp.nanosec


@pytest.mark.slow
def test_angles_are_published_beside_the_acceleration(ros):
    listener = ros.add(Node, 'listener')
    received = {}
    for kind, topic in (
        (Imu, 'imu/data_raw'), (Vector3Stamped, 'inclination'), (Temperature, 'temperature'),
    ):  # fmt: skip
        received[topic] = []
        listener.create_subscription(kind, f'/bench/mast/{topic}', received[topic].append, 500)
    ros.add(SensorNode, 'mast', parameters=TILTED)
    ros.spin_until(lambda: len(received['inclination']) >= 100, '100 inclinations')
    angles = received['inclination'][50:]
    # either topic may be ahead of the others
    ros.spin_until(
        lambda: (
            received['imu/data_raw'] and stamp(received['imu/data_raw'][-1]) >= stamp(angles[-1])
        )
    )
    ros.spin_until(lambda: received['temperature'], 'a temperature')
    tilt = np.array([[m.vector.x, m.vector.y, m.vector.z] for m in angles])
    np.testing.assert_allclose(tilt.mean(axis=0), np.radians([10.0, 0.0, 80.0]), atol=0.03)
    assert set(map(stamp, angles)) <= set(map(stamp, received['imu/data_raw']))
    assert angles[0].header.frame_id == 'mast_link'
    message = received['imu/data_raw'][-1]
    assert message.angular_velocity_covariance[0] == -1.0
    assert message.linear_acceleration_covariance[0] == 0.0
    assert message.orientation_covariance[0] == -1.0
    assert received['temperature'][-1].temperature == pytest.approx(25.0, abs=0.2)
