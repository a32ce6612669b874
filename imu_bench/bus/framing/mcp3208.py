# SPDX-License-Identifier: Apache-2.0
"""
The SPI frames of Microchip's MCP3208: DS21298E, figures 5-2 and 6-1.

Behind its lowest bit the converter sends the code once more, lowest bit first, as long as the
clock goes on.  It has no checksum, so both are read and compared.
"""

from __future__ import annotations

from imu_bench.errors import ChecksumError, FrameError, NoAnswer

FRAME_BYTES = 5
FULL_SCALE = 4095
_START, _SINGLE_ENDED, _NULL = 0x04, 0x02, 0x10


def request(channel: int) -> bytes:
    """Return the frame that converts an input against ground."""
    return bytes([_START | _SINGLE_ENDED | channel >> 2, (channel & 3) << 6, 0, 0, 0])


def code(answer: bytes) -> int:
    """Return the code in an answer; the bits before the null bit mean nothing."""
    if len(answer) != FRAME_BYTES:
        raise FrameError(f'a conversion has {FRAME_BYTES} bytes, this one {len(answer)}')
    if answer[1] & _NULL:
        raise NoAnswer(f'{answer.hex()}: nothing drives the line; check power, wiring and CS')
    forwards = (answer[1] & 0x0F) << 8 | answer[2]
    # the lowest bit is sent once; five zeros are behind the highest
    backwards = int(f'{forwards >> 1:011b}'[::-1], 2)
    if backwards << 5 != answer[3] << 8 | answer[4]:
        raise ChecksumError(f'{answer.hex()}: forwards and backwards differ; check the wiring')
    return forwards
