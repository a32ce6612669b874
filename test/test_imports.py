# SPDX-License-Identifier: Apache-2.0
"""The walls of the house: import contracts, and what imports without ROS or hardware."""

from pathlib import Path
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parent.parent

BLOCK = """
import sys
class Wall:
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] in {blocked!r}:
            raise ModuleNotFoundError(f'{{name}} is walled off', name=name)
sys.meta_path.insert(0, Wall())
import importlib, pkgutil
for package in {packages!r}:
    root = importlib.import_module(package)
    for module in pkgutil.walk_packages(getattr(root, '__path__', []), package + '.'):
        importlib.import_module(module.name)
"""

ROS = ['rclpy', 'sensor_msgs', 'std_msgs', 'geometry_msgs', 'diagnostic_msgs', 'rcl_interfaces']
HARDWARE = ['smbus2', 'periphery', 'serial', 'daqhats', 'spidev']


def import_without(blocked, packages):
    script = BLOCK.format(blocked=blocked, packages=packages)
    return subprocess.run(
        [sys.executable, '-W', 'error', '-c', script],
        cwd=ROOT, capture_output=True, text=True, timeout=100,
    )  # fmt: skip


def test_contracts_hold():
    result = subprocess.run(
        [Path(sys.executable).with_name('lint-imports'), '--no-cache'],
        cwd=ROOT, capture_output=True, text=True, timeout=100,
    )  # fmt: skip
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.parametrize('package', ['imu_bench.offline', 'imu_bench.metrology', 'imu_bench.cli'])
def test_offline_side_imports_on_a_laptop(package):
    result = import_without(ROS + HARDWARE, [package])
    assert result.returncode == 0, result.stderr


def test_drivers_and_emulators_import_without_hardware_libraries():
    packages = ['imu_bench.drivers', 'imu_bench.emulators', 'imu_bench.simulation']
    result = import_without(ROS + HARDWARE, packages)
    assert result.returncode == 0, result.stderr


def test_the_wall_is_real():
    result = import_without(['numpy'], ['imu_bench.metrology.curve'])
    assert 'numpy is walled off' in result.stderr
