# SPDX-License-Identifier: Apache-2.0
"""
The FIFO of the emulated LSM9DS1, talked to with bare register numbers and decoded by hand.

Numbers come from DocID025715 rev. 2, sections 3.3 and 3.5, not from the driver's tables.
"""

import math

from imu_bench.emulators.line import Line, Timing
import numpy as np

G = 9.80665


def test_a_slot_is_gyroscope_and_accelerometer_of_one_instant(
    chip, clock, make_source, on, fifo, level
):
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


def test_the_level_counts_slots_and_a_burst_takes_them_out(chip, clock, on, fifo, level):
    bus, _, _ = chip()
    on(bus, clock)
    fifo(bus)
    assert level(bus) == 0
    clock.sleep(0.01)
    before = level(bus)
    assert before in (9, 10)
    bus.read(0x18, 12 * 4)
    assert level(bus) in (before - 3, before - 2)  # 1.1 ms have passed


def test_gyroscope_and_accelerometer_may_be_read_one_after_the_other(chip, clock, on, fifo, level):
    bus, _, _ = chip()
    on(bus, clock, rate=3)
    fifo(bus)
    clock.sleep(0.1)
    before = level(bus)
    bus.read(0x18, 6)
    assert level(bus) == before
    bus.read(0x28, 6)
    assert level(bus) == before - 1


def test_an_overrun_keeps_the_newest_32_and_says_so_until_one_is_read(
    chip, clock, make_source, on, fifo
):
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


def test_bypass_empties_and_the_threshold_is_flagged(chip, clock, on, fifo):
    bus, _, _ = chip()
    on(bus, clock)
    fifo(bus, 0xC0 | 8)
    clock.sleep(0.005)
    assert bus.read(0x2F, 1)[0] & 0x80 == 0
    clock.sleep(0.005)
    assert bus.read(0x2F, 1)[0] & 0x80
    bus.write(0x2E, b'\x00')
    assert bus.read(0x2F, 1) == b'\x00'


def test_fifo_mode_stops_and_keeps_the_oldest(chip, clock, make_source, on, fifo, level):
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


def test_the_depth_can_be_limited(chip, clock, on, level):
    bus, _, _ = chip()
    on(bus, clock)
    bus.write(0x23, b'\x03')
    bus.write(0x2E, b'\x00')
    bus.write(0x2E, bytes([0xC0 | 9]))
    clock.sleep(0.1)
    assert level(bus) == 10


def test_an_empty_fifo_repeats_its_last_slot(chip, clock, on, fifo, level):
    bus, _, _ = chip()
    on(bus, clock, rate=1)
    fifo(bus)
    clock.sleep(0.1)
    last = bus.read(0x18, 12 * level(bus))[-12:]
    assert bus.read(0x18, 24) == last * 2


def test_a_burst_longer_than_the_fifo_gets_what_comes_meanwhile(chip, clock, on, fifo, level):
    bus, _, _ = chip(line=Line(clock, Timing.i2c(100e3)))
    on(bus, clock)
    fifo(bus)
    clock.sleep(0.003)
    bus.read(0x18, 12 * 20)  # 1.08 ms per slot of 1.05 ms
    assert level(bus) <= 5


def test_a_bus_that_is_too_slow_runs_over(chip, clock, on, fifo):
    bus, _, _ = chip(line=Line(clock, Timing.i2c(50e3)))
    on(bus, clock)
    fifo(bus)
    overrun = False
    for _ in range(50):
        source = bus.read(0x2F, 1)[0]
        overrun |= bool(source & 0x40)
        bus.read(0x18, 12 * (source & 0x3F))
    assert overrun


def test_nobody_asked_for_a_long_time(chip, clock, on, fifo, level):
    bus, magnetometer, source = chip()
    on(bus, clock)
    fifo(bus)
    magnetometer.write(0x22, b'\x00')
    clock.sleep(3600.0)
    assert level(bus) == 32
    assert source.made < 2000
    assert magnetometer.read(0x27, 1) == b'\xff'
