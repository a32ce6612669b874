# SPDX-License-Identifier: Apache-2.0
"""The analysis node as a process, on the executor it runs with in earnest."""

import signal

from geometry_msgs.msg import Vector3Stamped
import pytest
from rclpy.node import Node

pytestmark = pytest.mark.ros

ANALYSIS = 'imu_bench.nodes.analysis_node'
SENSOR = 'imu_bench.nodes.sensor_node'
GENERIC = (
    '-p', 'driver:=generic', '-p', 'backend:=emulated', '-p', 'rate_hz:=100.0',
    '-p', 'simulation.acceleration.noise_density:="60 µg/√Hz"', '-r', '__ns:=/bench/x',
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_it_analyses_a_sensor_and_ends_cleanly(ros, start, number):
    received = []
    ros.add(Node, 'listener').create_subscription(
        Vector3Stamped, '/bench/x/imu/noise_density/linear_acceleration', received.append, 10
    )
    analysis = start(ANALYSIS, '--ros-args', '-p', 'publish_rate_hz:=5.0')
    sensor = start(SENSOR, '--ros-args', *GENERIC)
    ros.spin_until(lambda: received, 'a noise density from the process')
    # 60 µg/√Hz in m/s²/√Hz
    assert received[-1].vector.x == pytest.approx(60e-6 * 9.80665, rel=0.5)
    for process in (analysis, sensor):
        process.process.send_signal(number)
        process.process.send_signal(number)
    for process in (analysis, sensor):
        code, output = process.finish()
        assert code == 0, output
        assert 'Traceback' not in output


def test_a_wrong_parameter_ends_it_with_one_clear_line(start):
    code, output = start(ANALYSIS, '--ros-args', '-p', 'window_s:=0.5').finish()
    assert code == 1
    assert output.count('\n') == 1, output
    assert 'window_s: 0.5 is not allowed; allowed: 1 to 86400 s' in output
