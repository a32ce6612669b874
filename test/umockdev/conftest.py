# SPDX-License-Identifier: Apache-2.0
"""A desk full of sensors whose device files unmodified programs can open."""

import json
import os
from pathlib import Path
import subprocess
import sys

from imu_bench.drivers import load, names
import pytest

collect_ignore = ['devices.py']  # for the system's Python, which has the bindings

HERE = Path(__file__).resolve().parent
SYSTEM_PYTHON = '/usr/bin/python3'
BINDINGS = "import gi; gi.require_version('UMockdev', '1.0'); from gi.repository import UMockdev"
PRELOAD = 'libumockdev-preload.so.0'


def scene():
    """Return every sensor on a bus of its own, and two on a shared one."""
    buses = {
        'i2c-1': [
            {'driver': 'mpu9250', 'kind': 'i2c'},
            {'driver': 'iim42652', 'kind': 'i2c', 'address': 0x69},
        ]
    }
    for number, name in enumerate(names(), 10):
        kinds = load(name).bus_kinds
        if 'i2c' in kinds:
            buses[f'i2c-{number}'] = [{'driver': name, 'kind': 'i2c'}]
        for kind in {'spi', 'frame'} & set(kinds):
            buses[f'spidev{number}.0'] = [{'driver': name, 'kind': kind}]
    return buses


PLACES = [(entries[0]['driver'], bus) for bus, entries in scene().items() if len(entries) == 1]
"""(driver, device) of every sensor on a bus of its own."""


def pytest_generate_tests(metafunc):
    """Run a test that asks for a place on every one."""
    if 'place' in metafunc.fixturenames:
        metafunc.parametrize('place', PLACES, ids=['-'.join(place) for place in PLACES])


class Desk:
    """The device files, and programs that see them."""

    def __init__(self, root, folder):
        self.environment = {
            **os.environ,
            'UMOCKDEV_DIR': root,
            'LD_PRELOAD': PRELOAD,
            # otherwise the import of rclpy waits for 3 s under umockdev
            'LTTNG_UST_REGISTER_TIMEOUT': '0',
            'ROS_LOG_DIR': str(folder),
        }

    def start(self, *arguments, prefix=()):
        """Start a Python program that sees the device files and no others."""
        return subprocess.Popen(
            [*prefix, sys.executable, *map(str, arguments)],
            env=self.environment, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip

    def client(self, driver, device, address=0, samples=100):
        """Start a client that reads a sensor."""
        return self.start(HERE / 'client.py', driver, device, hex(address), samples)

    def device_of(self, driver):
        """Return where a sensor has a bus of its own."""
        return next(bus for name, bus in PLACES if name == driver)

    def read(self, driver, device, address=0, samples=100):
        """Return what the client finds out about a sensor."""
        process = self.client(driver, device, address, samples)
        output, _ = process.communicate()
        assert process.returncode == 0, output
        return json.loads(output.splitlines()[-1])


def line_of(process):
    line = process.stdout.readline().strip()
    if not line:
        pytest.fail(f'{process.args[1]} did not start: {process.communicate()[0]}')
    return line


@pytest.fixture(scope='session')
def desk(tmp_path_factory):
    """Give the desk; without umockdev there is none, and in CI that is a failure."""
    check = subprocess.run([SYSTEM_PYTHON, '-c', BINDINGS], capture_output=True, check=False)
    if check.returncode != 0:
        text = 'apt-get install umockdev gir1.2-umockdev-1.0 python3-gi'
        (pytest.fail if 'CI' in os.environ else pytest.skip)(text)
    folder = tmp_path_factory.mktemp('desk')
    path, buses = folder / 'chips', scene()
    devices = [*buses, *(f'{bus[:-1]}1' for bus in buses if bus.startswith('spidev'))]
    with subprocess.Popen(
        [sys.executable, HERE / 'desk.py', path, json.dumps(buses)],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    ) as chips:  # fmt: skip
        try:
            assert line_of(chips) == 'ready'
            with subprocess.Popen(
                [SYSTEM_PYTHON, HERE / 'devices.py', path, *devices],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            ) as files:  # fmt: skip
                yield Desk(line_of(files), folder)
                files.stdin.close()
        finally:
            chips.kill()
