# SPDX-License-Identifier: Apache-2.0
"""The launch file, with stand-ins for launch and launch_ros, which have no wheels."""

from pathlib import Path
import runpy
import sys
from types import ModuleType

import pytest
import yaml

LAUNCH = Path(__file__).resolve().parents[2] / 'launch' / 'bench_launch.py'


class Call:
    """Remembers what it was made with."""

    def __init__(self, *args, **options):
        self.args, self.options = args, options


class LaunchConfiguration(Call):
    """Gives what the context holds."""

    def perform(self, context):
        return context[self.args[0]]


def kinds(*names):
    return {name: type(name, (Call,), {}) for name in names}


@pytest.fixture
def described(monkeypatch):
    modules = {
        'launch': kinds('LaunchDescription'),
        'launch.actions': kinds('DeclareLaunchArgument', 'OpaqueFunction'),
        'launch.substitutions': {'LaunchConfiguration': LaunchConfiguration},
        'launch_ros': {},
        'launch_ros.actions': kinds('Node'),
    }
    for name, content in modules.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    (description,) = runpy.run_path(str(LAUNCH))['generate_launch_description']().args
    return description


def nodes(description, **given):
    """Return the nodes that the launch file starts, as their options."""
    arguments = {a.args[0]: a.options['default_value'] for a in description[:-1]}
    assert set(given) <= set(arguments)
    return [node.options for node in description[-1].options['function'](arguments | given)]


def test_every_argument_is_described(described):
    assert {a.args[0] for a in described[:-1]} == {
        'bench', 'analysis', 'record', 'output', 'log_level', 'respawn', 'namespace',
        'use_sim_time',
    }  # fmt: skip
    assert all(argument.options['description'] for argument in described[:-1])


def test_the_bench_of_the_thesis_is_started(described):
    started = nodes(described)
    assert {node['package'] for node in started} == {'imu_bench'}
    assert [node['executable'] for node in started] == ['bench_node', 'analysis_node']
    names, files = zip(*(word.split('=') for word in started[0]['arguments']), strict=True)
    assert names == ('mti300', 'mpu9250', 'lsm9ds1', 'bno055', 'lsm303dlhc', 'mtn1100')
    assert all(Path(path).is_file() for each in files for path in each.split(','))
    assert started[0]['ros_arguments'] == [
        '--enclave', '/imu_bench/sensors', '--log-level', 'info',
    ]  # fmt: skip
    file, settings = started[-1]['parameters']
    assert Path(file).name == 'analysis.yaml'
    assert settings == {'window_s': 600.0, 'confidence': 0.95}


def test_own_bench_with_overrides_and_recorder(described, tmp_path):
    (tmp_path / 'mine.yaml').write_text(
        '/**:\n  ros__parameters:\n    driver: generic\n    backend: emulated\n    rate_hz: 10.0\n'
    )
    bench = tmp_path / 'bench.yaml'
    bench.write_text(
        'name: own\n'
        'sensors:\n'
        '  - {file: mine.yaml, name: left, overrides: {rate_hz: 20.0}}\n'
        'analysis: {window_s: 60.0}\n'
        'recorder: {storage: sqlite3}\n'
    )
    own = tmp_path / 'analysis.yaml'
    own.write_text('/**:\n  ros__parameters:\n    window_s: 30.0\n')
    started = nodes(
        described, bench=str(bench), record='true', output='/data/bag', respawn='true',
        analysis=str(own),
    )  # fmt: skip
    assert [node['executable'] for node in started] == [
        'bench_node', 'analysis_node', 'recorder_node',
    ]  # fmt: skip
    assert all(node['respawn'] for node in started)
    waits, sensor = started[0]['arguments']
    assert waits == '--recorded'
    first, second = sensor.removeprefix('left=').split(',')
    assert first == str(tmp_path / 'mine.yaml')
    assert yaml.safe_load(Path(second).read_text())['/**']['ros__parameters'] == {'rate_hz': 20.0}
    assert started[1]['parameters'][1]['window_s'] == 60.0
    assert started[1]['parameters'][2:] == [str(own)]
    assert started[2]['parameters'] == [{'storage': 'sqlite3', 'output': '/data/bag'}]


def test_a_robot_has_a_bench_of_its_own(described):
    started = nodes(described, namespace='robot1', record='1')
    assert {node['namespace'] for node in started} == {'/robot1'}
    assert started[1]['parameters'][1]['topics'] == ['/robot1/*']
    assert started[2]['parameters'][0]['sensors'][0] == '/robot1/bench/mti300'
    assert {node['namespace'] for node in nodes(described)} == {None}


def test_the_clock_of_a_simulation_is_for_those_that_measure_nothing(described):
    sensors, analysis, recorder = nodes(described, use_sim_time='true', record='true')
    assert sensors['parameters'] == []  # a sensor refuses it
    assert analysis['parameters'][1]['use_sim_time'] is True
    assert recorder['parameters'][0]['use_sim_time'] is True
    assert 'use_sim_time' not in nodes(described)[1]['parameters'][1]
