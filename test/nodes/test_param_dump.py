# SPDX-License-Identifier: Apache-2.0
"""A node starts again from its parameters as `ros2 param dump` writes them."""

from array import array

from imu_bench.nodes.analysis import AnalysisNode
from imu_bench.nodes.recorder import RecorderNode
from imu_bench.nodes.sensor import SensorNode
import pytest
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
import yaml

pytestmark = pytest.mark.ros

SENSOR = {'driver': 'mpu9250', 'backend': 'emulated', 'autostart': False, 'rate_hz': 500.0}


def dumped(ros, node):
    """Return the parameters of a node as the services give them, nested as in the file."""
    asks, name = ros.add(Node, 'asks'), node.get_fully_qualified_name()
    every = asks.create_client(ListParameters, f'{name}/list_parameters')
    names = ros.call(every, ListParameters.Request()).result.names
    values = asks.create_client(GetParameters, f'{name}/get_parameters')
    found = ros.call(values, GetParameters.Request(names=names)).values
    tree = {}
    for full, value in zip(names, found, strict=True):
        *parents, last = full.split('.')
        branch = tree
        for parent in parents:
            branch = branch.setdefault(parent, {})
        branch[last] = parameter_value_to_python(value)
        if isinstance(branch[last], tuple | array):
            branch[last] = list(branch[last])
    return {name: {'ros__parameters': tree}}


def own_of(tree):
    """Return parameters without those of topics, which are there once the topics are."""
    (own,) = tree.values()
    return {k: v for k, v in own['ros__parameters'].items() if k != 'qos_overrides'}


@pytest.mark.parametrize(
    ('make', 'parameters'),
    [
        (lambda **o: SensorNode('left', **o), SENSOR),
        (AnalysisNode, {'window_s': 20.0}),
        (RecorderNode, {'storage': 'sqlite3'}),
    ],
    ids=['sensor', 'analysis', 'recorder'],
)
def test_a_node_starts_again_from_a_dump_of_its_parameters(
    ros, elsewhere, tmp_path, monkeypatch, make, parameters
):
    monkeypatch.chdir(tmp_path)
    if make is RecorderNode:
        parameters |= {'output': str(tmp_path / 'first')}
    first = dumped(ros, ros.add(make, parameters=parameters))
    ros.close()
    if make is RecorderNode:
        (own,) = first.values()
        own['ros__parameters']['output'] = str(tmp_path / 'second')
    file = tmp_path / 'dump.yaml'
    file.write_text(yaml.safe_dump(first))
    again = elsewhere.add(make, cli_args=['--ros-args', '--params-file', str(file)])
    assert own_of(dumped(elsewhere, again)) == own_of(first)
