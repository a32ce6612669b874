# SPDX-License-Identifier: Apache-2.0
"""
Start a whole bench: a node per sensor, the analysis, and the recorder if it is wanted.

``ros2 launch imu_bench bench_launch.py bench:=/path/to/bench.yaml record:=true``
"""

from imu_bench.bench import load_bench
from imu_bench.config.location import config_file
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

DEFAULT_BENCH = 'benches/machine_vibration.yaml'

ARGUMENTS = {
    'bench': (DEFAULT_BENCH, 'Bench file: a path, or a name below the config of the package.'),
    'analysis': ('analysis.yaml', 'Parameter file of the analysis node.'),
    'record': ('false', 'Whether to record a bag.'),
    'output': ('', 'Folder of the bag; empty for one named after the time.'),
}


def generate_launch_description():
    """Return the arguments, and the nodes that follow from them."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=_nodes)])


def _nodes(context):
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    bench = load_bench(config_file(given['bench']))
    nodes = [
        _node(
            'sensor_node',
            [str(bench.files[sensor.name]), dict(bench.overrides[sensor.name])],
            namespace=sensor.namespace,
        )
        for sensor in bench.sensors
    ]
    analysis = {'window_s': bench.analysis.window_s, 'confidence': bench.analysis.confidence}
    nodes.append(_node('analysis_node', [str(config_file(given['analysis'])), analysis]))
    if given['record'].lower() in ('true', '1', 'yes'):
        recorder = {'storage': bench.recorder.storage, 'output': given['output']}
        nodes.append(_node('recorder_node', [recorder]))
    return nodes


def _node(executable, parameters, **options):
    return Node(
        package='imu_bench',
        executable=executable,
        parameters=[each for each in parameters if each],
        output='screen',
        **options,
    )
