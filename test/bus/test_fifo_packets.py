# SPDX-License-Identifier: Apache-2.0
"""FIFO packets of the IIM-42652: vectors worked out by hand from DS-000401 section 6.1."""

from hypothesis import given
from hypothesis import strategies as st
from imu_bench.bus.framing import fifo_packets
from imu_bench.errors import FrameError
import numpy as np
import pytest

THREE = bytes.fromhex('68 0000 0000 0800 00A4 FF5C 0000 00 03E8')
FOUR = bytes.fromhex('78 0000 FFFF 0800 00A3 FF5C 0000 052D 03E8 0C C4 00')


def test_packet_three():
    (packet,) = fifo_packets.unpack(THREE, 16)
    assert len(THREE) == 16
    assert packet['acceleration'].tolist() == [0, 0, 2048]
    assert packet['angular_velocity'].tolist() == [164, -164, 0]
    assert packet['temperature'] == 0
    assert packet['timestamp'] == 1000


def test_packet_four():
    packets = fifo_packets.unpack(FOUR, 20)
    assert len(FOUR) == 20
    acceleration, rotation = fifo_packets.words_20(packets)
    assert acceleration.tolist() == [[0, -4, 32768]]
    assert rotation.tolist() == [[2620, -2620, 0]]
    assert packets['temperature'].tolist() == [1325]


def by_hand(word):
    """Split a signed number of 20 bits as DS table 13 does."""
    bits = f'{word & 0xFFFFF:020b}'
    return int(bits[:16], 2), int(bits[16:], 2)


@given(st.lists(st.integers(-(2**19), 2**19 - 1), min_size=6, max_size=6))
def test_every_number_of_20_bits(words):
    parts = [by_hand(word) for word in words]
    body = b''.join(high.to_bytes(2, 'big') for high, _ in parts)
    low = bytes(a[1] << 4 | g[1] for a, g in zip(parts[:3], parts[3:], strict=True))
    packets = fifo_packets.unpack(b'\x78' + body + bytes(4) + low, 20)
    acceleration, rotation = fifo_packets.words_20(packets)
    assert [*acceleration[0].tolist(), *rotation[0].tolist()] == words


def test_an_empty_fifo_ends_the_burst():
    packets = fifo_packets.unpack(THREE * 2 + b'\xff' * 16 + THREE, 16)
    assert len(packets) == 2
    assert len(fifo_packets.unpack(b'\xff' * 16, 16)) == 0
    assert len(fifo_packets.unpack(b'', 20)) == 0


@pytest.mark.parametrize('header', [0x6B, 0x69])
def test_a_changed_rate_in_the_header_is_no_fault(header):
    assert len(fifo_packets.unpack(bytes([header]) + THREE[1:], 16)) == 1


@pytest.mark.parametrize('header', [0x00, 0x40, 0x20, 0x60, 0x6C, 0x78, 0x08])
def test_another_header_is_an_error(header):
    with pytest.raises(FrameError, match=f'0x{header:02X} instead of 0x68'):
        fifo_packets.unpack(THREE + bytes([header]) + THREE[1:], 16)


@pytest.mark.parametrize('place', range(6))
def test_a_sample_without_measurement_is_found(place):
    raw = bytearray(THREE)
    raw[1 + 2 * place : 3 + 2 * place] = b'\x80\x00'
    packets = fifo_packets.unpack(THREE + bytes(raw), 16)
    assert fifo_packets.invalid(packets).tolist() == [False, True]


@pytest.mark.parametrize('tick', [1.0, 32 / 30, 0.985, 1.015 * 32 / 30])
@pytest.mark.parametrize(
    ('rate', 'unit'), [(12.5, 16), (50.0, 16), (200.0, 16), (500.0, 1), (8000.0, 1)]
)
def test_packets_follow_one_another_whatever_the_tick(rate, unit, tick):
    times = np.floor(1e6 / rate / unit / tick * np.arange(1, 4000)).astype(np.int64) & 0xFFFF
    follow = fifo_packets.Continuity(rate, unit)
    assert all(follow.take(block) for block in np.array_split(times, 31))
    for missing in (1, 2, 3, 7):
        gap = np.delete(times[:100], slice(50, 50 + missing))
        assert not fifo_packets.Continuity(rate, unit).take(gap), missing
    follow.restart()
    assert follow.take(times[:1])
    assert follow.take(times[:0])
    assert follow.take(times[1:2])
