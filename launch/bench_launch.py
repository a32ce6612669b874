# SPDX-License-Identifier: Apache-2.0
"""
Start a whole bench: a node per sensor, the analysis, and the recorder if it is wanted.

The sensors share one process, as in `imu-bench record`: wires that they share are shared there.

``ros2 launch imu_bench bench_launch.py bench:=/path/to/bench.yaml record:=true``
"""

from pathlib import Path
from tempfile import mkdtemp

from imu_bench.bench import load_bench
from imu_bench.config.location import config_file
from imu_bench.nodes.bench_node import RECORDED
from imu_bench.nodes.bench_nodes import ANALYSIS, RECORDER, SENSORS, sensors_with_files
from imu_bench.nodes.bench_nodes import enclave as keys
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

DEFAULT_BENCH, DEFAULT_ANALYSIS = 'benches/machine_vibration.yaml', 'analysis.yaml'

ARGUMENTS = {
    'bench': (DEFAULT_BENCH, 'Bench file: a path, or a name below the config of the package.'),
    'analysis': ('', "Parameter file of the analysis node; it goes before the bench's."),
    'record': ('false', 'Whether to record a bag.'),
    'output': ('', 'Folder of the bag; empty for one named after the time.'),
    'namespace': ('', 'Namespace of all nodes; the sensors are below NAMESPACE/bench.'),
    'use_sim_time': (
        'false',
        "Whether analysis and recorder take their time from /clock; sensors have the machine's.",
    ),
    'log_level': ('info', 'What the nodes log: debug, info, warn, error or fatal.'),
    'respawn': ('false', 'Whether what ends is started again.'),
}

SWITCHES = ('record', 'respawn', 'use_sim_time')


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
    wanted = {name: given[name].lower() in ('true', '1', 'yes') for name in SWITCHES}
    space = given['namespace'].strip('/')
    same = {
        'log_level': given['log_level'],
        'respawn': wanted['respawn'],
        'namespace': f'/{space}' if space else None,
    }
    clock = {'use_sim_time': True} if wanted['use_sim_time'] else {}
    sensors = sensors_with_files(bench, bench.sensors, Path(mkdtemp(prefix='imu_bench_')), {})
    if wanted['record']:
        sensors.insert(0, RECORDED)  # they wait for it
    nodes = [_node('bench_node', [], enclave=SENSORS, arguments=sensors, **same)]
    analysis = {'window_s': bench.analysis.window_s, 'confidence': bench.analysis.confidence}
    if space:  # nothing of another robot
        analysis['topics'] = [f'/{space}/*']
    parameters = [str(config_file(DEFAULT_ANALYSIS)), analysis | clock]
    if given['analysis']:
        parameters.append(str(config_file(given['analysis'])))
    nodes.append(_node('analysis_node', parameters, enclave=ANALYSIS, **same))
    if wanted['record']:
        recorder = {'storage': bench.recorder.storage, 'output': given['output']} | clock
        if space:
            recorder['sensors'] = [f'/{space}{sensor.namespace}' for sensor in bench.sensors]
        nodes.append(_node('recorder_node', [recorder], enclave=RECORDER, **same))
    return nodes


def _node(executable, parameters, *, enclave, log_level, **options):
    return Node(
        package='imu_bench',
        executable=executable,
        parameters=parameters,
        output='screen',
        ros_arguments=[*keys(enclave), '--log-level', log_level],
        **options,
    )
