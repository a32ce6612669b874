# SPDX-License-Identifier: Apache-2.0
"""
The FIFO of the emulated LSM9DS1, talked to with bare register numbers and decoded by hand.

Numbers come from DocID025715 rev. 2, sections 3.3 and 3.5, not from the driver's tables.
"""

import math

from imu_bench.emulators import create
from imu_bench.emulators.line import Line, Timing
import numpy as np
import pytest

G = 9.80665


@pytest.fixture
def chip(clock, make_source):
    """Return main bus, magnetometer bus and source of a chip that is awake."""

    def make(kind='i2c', source=None, **options):
        source = source or make_source()
        buses = create('lsm9ds1', kind, source, clock, **options)
        clock.sleep(0.1)
        return buses[''], buses['magnetometer'], source

    return make


def on(bus, clock, rate=6, accelerometer=0x0, gyroscope=0x0, settle=True):
    """Turn both on: CTRL_REG6_XL, then CTRL_REG1_G, block update on."""
    bus.write(0x22, b'\x44')
    bus.write(0x20, bytes([rate << 5 | accelerometer << 3 | 0x04]))
    bus.write(0x10, bytes([rate << 5 | gyroscope << 3]))
    if settle:
        clock.sleep(2.0 if rate < 3 else 0.2)


def fifo(bus, mode=0xC0):
    bus.write(0x23, b'\x02')
    bus.write(0x2E, b'\x00')
    bus.write(0x2E, bytes([mode]))


def level(bus):
    return bus.read(0x2F, 1)[0] & 0x3F


def test_a_slot_is_gyroscope_and_accelerometer_of_one_instant(chip, clock, make_source):
    source = make_source(
        acceleration=(0.0, 0.0, 8 * G), angular_velocity=(math.radians(-70), 0.0, 0.0)
    )
    bus, _, _ = chip(source=source)
    on(bus, clock, accelerometer=1, gyroscope=3)
    fifo(bus)
    clock.sleep(0.0085)
    count = level(bus)
    assert count == 8
    # 1000 at 70 m°/s about the turned x; 10929 at 0.732 mg
    slot = bytes.fromhex('e803 0000 0000 0000 0000 b12a')
    assert bus.read(0x18, 12 * count) == slot * count


def test_the_level_counts_slots_and_a_burst_takes_them_out(chip, clock):
    bus, _, _ = chip()
    on(bus, clock)
    fifo(bus)
    assert level(bus) == 0
    clock.sleep(0.01)
    before = level(bus)
    assert before in (9, 10)
    bus.read(0x18, 12 * 4)
    assert level(bus) in (before - 3, before - 2)  # 1.1 ms have passed


def test_gyroscope_and_accelerometer_may_be_read_one_after_the_other(chip, clock):
    bus, _, _ = chip()
    on(bus, clock, rate=3)
    fifo(bus)
    clock.sleep(0.1)
    before = level(bus)
    bus.read(0x18, 6)
    assert level(bus) == before
    bus.read(0x28, 6)
    assert level(bus) == before - 1


def test_an_overrun_keeps_the_newest_32_and_says_so_until_one_is_read(chip, clock, make_source):
    source = make_source(acceleration=(0.0, 0.0, 0.0))
    bus, _, _ = chip(source=source)
    on(bus, clock)
    fifo(bus)
    clock.sleep(0.033)
    assert bus.read(0x2F, 1)[0] & 0x40 == 0
    source.values['acceleration'] = (0.0, 0.0, G)
    clock.sleep(0.02)
    assert bus.read(0x2F, 1)[0] == 0x40 | 32
    words = np.frombuffer(bus.read(0x18, 12 * 32), '<i2').reshape(-1, 6)[:, 5]
    assert (words[:10] == 0).all()
    assert (words[14:] > 10000).all()
    assert bus.read(0x2F, 1)[0] & 0x40 == 0


def test_bypass_empties_and_the_threshold_is_flagged(chip, clock):
    bus, _, _ = chip()
    on(bus, clock)
    fifo(bus, 0xC0 | 8)
    clock.sleep(0.005)
    assert bus.read(0x2F, 1)[0] & 0x80 == 0
    clock.sleep(0.005)
    assert bus.read(0x2F, 1)[0] & 0x80
    bus.write(0x2E, b'\x00')
    assert bus.read(0x2F, 1) == b'\x00'


def test_fifo_mode_stops_and_keeps_the_oldest(chip, clock, make_source):
    source = make_source(acceleration=(0.0, 0.0, 0.0))
    bus, _, _ = chip(source=source)
    on(bus, clock)
    fifo(bus, 0x20)
    clock.sleep(0.04)
    assert level(bus) == 32
    source.values['acceleration'] = (0.0, 0.0, G)
    clock.sleep(0.1)
    words = np.frombuffer(bus.read(0x18, 12 * 32), '<i2').reshape(-1, 6)[:, 5]
    assert not words.any()


def test_the_depth_can_be_limited(chip, clock):
    bus, _, _ = chip()
    on(bus, clock)
    bus.write(0x23, b'\x03')
    bus.write(0x2E, b'\x00')
    bus.write(0x2E, bytes([0xC0 | 9]))
    clock.sleep(0.1)
    assert level(bus) == 10


def test_an_empty_fifo_repeats_its_last_slot(chip, clock):
    bus, _, _ = chip()
    on(bus, clock, rate=1)
    fifo(bus)
    clock.sleep(0.1)
    last = bus.read(0x18, 12 * level(bus))[-12:]
    assert bus.read(0x18, 24) == last * 2


def test_a_burst_longer_than_the_fifo_gets_what_comes_meanwhile(chip, clock):
    bus, _, _ = chip(line=Line(clock, Timing.i2c(100e3)))
    on(bus, clock)
    fifo(bus)
    clock.sleep(0.003)
    bus.read(0x18, 12 * 20)  # 1.08 ms per slot of 1.05 ms
    assert level(bus) <= 5


def test_a_bus_that_is_too_slow_runs_over(chip, clock):
    bus, _, _ = chip(line=Line(clock, Timing.i2c(50e3)))
    on(bus, clock)
    fifo(bus)
    overrun = False
    for _ in range(50):
        source = bus.read(0x2F, 1)[0]
        overrun |= bool(source & 0x40)
        bus.read(0x18, 12 * (source & 0x3F))
    assert overrun


def test_nobody_asked_for_a_long_time(chip, clock):
    bus, magnetometer, source = chip()
    on(bus, clock)
    fifo(bus)
    magnetometer.write(0x22, b'\x00')
    clock.sleep(3600.0)
    assert level(bus) == 32
    assert source.made < 2000
    assert magnetometer.read(0x27, 1) == b'\xff'
