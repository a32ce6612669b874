# SPDX-License-Identifier: Apache-2.0
"""
The emulated MPU-9250, talked to with bare register numbers and decoded by hand.

Nothing here uses the driver's tables: numbers and formulas come from the register map
(RM-MPU-9250A-00) and the AK8963 data sheet, so a wrong table cannot prove itself.
"""

import math
import struct

from imu_bench.emulators import create
from imu_bench.emulators.line import Line, Timing
from imu_bench.errors import ConfigError, NoAnswer
import numpy as np
import pytest


# --- identity, reset, timing -------------------------------------------------------------
def test_reset_values(make_chip):
    bus, _, _ = make_chip()
    assert bus.read(0x75, 1) == b'\x71'
    assert bus.read(0x6B, 1) == b'\x01'
    assert bus.read(0x19, 11) == bytes(11)
    bus.write(0x75, b'\x00')
    assert bus.read(0x75, 1) == b'\x71'


def test_nothing_answers_during_start_up(make_chip, clock):
    bus, _, _ = make_chip()
    bus.write(0x1B, b'\x18')
    bus.write(0x6B, b'\x80')
    with pytest.raises(NoAnswer, match='emulated mpu9250 on i2c'):
        bus.read(0x75, 1)
    clock.sleep(0.011)
    assert bus.read(0x1B, 1) == b'\x00'


@pytest.mark.parametrize(('kind', 'bits'), [('i2c', 9 * (3 + 14) + 3), ('spi', 8 * (1 + 14) + 1)])
def test_bytes_take_their_time(make_chip, clock, kind, bits):
    bus, _, _ = make_chip(kind)
    before = clock.now_ns()
    bus.read(0x3B, 14)
    assert clock.now_ns() - before == pytest.approx(bits / {'i2c': 400e3, 'spi': 1e6}[kind] * 1e9)


def test_two_chips_on_one_line_wait_for_each_other(clock, make_source):
    line = Line(clock, Timing.i2c(100e3))
    one = create('mpu9250', 'i2c', make_source(), clock, line=line)['']
    two = create('mpu9250', 'i2c', make_source(), clock, line=line)['']
    clock.sleep(0.1)
    before = clock.now_ns()
    one.read(0x75, 1)
    two.read(0x75, 1)
    assert clock.now_ns() - before == 2 * round((4 * 9 + 3) * 1e4)


def test_only_buses_the_sensor_has(clock, make_source):
    with pytest.raises(ConfigError, match='i2c, spi'):
        create('mpu9250', 'serial', make_source(), clock)


# --- data registers ----------------------------------------------------------------------
@pytest.mark.parametrize(('code', 'per_g'), list(enumerate([16384, 8192, 4096, 2048])))
def test_acceleration_at_every_range(make_chip, clock, make_source, code, per_g):
    g = (0.5, -0.25, 1.0)
    bus, _, _ = make_chip(source=make_source(acceleration=[9.80665 * x for x in g]))
    bus.write(0x1C, bytes([code << 3]))
    clock.sleep(0.01)
    assert struct.unpack('>hhh', bus.read(0x3B, 6)) == tuple(round(x * per_g) for x in g)


@pytest.mark.parametrize(('code', 'per_dps'), list(enumerate([131, 65.5, 32.8, 16.4])))
def test_angular_velocity_at_every_range(make_chip, clock, make_source, code, per_dps):
    dps = (100.0, -200.0, 0.0)
    bus, _, _ = make_chip(source=make_source(angular_velocity=[math.radians(x) for x in dps]))
    bus.write(0x1B, bytes([code << 3]))
    clock.sleep(0.01)
    expected = tuple(round(x * per_dps) for x in dps)
    assert struct.unpack('>hhh', bus.read(0x43, 6)) == expected


def test_saturation_at_full_scale(make_chip, clock, make_source):
    bus, _, _ = make_chip(
        source=make_source(acceleration=(25.0, -25.0, 0.0), angular_velocity=(5.0, -5.0, 0.0))
    )
    clock.sleep(0.01)  # 2 g and 250 dps after reset
    assert struct.unpack('>hhh', bus.read(0x3B, 6)) == (32767, -32768, 0)
    assert struct.unpack('>hhh', bus.read(0x43, 6)) == (32767, -32768, 0)


def test_temperature(make_chip, clock, make_source):
    bus, _, _ = make_chip(source=make_source(temperature=31.0))
    clock.sleep(0.01)
    assert struct.unpack('>h', bus.read(0x41, 2)) == (3339,)


def test_a_sleeping_chip_keeps_its_data(make_chip, clock, make_source):
    source = make_source()
    bus, _, _ = make_chip(source=source)
    clock.sleep(0.01)
    before = bus.read(0x3B, 6)
    bus.write(0x6B, b'\x41')
    source.values['acceleration'] = (1.0, 2.0, 3.0)
    clock.sleep(0.01)
    assert bus.read(0x3B, 6) == before
    bus.write(0x6B, b'\x01')
    clock.sleep(0.01)
    assert bus.read(0x3B, 6) != before


# --- rate --------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ('config', 'divider', 'gyro', 'rate'),
    [
        (1, 0, 0, 1000.0),
        (1, 4, 0, 200.0),
        (6, 249, 0, 4.0),
        (0, 9, 0, 8000.0),
        (7, 0, 0, 8000.0),
        (1, 0, 1, 32000.0),
        (1, 0, 2, 32000.0),
    ],
)
def test_rate_by_registers_25_to_27(make_chip, config, divider, gyro, rate):
    bus, _, source = make_chip()
    bus.write(0x1A, bytes([config]))
    bus.write(0x1B, bytes([gyro]))
    bus.write(0x19, bytes([divider]))
    assert source.nominal_hz == rate


def test_the_oscillator_is_the_chips_own(make_chip, clock, make_source, start_fifo, count):
    source = make_source()
    source.rate_error = 0.01
    bus, _, _ = make_chip(source=source)
    start_fifo(bus)
    arrived = 0
    start = clock.now_ns()
    while clock.now_ns() - start < 10_000_000_000:
        clock.sleep(0.02)
        level = count(bus)
        bus.read(0x74, level)
        arrived += level
    elapsed = (clock.now_ns() - start) * 1e-9
    assert arrived / 12 == pytest.approx(1010 * elapsed, abs=12)


def test_the_low_pass_of_the_registers_filters_noise(
    make_chip, clock, make_source, start_fifo, count
):
    rng = np.random.default_rng(1)

    class Noisy(type(make_source())):
        def samples_until(self, t_ns):
            samples = super().samples_until(t_ns)
            return type(samples)(
                samples.stamps, rng.normal(0, 1.0, (len(samples), 3)), samples.angular_velocity
            )

    def deviation(code):
        source = make_source()
        source.__class__ = Noisy
        bus, _, _ = make_chip(source=source)
        start_fifo(bus, enabled=0x08)
        bus.write(0x1D, bytes([code]))
        data = b''
        for _ in range(200):
            clock.sleep(0.02)
            data += bus.read(0x74, count(bus))
        return np.frombuffer(data, '>i2').std() / 2048 * 9.80665

    # white noise of density d up to 500 Hz is d²·500; first order at f passes d²·f·π/2
    assert deviation(7) == pytest.approx(1.0, rel=0.15)
    assert deviation(5) == pytest.approx(math.sqrt(10 * math.pi / 2 / 500), rel=0.15)


# --- FIFO --------------------------------------------------------------------------------
def test_a_frame_as_in_the_documents(make_chip, clock, make_source, start_fifo, count):
    source = make_source(
        acceleration=(0.0, 0.0, 9.80665),
        angular_velocity=(math.radians(10), 0.0, -math.radians(10)),
        temperature=31.0,
    )
    bus, _, _ = make_chip(source=source)
    start_fifo(bus, enabled=0x78)
    clock.sleep(0.005)
    frame = bytes.fromhex('0000 0000 0800 00A4 0000 FF5C')
    level = count(bus)
    assert level % 12 == 0
    assert level >= 48
    assert bus.read(0x74, level) == frame * (level // 12)
    start_fifo(bus, enabled=0xF8)
    clock.sleep(0.005)
    assert bus.read(0x74, 14) == frame[:6] + b'\x0d\x0b' + frame[6:]


@pytest.mark.parametrize(
    ('enabled', 'size'), [(0x08, 6), (0x80, 2), (0x40, 2), (0x20, 2), (0x70, 6), (0x58, 10)]
)
def test_the_frame_has_what_is_enabled(make_chip, clock, enabled, size, start_fifo, count):
    bus, _, _ = make_chip()
    start_fifo(bus, enabled=enabled)
    before = clock.now_ns()
    clock.sleep(0.0105)
    level = count(bus)
    assert level % size == 0
    assert level // size == pytest.approx((clock.now_ns() - before) * 1e-6, abs=1.5)


def test_an_empty_fifo_repeats_its_last_byte(make_chip, clock, start_fifo, count):
    bus, _, _ = make_chip()
    start_fifo(bus)
    clock.sleep(0.005)
    bus.write(0x23, b'\x00')
    data = bus.read(0x74, count(bus))
    assert bus.read(0x74, 3) == data[-1:] * 3
    assert count(bus) == 0


def test_the_count_is_latched_when_its_high_byte_is_read(make_chip, clock, start_fifo, count):
    bus, _, _ = make_chip()
    start_fifo(bus)
    clock.sleep(0.01)
    latched = count(bus)
    clock.sleep(0.01)
    assert bus.read(0x73, 1)[0] == latched & 0xFF
    assert count(bus) > latched


def test_an_overflow_keeps_512_bytes_breaks_the_frames_and_says_so(
    make_chip, clock, make_source, start_fifo, count
):
    # the document's frame begins with four zero bytes, so the order of the frames shows
    source = make_source(acceleration=(0.0, 0.0, 9.80665), angular_velocity=(0.0, 0.0, 0.0))
    bus, _, _ = make_chip(source=source)
    start_fifo(bus)
    clock.sleep(0.040)
    assert bus.read(0x3A, 1)[0] & 0x10 == 0
    clock.sleep(0.010)
    assert count(bus) == 512
    status = bus.read(0x3A, 1)[0]
    assert status & 0x10
    data = bus.read(0x74, 504)
    assert data[:12] != bytes.fromhex('0000 0000 0800 0000 0000 0000')
    assert data[8:20] == bytes.fromhex('0000 0000 0800 0000 0000 0000')
    assert bus.read(0x3A, 1)[0] & 0x10 == 0x10  # it ran over while it was read
    clock.sleep(0.0001)
    bus.write(0x6A, b'\x44')
    bus.read(0x3A, 1)
    assert bus.read(0x3A, 1)[0] & 0x10 == 0
    assert bus.read(0x6A, 1) == b'\x40'  # the reset bit clears itself


def test_a_fifo_that_stops_keeps_the_oldest(make_chip, clock, make_source, start_fifo, count):
    bus, _, source = make_chip()
    start_fifo(bus, config=0x41)
    clock.sleep(0.02)
    assert count(bus) < 512
    source.values['acceleration'] = (1.0, 1.0, 1.0)
    clock.sleep(0.1)
    assert count(bus) == 512
    assert bus.read(0x74, 6) == bytes.fromhex('0000 0000 0800')


def test_interrupt_flags_clear_on_read_and_need_their_enable(make_chip, clock, start_fifo):
    bus, _, _ = make_chip()
    start_fifo(bus)
    clock.sleep(0.002)
    assert bus.read(0x3A, 1)[0] & 0x01
    bus.write(0x38, b'\x00')
    bus.read(0x3A, 1)
    clock.sleep(0.1)
    assert bus.read(0x3A, 1) == b'\x00'


@pytest.mark.slow
def test_a_transfer_that_is_too_slow_loses_bytes(clock, make_source, start_fifo, count):
    line = Line(clock, Timing.i2c(100e3))  # 12 bytes cost 1.08 ms of every ms
    bus = create('mpu9250', 'i2c', make_source(), clock, line=line)['']
    clock.sleep(0.1)
    start_fifo(bus)
    lost = False
    for _ in range(200):
        bus.read(0x74, count(bus) // 12 * 12)
        lost |= bool(bus.read(0x3A, 1)[0] & 0x10)
    assert lost


def test_nobody_asked_for_a_long_time(make_chip, clock, start_fifo, count):
    bus, _, source = make_chip()
    start_fifo(bus)
    clock.sleep(3600.0)
    assert count(bus) == 512
    assert source.made < 2000
