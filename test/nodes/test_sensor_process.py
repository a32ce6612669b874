# SPDX-License-Identifier: Apache-2.0
"""A sensor node as a process: how it starts, how it is refused, how it ends."""

import os
import signal

from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
import pytest
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node

pytestmark = pytest.mark.ros

SENSOR = 'imu_bench.nodes.sensor_node'
GENERIC = (
    '-p', 'driver:=generic', '-p', 'backend:=emulated', '-p', 'rate_hz:=100.0',
    '-p', 'simulation.acceleration.noise_density:="60 µg/√Hz"',
)  # fmt: skip


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_it_ends_cleanly_on_a_signal_and_survives_a_second(start, number):
    node = start(SENSOR, '--ros-args', *GENERIC, '-r', '__ns:=/bench/x')
    assert 'bench.x.sensor_node' in node.wait_for('emulated generic')
    node.process.send_signal(number)
    node.process.send_signal(number)
    code, output = node.finish()
    assert code == 0, output
    assert 'Traceback' not in output


def test_a_signal_before_it_is_up_is_not_lost(start):
    node = start(SENSOR, '--ros-args', *GENERIC, PYTHONSTARTUP='')
    node.wait_for('not measurements')
    node.process.send_signal(signal.SIGINT)
    code, output = node.finish()
    assert code == 0, output


def test_a_wrong_parameter_ends_it_with_one_clear_line(start):
    node = start(SENSOR, '--ros-args', *GENERIC, '-p', 'rate_hz:=0.01')
    code, output = node.finish()
    assert code == 1
    assert output.count('\n') == 1, output
    assert 'rate_hz: 0.01 is not allowed; allowed: 0.1 to 50000 Hz' in output


def test_a_sensor_that_is_not_there_ends_it(start):
    node = start(
        SENSOR, '--ros-args', '-p', 'driver:=mpu9250', '-p', 'backend:=hardware',
        '-p', 'bus:=i2c-99',
    )  # fmt: skip
    code, output = node.finish()
    assert code == 1
    assert 'i2c-99' in output
    assert 'Traceback' not in output


def test_nonsense_that_somebody_asks_ends_nothing(ros, start):
    node = start(SENSOR, '--ros-args', *GENERIC, '-r', '__ns:=/bench/x')
    stranger = ros.add(Node, 'stranger')

    def call(kind, name, request):
        return ros.call(stranger.create_client(kind, f'/bench/x/sensor_node/{name}'), request)

    for number in (Transition.TRANSITION_CLEANUP, 99):
        request = ChangeState.Request(transition=Transition(id=number))
        assert not call(ChangeState, 'change_state', request).success
    for value in (ParameterValue(type=99), ParameterValue(type=3, double_value=1.0)):
        request = SetParameters.Request(parameters=[Parameter(name='rate_hz', value=value)])
        results = call(SetParameters, 'set_parameters', request).results
        assert not any(result.successful for result in results)
    state = call(GetState, 'get_state', GetState.Request()).current_state.id
    assert state == State.PRIMARY_STATE_ACTIVE
    node.process.send_signal(signal.SIGINT)
    code, output = node.finish()
    assert code == 0, output
    assert 'set_parameters: refused a request: ' in output  # of a transition only in Jazzy


def test_help_is_given(start):
    code, output = start(SENSOR, '--help').finish()
    assert code == 0
    assert '--params-file FILE' in output
    assert 'Traceback' not in output


def test_a_simulated_clock_is_refused(start):
    code, output = start(SENSOR, '--ros-args', *GENERIC, '-p', 'use_sim_time:=true').finish()
    assert code == 1
    assert output.count('\n') == 1, output
    assert 'use_sim_time: true is not allowed' in output


def test_an_argument_that_is_not_ros_is_wrong_usage(start):
    code, output = start(SENSOR, 'mpu9250.yaml').finish()
    assert code == 2
    assert "unknown argument 'mpu9250.yaml'" in output


@pytest.mark.parametrize(
    ('content', 'says'),
    [(None, 'is the path right?'), ('a:\n\tb: 1\n', 'spaces instead of tabs')],
)
def test_malformed_ros_arguments_are_one_line(start, tmp_path, content, says):
    path = tmp_path / 'mine.yaml'
    if content is not None:
        path.write_text(content, encoding='utf-8')
    code, output = start(SENSOR, '--ros-args', '--params-file', str(path)).finish()
    assert code == 1
    assert output.count('\n') == 1
    assert f"'--params-file {path}'" in output
    assert says in output
    assert '.c:' not in output


def test_without_ros_it_says_how_to_install_it(start, tmp_path):
    # a module of that name that is not there, as on a machine without ROS 2
    (tmp_path / 'sitecustomize.py').write_text(
        'import sys\n'
        'class Missing:\n'
        '    def find_spec(self, name, path=None, target=None):\n'
        '        if name == "rclpy":\n'
        '            raise ModuleNotFoundError(f"No module named {name!r}", name=name)\n'
        'sys.meta_path.insert(0, Missing())\n'
    )
    path = os.pathsep.join([str(tmp_path), os.environ.get('PYTHONPATH', os.getcwd())])
    code, output = start(SENSOR, PYTHONPATH=path).finish()
    assert code == 1
    assert output.startswith('ROS 2 is not installed')
    assert output.count('\n') == 1
