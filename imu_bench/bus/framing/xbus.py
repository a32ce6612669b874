# SPDX-License-Identifier: Apache-2.0
"""
Xbus, the serial protocol of Xsens motion trackers: bytes in, messages out.

Document: MT Low-Level Communication Protocol, MT0101P 2020.A (LLCP): section 3 the frame,
section 4 the messages, section 5 the packets of MTData2.

A frame is preamble, bus id, message id, length, data and a checksum that makes the sum of all
but the preamble zero; numbers are big endian.

Which frames are missing, the packet counter tells, held against the clock of the device.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from enum import IntEnum
import struct
from typing import NamedTuple

from imu_bench.errors import FrameError
import numpy as np
import numpy.typing as npt

PREAMBLE = 0xFA
BUS_IDS = (0xFF, 0x01)  # master; a device answers with the id it was asked with
EXTENDED = 0xFF  # as length: the true one follows in two bytes
LONGEST = 2048
EVERY_FRAME = 0xFFFF  # as rate of an output


class Mid(IntEnum):
    """Message ids; a request is acknowledged with the next one."""

    REQ_DEVICE_ID = 0x00
    GO_TO_MEASUREMENT = 0x10
    REQ_FIRMWARE = 0x12
    BAUD_RATE = 0x18
    REQ_PRODUCT_CODE = 0x1C
    GO_TO_CONFIG = 0x30
    DATA = 0x36
    WAKE_UP = 0x3E
    WAKE_UP_ACK = 0x3F
    RESET = 0x40
    ERROR = 0x42
    FILTER_PROFILE = 0x64
    OUTPUT_CONFIGURATION = 0xC0


ERRORS = {
    0x03: 'period out of range',
    0x04: 'message not valid in this state',
    0x1E: 'timer overflow: more data than the line carries',
    0x20: 'baud rate out of range',
    0x21: 'parameter out of range',
    0x28: 'device error; its firmware needs to be updated',
}
"""Codes of the message Error."""

BAUD_CODES = {460800: 0x00, 230400: 0x01, 115200: 0x02, 921600: 0x80}
"""Those of the document that a motion tracker's stream needs."""


class Message(NamedTuple):
    """A message: its id and its data."""

    mid: int
    data: bytes = b''


class Output(NamedTuple):
    """One line of an output configuration: what, and how often in Hz."""

    identifier: int
    rate: int = EVERY_FRAME


def encode(mid: int, data: bytes = b'') -> bytes:
    """
    Return the frame of a message.

    Raises
    ------
    FrameError
        If the data are too long.

    Examples
    --------
    >>> encode(Mid.GO_TO_CONFIG).hex(' ')
    'fa ff 30 00 d1'
    """
    if len(data) < EXTENDED:
        length = bytes([len(data)])
    elif len(data) <= LONGEST:
        length = struct.pack('>BH', EXTENDED, len(data))
    else:
        raise FrameError(f'{len(data)} bytes do not fit a message; {LONGEST} do')
    body = bytes([BUS_IDS[0], mid]) + length + data
    return bytes([PREAMBLE]) + body + bytes([-sum(body) & 0xFF])


def pack_outputs(outputs: Iterable[Output]) -> bytes:
    """Return the data of an output configuration."""
    return b''.join(struct.pack('>HH', *output) for output in outputs)


def unpack_outputs(data: bytes) -> tuple[Output, ...]:
    """
    Return an output configuration from its data.

    Raises
    ------
    FrameError
        If the data are no list of pairs.

    Examples
    --------
    >>> unpack_outputs(bytes.fromhex('1020ffff40200190'))[1]
    Output(identifier=16416, rate=400)
    """
    if len(data) % 4:
        raise FrameError(f'{len(data)} bytes are no output configuration')
    return tuple(Output(*pair) for pair in struct.iter_unpack('>HH', data))


class Decoder:
    """
    Messages out of a stream of bytes; what is incomplete is kept for the next call.

    After a wrong checksum the search goes on one byte later, because a preamble may stand
    anywhere in the data.

    Examples
    --------
    >>> decoder = Decoder()
    >>> decoder.feed(b'??' + bytes.fromhex('faff3100d0faff36'))
    [Message(mid=49, data=b'')]
    >>> decoder.garbage, decoder.waiting
    (2, 3)
    """

    def __init__(self) -> None:
        self.checksum_errors = 0  # frames that arrived whole and wrong
        self.garbage = 0  # bytes that belong to no message
        self._tail = b''

    @property
    def waiting(self) -> int:
        """Return how many bytes of an incomplete frame are kept."""
        return len(self._tail)

    def feed(self, data: bytes) -> list[Message]:
        """Return the messages that are complete with these bytes."""
        stream = self._tail + data
        found: list[Message] = []
        at = 0
        while (start := stream.find(PREAMBLE, at)) >= 0:
            self.garbage += start - at
            at, message = self._frame(stream, start)
            if message is not None:
                found.append(message)
            elif at == start:
                break
        else:
            self.garbage += len(stream) - at
            at = len(stream)
        self._tail = stream[at:]
        return found

    def give_up(self) -> list[Message]:
        """
        Return the messages behind the start of a frame whose rest does not come.

        For a line that is silent: what looked like a long frame was none.
        """
        found: list[Message] = []
        while self._tail and not found:
            self.garbage += 1
            self._tail = self._tail[1:]
            found = self.feed(b'')
        return found

    def _frame(self, stream: bytes, start: int) -> tuple[int, Message | None]:
        """Return where to go on, and the message; the start itself if bytes are missing."""
        if len(stream) < start + 4:
            complete = stream[start + 1 : start + 2] in (b'', *map(_byte, BUS_IDS))
            return (start, None) if complete else self._no_frame(start)
        first, length = start + 4, stream[start + 3]
        if length == EXTENDED and len(stream) >= start + 6:
            first, length = start + 6, int.from_bytes(stream[start + 4 : start + 6], 'big')
        if stream[start + 1] not in BUS_IDS or length > LONGEST:
            return self._no_frame(start)
        end = first + length + 1
        if len(stream) < end:
            return start, None
        if sum(stream[start + 1 : end]) & 0xFF:
            self.checksum_errors += 1
            return self._no_frame(start)
        return end, Message(stream[start + 2], stream[first : end - 1])

    def _no_frame(self, start: int) -> tuple[int, None]:
        self.garbage += 1
        return start + 1, None


def _byte(value: int) -> bytes:
    return bytes([value])


class Column(NamedTuple):
    """One output over many MTData2: in which of them it was, shape (k,), its bytes (k, size)."""

    places: npt.NDArray[np.intp]
    data: npt.NDArray[np.uint8]

    def words(self, dtype: str) -> npt.NDArray[np.generic]:
        """
        Return the bytes as numbers, shape (k, size // itemsize).

        Raises
        ------
        FrameError
            If the size does not fit.
        """
        if self.data.shape[1] % np.dtype(dtype).itemsize:
            raise FrameError(f'{self.data.shape[1]} bytes are no whole number of {dtype}')
        return np.ascontiguousarray(self.data).view(dtype)


def columns(payloads: Sequence[bytes]) -> dict[int, Column]:
    """
    Return the outputs of MTData2 messages by their data identifier.

    Parameters
    ----------
    payloads : sequence of bytes, length n
        Data of the messages; each a run of packets: identifier, size, data.

    Raises
    ------
    FrameError
        If a message is not made of whole packets.

    Examples
    --------
    >>> found = columns([bytes.fromhex('1020020007'), bytes.fromhex('1020020008')])
    >>> found[0x1020].words('>u2')[:, 0].tolist()
    [7, 8]
    """
    alike: dict[tuple[tuple[int, int, int], ...], list[int]] = {}
    for place, payload in enumerate(payloads):
        alike.setdefault(_layout(payload), []).append(place)
    parts: dict[int, list[Column]] = {}
    for layout, members in alike.items():
        places = np.array(members)
        rows = np.frombuffer(b''.join([payloads[k] for k in members]), dtype=np.uint8)
        rows = rows.reshape(len(members), -1)
        for identifier, first, size in layout:
            column = Column(places, rows[:, first : first + size])
            parts.setdefault(identifier, []).append(column)
    return {identifier: _joined(identifier, found) for identifier, found in parts.items()}


def _layout(payload: bytes) -> tuple[tuple[int, int, int], ...]:
    """Return identifier, place and size of each packet."""
    found, at = [], 0
    while at + 3 <= len(payload):
        size = payload[at + 2]
        found.append((payload[at] << 8 | payload[at + 1], at + 3, size))
        at += 3 + size
    if at != len(payload):
        raise FrameError(f'MTData2 of {len(payload)} bytes is not made of whole packets')
    return tuple(found)


def _joined(identifier: int, parts: list[Column]) -> Column:
    if len(parts) == 1:
        return parts[0]
    if len({part.data.shape[1] for part in parts}) > 1:
        raise FrameError(f'output 0x{identifier:04X} changes its size')
    places = np.concatenate([part.places for part in parts])
    order = np.argsort(places)
    return Column(places[order], np.concatenate([part.data for part in parts])[order])


COUNTS = 1 << 16
"""Where PacketCounter begins anew."""

TICKS_PER_S = 10_000
"""Of SampleTimeFine."""

TICKS_A_DAY = 864_000_000
"""Where SampleTimeFine begins anew."""

TICK_NS = 1_000_000_000 // TICKS_PER_S


class Counted(NamedTuple):
    """What the counters of some frames say."""

    missing: npt.NDArray[np.int64]  # frames that are missing before each; of those up to a jump
    ages_ns: npt.NDArray[np.int64]  # how much earlier than the last of them each was sampled
    jumped: bool  # counter and clock contradict each other after these: the device began anew


class FrameCounter:
    """
    Follows the counters from frame to frame.

    Examples
    --------
    >>> frames = FrameCounter(400.0)
    >>> frames.take(np.array([65534, 65535, 2]), np.array([100, 125, 200])).missing.tolist()
    [0, 0, 2]
    """

    def __init__(self, rate_hz: float) -> None:
        self._period = round(TICKS_PER_S / rate_hz)
        self._last: tuple[int, int] | None = None

    def begin(self) -> None:
        """Take the next frame as the first one."""
        self._last = None

    def take(self, counter: npt.NDArray[np.int64], ticks: npt.NDArray[np.int64]) -> Counted:
        """
        Return what is missing.

        Parameters
        ----------
        counter, ticks : ndarray of int64, shape (n,)
            PacketCounter and SampleTimeFine of frames in their order, one at least.
        """
        if self._last is None:
            self._last = int(counter[0]) - 1, int(ticks[0]) - self._period
        before = np.array(self._last)[:, np.newaxis]
        steps, passed = np.diff(np.hstack([before, np.stack([counter, ticks])]))
        steps, passed = steps % COUNTS, passed % TICKS_A_DAY
        off = np.abs(passed - steps * self._period) > self._period / 2
        jumps = np.flatnonzero(off | (steps == 0))
        n = int(jumps[0]) if jumps.size else counter.size
        self._last = int(counter[-1]), int(ticks[-1])
        ages = (ticks[n - 1] - ticks[:n]) % TICKS_A_DAY * TICK_NS
        return Counted(steps[:n] - 1, ages, bool(jumps.size))
