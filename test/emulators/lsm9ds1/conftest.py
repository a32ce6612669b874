# SPDX-License-Identifier: Apache-2.0
"""What turns on and reads an LSM9DS1 with bare register numbers of DocID025715 rev. 2."""

from imu_bench.emulators import create
import pytest


@pytest.fixture
def chip(clock, make_source):
    """Return main bus, magnetometer bus and source of a chip that is awake."""

    def make(kind='i2c', source=None, **options):
        source = source or make_source()
        buses = create('lsm9ds1', kind, source, clock, **options)
        clock.sleep(0.1)
        return buses[''], buses['magnetometer'], source

    return make


def _on(bus, clock, rate=6, accelerometer=0x0, gyroscope=0x0, settle=True):
    """Turn both on: CTRL_REG6_XL, then CTRL_REG1_G, block update on."""
    bus.write(0x22, b'\x44')
    bus.write(0x20, bytes([rate << 5 | accelerometer << 3 | 0x04]))
    bus.write(0x10, bytes([rate << 5 | gyroscope << 3]))
    if settle:
        clock.sleep(2.0 if rate < 3 else 0.2)


def _fifo(bus, mode=0xC0):
    bus.write(0x23, b'\x02')
    bus.write(0x2E, b'\x00')
    bus.write(0x2E, bytes([mode]))


def _level(bus):
    return bus.read(0x2F, 1)[0] & 0x3F


@pytest.fixture
def on():
    """Return what turns accelerometer and gyroscope on."""
    return _on


@pytest.fixture
def fifo():
    """Return what starts the FIFO."""
    return _fifo


@pytest.fixture
def level():
    """Return what reads the level of the FIFO."""
    return _level
