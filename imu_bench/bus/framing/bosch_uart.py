# SPDX-License-Identifier: Apache-2.0
"""
The register protocol of the BNO055 on a serial line: bytes in, answers out.

Document: BST-BNO055-DS000-12 rev. 1.2 (DS), section 4.7.  There is no checksum.
"""

from __future__ import annotations

from typing import NamedTuple

from imu_bench.errors import FrameError

START = 0xAA
WRITE, READ = 0x00, 0x01
DATA, STATUS = 0xBB, 0xEE
LONGEST = 128
SUCCESS = 0x01

CODES = {
    0x01: 'written',
    0x02: 'read failed',
    0x03: 'write failed',
    0x04: 'no such register on this page',
    0x05: 'register cannot be written in this mode',
    0x06: 'wrong start byte',
    0x07: 'bus overrun',
    0x08: 'more than 128 bytes',
    0x09: 'no bytes',
    0x0A: 'a character of the command came too late',
}
"""DS section 4.7.3."""

TRY_AGAIN = frozenset({0x02, 0x03, 0x06, 0x07, 0x0A})
"""What a busy chip or a disturbed line may answer; the others stay as they are."""


class Answer(NamedTuple):
    """What the chip says: data that was read, or a code."""

    data: bytes | None = None
    code: int = SUCCESS

    @property
    def text(self) -> str:
        """Return the code in words."""
        return f'0x{self.code:02X}, {CODES.get(self.code, "which has no meaning")}'


def encode_read(register: int, length: int) -> bytes:
    """Return the command that reads registers."""
    return bytes([START, READ, register, _checked(length)])


def encode_write(register: int, data: bytes) -> bytes:
    """Return the command that writes registers."""
    return bytes([START, WRITE, register, _checked(len(data))]) + data


def _checked(length: int) -> int:
    if not 1 <= length <= LONGEST:
        raise FrameError(f'{length} bytes do not fit a command; 1 to {LONGEST} do')
    return length


class Decoder:
    """Answers out of a stream of bytes; what is incomplete is kept for the next call."""

    def __init__(self) -> None:
        self.garbage = 0  # bytes that belong to no answer
        self._tail = b''

    def feed(self, data: bytes) -> list[Answer]:
        """Return the answers that are complete with these bytes."""
        stream = self._tail + data
        found: list[Answer] = []
        at = 0
        while at < len(stream):
            size = self._size(stream, at)
            if size == 0:
                self.garbage += 1
                at += 1
                continue
            if len(stream) < at + size:
                break
            content = stream[at + 2 : at + size]
            found.append(Answer(content) if stream[at] == DATA else Answer(code=stream[at + 1]))
            at += size
        self._tail = stream[at:]
        return found

    def drop(self) -> None:
        """Forget the start of an answer whose rest does not come."""
        self.garbage += len(self._tail)
        self._tail = b''

    @staticmethod
    def _size(stream: bytes, at: int) -> int:
        """Return the length of the answer that begins here, 0 if none does."""
        kind, rest = stream[at], stream[at + 1 : at + 2]
        if kind == STATUS:
            return 2 if not rest or rest[0] in CODES else 0
        if kind == DATA:
            return 2 if not rest else 2 + rest[0] if 1 <= rest[0] <= LONGEST else 0
        return 0
