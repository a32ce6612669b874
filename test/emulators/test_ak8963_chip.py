# SPDX-License-Identifier: Apache-2.0
"""
The emulated AK8963 behind the emulated MPU-9250, talked to with bare register numbers.

Numbers and formulas come from AK8963 MS1356-E-02 and RM-MPU-9250A-00, not from the driver.
"""

import struct

from imu_bench.errors import NoAnswer
import numpy as np
import pytest


def tesla(raw, asa):
    """Return the field in the magnetometer's own axes, AK section 8.3.11."""
    return [h * 0.15e-6 * ((a - 128) * 0.5 / 128 + 1) for h, a in zip(raw, asa, strict=True)]


def fuse_rom(mag, clock):
    mag.write(0x0A, b'\x1f')
    clock.sleep(0.001)
    asa = mag.read(0x10, 3)
    mag.write(0x0A, b'\x10')
    clock.sleep(0.001)
    return asa


def test_the_magnetometer_is_on_the_bus_in_bypass_only(make_chip):
    bus, mag, _ = make_chip()
    with pytest.raises(NoAnswer):
        mag.read(0x00, 1)
    bus.write(0x37, b'\x02')
    assert mag.read(0x00, 1) == b'\x48'
    bus.write(0x6A, b'\x20')
    with pytest.raises(NoAnswer):
        mag.read(0x00, 1)


def test_field_axes_trim_and_flags(make_chip, clock, make_source):
    # the magnetometer's x is the body's y, its y the body's x, its z points down
    bus, mag, _ = make_chip(source=make_source(magnetic_field=(30e-6, 10e-6, -40e-6)))
    bus.write(0x37, b'\x02')
    assert mag.read(0x10, 3) == bytes(3)
    asa = fuse_rom(mag, clock)
    assert all(asa)
    mag.write(0x0A, b'\x16')
    clock.sleep(0.0105)
    status, *raw, status2 = struct.unpack('<BhhhB', mag.read(0x02, 8))
    assert (status, status2) == (0x01, 0x00)
    assert tesla(raw, asa) == pytest.approx([10e-6, 30e-6, 40e-6], abs=0.1e-6)
    assert mag.read(0x02, 1) == b'\x00'


def test_an_unread_measurement_is_an_overrun(make_chip, clock):
    bus, mag, _ = make_chip()
    bus.write(0x37, b'\x02')
    mag.write(0x0A, b'\x16')
    clock.sleep(0.025)
    assert mag.read(0x02, 1) == b'\x03'


def test_data_are_frozen_until_st2_is_read(make_chip, clock):
    bus, mag, source = make_chip()
    bus.write(0x37, b'\x02')
    mag.write(0x0A, b'\x16')
    clock.sleep(0.011)
    before = mag.read(0x03, 6)
    source.values['magnetic_field'] = (1e-3, 1e-3, 1e-3)
    clock.sleep(0.05)
    assert mag.read(0x03, 6) == before
    mag.read(0x09, 1)
    clock.sleep(0.011)
    assert mag.read(0x03, 6) != before


def test_a_field_too_strong_is_flagged(make_chip, clock, make_source):
    bus, mag, _ = make_chip(source=make_source(magnetic_field=(3e-3, 1e-3, 1e-3)))
    bus.write(0x37, b'\x02')
    mag.write(0x0A, b'\x16')
    clock.sleep(0.011)
    assert mag.read(0x02, 8)[7] == 0x08


def test_modes_change_through_power_down_after_100_us(make_chip, clock):
    bus, mag, _ = make_chip()
    bus.write(0x37, b'\x02')
    mag.write(0x0A, b'\x12')
    mag.write(0x0A, b'\x16')
    assert mag.read(0x0A, 1) == b'\x12'
    mag.write(0x0A, b'\x10')
    mag.write(0x0A, b'\x16')  # the write itself takes 67 µs, less than asked for
    assert mag.read(0x0A, 1) == b'\x10'
    clock.sleep(0.0001)
    mag.write(0x0A, b'\x16')
    assert mag.read(0x0A, 1) == b'\x16'


def test_a_single_measurement_ends_in_power_down(make_chip, clock):
    bus, mag, _ = make_chip()
    bus.write(0x37, b'\x02')
    mag.write(0x0A, b'\x11')
    clock.sleep(0.009)
    assert mag.read(0x0A, 1) == b'\x10'
    assert mag.read(0x02, 1) == b'\x01'


def test_fourteen_bits_are_four_times_coarser(make_chip, clock, make_source):
    bus, mag, _ = make_chip(
        source=make_source(magnetic_field=(0.0, 600e-6, 0.0)), asa=(128, 128, 128)
    )
    bus.write(0x37, b'\x02')
    mag.write(0x0A, b'\x06')
    clock.sleep(0.011)
    assert struct.unpack('<h', mag.read(0x03, 2)) == (1000,)


def test_soft_reset(make_chip, clock):
    bus, mag, _ = make_chip()
    bus.write(0x37, b'\x02')
    mag.write(0x0A, b'\x16')
    mag.write(0x0B, b'\x01')
    assert mag.read(0x0A, 2) == b'\x00\x00'


def slave4(bus, clock, address, register, value=0):
    bus.read(0x36, 1)
    bus.write(0x31, bytes([address, register, value, 0x80]))
    clock.sleep(0.002)
    return bus.read(0x36, 1)[0], bus.read(0x35, 1)[0]


def test_slave_4_reaches_the_magnetometer(make_chip, clock):
    bus, mag, _ = make_chip('spi')
    assert mag is None
    assert slave4(bus, clock, 0x8C, 0x00)[0] == 0x00  # the master is off
    bus.write(0x6A, b'\x30')
    assert slave4(bus, clock, 0x8C, 0x00) == (0x40, 0x48)
    assert slave4(bus, clock, 0x0C, 0x0A, 0x16)[0] == 0x40
    assert slave4(bus, clock, 0x8C, 0x0A) == (0x40, 0x16)
    assert slave4(bus, clock, 0x8D, 0x00)[0] == 0x50
    assert bus.read(0x34, 1) == b'\x00'


def test_slave_0_puts_the_magnetometer_into_the_fifo(make_chip, clock, start_fifo, count):
    bus, _, _ = make_chip('spi')
    bus.write(0x6A, b'\x30')
    slave4(bus, clock, 0x0C, 0x0A, 0x16)
    bus.write(0x25, b'\x8c\x02\x88')
    start_fifo(bus, enabled=0x79, user=0x70)
    clock.sleep(0.0205)
    level = count(bus)
    assert level % 20 == 0
    frames = np.frombuffer(bus.read(0x74, level), np.uint8).reshape(-1, 20)
    assert (frames[:, 12] & 1).sum() == 2  # new twice in 20 ms
    assert bus.read(0x49, 8)[7] == 0
