# SPDX-License-Identifier: Apache-2.0
"""The launch file, with stand-ins for launch and launch_ros, which have no wheels."""

from pathlib import Path
import runpy
import sys
from types import ModuleType

import pytest

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
    assert {a.args[0] for a in described[:-1]} == {'bench', 'analysis', 'record', 'output'}
    assert all(argument.options['description'] for argument in described[:-1])


def test_the_bench_of_the_thesis_is_started(described):
    started = nodes(described)
    assert {node['package'] for node in started} == {'imu_bench'}
    sensors = [node for node in started if node['executable'] == 'sensor_node']
    assert [node['namespace'] for node in sensors] == [
        f'/bench/{name}'
        for name in ('mti300', 'mpu9250', 'lsm9ds1', 'bno055', 'lsm303dlhc', 'mtn1100')
    ]
    assert all(Path(node['parameters'][0]).is_file() for node in sensors)
    assert [node['executable'] for node in started[len(sensors) :]] == ['analysis_node']
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
    started = nodes(described, bench=str(bench), record='true', output='/data/bag')
    assert [node['executable'] for node in started] == [
        'sensor_node', 'analysis_node', 'recorder_node',
    ]  # fmt: skip
    assert started[0]['namespace'] == '/bench/left'
    assert started[0]['parameters'] == [str(tmp_path / 'mine.yaml'), {'rate_hz': 20.0}]
    assert started[1]['parameters'][1]['window_s'] == 60.0
    assert started[2]['parameters'] == [{'storage': 'sqlite3', 'output': '/data/bag'}]
