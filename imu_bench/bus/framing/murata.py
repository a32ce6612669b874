# SPDX-License-Identifier: Apache-2.0
"""
The 32-bit SPI frames of Murata's inclinometers and accelerometers.

Murata SCL3300-D01 data sheet, Doc 4921 rev. 2 (DS), section 5.1: one bit read or write, five
bits address, two bits return status, sixteen bits data, eight bits checksum, first bit first.
The answer to a frame comes with the next one.
"""

from __future__ import annotations

from typing import NamedTuple

from imu_bench.errors import ChecksumError, ConfigError, FrameError, NoAnswer

FRAME_BYTES = 4

STARTING, NORMAL, RESERVED, ERROR = range(4)
"""Return status, DS table 14."""


def _crc_of(byte: int) -> int:
    for _ in range(8):
        byte = byte << 1 ^ (0x11D if byte & 0x80 else 0)
    return byte


_TABLE = tuple(_crc_of(byte) for byte in range(256))


def crc8(data: bytes) -> int:
    """
    Return the checksum of the first three bytes of a frame.

    Polynomial x⁸ + x⁴ + x³ + x² + 1, start 0xFF, result inverted: DS section 5.1.6, the
    CRC-8/SAE-J1850 of the catalogues.

    Examples
    --------
    >>> hex(crc8(bytes.fromhex('040000')))
    '0xf7'
    """
    first, second, third = data
    return _TABLE[_TABLE[_TABLE[0xFF ^ first] ^ second] ^ third] ^ 0xFF


def frame(address: int, data: int = 0, *, write: bool = False, status: int = 0) -> bytes:
    """
    Return a frame: a request, or with a status an answer.

    Raises
    ------
    ConfigError
        If a part does not fit.

    Examples
    --------
    >>> frame(0x0D, 3, write=True).hex()
    'b4000338'
    """
    if not (0 <= address < 1 << 5 and 0 <= data < 1 << 16 and 0 <= status < 1 << 2):
        raise ConfigError(
            f'address 0x{address:X}, data 0x{data:X}, status {status} do not fit a frame of '
            '5, 16 and 2 bits'
        )
    body = bytes([write << 7 | address << 2 | status, data >> 8, data & 0xFF])
    return body + bytes([crc8(body)])


class Answer(NamedTuple):
    """What a frame from the chip says."""

    write: bool
    address: int
    status: int
    data: int

    def belongs_to(self, request: bytes) -> bool:
        """Return whether it is the answer to a request."""
        return self.write << 7 | self.address << 2 == request[0]


def parse(raw: bytes) -> Answer:
    """Return what a frame from the chip says."""
    if len(raw) != FRAME_BYTES:
        raise FrameError(f'a frame has {FRAME_BYTES} bytes, this one {len(raw)}')
    if crc8(raw[:3]) != raw[3]:
        if raw in (b'\x00\x00\x00\x00', b'\xff\xff\xff\xff'):
            raise NoAnswer(f'{raw.hex()}: nothing drives the line; check power, wiring and CSB')
        raise ChecksumError(
            f'frame {raw.hex()} has checksum 0x{raw[3]:02x} instead of 0x{crc8(raw[:3]):02x}'
        )
    first = raw[0]
    return Answer(bool(first >> 7), first >> 2 & 0x1F, first & 3, raw[1] << 8 | raw[2])
