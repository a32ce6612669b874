# SPDX-License-Identifier: Apache-2.0
"""Device files, their groups and clocks, on a made-up machine."""

import os
import re
import struct

from imu_bench.doctor import machine
import pytest


@pytest.fixture
def made_up(tmp_path, monkeypatch):
    """Give the root of a machine with two buses."""
    (tmp_path / 'dev').mkdir()
    for name in ('i2c-1', 'spidev0.0', 'ttyUSB0', 'ttyS0', 'null'):
        (tmp_path / 'dev' / name).touch()
    node = tmp_path / 'sys/class/i2c-adapter/i2c-1/of_node'
    node.mkdir(parents=True)
    (node / 'clock-frequency').write_bytes(struct.pack('>I', 400_000))
    names = tmp_path / 'sys/class/i2c-dev/i2c-1'
    names.mkdir(parents=True)
    (names / 'name').write_text('bcm2835 (i2c@7e804000)\n')
    (tmp_path / 'model').write_text('Raspberry Pi 4 Model B Rev 1.4\0')
    monkeypatch.setattr(machine, '_DEV', tmp_path / 'dev')
    monkeypatch.setattr(machine, '_SYS', tmp_path / 'sys')
    monkeypatch.setattr(machine, '_MODEL', tmp_path / 'model')
    return tmp_path


def test_buses_are_listed_with_what_their_files_say(made_up):
    i2c, spi, serial = machine.buses()
    assert [bus.kind for bus in (i2c, spi, serial)] == ['i2c', 'spi', 'serial']
    assert i2c.device.endswith('/dev/i2c-1')
    assert (i2c.adapter, i2c.speed_hz) == ('bcm2835 (i2c@7e804000)', 400e3)
    assert (spi.adapter, spi.speed_hz) == ('', 0.0)
    assert i2c.accessible
    assert i2c.advice == ''


@pytest.mark.parametrize(
    ('group', 'advice'),
    [
        ('i2c', r'^sudo usermod -aG i2c \$USER, then'),
        ('root', 'sudo chgrp i2c .*i2c-1.*udev rule'),
    ],
)
def test_what_may_not_be_opened_has_advice(made_up, monkeypatch, group, advice):
    monkeypatch.setattr(os, 'access', lambda path, mode: False)
    monkeypatch.setattr(machine, '_group', lambda path: group)
    assert re.search(advice, machine.buses()[0].advice)


def test_a_chip_that_the_kernel_has_is_known(made_up):
    place = made_up / 'sys/bus/i2c/devices/1-0068'
    place.mkdir(parents=True)
    (place / 'driver').symlink_to('../../../drivers/inv-mpu6050-i2c')
    assert machine.kernel_driver('/dev/i2c-1', 0x68) == 'inv-mpu6050-i2c'
    assert machine.kernel_driver('/dev/i2c-1', 0x69) == ''


def test_a_raspberry_pi_is_known(made_up, monkeypatch):
    assert machine.is_raspberry_pi()
    monkeypatch.setattr(machine, '_MODEL', made_up / 'nothing')
    assert not machine.is_raspberry_pi()


@pytest.mark.parametrize(
    ('model', 'wrongly'),
    [
        ('Raspberry Pi 4 Model B Rev 1.4', True),
        ('Raspberry Pi Zero 2 W Rev 1.0', True),
        ('Raspberry Pi Compute Module 4 Rev 1.1', True),
        ('Raspberry Pi 5 Model B Rev 1.0', False),
        ('Raspberry Pi 500 Rev 1.0', False),
        ('Raspberry Pi Compute Module 5 Rev 1.0', False),
        ('', False),
    ],
)
def test_which_computers_handle_a_stretched_clock_wrongly(monkeypatch, model, wrongly):
    monkeypatch.setattr(machine, 'model', lambda: model)
    assert machine.mishandles_stretching() == wrongly


@pytest.mark.parametrize(
    ('granted', 'advised'), [('real time, priority 10', False), ('ordinary: no', True)]
)
def test_threads_that_may_not_go_first_have_advice(monkeypatch, granted, advised):
    monkeypatch.setattr(machine, 'permitted', lambda: granted)
    found, advice = machine.scheduling()
    assert found == granted
    assert ('rtprio' in advice) == advised
