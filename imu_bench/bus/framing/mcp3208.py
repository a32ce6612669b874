# SPDX-License-Identifier: Apache-2.0
"""The SPI frames of Microchip's MCP3208: DS21298E, figure 6-1, three bytes for a conversion."""

from __future__ import annotations

from imu_bench.errors import FrameError, NoAnswer

FRAME_BYTES = 3
FULL_SCALE = 4095
_START, _SINGLE_ENDED, _NULL = 0x04, 0x02, 0x10


def request(channel: int) -> bytes:
    """
    Return the frame that converts an input against ground.

    Examples
    --------
    >>> request(0).hex(), request(3).hex(), request(7).hex()
    ('060000', '06c000', '07c000')
    """
    return bytes([_START | _SINGLE_ENDED | channel >> 2, (channel & 3) << 6, 0])


def code(answer: bytes) -> int:
    """
    Return the code in an answer; the bits before the null bit mean nothing.

    Raises
    ------
    NoAnswer
        If the null bit is one: nothing drives the line.
    FrameError
        If it is not three bytes.

    Examples
    --------
    >>> code(bytes.fromhex('ffe87c'))
    2172
    """
    if len(answer) != FRAME_BYTES:
        raise FrameError(f'a conversion has {FRAME_BYTES} bytes, this one {len(answer)}')
    if answer[1] & _NULL:
        raise NoAnswer(f'{answer.hex()}: nothing drives the line; check power, wiring and CS')
    return (answer[1] & 0x0F) << 8 | answer[2]
