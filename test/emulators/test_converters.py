# SPDX-License-Identifier: Apache-2.0
"""
The emulated converters of an MTN/1100, with bare numbers and decoded by hand.

Numbers come from SBAS444D (ADS1115), DS21298E (MCP3208) and the MCC 172 specification, at
100 mV/g.
"""

import math
import struct

from imu_bench.emulators import create
from imu_bench.errors import BusBusy, NoAnswer
import numpy as np
import pytest

G = 9.80665


@pytest.fixture
def wire(clock, make_source):
    def make(kind, g=0.0, **options):
        source = make_source(acceleration=(3.0, 4.0, g * G))
        return create('mtn1100', kind, source, clock, **options)[''], source

    return make


# --- ADS1115 -----------------------------------------------------------------------------
def config(bus, word):
    bus.write(1, struct.pack('>H', word))


def converted(bus, clock, word, seconds=0.2):
    config(bus, word)
    clock.sleep(seconds)
    return struct.unpack('>h', bus.read(0, 2))[0]


def test_ads1115_reset_values(wire):
    bus, _ = wire('i2c')
    words = [struct.unpack('>H', bus.read(number, 2))[0] for number in range(4)]
    assert words == [0x0000, 0x8583, 0x8000, 0x7FFF]
    bus.write(0, b'\x12\x34')
    assert bus.read(0, 2) == b'\x00\x00'
    bus.write(2, b'\x12\x34')
    assert bus.read(2, 2) == b'\x12\x34'


@pytest.mark.parametrize(
    ('code', 'microvolts'), list(enumerate([187.5, 125, 62.5, 31.25, 15.625, 7.8125]))
)
def test_ads1115_at_every_range(wire, clock, code, microvolts):
    bus, _ = wire('i2c', g=-0.6)
    assert converted(bus, clock, 0x8183 | code << 9) == round(-0.06e6 / microvolts)


def test_ads1115_saturates(wire, clock):
    bus, source = wire('i2c', g=50.0)
    assert converted(bus, clock, 0x8583) == 32767
    source.values['acceleration'] = (0.0, 0.0, -50.0 * G)
    clock.sleep(0.1)
    assert converted(bus, clock, 0x8583) == -32768


@pytest.mark.parametrize(('code', 'rate'), list(enumerate([8, 16, 32, 64, 128, 250, 475, 860])))
@pytest.mark.parametrize('error', [-0.1, 0.0, 0.1])
def test_ads1115_says_when_a_conversion_is_over(wire, clock, code, rate, error):
    bus, _ = wire('i2c', g=1.0, rate_error=error)
    config(bus, 0x8503 | code << 5)
    assert bus.read(1, 2)[0] & 0x80 == 0
    assert bus.read(0, 2) == b'\x00\x00'
    started = clock.now_ns()
    while bus.read(1, 2)[0] & 0x80 == 0:
        clock.sleep(2e-5)
    elapsed = (clock.now_ns() - started) * 1e-9
    assert elapsed == pytest.approx(1 / rate / (1 + error), abs=1e-3)
    assert bus.read(0, 2) == struct.pack('>h', 1600)
    # nothing more happens
    clock.sleep(0.5)
    assert bus.read(0, 2) == struct.pack('>h', 1600)


def test_ads1115_a_conversion_is_the_mean_over_its_time(wire, clock):
    bus, source = wire('i2c', g=2.0)
    config(bus, 0x8503)  # 8 Hz
    clock.sleep(0.0625)
    bus.read(1, 2)
    source.values['acceleration'] = (0.0, 0.0, 0.0)
    clock.sleep(0.1)
    assert struct.unpack('>h', bus.read(0, 2))[0] == pytest.approx(1600, rel=0.1)


def test_ads1115_runs_by_itself_in_continuous_mode(wire, clock):
    bus, source = wire('i2c', g=1.0)
    config(bus, 0x84E3)
    seen = set()
    for step in range(50):
        source.values['acceleration'] = (0.0, 0.0, step * 0.1 * G)
        clock.sleep(0.002)
        seen.add(bus.read(0, 2))
    assert len(seen) > 40
    assert bus.read(1, 2)[0] & 0x80 == 0


# --- MCP3208 -----------------------------------------------------------------------------
@pytest.mark.parametrize('channel', range(8))
@pytest.mark.parametrize(('g', 'code'), [(0.0, 2048), (0.99902, 2172), (-3.0, 1676)])
def test_mcp3208_codes(wire, clock, channel, g, code):
    bus, _ = wire('frame', g)
    clock.sleep(0.01)
    request = bytes([0x06 | channel >> 2, (channel & 3) << 6, 0])
    answer = bus.transfer(request)
    assert answer[1] & 0x10 == 0
    assert answer[1] & 0xE0 == 0xE0  # undefined: here ones
    assert (answer[1] & 0x0F) << 8 | answer[2] == code


@pytest.mark.parametrize(('g', 'code'), [(20.0, 4095), (-20.0, 0)])
def test_mcp3208_saturates(wire, clock, g, code):
    bus, _ = wire('frame', g)
    clock.sleep(0.01)
    answer = bus.transfer(bytes.fromhex('060000'))
    assert (answer[1] & 0x0F) << 8 | answer[2] == code


def test_mcp3208_needs_its_start_bit_and_single_ended(wire, clock):
    bus, _ = wire('frame', g=5.0)
    clock.sleep(0.01)
    assert bus.transfer(bytes(3)) == b'\xff' * 3
    # without S it converts the difference of two inputs, which are alike here
    answer = bus.transfer(bytes.fromhex('040000'))
    assert (answer[1] & 0x0F, answer[2]) == (0, 0)
    # with more clocks the code once more, lowest bit first; then zeros (section 5.0)
    answer = int.from_bytes(bus.transfer(bytes.fromhex('06000000000000')), 'big')
    code, again = answer >> 32 & 0xFFF, answer >> 21 & 0x7FF
    assert f'{again:011b}' == f'{code:012b}'[-2::-1]
    assert answer & 0x1FFFFF == 0


def test_mcp3208_takes_the_value_of_the_moment(wire, clock):
    bus, source = wire('frame')
    bus.transfer(bytes.fromhex('060000'))
    clock.sleep(0.001)
    source.values['acceleration'] = (0.0, 0.0, 0.99902 * G)
    clock.sleep(0.001)
    assert bus.transfer(bytes.fromhex('060000'))[2] == 2172 & 0xFF


def test_mcp3208_frames_take_their_time(wire, clock):
    bus, _ = wire('frame')
    before = clock.now_ns()
    bus.transfer(bytes.fromhex('060000'))
    # 24 clocks at 1 MHz, one for chip select, 10 µs between two transfers
    assert clock.now_ns() - before == pytest.approx(35_000)


# --- MCC 172 -----------------------------------------------------------------------------
def scanning(board, clock, rate=1024.0, fed=True):
    if fed:
        board.set_supply(0, True)
        clock.sleep(3.0)
    board.set_rate(rate)
    board.start(0)


def test_mcc172_codes(wire, clock):
    board, _ = wire('daqhat', g=5.0)
    scanning(board, clock)
    clock.sleep(0.5)
    scan = board.scan()
    # 0.5 V of 5 V and 2^23 codes
    assert set(scan.codes) == {round(0.5 / 5 * 2**23)}
    assert (scan.running, scan.hardware_overrun, scan.buffer_overrun) == (True, False, False)


def test_mcc172_clips_at_five_volts(wire, clock):
    board, source = wire('daqhat', g=60.0)
    scanning(board, clock)
    clock.sleep(0.2)
    assert set(board.scan().codes) == {2**23 - 1}
    source.values['acceleration'] = (0.0, 0.0, -60.0 * G)
    clock.sleep(0.2)
    board.scan()
    clock.sleep(0.2)
    assert set(board.scan().codes) == {-(2**23)}


def test_mcc172_without_supply_there_is_no_signal(wire, clock):
    board, _ = wire('daqhat', g=5.0)
    assert not board.supply(0)
    scanning(board, clock, fed=False)
    clock.sleep(0.2)
    assert set(board.scan().codes) == {0.0}


def test_mcc172_the_bias_has_to_settle(wire, clock):
    board, _ = wire('daqhat')
    board.set_supply(0, True)
    scanning(board, clock, fed=False)
    clock.sleep(3.0)
    volts = board.scan().codes * 5 / 2**23
    assert volts[0] == pytest.approx(5.0)  # clipped
    at = round(0.8 * 1024)
    start = 128 / 1024  # the converters synchronise meanwhile
    assert volts[at] == pytest.approx(11 * math.exp(-(0.8 + start) / 0.204), rel=0.02)
    assert volts[-1] == 0.0


@pytest.mark.parametrize(
    ('asked', 'rate'), [(1000.0, 51200 / 51), (51200.0, 51200.0), (1.0, 200.0), (9e9, 51200.0)]
)
def test_mcc172_rates(wire, clock, asked, rate):
    board, source = wire('daqhat')
    board.set_rate(asked)
    found, synchronised = board.clock()
    assert found == pytest.approx(rate)
    assert not synchronised
    clock.sleep(128 / rate)
    assert board.clock()[1]
    board.start(0)
    assert source.nominal_hz == pytest.approx(rate)


def test_mcc172_samples_come_when_they_have_passed_the_filter(wire, clock):
    board, _ = wire('daqhat')
    scanning(board, clock)
    before = clock.now_ns()
    codes = [board.scan(1.0).codes for _ in range(10)]
    # the tenth block came with a look of the library's thread
    since = (clock.now_ns() - before) * 1e-9
    assert since == pytest.approx(round(since / 0.0256) * 0.0256)
    assert sum(map(len, codes)) == int((since - 4.5e-6) * 1024 - 39)


def test_mcc172_gives_blocks_of_a_tenth_of_a_second(wire, clock):
    board, _ = wire('daqhat')
    scanning(board, clock)
    lengths = []
    for _ in range(1000):
        clock.sleep(0.001)
        lengths.append(len(board.scan().codes))
    blocks = [n for n in lengths if n]
    # 102 samples are a block; they are found by looks every 25.6 ms
    assert set(blocks[1:]) <= set(range(102, 102 + 27))
    assert len(blocks) in (7, 8, 9)


def test_mcc172_overruns(wire, clock):
    board, _ = wire('daqhat', depth_s=1.0)
    scanning(board, clock)
    clock.sleep(1.5)
    assert board.scan().buffer_overrun
    board.hardware_overrun = True
    assert board.scan().hardware_overrun
    board.stop()
    board.start(0)
    clock.sleep(0.1)
    assert not board.scan().hardware_overrun


def test_mcc172_refuses_at_the_wrong_time(wire, clock):
    board, _ = wire('daqhat')
    with pytest.raises(NoAnswer, match='scan not active'):
        board.scan()
    board.start(0)
    with pytest.raises(BusBusy, match='already active'):
        board.start(0)
    with pytest.raises(BusBusy, match='while a scan is active'):
        board.set_rate(1024.0)
    board.close()
    assert np.isfinite(board.scan().codes).all()
