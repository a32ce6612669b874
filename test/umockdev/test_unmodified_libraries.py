# SPDX-License-Identifier: Apache-2.0
"""
Every driver through the real smbus2 and python-periphery, on device files of umockdev.

The chips are the emulated ones; what is proven here is the way to them: I2C_RDWR with its
combined messages, SPI_IOC_MESSAGE with mode and clock, errno into named errors.
"""

import json
import re

from imu_bench.drivers import load
import pytest

pytestmark = [pytest.mark.slow]

LIBRARIES = {'i2c': 'smbus2', 'spi': 'periphery'}

UNACKNOWLEDGED = {('iim42652', 'i2c'): 1}
"""Writes that the part carries out without acknowledging them, which the bus counts as failed."""


def test_a_sensor_is_configured_and_streams(desk, place):
    driver, device = place
    found = desk.read(driver, device)
    assert 'kind' not in found, found
    assert found['libraries'] == [LIBRARIES[device[:3]]]
    assert found['samples'] >= 100
    assert found['rising']
    assert found['error'] == ''
    assert found['bus_errors'] == UNACKNOWLEDGED.get((driver, device[:3]), 0)
    gravity = 0.0 if load(driver).typical['acceleration'].high_pass else 9.8
    assert found['acceleration'] == pytest.approx(gravity, abs=1.5)


def test_two_programs_share_a_bus(desk):
    running = {
        driver: desk.client(driver, 'i2c-1', address, 500)
        for driver, address in (('mpu9250', 0x68), ('iim42652', 0x69))
    }
    parts = set()
    for driver, process in running.items():
        output, _ = process.communicate()
        found = json.loads(output.splitlines()[-1])
        assert found['samples'] >= 500
        assert found['bus_errors'] == UNACKNOWLEDGED.get((driver, 'i2c'), 0)
        assert found['acceleration'] == pytest.approx(9.8, abs=1.5)
        parts.add(found['part'])
    assert parts == {'MPU-9250', 'TDK InvenSense IIM-42652'}


@pytest.mark.parametrize(
    ('driver', 'device', 'address', 'kind', 'text'),
    [
        # errno 121 of the kernel, as on a Raspberry Pi
        ('mpu9250', 'i2c-1', 0x69, 'IdentityError', 'holds 0x6F'),
        ('iim42652', 'i2c-1', 0x68, 'IdentityError', 'holds 0x71 .*expected 0x6F'),
        ('lsm9ds1', 'i2c-1', 0x6A, 'NoAnswer', 'nothing answers; check power.*Remote I/O error'),
        ('scl3300', 'spidev0.7', 0, 'BusError', r'/dev/spidev0\.7: there is no such device'),
        ('mpu9250', 'i2c-251', 0, 'BusError', 'there is no such device.*i2c_arm'),
    ],
)
def test_what_is_not_there_is_named(desk, driver, device, address, kind, text):
    found = desk.read(driver, device, address)
    assert found['kind'] == kind
    assert re.search(text, found['text']), found['text']
