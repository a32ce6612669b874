# SPDX-License-Identifier: Apache-2.0
"""
The emulated BNO055, talked to with bare register numbers and bytes and decoded by hand.

Nothing here uses the driver's tables or the codec of its serial line: numbers and formulas come
from BST-BNO055-DS000-12 rev. 1.2, so a wrong table cannot prove itself.
"""

import math
import struct

from imu_bench.emulators import create
from imu_bench.errors import NoAnswer
import pytest

G = 9.80665


@pytest.fixture
def chip(clock, make_source):
    """Return bus and source of a chip that has started."""

    def make(kind='i2c', asleep=False, options=None, **values):
        source = make_source(**values)
        bus = create('bno055', kind, source, clock, **(options or {}))['']
        clock.sleep(0.0 if asleep else 0.41)
        return bus

    return make


def mode(bus, clock, code, wait=0.1):
    bus.write(0x3D, bytes([code]))
    clock.sleep(wait)


def page_1(bus, register, data):
    bus.write(0x07, b'\x01')
    bus.write(register, data)
    bus.write(0x07, b'\x00')


def words(bus, register, n):
    return struct.unpack(f'<{n}h', bus.read(register, 2 * n))


# --- identity, pages, reset --------------------------------------------------------------
def test_values_after_reset(chip):
    bus = chip()
    assert bus.read(0x00, 8).hex() == 'a0fb320f080300' + '00'
    assert bus.read(0x34, 8).hex() == '00000f0000000080'
    assert bus.read(0x3D, 1)[0] & 0x0F == 0  # CONFIG
    assert bus.read(0x41, 2).hex() == '2400'
    bus.write(0x07, b'\x01')
    assert bus.read(0x07, 5).hex() == '010d0b3800'


def test_the_page_register_is_on_both_pages_and_a_burst_stays_on_its_page(chip):
    bus = chip()
    bus.write(0x07, b'\x01')
    assert bus.read(0x07, 1) == b'\x01'
    assert bus.read(0x06, 3)[1:] == b'\x01\x0d'
    bus.write(0x07, b'\x00')
    assert bus.read(0x06, 3)[1:] == b'\x00\x00'


def test_nothing_answers_before_it_has_started_and_while_it_resets(chip, clock):
    bus = chip(asleep=True)
    clock.sleep(0.39)
    with pytest.raises(NoAnswer, match='emulated bno055 on i2c'):
        bus.read(0x00, 1)
    clock.sleep(0.02)
    mode(bus, clock, 0x0C)
    with pytest.raises(NoAnswer):  # it resets before it acknowledges: Adafruit catches that
        bus.write(0x3F, b'\x20')
    clock.sleep(0.6)
    with pytest.raises(NoAnswer):
        bus.read(0x00, 1)
    clock.sleep(0.06)
    assert bus.read(0x3D, 1)[0] & 0x0F == 0
    assert bus.read(0x39, 1) == b'\x00'


def test_identity_cannot_be_written(chip):
    bus = chip()
    bus.write(0x00, b'\x00')
    assert bus.read(0x00, 1) == b'\xa0'


def test_bytes_take_their_time(chip, clock):
    bus = chip()
    before = clock.now_ns()
    bus.read(0x08, 18)
    # 180 µs after each byte, on a scope: Bosch community, minimum I2C communication interval
    on_the_wire = (9 * (3 + 18) + 3) / 400e3
    assert clock.now_ns() - before == pytest.approx((on_the_wire + 18 * 180e-6) * 1e9)


# --- modes -------------------------------------------------------------------------------
@pytest.mark.parametrize(('code', 'status'), [(0x07, 6), (0x05, 6), (0x08, 5), (0x0C, 5)])
def test_status_of_a_mode(chip, clock, code, status):
    bus = chip()
    mode(bus, clock, code)
    assert bus.read(0x39, 1)[0] == status
    assert bus.read(0x3D, 1)[0] & 0x0F == code


def test_there_are_no_data_in_config_mode(chip, clock):
    bus = chip()
    clock.sleep(0.1)
    assert not any(bus.read(0x08, 44))
    mode(bus, clock, 0x0C)
    assert any(bus.read(0x08, 18))
    mode(bus, clock, 0x00)
    assert not any(bus.read(0x08, 44))


@pytest.mark.parametrize(('register', 'page'), [(0x3B, 0), (0x41, 0), (0x08, 1), (0x0A, 1)])
def test_configuration_outside_config_mode_is_ignored_silently(chip, clock, register, page):
    bus = chip()
    bus.write(0x07, bytes([page]))
    before = bus.read(register, 1)
    bus.write(0x07, b'\x00')
    mode(bus, clock, 0x07)
    bus.write(0x07, bytes([page]))
    bus.write(register, b'\x01')
    assert bus.read(register, 1) == before


def test_a_change_of_mode_takes_its_time(chip, clock):
    bus = chip()
    mode(bus, clock, 0x07, wait=0.006)
    bus.write(0x3D, b'\x00')  # 7 ms: still changing
    assert bus.read(0x3D, 1)[0] & 0x0F == 7
    clock.sleep(0.01)
    mode(bus, clock, 0x00, wait=0.018)
    page_1(bus, 0x08, b'\x0f')
    bus.write(0x07, b'\x01')
    assert bus.read(0x08, 1) == b'\x0d'  # 19 ms: written too early
    clock.sleep(0.002)
    bus.write(0x08, b'\x0f')
    assert bus.read(0x08, 1) == b'\x0f'


@pytest.mark.parametrize(
    ('code', 'shown'),
    [
        (0x01, (True, False, False)),
        (0x02, (False, True, False)),
        (0x03, (False, False, True)),
        (0x04, (True, True, False)),
        (0x07, (True, True, True)),
        (0x08, (True, False, True)),
        (0x09, (True, True, False)),
    ],
)
def test_what_a_mode_measures(chip, clock, code, shown):
    bus = chip()
    mode(bus, clock, code, wait=0.5)
    data = bus.read(0x08, 18)
    assert tuple(any(data[k : k + 6]) for k in (0, 6, 12)) == shown


@pytest.mark.parametrize(('code', 'rate'), [(0x0C, 100), (0x0A, 50), (0x09, 20), (0x07, 100)])
def test_data_are_overwritten_at_the_rate_of_the_mode(chip, clock, code, rate):
    bus = chip()
    mode(bus, clock, code, wait=0.05)
    bus.read(0x08, 1)
    before = bus.chip._made
    clock.sleep(2.0)
    bus.read(0x08, 1)
    assert bus.chip._made - before == pytest.approx(2 * rate, abs=1)


# --- data --------------------------------------------------------------------------------
def test_words_in_amg_mode(chip, clock):
    bus = chip(
        acceleration=(1.0, -2.0, 9.81),
        angular_velocity=(math.radians(10), 0.0, math.radians(-100)),
        magnetic_field=(45e-6, 0.0, -20e-6),
        temperature=-7.0,
    )
    mode(bus, clock, 0x07, wait=0.2)
    assert words(bus, 0x08, 9) == (100, -200, 981, 720, 0, -320, 164, 0, -1638)  # 2000/2^15 °/s
    assert bus.read(0x34, 1) == b'\xf9'


def test_other_units(chip, clock):
    bus = chip(acceleration=(0.0, 0.5 * G, G), angular_velocity=(1.0, 0.0, -0.5), temperature=25.0)
    bus.write(0x3B, bytes([0x80 | 0x01 | 0x02 | 0x10]))  # mg, rad/s, °F
    mode(bus, clock, 0x05, wait=0.1)
    assert words(bus, 0x08, 3) == (0, 500, 1000)
    assert words(bus, 0x14, 3) == (939, 0, -469)  # without fusion always 2000/2^15 °/s
    assert bus.read(0x34, 1)[0] * 2 == pytest.approx(25 * 1.8 + 32, abs=1)


@pytest.mark.parametrize(('code', 'g'), [(0, 2), (1, 4), (2, 8), (3, 16)])
def test_acceleration_saturates_at_its_range(chip, clock, code, g):
    bus = chip(acceleration=(20 * G, -20 * G, 0.9 * g * G))
    page_1(bus, 0x08, bytes([0x0C | code]))
    mode(bus, clock, 0x07)
    high, low, inside = words(bus, 0x08, 3)
    # Linux: 1962, 3924, 7848, 15696
    assert (high, low) == (981 * g, -981 * g)
    assert inside == round(0.9 * g * G * 100)


def test_angular_velocity_saturates(chip, clock):
    bus = chip(angular_velocity=(math.radians(2500), math.radians(-2500), 0.0))
    mode(bus, clock, 0x07)
    assert words(bus, 0x14, 2) == (32767, -32768)


def test_with_fusion_angular_velocity_has_the_units_of_the_document(chip, clock):
    bus = chip(angular_velocity=(1.0, math.radians(-2500), math.radians(10)))
    bus.write(0x3B, b'\x80')
    mode(bus, clock, 0x08, wait=0.1)
    assert words(bus, 0x14, 3) == (917, -32000, 160)
    mode(bus, clock, 0x00)
    bus.write(0x3B, b'\x82')
    mode(bus, clock, 0x08, wait=0.1)
    assert words(bus, 0x14, 1) == (900,)


def test_the_field_has_a_rate_of_its_own(chip, clock, make_source):
    bus = chip()
    page_1(bus, 0x09, b'\x08')  # 2 Hz, regular
    mode(bus, clock, 0x07, wait=0.45)
    assert words(bus, 0x0E, 3) == (0, 0, 0)
    clock.sleep(0.1)
    assert words(bus, 0x0E, 3) == (320, 0, -640)


def test_orientation_gravity_and_calibration_with_fusion(chip, clock):
    # at rest, x to the north: 90° from east about z
    bus = chip(acceleration=(0.0, 0.0, 9.80665), magnetic_field=(20e-6, 0.0, -40e-6))
    mode(bus, clock, 0x0C, wait=0.5)
    assert bus.read(0x35, 1)[0] >> 6 == 0
    clock.sleep(6.0)
    half = round(2**14 * math.sqrt(0.5))
    assert words(bus, 0x20, 4) == pytest.approx((half, 0, 0, half), abs=1)
    assert words(bus, 0x28, 3) == pytest.approx((0, 0, 0), abs=1)
    assert words(bus, 0x2E, 3) == pytest.approx((0, 0, 981), abs=1)
    heading, roll, pitch = words(bus, 0x1A, 3)
    assert heading / 16 == pytest.approx(270, abs=0.1)
    assert (roll, pitch) == (0, 0)
    assert bus.read(0x35, 1) == b'\xff'


def test_a_tilted_chip(chip, clock):
    angle = math.radians(30)  # about x
    force = (0.0, G * math.sin(angle), G * math.cos(angle))
    bus = chip(acceleration=force, magnetic_field=(20e-6, 0.0, 0.0))
    mode(bus, clock, 0x0C, wait=5.0)
    w, x, y, z = (word / 2**14 for word in words(bus, 0x20, 4))
    # third row of the rotation matrix: up, seen by the sensor
    up = (2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z)
    assert [c * G for c in up] == pytest.approx(force, abs=0.01)
    assert words(bus, 0x2E, 3) == pytest.approx([100 * f for f in force], abs=1)


def test_the_external_crystal_is_busy_for_a_while(chip, clock):
    bus = chip()
    bus.write(0x3F, b'\x80')
    assert bus.read(0x38, 1) == b'\x01'
    clock.sleep(0.7)
    assert bus.read(0x38, 1) == b'\x00'


# --- serial line -------------------------------------------------------------------------
@pytest.fixture
def ask(clock):
    """Return what sends a command as text, all at once, and returns the answer as text."""

    def asked(line, text, wait=0.02):
        line.write(bytes.fromhex(text))
        clock.sleep(wait)
        return line.read(0.0).hex(' ')

    return asked


@pytest.mark.parametrize(
    ('command', 'answer'),
    [
        ('aa 01 00 01', 'bb 01 a0'),
        ('aa 01 00 04', 'bb 04 a0 fb 32 0f'),
        ('aa 00 3d 01 0c', 'ee 01'),
        ('aa 01 3d 00', 'ee 09'),
        ('aa 01 00 81', 'ee 08'),
        ('aa 01 7f 01', 'ee 04'),
        ('00', 'ee 06'),
    ],
)
def test_commands_of_the_document(chip, ask, command, answer):
    assert ask(chip('serial'), command) == answer


def test_configuration_outside_config_mode_is_refused_on_the_serial_line(chip, ask):
    line = chip('serial')
    assert ask(line, 'aa 00 3d 01 0c') == 'ee 01'
    assert ask(line, 'aa 00 3b 01 00') == 'ee 05'


def test_a_command_that_comes_in_pieces_is_refused_when_it_takes_too_long(chip, ask):
    line = chip('serial')
    assert ask(line, 'aa 01', wait=0.01) == ''
    assert ask(line, '00 01') == 'bb 01 a0'
    assert ask(line, 'aa 01', wait=0.05) == 'ee 0a'
    assert ask(line, 'aa 01 00 01') == 'bb 01 a0'


def test_an_overrun_now_and_then(chip, ask):
    line = chip('serial', options={'overrun_every': 2})
    assert [ask(line, 'aa 01 00 01') for _ in range(6)] == ['bb 01 a0', 'bb 01 a0', 'ee 07'] * 2


def test_the_line_has_a_speed(chip, clock):
    line = chip('serial')
    before = clock.now_ns()
    line.write(bytes.fromhex('aa010812'))
    data = b''
    while len(data) < 20:
        data += line.read(0.1)
    # 4 bytes there, 20 back, 10 bit each; the chip needs some time
    assert (clock.now_ns() - before) * 1e-9 == pytest.approx(24 * 10 / 115200, abs=1.5e-3)


def test_at_another_speed_nothing_is_understood(chip, ask):
    line = chip('serial')
    line.baud = 9600
    assert ask(line, 'aa 01 00 01') == ''


def test_a_reset_is_not_answered(chip, ask):
    line = chip('serial')
    assert ask(line, 'aa 00 3f 01 20') == ''
    assert ask(line, 'aa 01 00 01', wait=0.6) == ''
    assert ask(line, 'aa 01 00 01', wait=0.1) in ('', 'bb 01 a0')
    assert ask(line, 'aa 01 00 01') == 'bb 01 a0'
