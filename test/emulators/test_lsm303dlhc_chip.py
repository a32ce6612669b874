# SPDX-License-Identifier: Apache-2.0
"""
The emulated LSM303DLHC, talked to with bare register numbers and decoded by hand.

Nothing here uses the driver's tables: numbers and formulas come from Doc ID 018771 rev. 1, so a
wrong table cannot prove itself.
"""

import math
import struct

from imu_bench.emulators import create
from imu_bench.emulators.line import Line, Timing
from imu_bench.errors import ConfigError, NoAnswer
import numpy as np
import pytest

G = 9.80665


@pytest.fixture
def chip(clock, make_source):
    """Return main bus, magnetometer bus and source of a chip that is awake."""

    def make(source=None, **options):
        source = source or make_source()
        buses = create('lsm303dlhc', 'i2c', source, clock, **options)
        clock.sleep(0.1)
        return buses[''], buses['magnetometer'], source

    return make


def on(bus, clock, rate=9, scale=0):
    """Normal mode, all axes, block update, 12 bit."""
    bus.write(0x23, bytes([0x88 | scale << 4]))
    bus.write(0x20, bytes([rate << 4 | 0x07]))
    clock.sleep(10.0 if rate == 1 else 1.0)


def fifo(bus, mode=0x80):
    bus.write(0x24, b'\x40')
    bus.write(0x2E, b'\x00')
    bus.write(0x2E, bytes([mode]))


def level(bus):
    return bus.read(0x2F, 1)[0] & 0x1F


def words(data):
    """Left-justified words of 12 bit, low byte first."""
    return np.frombuffer(data, '<i2').reshape(-1, 3) >> 4


# --- identity, addresses, timing ---------------------------------------------------------
def test_reset_values(chip):
    bus, magnetometer, _ = chip()
    assert bus.read(0x20, 8) == bytes.fromhex('07 00 00 00 00 00 00 00')
    assert magnetometer.read(0x00, 3) == bytes.fromhex('10 20 03')
    assert magnetometer.read(0x0A, 3) == b'H43'


def test_nothing_answers_right_after_power_up(clock, make_source):
    buses = create('lsm303dlhc', 'i2c', make_source(), clock)
    for bus in buses.values():
        with pytest.raises(NoAnswer, match='emulated lsm303dlhc on i2c'):
            bus.read(0x0A, 1)
    clock.sleep(0.005)
    assert buses['magnetometer'].read(0x0A, 1) == b'H'


def test_without_bit_7_the_accelerometer_repeats_a_byte(chip, clock):
    bus, _, _ = chip()
    on(bus, clock)
    die, now = bus.chip, clock.now_ns()
    assert die.read(0x20, 3, now, 0.0) == b'\x97\x97\x97'
    assert die.read(0x20 | 0x80, 4, now, 0.0) == bytes.fromhex('97 00 00 88')


def test_the_pointer_of_the_magnetometer_goes_round(chip):
    _, bus, _ = chip()
    assert bus.read(0x06, 5)[3:] == bus.read(0x03, 2)  # 06 07 08 03 04
    assert bus.read(0x0A, 5) == bytes.fromhex('48 34 33 10 20')  # 0A 0B 0C 00 01
    assert bus.read(0x31, 2)[1:] == b'\x10'  # the second byte is register 00


def test_bytes_take_their_time(chip, clock):
    bus, _, _ = chip()
    before = clock.now_ns()
    bus.read(0x28, 6)
    assert clock.now_ns() - before == round((9 * (3 + 6) + 3) / 400e3 * 1e9)


def test_only_i2c(clock, make_source):
    with pytest.raises(ConfigError, match='it can be on i2c'):
        create('lsm303dlhc', 'spi', make_source(), clock)


def test_a_reboot_clears_its_bit_and_leaves_the_settings(chip, clock):
    bus, _, _ = chip()
    on(bus, clock)
    bus.write(0x24, b'\xc0')
    assert bus.read(0x24, 1) == b'\x40'
    assert bus.read(0x20, 1) == b'\x97'


# --- data registers ----------------------------------------------------------------------
@pytest.mark.parametrize(('code', 'mg'), [(0, 1), (1, 2), (2, 4), (3, 12)])
def test_acceleration_at_every_range(chip, clock, make_source, code, mg):
    g = (0.5, -0.25, 1.0)
    bus, _, _ = chip(source=make_source(acceleration=[G * x for x in g]))
    on(bus, clock, scale=code)
    data = bus.read(0x28, 6)
    assert words(data).tolist() == [[round(x * 1e3 / mg) for x in g]]
    assert all(low & 0x0F == 0 for low in data[::2])


def test_saturation_at_12_bit(chip, clock, make_source):
    bus, _, _ = chip(source=make_source(acceleration=(25.0, -25.0, 0.0)))
    on(bus, clock)
    assert words(bus.read(0x28, 6)).tolist() == [[2047, -2048, 0]]


def test_without_high_resolution_there_are_10_bit(chip, clock, make_source):
    bus, _, _ = chip(source=make_source(acceleration=(0.0, 0.0, 0.9995 * G)))
    bus.write(0x20, b'\x97')
    clock.sleep(0.1)
    assert words(bus.read(0x28, 6)).tolist() == [[0, 0, 1000]]
    bus.write(0x23, b'\x00')
    clock.sleep(0.1)
    assert bus.read(0x2C, 1)[0] & 0x3F == 0


def test_an_axis_that_is_off_reads_zero(chip, clock, make_source):
    bus, _, _ = chip(source=make_source(acceleration=(G, G, G)))
    bus.write(0x23, b'\x88')
    bus.write(0x20, b'\x95')
    clock.sleep(0.1)
    assert words(bus.read(0x28, 6)).tolist() == [[1000, 0, 1000]]


GAINS = [
    (1, 1100, 980),
    (2, 855, 760),
    (3, 670, 600),
    (4, 450, 400),
    (5, 400, 355),
    (6, 330, 295),
    (7, 230, 205),
]


@pytest.mark.parametrize(('code', 'xy', 'z'), GAINS)
def test_field_at_every_gain_in_the_order_x_z_y_high_byte_first(
    chip, clock, make_source, code, xy, z
):
    gauss = (0.2, -0.1, 0.4)
    _, bus, _ = chip(source=make_source(magnetic_field=[1e-4 * x for x in gauss]))
    bus.write(0x00, b'\x18')
    bus.write(0x01, bytes([code << 5]))
    bus.write(0x02, b'\x00')
    clock.sleep(0.3)
    expected = (round(0.2 * xy), round(0.4 * z), round(-0.1 * xy))
    assert struct.unpack('>hhh', bus.read(0x03, 6)) == expected


def test_the_field_saturates_at_12_bit(chip, clock, make_source):
    _, bus, _ = chip(source=make_source(magnetic_field=(3e-4, -3e-4, 3e-4)))
    bus.write(0x02, b'\x00')
    clock.sleep(0.3)
    assert struct.unpack('>hhh', bus.read(0x03, 6)) == (2047, 2047, -2048)


def test_temperature_only_when_enabled_left_justified(chip, clock, make_source):
    _, bus, _ = chip(source=make_source(temperature=30.0))
    bus.write(0x02, b'\x00')
    clock.sleep(0.3)
    assert (bus.read(0x31, 1), bus.read(0x32, 1)) == (b'\x00', b'\x00')
    bus.write(0x00, b'\x90')
    clock.sleep(0.3)
    # 80 at 8 LSB per kelvin from 20 °C on
    assert (bus.read(0x31, 1), bus.read(0x32, 1)) == (b'\x05', b'\x00')


# --- flags -------------------------------------------------------------------------------
def test_new_and_overwritten_accelerations_are_flagged(chip, clock):
    bus, _, _ = chip()
    on(bus, clock, rate=5)  # 100 Hz
    bus.read(0x28, 6)
    assert bus.read(0x27, 1)[0] & 0x80 == 0
    clock.sleep(0.0101)
    assert bus.read(0x27, 1) == b'\x0f'
    clock.sleep(0.0101)
    assert bus.read(0x27, 1) == b'\xff'
    bus.read(0x28, 2)
    assert bus.read(0x27, 1)[0] & 0x11 == 0


def test_the_ready_flag_of_the_field_and_its_lock(chip, clock, make_source):
    source = make_source(magnetic_field=(10e-6, 0.0, 0.0))
    _, bus, _ = chip(source=source)
    bus.write(0x00, b'\x18')
    assert bus.read(0x09, 1) == b'\x00'
    bus.write(0x02, b'\x00')
    clock.sleep(0.014)
    assert bus.read(0x09, 1) == b'\x01'
    first = bus.read(0x03, 2)
    assert bus.read(0x09, 1)[0] & 0x02
    source.values['magnetic_field'] = (20e-6, 0.0, 0.0)
    clock.sleep(0.3)
    assert bus.read(0x03, 2) == first  # locked
    bus.read(0x05, 4)
    assert bus.read(0x09, 1) == b'\x00'
    clock.sleep(0.3)
    assert struct.unpack('>h', bus.read(0x03, 2)) == (220,)


def test_a_flag_that_stays_is_away_only_while_data_are_written(chip, clock):
    _, bus, _ = chip(ready_stays=True)
    bus.write(0x00, b'\x18')
    bus.write(0x02, b'\x00')
    clock.sleep(0.014)
    flags = []
    for _ in range(2000):
        bus.read(0x03, 6)
        flags.append(bus.read(0x09, 1)[0] & 0x01)
    assert 0.96 < np.mean(flags) < 1.0


@pytest.mark.parametrize(('code', 'rate'), [(0, 0.75), (4, 15.0), (6, 75.0), (7, 220.0)])
def test_the_rate_of_the_magnetometer(chip, clock, code, rate):
    _, bus, _ = chip()
    bus.write(0x00, bytes([code << 2]))
    bus.write(0x02, b'\x00')
    fresh, start = 0, clock.now_ns()
    while clock.now_ns() - start < 10_000_000_000:
        clock.sleep(0.3 / rate)
        if bus.read(0x09, 1)[0] & 0x01:
            fresh += 1
            bus.read(0x03, 6)
    assert fresh == pytest.approx(10 * rate, abs=2)


def test_a_single_measurement_ends_asleep(chip, clock):
    _, bus, _ = chip()
    bus.write(0x02, b'\x01')
    clock.sleep(0.1)
    assert bus.read(0x09, 1) == b'\x01'
    assert bus.read(0x02, 1)[0] & 0x03 == 0x03
    bus.read(0x03, 6)
    clock.sleep(1.0)
    assert bus.read(0x09, 1) == b'\x00'


# --- rate and filter ---------------------------------------------------------------------
@pytest.mark.parametrize(
    ('code', 'rate'),
    [
        (1, 1.0),
        (2, 10.0),
        (3, 25.0),
        (4, 50.0),
        (5, 100.0),
        (6, 200.0),
        (7, 400.0),
        (9, 1344.0),
    ],
)
def test_the_rate_of_the_accelerometer(chip, code, rate):
    bus, _, source = chip()
    bus.write(0x20, bytes([code << 4 | 0x07]))
    assert source.nominal_hz == rate


def test_the_bandwidth_is_a_ninth_of_the_rate(chip, clock, make_source):
    rng = np.random.default_rng(1)

    class Noisy(type(make_source())):
        def samples_until(self, t_ns):
            samples = super().samples_until(t_ns)
            return type(samples)(samples.stamps, rng.normal(0, 1.0, (len(samples), 3)))

    source = make_source()
    source.__class__ = Noisy
    bus, _, _ = chip(source=source)
    on(bus, clock)
    fifo(bus)
    clock.sleep(0.01)
    data = b''
    for _ in range(300):
        clock.sleep(0.01)
        data += bus.read(0x28, 6 * level(bus))
    # samples of white noise behind an analogue filter of first order are correlated by this
    p = math.exp(-2.0 * math.pi / 9.0)
    assert words(data).std() * 1e-3 * G == pytest.approx(math.sqrt((1 - p) / (1 + p)), rel=0.05)


# --- FIFO --------------------------------------------------------------------------------
def test_a_burst_takes_slots_out(chip, clock, make_source):
    bus, _, _ = chip(source=make_source(acceleration=(0.0, 0.0, 0.996 * G)))
    on(bus, clock, scale=3)
    fifo(bus)
    clock.sleep(0.008)
    count = level(bus)
    assert count in (10, 11)
    assert bus.read(0x28, 6 * count) == bytes.fromhex('0000 0000 3005') * count
    assert level(bus) <= 3


def test_the_flags_of_the_fifo(chip, clock):
    bus, _, _ = chip()
    on(bus, clock)
    fifo(bus, 0x80 | 10)
    assert bus.read(0x2F, 1) == b'\x20'  # empty
    clock.sleep(0.004)
    assert bus.read(0x2F, 1)[0] & 0xE0 == 0
    clock.sleep(0.006)
    assert bus.read(0x2F, 1)[0] & 0xE0 == 0x80  # threshold
    clock.sleep(0.03)
    assert bus.read(0x2F, 1) == b'\xdf'  # overrun, and five bits do not go beyond 31
    bus.read(0x28, 6)
    assert bus.read(0x2F, 1)[0] & 0x40 == 0
    bus.write(0x2E, b'\x00')
    assert bus.read(0x2F, 1)[0] & 0x3F == 0x20


def test_an_overrun_keeps_the_newest_32(chip, clock, make_source):
    source = make_source(acceleration=(0.0, 0.0, 0.0))
    bus, _, _ = chip(source=source)
    on(bus, clock)
    fifo(bus)
    clock.sleep(0.1)
    level(bus)
    source.values['acceleration'] = (0.0, 0.0, G)
    clock.sleep(0.012)
    z = words(bus.read(0x28, 6 * 32))[:, 2]
    assert (z[:14] == 0).all()
    assert (z[20:] > 500).all()


def test_fifo_mode_stops_when_full(chip, clock, make_source):
    source = make_source(acceleration=(0.0, 0.0, 0.0))
    bus, _, _ = chip(source=source)
    on(bus, clock)
    fifo(bus, 0x40)
    clock.sleep(0.03)
    level(bus)
    source.values['acceleration'] = (0.0, 0.0, G)
    clock.sleep(0.1)
    assert not words(bus.read(0x28, 6 * 32)).any()


def test_a_bus_that_is_too_slow_runs_over(chip, clock):
    bus, _, _ = chip(line=Line(clock, Timing.i2c(50e3)))
    on(bus, clock)
    fifo(bus)
    overrun = False
    for _ in range(50):
        source = bus.read(0x2F, 1)[0]
        overrun |= bool(source & 0x40)
        bus.read(0x28, 6 * (source & 0x1F) or 6)
    assert overrun


def test_after_turn_on_the_first_samples_are_not_settled(chip, clock, make_source):
    bus, _, _ = chip(source=make_source(acceleration=(0.0, 0.0, G)))
    bus.write(0x23, b'\x88')
    fifo(bus)
    bus.write(0x20, b'\x97')
    clock.sleep(0.02)
    z = words(bus.read(0x28, 6 * level(bus)))[:, 2]
    assert (z[:7] < 1000).all()
    assert (z[7:] == 1000).all()


def test_nobody_asked_for_a_long_time(chip, clock):
    bus, magnetometer, source = chip()
    on(bus, clock)
    fifo(bus)
    magnetometer.write(0x02, b'\x00')
    clock.sleep(3600.0)
    assert bus.read(0x2F, 1)[0] & 0x40
    assert source.made < 2000
    assert magnetometer.read(0x09, 1)[0] & 0x01
