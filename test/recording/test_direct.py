# SPDX-License-Identifier: Apache-2.0
"""`imu-bench record --direct`, and what it is where there is no ROS."""

import json
import os
import subprocess
import sys

import pytest
from rosbags.highlevel import AnyReader
import yaml

NO_ROS = """
import sys

class Wall:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in ('rclpy', 'sensor_msgs', 'diagnostic_msgs', 'rcl_interfaces'):
            raise ModuleNotFoundError(f'no {name} here', name=name)

sys.meta_path.insert(0, Wall())
import importlib.util
find = importlib.util.find_spec
importlib.util.find_spec = lambda name, *rest: None if name == 'rclpy' else find(name, *rest)
from imu_bench.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture
def sensor(tmp_path):
    """Return the file of a simulated sensor of 100 Hz."""
    settings = {
        'driver': 'generic',
        'backend': 'emulated',
        'rate_hz': 100.0,
        'simulation': {'acceleration': {'noise_density': '60 µg/√Hz'}},
    }
    path = tmp_path / 'quiet.yaml'
    path.write_text(yaml.safe_dump({'/**': {'ros__parameters': settings}}, allow_unicode=True))
    return path


def record(*arguments, ros=True):
    code = 'import sys; from imu_bench.cli.main import main; sys.exit(main(sys.argv[1:]))'
    return subprocess.run(
        [sys.executable, '-c', code if ros else NO_ROS, 'record', *map(str, arguments)],
        capture_output=True, text=True, check=False,
        env={**os.environ, 'COLUMNS': '200'},
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize('ros', [True, False])
def test_a_bench_is_recorded_without_ros(tmp_path, sensor, ros):
    direct = ['--direct'] if ros else []
    result = record(sensor, '-o', tmp_path / 'bag', '--duration', '3s', *direct, ros=ros)
    assert result.returncode == 0, result.stderr
    assert 'quiet: ' in result.stdout
    assert 'nothing lost' in result.stdout
    assert ('ROS 2 is not installed here' in result.stderr) != ros
    with AnyReader([tmp_path / 'bag']) as reader:
        counts = {each.topic: each.msgcount for each in reader.connections}
    # not of the start alone: what came while it was shown is there
    assert counts['/bench/quiet/imu/data_raw'] >= 290
    assert counts['/diagnostics'] >= 3


@pytest.mark.slow
def test_analyze_finds_nothing_wrong_with_it(tmp_path, sensor):
    assert record(sensor, '-o', tmp_path / 'bag', '--duration', '3s', '--direct').returncode == 0
    out = tmp_path / 'results.json'
    code = 'import sys; from imu_bench.cli.main import main; sys.exit(main(sys.argv[1:]))'
    subprocess.run(
        [sys.executable, '-c', code, 'analyze', str(tmp_path / 'bag'), '--json', str(out)],
        capture_output=True, check=True,
    )  # fmt: skip
    (found,) = json.loads(out.read_text())['recordings']
    assert found['topic'] == '/bench/quiet/imu/data_raw'
    codes = [finding['code'] for finding in found['health']['findings']]
    assert not [code for code in codes if 'lost' in code or 'gap' in code]


@pytest.mark.slow
def test_direct_is_about_a_bench(tmp_path):
    result = record('--direct', '-o', tmp_path / 'bag')
    assert result.returncode == 1
    assert '--direct reads the sensors itself: name a bench' in result.stderr
