# SPDX-License-Identifier: Apache-2.0
"""One program per chip: processes that want the same one, that wait, and that die."""

import fcntl
import os
import signal
import struct
import subprocess
import sys
import time

from imu_bench.bus.claim import claim, holder
from imu_bench.errors import BusBusy
import pytest

HOLD = """
import os, sys
from imu_bench.bus.claim import claim
fd = os.open(sys.argv[1], os.O_RDWR)
claim(fd, int(sys.argv[2]), 'there', float(sys.argv[3]))
print('claimed', flush=True)
sys.stdin.readline()
"""

COUNT = """
import os, sys
from imu_bench.bus.claim import claim
for _ in range(50):
    device = os.open(sys.argv[1], os.O_RDWR)
    claim(device, 0x68, 'there', 30.0)
    # two transfers that belong together: a number is read, and the next one written
    with open(sys.argv[2], 'r+') as numbers:
        number = int(numbers.read() or 0)
        numbers.seek(0)
        numbers.write(str(number + 1))
    os.close(device)
"""


@pytest.fixture
def device(tmp_path):
    """Give a file that stands for the device."""
    (tmp_path / 'device').touch()
    return tmp_path / 'device'


@pytest.fixture
def hold(device):
    """Start processes that hold a chip until they are told or killed."""
    running = []

    def start(place, patience_s=0.0):
        process = subprocess.Popen(
            [sys.executable, '-c', HOLD, str(device), str(place), str(patience_s)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        running.append(process)
        return process

    yield start
    for process in running:
        process.kill()
        process.communicate()


@pytest.fixture
def opened(device):
    """Give the device file, open."""
    fd = os.open(device, os.O_RDWR)
    yield fd
    os.close(fd)


def test_a_chip_that_another_process_has_is_refused_with_its_name(hold, opened):
    other = hold(0x68)
    assert other.stdout.readline() == 'claimed\n'
    assert holder(opened, 0x68).startswith(f'process {other.pid} (python')
    assert holder(opened, 0x69) == ''
    started = time.monotonic()
    with pytest.raises(BusBusy, match=rf'^i2c-1 0x68: process {other.pid} .*uses this chip; stop'):
        claim(opened, 0x68, 'i2c-1 0x68', 0.1)
    assert time.monotonic() - started >= 0.1


def test_another_chip_of_the_same_bus_is_free(hold, opened):
    assert hold(0x68).stdout.readline() == 'claimed\n'
    claim(opened, 0x69, 'i2c-1 0x69', 0.0)
    claim(opened, 0x69, 'i2c-1 0x69', 0.0)


@pytest.mark.parametrize('end', [signal.SIGKILL, signal.SIGTERM])
def test_a_chip_is_free_when_its_process_dies(hold, opened, end):
    other = hold(0x68)
    assert other.stdout.readline() == 'claimed\n'
    other.send_signal(end)
    claim(opened, 0x68, 'i2c-1 0x68', 30.0)


def test_who_waits_gets_it_when_the_other_one_ends(hold, opened):
    claim(opened, 0x68, 'i2c-1 0x68', 0.0)
    other = hold(0x68, 60.0)
    assert other.poll() is None
    with pytest.raises(subprocess.TimeoutExpired):
        other.wait(0.5)
    fcntl.fcntl(opened, fcntl.F_OFD_SETLK, struct.pack('@hhqqi0q', fcntl.F_UNLCK, 0, 0x68, 1, 0))
    assert other.stdout.readline() == 'claimed\n'


def test_what_belongs_together_is_not_interleaved(device, tmp_path):
    numbers = tmp_path / 'numbers'
    numbers.touch()
    command = [sys.executable, '-c', COUNT, str(device), str(numbers)]
    processes = [subprocess.Popen(command) for _ in range(3)]
    assert [process.wait() for process in processes] == [0, 0, 0]
    assert numbers.read_text() == '150'
