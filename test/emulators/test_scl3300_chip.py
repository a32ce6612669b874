# SPDX-License-Identifier: Apache-2.0
"""
The emulated SCL3300, talked to with the frames of its data sheet and decoded by hand.

Nothing here uses the driver's tables or the codec: numbers and formulas come from Doc 4921
rev. 2, so a wrong table cannot prove itself.
"""

import math

from imu_bench.emulators import create
import numpy as np
import pytest

READ = {
    'x': '040000F7', 'y': '080000FD', 'z': '0C0000FB', 'sto': '100000E9', 't': '140000EF',
    'status': '180000E5', 'err1': '1C0000E3', 'err2': '200000C1', 'ax': '240000C7',
    'ay': '280000CD', 'az': '2C0000CB', 'mode': '340000DF', 'who': '40000091',
    's1': '640000A7', 's2': '680000AD', 'bank': '7C0000B3',
}  # fmt: skip
MODES = {1: 'B400001F', 2: 'B4000102', 3: 'B4000225', 4: 'B4000338'}
PER_G = {1: 6000, 2: 3000, 3: 12000, 4: 12000}
ANGLES, RESET, POWER_DOWN, BANK1 = 'B0001F6F', 'B4002098', 'B400046B', 'FC00016E'


def checksum(body):
    crc = 0xFF
    for byte in body:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x1D if crc & 0x80 else crc << 1) & 0xFF
    return crc ^ 0xFF


class Bare:
    """The chip with nothing but frames as text."""

    def __init__(self, clock, source, **options):
        self.clock, self.source = clock, source
        self.bus = create('scl3300', 'frame', source, clock, **options)['']

    def send(self, text):
        raw = self.bus.transfer(bytes.fromhex(text))
        assert checksum(raw[:3]) == raw[3], raw.hex()
        return raw

    def ask(self, *names):
        """Return (return status, signed word) of each register."""
        for name in names[:1]:
            self.send(READ[name])
        answers = [self.send(READ[name]) for name in (*names[1:], 'who')]
        for raw, name in zip(answers, names, strict=True):
            assert raw[0] & 0xFC == int(READ[name][:2], 16)
        return [(raw[0] & 3, int.from_bytes(raw[1:3], 'big', signed=True)) for raw in answers]

    def word(self, name):
        return self.ask(name)[0][1]

    def bring_up(self, mode=1):
        self.clock.sleep(0.01)
        self.send(MODES[mode])
        self.send(ANGLES)
        self.clock.sleep(0.1)
        self.ask('status', 'status')


@pytest.fixture
def chip(clock, make_source):
    def make(source=None, **options):
        return Bare(clock, source or make_source(), **options)

    return make


# --- start -------------------------------------------------------------------------------
def test_the_states_of_the_start_up(chip, clock):
    made = chip()
    made.send(READ['who'])
    assert made.send(READ['who'])[0] & 3 == 0  # start-up in progress
    clock.sleep(0.001)
    assert made.ask('who') == [(3, 0xC1)]
    made.send(MODES[1])
    echo = made.send(ANGLES)
    assert echo[:3].hex() == 'b70000'  # write, mode, error: flags of the start
    clock.sleep(0.025)
    # DS table 11: error twice, then normal
    made.send(READ['status'])
    found = [made.send(READ['status']) for _ in range(3)]
    assert [raw[0] & 3 for raw in found] == [3, 1, 1]
    assert [int.from_bytes(raw[1:3], 'big') for raw in found] == [0x12, 0x12, 0]
    assert made.ask('who', 'mode') == [(1, 0xC1), (1, 0)]


def test_the_flag_trace_of_the_document(chip, clock):
    made = chip()
    made.bring_up()
    made.bus.chip.status = 0x40  # DS section 6.3.1: saturated
    frames = [made.send(READ['status']).hex().upper() for _ in range(4)]
    assert frames[1:] == ['1B00407A', '19004079', '1900006A']


def test_a_reset_forgets_everything(chip, clock):
    made = chip()
    made.bring_up(mode=4)
    assert made.word('mode') == 3
    assert made.word('az') != 0
    made.send(RESET)
    clock.sleep(0.002)
    assert [word for _, word in made.ask('mode', 'az', 'status', 'err2')] == [0, 0, 0x10, 0x10]


def test_power_down_is_flagged_and_woken_from(chip, clock):
    made = chip()
    made.bring_up()
    made.send(POWER_DOWN)
    assert made.word('status') == 4
    made.source.values['acceleration'] = (3.0, 0.0, 0.0)
    clock.sleep(0.1)
    assert made.word('x') == 0
    made.send(MODES[1])
    clock.sleep(0.1)
    assert made.word('x') == pytest.approx(3 / 9.80665 * 6000, abs=1)


# --- frames ------------------------------------------------------------------------------
def test_a_broken_request_is_refused_and_said(chip):
    made = chip()
    made.bring_up()
    made.send('B4000337')  # mode 4 with a wrong checksum
    assert made.send(READ['mode'])[0] & 3 == 3
    assert made.send(READ['status']) == bytes.fromhex('35000050')
    assert made.word('status') == 0


def test_bytes_take_their_time(chip, clock):
    made = chip()
    before = clock.now_ns()
    made.send(READ['who'])
    # 32 clocks at 2 MHz, half a clock at each end, 10 µs of CSB high: DS section 5.1.2
    assert clock.now_ns() - before == pytest.approx(16_000 + 500 + 10_000)


def test_serial_number_is_in_the_other_bank(chip):
    made = chip(serial=0x3CE5F7DA)
    made.bring_up()
    assert made.word('bank') == 0
    assert [made.word('s1'), made.word('s2')] == [0, 0]
    made.send(BANK1)
    made.send(READ['s1'])
    assert made.send(READ['s2']).hex().upper() == '65F7DA19'
    assert made.send(READ['who']).hex().upper() == '693CE54F'
    assert made.send(READ['bank'])[1:3] == b'\x00\x00'  # no WHOAMI here
    assert made.send(READ['bank'])[1:3] == b'\x00\x01'


# --- quantities --------------------------------------------------------------------------
@pytest.mark.parametrize('mode', MODES)
def test_acceleration_in_every_mode(chip, make_source, mode):
    g = (0.5, -0.25, 0.7)
    made = chip(make_source(acceleration=[9.80665 * x for x in g]))
    made.bring_up(mode)
    words = [word for _, word in made.ask('x', 'y', 'z')]
    assert words == [round(x * PER_G[mode]) for x in g]


def test_the_words_of_the_document(chip, make_source):
    made = chip(make_source(acceleration=(0.359577, 0.0, 9.80665), temperature=26.577))
    made.bring_up()
    made.send(READ['x'])
    assert made.send(READ['t']).hex().upper() == '0500DC1C'
    assert made.send(READ['x']).hex().upper() == '15161E0A'


@pytest.mark.parametrize('degrees', [-89.0, -21.84, -3.0, 0.5, 10.0, 45.0])
def test_angles(chip, make_source, degrees):
    angle = math.radians(degrees)
    made = chip(
        make_source(acceleration=(9.80665 * math.sin(angle), 0.0, 9.80665 * math.cos(angle)))
    )
    made.bring_up()
    ax, ay, az = (word for _, word in made.ask('ax', 'ay', 'az'))
    assert ax == pytest.approx(degrees * 2**14 / 90, abs=1)
    assert ay == 0
    assert az == pytest.approx((90 - abs(degrees)) * 2**14 / 90, abs=1)


def test_no_angles_unless_enabled(chip, clock):
    made = chip()
    clock.sleep(0.1)
    assert [word for _, word in made.ask('ax', 'ay', 'az')] == [0, 0, 0]


@pytest.mark.parametrize(('mode', 'limit'), [(1, 1.2), (2, 2.4)])
def test_saturation_is_flagged_beyond_full_scale(chip, clock, make_source, mode, limit):
    source = make_source(acceleration=(9.80665 * limit * 0.99, 0.0, 0.0))
    made = chip(source)
    made.bring_up(mode)
    assert made.word('status') == 0
    source.values['acceleration'] = (-9.80665 * limit * 1.01, 0.0, 0.0)
    clock.sleep(0.2)
    assert made.ask('x', 'status') == [(3, round(-limit * 1.01 * PER_G[mode])), (3, 0x40)]
    source.values['acceleration'] = (200.0, 0.0, 0.0)
    clock.sleep(0.2)
    assert made.word('x') == 32767


def test_temperature_saturation_is_flagged(chip, clock, make_source):
    source = make_source(temperature=20.0)
    made = chip(source)
    made.bring_up()
    source.values['temperature'] = 160.0
    clock.sleep(0.01)
    assert made.word('status') == 0x20


def test_the_self_test_output_is_what_the_defect_makes_of_it(chip):
    made = chip(self_test=-2500)
    made.bring_up()
    assert made.word('sto') == -2500


# --- sampling ----------------------------------------------------------------------------
def test_values_change_two_thousand_times_a_second(chip, clock, make_source):
    source = make_source()
    made = chip(source)
    assert source.nominal_hz == 2000.0
    made.bring_up()
    first = source.made
    clock.sleep(0.9)
    made.word('x')
    assert source.made - first == pytest.approx(1800, abs=4)


@pytest.mark.parametrize(('mode', 'corner'), [(1, 40.0), (2, 70.0), (3, 10.0), (4, 10.0)])
def test_the_low_pass_of_the_mode(chip, clock, make_source, mode, corner):
    source = make_source(acceleration=(0.0, 0.0, 0.0))
    made = chip(source)
    made.bring_up(mode)
    source.values['acceleration'] = (5.0, 0.0, 0.0)
    tau = 1 / (2 * math.pi * corner)
    before = clock.now_ns()
    clock.sleep(tau)
    made.send(READ['x'])
    elapsed = (clock.now_ns() - before) * 1e-9
    word = int.from_bytes(made.send(READ['who'])[1:3], 'big', signed=True)
    full = 5.0 / 9.80665 * PER_G[mode]
    expected = full * (1 - math.exp(-elapsed / tau))
    assert word == pytest.approx(expected, abs=full * math.exp(-1) * 0.75e-3 / tau)


@pytest.mark.slow
def test_noise_passes_a_first_order_low_pass(chip, clock, make_source):
    """Doc 4921 table 2: 32 µg/√Hz and 10 Hz of first order make 0.13 mg rms."""
    rng = np.random.default_rng(1)
    white = 32e-6 * 9.80665 * math.sqrt(1000)

    class Noisy(type(make_source())):
        def samples_until(self, t_ns):
            samples = super().samples_until(t_ns)
            return type(samples)(samples.stamps, rng.normal(0, white, (len(samples), 3)))

    source = make_source()
    source.__class__ = Noisy
    made = chip(source)
    made.bring_up(3)
    words = []
    for _ in range(3000):
        clock.sleep(0.02)
        words.append([word for _, word in made.ask('x', 'y', 'z')])
    quantisation = 1 / 12000 / math.sqrt(12)
    rms = np.sqrt(np.var(np.array(words) / 12000) - quantisation**2)
    assert rms == pytest.approx(0.127e-3, rel=0.05)


def test_nobody_asked_for_a_long_time(chip, clock):
    made = chip()
    made.bring_up()
    clock.sleep(3600.0)
    made.word('x')
    assert made.source.made < 5000
