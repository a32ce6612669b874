# SPDX-License-Identifier: Apache-2.0
"""
The emulated LSM9DS1, talked to with bare register numbers and decoded by hand.

Nothing here uses the driver's tables: numbers and formulas come from DocID025715 rev. 2, so a
wrong table cannot prove itself.
"""

import math
import struct

from imu_bench.emulators import create
from imu_bench.errors import ConfigError, NoAnswer
import numpy as np
import pytest

G = 9.80665


# --- identity, reset, timing -------------------------------------------------------------
def test_reset_values(chip):
    bus, magnetometer, _ = chip()
    assert bus.read(0x0F, 1) == b'\x68'
    assert bus.read(0x1E, 7) == bytes.fromhex('38 38 00 00 04 00 00')
    assert magnetometer.read(0x0F, 1) == b'\x3d'
    assert magnetometer.read(0x20, 5) == bytes.fromhex('10 00 03 00 00')
    bus.write(0x0F, b'\x00')
    assert bus.read(0x0F, 1) == b'\x68'


def test_a_software_reset_clears_itself_and_everything_else(chip, clock, on):
    bus, magnetometer, _ = chip()
    on(bus, clock)
    bus.write(0x22, b'\x05')
    assert bus.read(0x22, 1) == b'\x04'
    assert bus.read(0x10, 1) == b'\x00'
    magnetometer.write(0x22, b'\x00')
    magnetometer.write(0x21, b'\x0c')
    assert magnetometer.read(0x20, 3) == bytes.fromhex('10 00 03')


def test_nothing_answers_right_after_power_up(clock, make_source):
    buses = create('lsm9ds1', 'i2c', make_source(), clock)
    for bus in buses.values():
        with pytest.raises(NoAnswer, match='emulated lsm9ds1 on i2c'):
            bus.read(0x0F, 1)
    clock.sleep(0.01)
    assert buses[''].read(0x0F, 1) == b'\x68'


@pytest.mark.parametrize(('kind', 'bits'), [('i2c', 9 * (3 + 12) + 3), ('spi', 8 * (1 + 12) + 1)])
def test_bytes_take_their_time(chip, clock, kind, bits):
    bus, _, _ = chip(kind)
    before = clock.now_ns()
    bus.read(0x18, 12)
    assert clock.now_ns() - before == pytest.approx(bits / {'i2c': 400e3, 'spi': 1e6}[kind] * 1e9)


def test_only_buses_the_sensor_has(clock, make_source):
    with pytest.raises(ConfigError, match='i2c, spi'):
        create('lsm9ds1', 'serial', make_source(), clock)


# --- addresses ---------------------------------------------------------------------------
def test_the_main_die_increments_if_control_register_8_says_so(chip):
    bus, _, _ = chip()
    assert bus.read(0x0F, 2) == b'\x68\x00'
    bus.write(0x22, b'\x00')
    assert bus.read(0x0F, 2) == b'\x68\x68'


@pytest.mark.parametrize(('kind', 'bit'), [('i2c', 0x80), ('spi', 0x40)])
def test_the_magnetometer_increments_with_a_bit_of_the_address(chip, clock, kind, bit):
    _, bus, _ = chip(kind)
    die, now = bus.chip, clock.now_ns()
    assert die.read(0x0F, 2, now, 0.0) == b'\x3d\x3d'
    assert die.read(0x20 | bit, 3, now, 0.0) == bytes.fromhex('10 00 03')


def test_a_burst_jumps_from_one_output_to_the_other_and_back(chip, clock, make_source, on):
    source = make_source(acceleration=(0.0, 0.0, G), angular_velocity=(0.0, 0.0, math.radians(50)))
    bus, _, _ = chip(source=source)
    on(bus, clock)
    gyroscope, accelerometer = bus.read(0x18, 6), bus.read(0x28, 6)
    assert bus.read(0x18, 24) == (gyroscope + accelerometer) * 2
    assert bus.read(0x2A, 10) == accelerometer[2:] + gyroscope
    bus.write(0x10, b'\x00')  # accelerometer alone: it stays there
    clock.sleep(0.2)
    assert bus.read(0x28, 12) == accelerometer * 2


# --- data registers ----------------------------------------------------------------------
@pytest.mark.parametrize(('code', 'mg'), [(0, 0.061), (2, 0.122), (3, 0.244), (1, 0.732)])
def test_acceleration_at_every_range_and_left_handed(chip, clock, make_source, code, mg, on):
    g = (0.5, -0.25, 1.0)  # right-handed
    bus, _, _ = chip(source=make_source(acceleration=[G * x for x in g]))
    on(bus, clock, accelerometer=code)
    expected = (-0.5e3 / mg, -0.25e3 / mg, 1e3 / mg)
    assert struct.unpack('<hhh', bus.read(0x28, 6)) == tuple(round(x) for x in expected)


@pytest.mark.parametrize(('code', 'mdps'), [(0, 8.75), (1, 17.5), (3, 70.0)])
def test_angular_velocity_at_every_range_and_left_handed(chip, clock, make_source, code, mdps, on):
    dps = (100.0, -200.0, 50.0)
    bus, _, _ = chip(source=make_source(angular_velocity=[math.radians(x) for x in dps]))
    on(bus, clock, gyroscope=code)
    expected = (-100e3 / mdps, -200e3 / mdps, 50e3 / mdps)
    assert struct.unpack('<hhh', bus.read(0x18, 6)) == tuple(round(x) for x in expected)


def test_saturation_at_the_end_of_the_word(chip, clock, make_source, on):
    bus, _, _ = chip(
        source=make_source(acceleration=(25.0, 25.0, -25.0), angular_velocity=(6.0, 6.0, -6.0))
    )
    on(bus, clock)
    assert struct.unpack('<hhh', bus.read(0x28, 6)) == (-32768, 32767, -32768)
    assert struct.unpack('<hhh', bus.read(0x18, 6)) == (-32768, 32767, -32768)


@pytest.mark.parametrize(('celsius', 'word'), [(35.0, 160), (25.0, 0), (-15.0, -640)])
def test_temperature_has_16_lsb_per_kelvin_and_zero_at_25(
    chip, clock, make_source, celsius, word, on
):
    bus, _, _ = chip(source=make_source(temperature=celsius))
    on(bus, clock)
    assert struct.unpack('<h', bus.read(0x15, 2)) == (word,)


@pytest.mark.parametrize(('code', 'per_gauss'), [(0, 6842), (1, 3421), (2, 2281), (3, 1711)])
def test_field_at_every_range(chip, clock, make_source, code, per_gauss, on):
    gauss = (0.2, -0.1, 0.4)
    bus, magnetometer, _ = chip(source=make_source(magnetic_field=[1e-4 * x for x in gauss]))
    on(bus, clock)
    magnetometer.write(0x20, b'\xfc')
    magnetometer.write(0x21, bytes([code << 5]))
    magnetometer.write(0x22, b'\x00')
    clock.sleep(0.1)
    expected = tuple(round(x * per_gauss) for x in gauss)
    assert struct.unpack('<hhh', magnetometer.read(0x28, 6)) == expected


# --- flags -------------------------------------------------------------------------------
def test_new_data_are_flagged_until_they_are_read(chip, clock, on):
    bus, _, _ = chip()
    on(bus, clock, rate=1)
    assert bus.read(0x17, 1)[0] & 0x07 == 0x07
    assert bus.read(0x27, 1)[0] & 0x07 == 0x07
    bus.read(0x28, 6)
    assert bus.read(0x17, 1)[0] & 0x07 == 0x06
    bus.read(0x18, 6)
    bus.read(0x15, 2)
    assert bus.read(0x17, 1)[0] & 0x07 == 0x00
    clock.sleep(0.07)
    assert bus.read(0x17, 1)[0] & 0x03 == 0x03


def test_temperature_is_refreshed_59_times_a_second(chip, clock, on):
    bus, _, _ = chip()
    on(bus, clock)
    fresh, start = 0, clock.now_ns()
    while clock.now_ns() - start < 2_000_000_000:
        clock.sleep(0.002)
        if bus.read(0x17, 1)[0] & 0x04:
            fresh += 1
            bus.read(0x15, 2)
    assert fresh == pytest.approx(119, abs=2)


def test_block_update_keeps_a_word_that_was_read_half(chip, clock, make_source, on):
    source = make_source(acceleration=(0.0, 0.0, 1.0 * 0.061e-3 * G * 256))
    bus, _, _ = chip(source=source)
    on(bus, clock)
    assert bus.read(0x2C, 1) == b'\x00'  # low byte of 0x0100
    source.values['acceleration'] = (0.0, 0.0, 0.0)
    clock.sleep(0.2)
    assert bus.read(0x2D, 1) == b'\x01'
    assert bus.read(0x2D, 1) == b'\x00'
    bus.write(0x22, b'\x04')
    source.values['acceleration'] = (0.0, 0.0, 1.0 * 0.061e-3 * G * 256)
    clock.sleep(0.2)
    assert bus.read(0x2C, 1) == b'\x00'
    source.values['acceleration'] = (0.0, 0.0, 0.0)
    clock.sleep(0.2)
    assert bus.read(0x2D, 1) == b'\x00'  # torn


def test_the_magnetometer_flags_new_and_overwritten_data(chip, clock):
    _, bus, _ = chip()
    bus.write(0x20, b'\xfc')
    bus.write(0x24, b'\x40')
    bus.write(0x22, b'\x00')
    clock.sleep(0.0126)
    assert bus.read(0x27, 1) == b'\x0f'
    clock.sleep(0.0126)
    assert bus.read(0x27, 1) == b'\xff'
    bus.read(0x28, 6)
    assert bus.read(0x27, 1) == b'\x00'


@pytest.mark.parametrize(('code', 'rate'), [(0, 0.625), (4, 10.0), (7, 80.0)])
def test_the_rate_of_the_magnetometer(chip, clock, code, rate):
    _, bus, _ = chip()
    bus.write(0x20, bytes([code << 2]))
    bus.write(0x22, b'\x00')
    fresh, start = 0, clock.now_ns()
    while clock.now_ns() - start < 20_000_000_000:
        clock.sleep(0.3 / rate)
        if bus.read(0x27, 1)[0] & 0x08:
            fresh += 1
            bus.read(0x28, 6)
    assert fresh == pytest.approx(20 * rate, abs=2)
    bus.write(0x22, b'\x03')
    bus.read(0x28, 6)
    clock.sleep(5.0)
    assert bus.read(0x27, 1) == b'\x00'


# --- rate and filters --------------------------------------------------------------------
@pytest.mark.parametrize(
    ('code', 'rate'), [(1, 14.9), (2, 59.5), (3, 119.0), (4, 238.0), (5, 476.0), (6, 952.0)]
)
def test_with_the_gyroscope_on_its_rate_is_that_of_both(chip, code, rate):
    bus, _, source = chip()
    bus.write(0x20, b'\x60')
    assert source.nominal_hz == 119.0
    bus.write(0x10, bytes([code << 5]))
    assert source.nominal_hz == rate


@pytest.mark.parametrize(('code', 'rate'), [(1, 10.0), (2, 50.0), (6, 952.0)])
def test_the_accelerometer_alone_has_rates_of_its_own(chip, clock, code, rate, fifo, level):
    bus, _, source = chip()
    bus.write(0x20, bytes([code << 5]))
    assert source.nominal_hz == rate
    fifo(bus)
    clock.sleep(10.0 / rate)
    count = level(bus)
    assert count == pytest.approx(10, abs=1)
    assert len(bus.read(0x28, 6 * count)) == 6 * count
    assert level(bus) <= 2


@pytest.mark.slow
def test_the_filters_of_the_registers_filter_noise(chip, clock, make_source, fifo, level):
    rng = np.random.default_rng(1)

    class Noisy(type(make_source())):
        def samples_until(self, t_ns):
            samples = super().samples_until(t_ns)
            noise = rng.normal(0, 1.0, (len(samples), 3))
            return type(samples)(samples.stamps, noise, noise)

    def deviations(accelerometer, gyroscope, output):
        source = make_source()
        source.__class__ = Noisy
        bus, _, _ = chip(source=source)
        bus.write(0x20, bytes([0xC0 | 0x08 | accelerometer]))
        bus.write(0x11, bytes([output]))
        bus.write(0x10, bytes([0xC0 | 0x18 | gyroscope]))
        fifo(bus)
        clock.sleep(0.02)
        data = b''
        for _ in range(200):
            clock.sleep(0.02)
            data += bus.read(0x18, 12 * level(bus))
        words = np.frombuffer(data, '<i2').reshape(-1, 6)[30:]
        return words[:, 3:].std() * 0.732e-3 * G, math.radians(words[:, :3].std() * 0.07)

    def passed(hertz):  # analogue, of first order, sampled at 952 Hz
        p = math.exp(-2.0 * math.pi * hertz / 952)
        return math.sqrt((1 - p) / (1 + p))

    wide = deviations(0x04, 0, 0)
    assert wide == pytest.approx((passed(408), passed(100)), rel=0.05)
    narrow = deviations(0x07, 0, 2)
    assert narrow == pytest.approx((passed(50), passed(33)), rel=0.05)
    automatic = deviations(0x03, 3, 2)
    assert automatic == pytest.approx((passed(408), passed(100)), rel=0.05)


def test_after_turn_on_the_first_samples_are_not_settled(
    chip, clock, make_source, on, fifo, level
):
    bus, _, _ = chip(source=make_source(acceleration=(0.0, 0.0, G)))
    fifo(bus)
    on(bus, clock, settle=False)
    clock.sleep(0.033)
    words = np.frombuffer(bus.read(0x18, 12 * level(bus)), '<i2').reshape(-1, 6)[:, 5]
    settled = round(1e3 / 0.061)
    assert (words[:18] < settled).all()
    assert (words[18:] == settled).all()
