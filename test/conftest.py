# SPDX-License-Identifier: Apache-2.0
"""Fixtures for every test: the shared recordings, and a ROS 2 that stays on this machine."""

import base64
import gzip
import json
import os
from pathlib import Path
import re
import tempfile

try:
    import fcntl
except ModuleNotFoundError:  # without it there is no ROS 2 to keep apart either (elsewhere.py)
    fcntl = None

# each worker of the tests is one core; said before anything imports numpy
os.environ.setdefault('OMP_NUM_THREADS', '1')
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
os.environ.setdefault('MKL_NUM_THREADS', '1')

from imu_bench.nodes import network
import pytest

ROOT = Path(__file__).resolve().parent.parent

DEMOS = {
    'test_demo.py': 'demo', 'test_demo_faults.py': 'demo', 'test_survive.py': 'demo',
    'test_security.py': 'demo', 'test_record.py': 'record', 'test_strangers.py': 'record',
}  # fmt: skip
"""
Files of tests that run whole benches in real time, the longest of all and mostly waiting, by what
one worker takes one after the other: two benches of six sensors are more than four cores can do.
"""

LONG = (
    'test_many_recordings.py', 'test_network.py', 'test_fuzzed_files.py',
    'test_recorder_process.py', 'test_plan_bench.py', 'test_others.py', 'test_memory.py',
    'test_sensor_process.py', 'test_closed_loop.py', 'test_analysis_node.py', 'test_wheel.py',
)  # fmt: skip
"""Files of few tests that take long, those that wait and those that compute in turn."""

SPREAD = ('test_benchmarks.py', 'test_every_fault.py', 'test_every_driver.py')
"""Files of many tests without fixtures to share: any worker takes the next of them, at the end."""


def own_domain(config):
    """
    Return a domain of ROS 2 that no other worker and no other run on this machine has.

    Two that shared one would hear each other: their nodes and topics have the same names.
    """
    for number in range(os.getpid(), os.getpid() + 101):
        domain = 1 + number % 101  # 1..101 are safe on Linux
        path = Path(tempfile.gettempdir()) / f'imu_bench_test_domain_{domain}'
        try:
            file = path.open('wb')
        except PermissionError:  # of another user
            continue
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.close()
            continue
        config.add_cleanup(file.close)
        return domain
    raise pytest.UsageError('every domain of ROS 2 is in use by other runs of the tests')


def pytest_configure(config):
    """Keep ROS 2 on this machine and strict, before anything imports rclpy."""
    network.apply(network.variables(network.ALONE, {}))
    os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'
    if fcntl is not None:
        os.environ['ROS_DOMAIN_ID'] = str(own_domain(config))


def turn(scope):
    """Return when tests have their turn: the longest first, the shortest at the end."""
    name = Path(scope.partition('::')[0]).name
    order = [*DEMOS.values(), *LONG, '', *SPREAD]
    return order.index(name if name in order else '')


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Keep the tests of a file on one worker, which shares what they set up."""
    from xdist.scheduler import LoadScopeScheduling

    class ByFile(LoadScopeScheduling):
        def _split_scope(self, nodeid):
            path = Path(nodeid.partition('::')[0])
            return nodeid if path.name in SPREAD else DEMOS.get(path.name, str(path))

        def _assign_work_unit(self, node):
            if not any(self.assigned_work.values()):  # the first: what was sorted by xdist
                for scope in sorted(self.workqueue, key=turn):
                    self.workqueue.move_to_end(scope)
            super()._assign_work_unit(node)

    return ByFile(config, log)


@pytest.fixture(scope='session')
def shared_data():
    """Return the folder of real recordings; they are not part of the repository."""
    folder = Path(os.environ.get('IMU_BENCH_DATA', ROOT.parent / 'shared' / 'data'))
    if not folder.is_dir():
        message = (
            f'no recordings at {folder}: set IMU_BENCH_DATA to the folder that holds nbs14, '
            'mpu6050_static, rosbag1_husky_imu and the others'
        )
        if os.environ.get('CI'):
            pytest.fail(message)
        pytest.skip(message)
    return folder


@pytest.fixture(scope='session')
def figures_in():
    """Return what unpacks the documents of the figures of a page."""

    def unpacked(page):
        packed = re.search(r'id="packed-figures">([^<]*)<', page)
        return [] if packed is None else json.loads(gzip.decompress(base64.b64decode(packed[1])))

    return unpacked
