# SPDX-License-Identifier: Apache-2.0
"""
One event of a wire recording: a reading of the clock, or a request with its answer.

In the file an event is its kind (one byte), and then: of the clock the time in ns (int64); of a
request the number of the die (uint8), the lengths of request and answer (uint32 each), and both.
The highest bit of the kind says that the answer is an error: its class, a line feed, its text.
Numbers are little endian.  What a request holds is packed by `wires`.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum
import struct
from typing import NamedTuple

from imu_bench import errors
from imu_bench.bus.claim import ChipInUse
from imu_bench.errors import BenchError, RecordingError

CLOCK = struct.Struct('<Bq')
REQUEST = struct.Struct('<BBII')
REGISTER = struct.Struct('<HI')
FAILED = 0x80

_ERRORS: dict[str, type[BenchError]] = {
    name: kind
    for name, kind in vars(errors).items()
    if isinstance(kind, type) and issubclass(kind, BenchError)
} | {'ChipInUse': ChipInUse}


class Kind(IntEnum):
    """What is asked."""

    TIME = 0
    READ = 1
    WRITE = 2
    TRANSFER = 3
    RECEIVE = 4
    SEND = 5
    BAUD = 6
    IDENTITY = 7
    SET_SUPPLY = 8
    SUPPLY = 9
    SET_RATE = 10
    RATE = 11
    START = 12
    SCAN = 13
    STOP = 14
    EDGES = 15
    DRIVE = 16


_NUMBERS = frozenset(Kind)


class Event(NamedTuple):
    """One event."""

    kind: int  # of `Kind`
    part: int = 0  # number of the die
    # request, answer: of a reading of the clock there are none
    request: bytes = b''
    answer: bytes = b''
    failed: bool = False  # the answer is an error
    time_ns: int = 0  # of a reading of the clock


def packed_error(error: BenchError) -> bytes:
    """Return an error as an answer; of one that is not in the tree, the nearest that is."""
    name = next(kind.__name__ for kind in type(error).__mro__ if kind in _ERRORS.values())
    return f'{name}\n{error}'.encode()


def unpacked_error(answer: bytes) -> BenchError:
    """Return the error that an answer is."""
    name, _, text = answer.decode(errors='replace').partition('\n')
    if name not in _ERRORS:
        raise RecordingError(f'holds an error {name!r}, which this version does not have')
    return _ERRORS[name](text)


def unpack(block: bytes) -> Iterator[Event]:
    """Yield the events of a block."""
    at, end = 0, len(block)
    while at < end:
        try:
            if block[at] == Kind.TIME:
                _, time_ns = CLOCK.unpack_from(block, at)
                at += CLOCK.size
                yield Event(Kind.TIME, time_ns=time_ns)
                continue
            kind, part, asked, answered = REQUEST.unpack_from(block, at)
        except struct.error as error:
            raise RecordingError('half an event') from error
        at += REQUEST.size
        if at + asked + answered > end or kind & ~FAILED not in _NUMBERS:
            raise RecordingError('bytes that are no event')
        request, answer = block[at : at + asked], block[at + asked : at + asked + answered]
        at += asked + answered
        yield Event(kind & ~FAILED, part, request, answer, kind & FAILED > 0)


def spoken(kind: int, part: str, request: bytes) -> str:
    """Return a request in words."""
    where = f' of {part}' if part else ''
    if kind in (Kind.READ, Kind.WRITE) and len(request) >= REGISTER.size:
        register, length = REGISTER.unpack_from(request)
        data = request[REGISTER.size :].hex()
        doing = f'read {length} bytes from' if kind == Kind.READ else f'write {data} to'
        return f'{doing} register 0x{register:02X}{where}'
    if kind == Kind.TIME:
        return 'read the clock'
    word = Kind(kind).name.lower().replace('_', ' ')
    return f'{word} {request.hex()}'.rstrip() + where
