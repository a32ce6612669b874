# SPDX-License-Identifier: Apache-2.0
"""Murata's SPI frames: checksums of the data sheet, and the answer that comes one frame late."""

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st
from imu_bench.bus.framing import murata
from imu_bench.bus.off_frame import OffFrameBus
from imu_bench.bus.scripted import ScriptedFrames
from imu_bench.errors import BusBusy, ChecksumError, ConfigError, FrameError, NoAnswer
import pytest

# Doc 4921 rev. 2, tables 13 and 15 and sections 5 and 6: frames printed there
_TEXT = """
040000F7 080000FD 0C0000FB 100000E9 140000EF 180000E5 1C0000E3 200000C1 240000C7 280000CD
2C0000CB B0001F6F 340000DF 40000091 640000A7 680000AD 7C0000B3 B400001F B4000102 B4000225
B4000338 B400046B B4002098 FC000073 FC00016E
0500DC1C B70002A9 15161E0A B7000093 250F8825 1900129D 1100017B 1B00129E 65F7DA19 693CE54F
1B00407A 19004079 1900006A FD0001E1 4100C136 35000050 35000377
"""
PRINTED = _TEXT.split()


def crc_by_bits(data):
    """Shift one bit after the other through x⁸+x⁴+x³+x²+1, as the data sheet describes it."""
    crc = 0xFF
    for bit in ''.join(f'{byte:08b}' for byte in data):
        top = crc >> 7
        crc = crc << 1 & 0xFF
        if top != int(bit):
            crc ^= 0x1D
    return crc ^ 0xFF


@pytest.mark.parametrize('text', PRINTED)
def test_the_printed_checksums(text):
    raw = bytes.fromhex(text)
    assert crc_by_bits(raw[:3]) == raw[3]
    assert murata.crc8(raw[:3]) == raw[3]
    found = murata.parse(raw)
    again = murata.frame(found.address, found.data, write=found.write, status=found.status)
    assert again == raw


@given(st.binary(min_size=3, max_size=3))
def test_every_checksum_is_that_of_the_bitwise_rule(body):
    assert murata.crc8(body) == crc_by_bits(body)


@given(st.sampled_from(PRINTED), st.integers(0, 31))
def test_every_single_bit_error_is_found(text, bit):
    raw = (int(text, 16) ^ 1 << bit).to_bytes(4, 'big')
    with pytest.raises(ChecksumError, match=f'frame {raw.hex()} has checksum'):
        murata.parse(raw)


@given(st.sampled_from(PRINTED), st.integers(1, 255), st.integers(0, 24))
def test_every_burst_of_up_to_eight_bits_is_found(text, pattern, place):
    raw = (int(text, 16) ^ pattern << place).to_bytes(4, 'big')
    with pytest.raises((ChecksumError, NoAnswer)):
        murata.parse(raw)


def test_the_parts_of_an_answer():
    assert murata.parse(bytes.fromhex('B70002A9')) == (True, 0x0D, murata.ERROR, 2)
    assert murata.parse(bytes.fromhex('05F4484C')) == (False, 1, murata.NORMAL, 0xF448)


@pytest.mark.parametrize('raw', [bytes(4), b'\xff' * 4])
def test_a_line_nobody_drives(raw):
    with pytest.raises(NoAnswer, match='nothing drives the line'):
        murata.parse(raw)


def test_what_does_not_fit_is_refused():
    with pytest.raises(FrameError, match='4 bytes'):
        murata.parse(b'\x18\x00\x00')
    with pytest.raises(ConfigError, match='do not fit'):
        murata.frame(0x20)
    with pytest.raises(ConfigError, match='do not fit'):
        murata.frame(0, 1 << 16)


# --- one frame later ---------------------------------------------------------------------
def bus(*steps):
    script = [
        (bytes.fromhex(out), back if isinstance(back, Exception) else bytes.fromhex(back))
        for out, back in steps
    ]
    wire = ScriptedFrames(script)
    return OffFrameBus(wire, Counter()), wire


WHOAMI, WHO_IS = '40000091', '4100C136'


def test_answers_belong_to_the_frame_before():
    # the flag-clear trace of DS section 6.3.1, then WHOAMI to fetch the last answer
    made, wire = bus(
        ('180000E5', '00112233'),
        ('180000E5', '1B00407A'),
        ('180000E5', '19004079'),
        (WHOAMI, '1900006A'),
    )
    answers = [(a.status, a.data) for a in made.exchange([bytes.fromhex('180000E5')] * 3)]
    assert answers == [(3, 0x40), (1, 0x40), (1, 0)]
    wire.finish()
    assert made.name == 'script'


def test_the_last_answer_is_checked_by_the_next_exchange():
    made, wire = bus(
        (WHOAMI, 'FFFFFFFF'), (WHOAMI, WHO_IS), (WHOAMI, WHO_IS), (WHOAMI, '4100C137')
    )
    assert made.read(0x10, 2) == b'\x00\xc1'
    with pytest.raises(ChecksumError, match='script: frame 4100c137'):
        made.read(0x10, 2)
    assert made._counters == {'crc_errors': 1}
    wire.finish()


def test_words_come_in_one_exchange():
    made, wire = bus(
        ('040000F7', '00000000'),
        ('080000FD', '0500DC1C'),
        ('0C0000FB', murata.frame(2, 0x1234, status=1).hex()),
        (WHOAMI, murata.frame(3, 0xFEDC, status=1).hex()),
    )
    assert made.read(0x01, 6).hex() == '00dc1234fedc'
    wire.finish()


def test_the_echo_of_a_write_is_checked():
    made, _ = bus(('FC00016E', '00000000'), (WHOAMI, 'FD0001E1'), (WHOAMI, WHO_IS))
    made.write(0x1F, b'\x00\x01')
    assert made.read(0x10, 2) == b'\x00\xc1'
    made, _ = bus(('B4000338', '00000000'), (WHOAMI, 'B70002A9'))
    made.write(0x0D, b'\x00\x03')
    with pytest.raises(FrameError, match='b70002a9 does not answer b4000338'):
        made.read(0x10, 2)
    assert made._counters == {'frame_errors': 1}


def test_nothing_is_expected_after_a_reset():
    made, wire = bus(('B4002098', '00000000'), (WHOAMI, 'DEADBEEF'), (WHOAMI, WHO_IS))
    made.write(0x0D, b'\x00\x20')
    assert made.read(0x10, 2) == b'\x00\xc1'
    wire.finish()


def test_after_a_failure_the_pipeline_begins_anew():
    made, wire = bus(
        ('180000E5', '00000000'),
        (WHOAMI, BusBusy('stuck')),
        ('180000E5', 'DEADBEEF'),
        (WHOAMI, '1900006A'),
    )
    with pytest.raises(BusBusy):
        made.read(0x06, 2)
    assert made.read(0x06, 2) == b'\x00\x00'
    assert not made._counters
    made.close()
    assert wire.closed


def test_an_answer_to_something_else_is_an_error():
    made, _ = bus(('180000E5', '00000000'), (WHOAMI, '15161E0A'))
    with pytest.raises(FrameError, match='15161e0a does not answer 180000e5; check that CSB'):
        made.read(0x06, 2)
