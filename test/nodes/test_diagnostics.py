# SPDX-License-Identifier: Apache-2.0
"""What a node says of itself comes once a second, whatever the clock of the system does."""

import pytest

pytestmark = pytest.mark.ros


@pytest.mark.parametrize('stands', [True, False])
def test_it_comes_though_the_clock_of_ros_stands(ros, stands):
    """A clock that was set back by an hour stands for an hour, as far as a timer can tell."""
    from diagnostic_msgs.msg import DiagnosticArray
    from imu_bench.nodes.diagnostics import Diagnostics
    from rclpy.node import Node

    node = ros.add(Node, 'speaker', parameters={'use_sim_time': stands})
    heard = []
    node.create_subscription(DiagnosticArray, '/diagnostics', heard.append, 10)
    Diagnostics(node, list)
    ros.spin_until(lambda: len(heard) > 1, 'two diagnostics')


def test_a_sensor_that_waits_tries_again_though_the_clock_of_ros_stands(ros):
    from imu_bench.errors import BusBusy
    from imu_bench.nodes.sensor import SensorNode

    tries = []

    class Waiting(SensorNode):
        def bring_up(self):
            tries.append(None)
            self._reason = BusBusy('somebody else has it')
            raise self._reason

    parameters = {
        'driver': 'generic',
        'rate_hz': 100.0,
        'backend': 'emulated',
        'simulation.acceleration.noise_density': '100 µg/√Hz',
    }
    node = ros.add(Waiting, 'a', parameters=parameters)
    node.get_clock()._set_ros_time_is_active(True)  # and nobody publishes /clock
    tries.clear()
    ros.spin_until(lambda: len(tries) > 1, 'a second try')


def test_what_was_said_in_a_minute_waits_for_a_recorder_that_was_stopped(ros):
    from imu_bench.nodes.diagnostics import Diagnostics, PERIOD_S
    from rclpy.node import Node

    node = ros.add(Node, 'speaker')
    Diagnostics(node, list)
    (offered,) = (each for each in node.publishers if each.topic_name == '/diagnostics')
    # a status changes now and then, too, and is said at once
    assert offered.qos_profile.depth * PERIOD_S >= 60.0 + 10.0
