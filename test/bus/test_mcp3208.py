# SPDX-License-Identifier: Apache-2.0
"""Frames of the MCP3208: DS21298E figure 6-1."""

from imu_bench.bus.converters import mcp3208
from imu_bench.errors import FrameError, NoAnswer
import pytest


def test_requests_of_every_input():
    expected = [f'0{k}0000000' for k in ('60', '64', '68', '6c', '70', '74', '78', '7c')]
    assert [mcp3208.request(channel).hex() for channel in range(8)] == expected


@pytest.mark.parametrize('undefined', [0x00, 0x20, 0xC0, 0xE0])
@pytest.mark.parametrize('code', [0, 1, 255, 256, 2172, 4095])
def test_bits_before_the_null_bit_mean_nothing(undefined, code):
    backwards = int(f'{code:012b}'[-2::-1], 2) << 5
    answer = bytes([undefined, undefined | code >> 8, code & 0xFF]) + backwards.to_bytes(2, 'big')
    assert mcp3208.code(answer) == code


@pytest.mark.parametrize('answer', ['ffffffffff', '0010000000', 'fff87c7c20'])
def test_a_null_bit_of_one_is_an_open_line(answer):
    with pytest.raises(NoAnswer, match=f'{answer}: nothing drives the line'):
        mcp3208.code(bytes.fromhex(answer))


def test_a_frame_has_five_bytes():
    with pytest.raises(FrameError, match='5 bytes'):
        mcp3208.code(b'\x00\x00')
