# SPDX-License-Identifier: Apache-2.0
"""
The emulated IIM-42652, talked to with bare register numbers and decoded by hand.

Nothing here uses the driver's tables or the packet codec: numbers and formulas come from
DS-000401 rev. 1.2, so a wrong table cannot prove itself.
"""

import math
import struct

from imu_bench.emulators import create
from imu_bench.errors import NoAnswer
import numpy as np
import pytest


class Bare:
    """The chip with nothing but register numbers."""

    def __init__(self, clock, source, kind='i2c', **options):
        self.clock, self.source = clock, source
        self.bus = create('iim42652', kind, source, clock, **options)['']
        clock.sleep(0.01)

    def write(self, number, byte, bank=0):
        self.bus.write(0x76, bytes([bank]))
        self.bus.write(number, bytes([byte]))
        self.bus.write(0x76, b'\x00')

    def read(self, number, length=1, bank=0):
        self.bus.write(0x76, bytes([bank]))
        data = self.bus.read(number, length)
        self.bus.write(0x76, b'\x00')
        return data

    def start(self, rate=0x06, fs=0x00, fifo=0x0F, bandwidth=0x11, tick=0x23, order=2):
        """As DS section 12 orders it: filters, FIFO, power, stream."""
        for number, byte in (
            (0x4F, fs | rate), (0x50, fs | rate), (0x52, bandwidth), (0x54, tick),
            (0x51, 0x12 | order - 1 << 2), (0x53, 0x05 | order - 1 << 3), (0x5F, fifo),
            (0x64, 0x00), (0x4E, 0x0F),
        ):  # fmt: skip
            self.write(number, byte)
        self.clock.sleep(0.06)
        self.bus.write(0x16, b'\x40')
        self.bus.write(0x4B, b'\x02')
        self.read(0x2D)

    def count(self):
        return int.from_bytes(self.read(0x2E, 2), 'big')

    def packets(self, size):
        data = self.bus.read(0x30, self.count() // size * size)
        return [data[k : k + size] for k in range(0, len(data), size)]


@pytest.fixture
def chip(clock, make_source):
    def make(kind='i2c', source=None, **options):
        return Bare(clock, source or make_source(), kind, **options)

    return make


# --- identity, banks, reset --------------------------------------------------------------
def test_reset_values(chip):
    made = chip()
    assert made.read(0x75) == b'\x6f'
    assert made.read(0x4C, 9).hex() == '309100060616110d23'
    assert made.read(0x1D, 14) == b'\x80\x00' * 7
    assert made.read(0x7A, 3, bank=1).hex() == '03205f'
    assert made.read(0x03, 3, bank=2).hex() == '304062'
    assert made.read(0x0B, 4, bank=1).hex() == 'a00daa80'
    assert made.read(0x75, bank=3) == b'\x00'


def test_banks_are_apart_and_their_register_is_everywhere(chip):
    made = chip()
    made.write(0x0C, 0x11, bank=1)
    assert made.read(0x0C, bank=1) == b'\x11'
    made.bus.write(0x76, b'\x04')
    assert made.bus.read(0x76, 1) == b'\x04'
    assert made.read(0x0C, bank=2) == b'\x00'


def test_a_reset_says_so_and_takes_its_time(chip, clock):
    made = chip()
    assert made.read(0x2D) == b'\x10'
    assert made.read(0x2D) == b'\x00'
    made.write(0x4F, 0x66)
    made.bus.write(0x11, b'\x01')
    with pytest.raises(NoAnswer):
        made.bus.read(0x75, 1)
    clock.sleep(0.001)
    assert made.read(0x2D) == b'\x10'
    assert made.read(0x4F) == b'\x06'


# --- data registers ----------------------------------------------------------------------
@pytest.mark.parametrize(('code', 'per_g'), list(enumerate([2048, 4096, 8192, 16384])))
def test_acceleration_at_every_range(chip, clock, make_source, code, per_g):
    g = (0.5, -0.25, 1.0)
    made = chip(source=make_source(acceleration=[9.80665 * x for x in g]))
    made.start(fs=code << 5)
    assert struct.unpack('>hhh', made.read(0x1F, 6)) == tuple(round(x * per_g) for x in g)


@pytest.mark.parametrize(
    ('code', 'per_dps'), list(enumerate([16.4, 32.8, 65.5, 131, 262, 524.3, 1048.6, 2097.2]))
)
def test_angular_velocity_at_every_range(chip, make_source, code, per_dps):
    dps = (10.0, -5.0, 0.25)
    made = chip(source=make_source(angular_velocity=[math.radians(x) for x in dps]))
    made.start()
    made.bus.write(0x4F, bytes([code << 5 | 6]))  # may change while it runs
    made.clock.sleep(0.05)
    assert struct.unpack('>hhh', made.read(0x25, 6)) == tuple(round(x * per_dps) for x in dps)


def test_saturation_keeps_clear_of_the_mark_of_invalid_data(chip, make_source):
    made = chip(
        source=make_source(acceleration=(500.0, -500.0, 0.0), angular_velocity=(50, -50, 0))
    )
    made.start()
    assert struct.unpack('>hhhhhh', made.read(0x1F, 12)) == (32767, -32766, 0, 32767, -32766, 0)


def test_temperature(chip, make_source):
    made = chip(source=make_source(temperature=35.0))
    made.start()
    assert made.read(0x1D, 2).hex() == '052d'


def test_no_measurement_until_the_sensors_have_started(chip, clock):
    made = chip()
    made.write(0x4E, 0x0F)
    clock.sleep(0.015)
    assert made.read(0x1F, 12) == b'\x80\x00' * 6
    clock.sleep(0.010)
    assert made.read(0x1F, 2) != b'\x80\x00'
    assert made.read(0x25, 2) == b'\x80\x00'
    clock.sleep(0.025)
    assert made.read(0x25, 2) != b'\x80\x00'
    made.write(0x4E, 0x00)
    before = made.source.made
    clock.sleep(0.1)
    made.read(0x2D)
    assert made.source.made == before


def test_writes_at_the_wrong_time_are_noted(chip, clock):
    made = chip()
    made.start()
    assert made.bus.chip.improper == ['REG_BANK_SEL (0x76)']  # within 200 µs of the power mode
    made.write(0x52, 0x22)
    assert made.bus.chip.improper[1:] == ['GYRO_ACCEL_CONFIG0 (0x52 of bank 0)']


# --- rate and filter ---------------------------------------------------------------------
@pytest.mark.parametrize(
    ('code', 'rate'),
    [(1, 32000), (3, 8000), (6, 1000), (7, 200), (8, 100), (11, 12.5), (15, 500)],
)
def test_codes_of_the_rate(chip, code, rate):
    made = chip()
    made.write(0x4F, code)
    made.write(0x50, code)
    made.write(0x4E, 0x0F)
    assert made.source.nominal_hz == rate


@pytest.mark.slow
@pytest.mark.parametrize(
    ('rate', 'code', 'order', 'corner'),
    [
        # DS section 5.5
        (0x06, 0x1, 2, 230.7), (0x06, 0x4, 2, 97.1), (0x06, 0x7, 2, 21.3), (0x0F, 0x1, 2, 115.3),
        (0x0F, 0x3, 2, 58.8), (0x0F, 0x6, 2, 24.0), (0x07, 0x5, 2, 23.8), (0x07, 0x1, 2, 92.3),
        (0x06, 0x3, 1, 111.0), (0x06, 0x7, 1, 23.9), (0x06, 0x3, 3, 118.9), (0x06, 0x7, 3, 25.2),
    ],
)  # fmt: skip
def test_the_filter_of_the_registers(chip, clock, make_source, rate, code, order, corner):
    class Sine(type(make_source())):
        def samples_until(self, t_ns):
            samples = super().samples_until(t_ns)
            t = (samples.stamps - self.anchor_ns) * 1e-9
            wave = 10.0 * np.sin(2 * math.pi * corner * t)[:, None] * np.ones(3)
            return type(samples)(samples.stamps, wave, wave / 100)

    source = make_source()
    source.__class__ = Sine
    made = chip(source=source)
    made.start(rate=rate, bandwidth=code << 4 | code, order=order)
    words = []
    for _ in range(60):
        clock.sleep(0.05)
        words += [struct.unpack('>xhxxxxh', packet[:9]) for packet in made.packets(16)]
    accel, gyro = np.array(words[20:]).T
    expected = 10.0 / math.sqrt(2) / math.sqrt(2)  # rms, -3 dB
    assert accel.std() / 2048 * 9.80665 == pytest.approx(expected, rel=0.04)
    assert math.radians(gyro.std() / 16.4) == pytest.approx(expected / 100, rel=0.06)


# --- FIFO --------------------------------------------------------------------------------
@pytest.fixture
def document(make_source):
    """What the vectors of the sheet were made of."""
    return make_source(
        acceleration=(0.0, 0.0, 9.80665),
        angular_velocity=(math.radians(10), -math.radians(10), 0.0),
        temperature=25.0,
    )


def test_packets_of_16_bits(chip, clock, document):
    made = chip(source=document)
    made.start()
    clock.sleep(0.02)
    packets = made.packets(16)
    assert len(packets) == pytest.approx(20, abs=2)
    for packet in packets:
        assert packet[:14].hex() == '680000000008' + '00' + '00a4ff5c0000' + '00'
    ticks = np.array([int.from_bytes(packet[14:], 'big') for packet in packets])
    # DS section 12.7: 1 ms shows as 937 or 938
    assert set(np.diff(ticks) % 65536) <= {937, 938}


def test_packets_of_20_bits(chip, clock, document):
    document.values.update(acceleration=(0.0, -4 / 32768 * 9.80665, 9.80665), temperature=35.0)
    made = chip(source=document, tick=1.0)
    made.start(fs=0x60, fifo=0x1F)  # 2 g and 250 °/s are set, and do not count
    clock.sleep(0.02)
    packets = made.packets(20)
    assert len(packets) == pytest.approx(20, abs=2)
    for packet in packets:
        assert packet[:15].hex() == '78' + '0000ffff0800' + '00a3ff5c0000' + '052d'
        assert packet[17:].hex() == '0cc400'
    ticks = np.array([int.from_bytes(packet[15:17], 'big') for packet in packets])
    assert set(np.diff(ticks) % 65536) == {1000}


@pytest.mark.parametrize(('fifo', 'header'), [(0x01, '40'), (0x02, '20')])
def test_packets_of_one_sensor(chip, clock, document, fifo, header):
    made = chip(source=document)
    made.start(fifo=fifo)
    clock.sleep(0.01)
    body = {'40': '000000000800', '20': '00a4ff5c0000'}[header]
    assert {packet.hex() for packet in made.packets(8)} == {f'{header}{body}00'}


def test_temperature_of_eight_bits(chip, clock, document):
    document.values['temperature'] = 35.14
    made = chip(source=document)
    made.start()
    clock.sleep(0.01)
    assert {packet[13] for packet in made.packets(16)} == {21}


def test_a_longer_tick(chip, clock, document):
    made = chip(source=document)
    made.start(rate=0x0B, tick=0x2B)  # 12.5 Hz, 16 µs
    clock.sleep(1.0)
    ticks = np.array([int.from_bytes(packet[14:], 'big') for packet in made.packets(16)])
    np.testing.assert_allclose(np.diff(ticks) % 65536, 80000 / 16 * 30 / 32, atol=1)


def test_the_end_of_the_fifo_is_marked(chip, clock):
    made = chip()
    made.start()
    clock.sleep(0.01)
    count = made.count()
    data = made.bus.read(0x30, count + 64)
    whole = (len(data.rstrip(b'\xff')) + 15) // 16 * 16
    assert whole >= count
    assert data[whole:] == b'\xff' * (len(data) - whole)


def test_part_of_a_packet_stays(chip, clock):
    made = chip()
    made.start()
    clock.sleep(0.01)
    before = made.count()
    first = made.bus.read(0x30, 5)
    assert made.bus.read(0x30, 16)[:5] == first
    assert made.count() >= before - 16


def test_the_count_in_records(chip, clock):
    made = chip()
    made.write(0x4C, 0x70)
    made.start()
    clock.sleep(0.02)
    assert made.count() == pytest.approx(20, abs=2)


def test_an_overflow_keeps_the_newest_counts_the_rest_and_says_so(chip, clock, document):
    made = chip(source=document)
    made.start()
    clock.sleep(0.1)
    assert made.read(0x2D)[0] & 0x02 == 0
    document.values['acceleration'] = (9.80665, 0.0, 0.0)
    clock.sleep(0.2)
    assert made.count() == 2032
    assert made.read(0x2D)[0] & 0x02
    lost = int.from_bytes(made.read(0x6C, 2), 'little')
    assert lost == pytest.approx(300 - 127, abs=5)
    newest = made.packets(16)[-1]
    assert newest[1:7].hex() == '080000000000'
    made.bus.write(0x4B, b'\x02')
    assert made.count() < 64
    assert made.read(0x4B) == b'\x00'
    assert int.from_bytes(made.read(0x6C, 2), 'little') == 0


def test_a_fifo_that_stops_keeps_the_oldest(chip, clock, document):
    made = chip(source=document)
    made.start()
    made.bus.write(0x16, b'\x80')
    clock.sleep(0.1)
    made.count()
    document.values['acceleration'] = (9.80665, 0.0, 0.0)
    clock.sleep(0.2)
    assert made.count() == 2032
    assert {packet[1:7].hex() for packet in made.packets(16)[:50]} == {'000000000800'}
    made.bus.write(0x16, b'\x00')
    assert made.count() == 0


def test_nobody_asked_for_a_long_time(chip, clock):
    made = chip()
    made.start()
    clock.sleep(3600.0)
    assert made.count() == 2032
    assert made.source.made < 2000
