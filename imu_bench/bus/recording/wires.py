# SPDX-License-Identifier: Apache-2.0
"""
The six kinds of wire as requests and answers in bytes, the same when recorded and when played.

How long somebody is ready to wait for bytes is not on the wire, and is not recorded.
"""

from __future__ import annotations

from collections.abc import Callable
import struct
from typing import Any

from imu_bench.bus.interface import Scan
from imu_bench.bus.recording.events import Kind, REGISTER
from imu_bench.bus.recording.file import WireHead
import numpy as np

Exchange = Callable[[int, bytes, Callable[[], bytes]], bytes]
"""Kind, request, and what asks the live wire; gives the answer or raises the error."""

_SUPPLY = struct.Struct('<i?')
_CHANNEL = struct.Struct('<i')
_RATE = struct.Struct('<d')
_CLOCK = struct.Struct('<d?')
_FLAGS = struct.Struct('<???')


class _Taped:
    """What is common to all kinds; a played wire has no live one."""

    def __init__(self, head: WireHead, exchange: Exchange, live: Any = None) -> None:
        self.name = head.name
        self._head = head
        self._exchange = exchange
        self._live = live

    def close(self) -> None:
        """Release the device."""
        if self._live is not None:
            self._live.close()

    def _do(self, kind: Kind, request: bytes, method: str, *arguments: object) -> None:
        """Ask for something that has no answer."""

        def live() -> bytes:
            getattr(self._live, method)(*arguments)
            return b''

        self._exchange(kind, request, live)


class TapedRegisters(_Taped):
    """A RegisterBus."""

    def read(self, register: int, length: int) -> bytes:
        """Return `length` bytes from `register` on, in one transaction."""
        request = REGISTER.pack(register, length)
        return self._exchange(Kind.READ, request, lambda: self._live.read(register, length))

    def write(self, register: int, data: bytes) -> None:
        """Write bytes from `register` on, in one transaction."""
        request = REGISTER.pack(register, len(data)) + data
        self._do(Kind.WRITE, request, 'write', register, data)


class TapedFrames(_Taped):
    """A FrameBus."""

    def transfer(self, frame: bytes) -> bytes:
        """Send a frame; return what the chip sent meanwhile, of the same length."""
        return self._exchange(Kind.TRANSFER, frame, lambda: self._live.transfer(frame))


class TapedStream(_Taped):
    """A ByteStream."""

    def __init__(self, head: WireHead, exchange: Exchange, live: Any = None) -> None:
        super().__init__(head, exchange, live)
        self._baud = head.baud

    @property
    def baud(self) -> int:
        """Speed in bit/s."""
        return self._baud

    @baud.setter
    def baud(self, baud: int) -> None:
        self._do(Kind.BAUD, _CHANNEL.pack(baud), '__setattr__', 'baud', baud)
        self._baud = baud

    def read(self, timeout_s: float) -> bytes:
        """Return what has arrived, waiting up to `timeout_s` for the first byte."""
        return self._exchange(Kind.RECEIVE, b'', lambda: self._live.read(timeout_s))

    def write(self, data: bytes) -> None:
        """Send bytes."""
        self._do(Kind.SEND, data, 'write', data)


class TapedBoard(_Taped):
    """A DaqBoard."""

    def identity(self) -> str:
        """Return product, serial number and firmware."""
        return self._exchange(Kind.IDENTITY, b'', lambda: self._live.identity().encode()).decode()

    def set_supply(self, channel: int, on: bool) -> None:
        """Switch the constant current (IEPE) that feeds a sensor."""
        self._do(Kind.SET_SUPPLY, _SUPPLY.pack(channel, on), 'set_supply', channel, on)

    def supply(self, channel: int) -> bool:
        """Return whether a sensor is fed."""
        request = _CHANNEL.pack(channel)
        return self._exchange(
            Kind.SUPPLY, request, lambda: bytes([self._live.supply(channel)])
        ) == bytes([True])

    def set_rate(self, rate_hz: float) -> None:
        """Set the rate of all channels; the converters begin to synchronise."""
        self._do(Kind.SET_RATE, _RATE.pack(rate_hz), 'set_rate', rate_hz)

    def clock(self) -> tuple[float, bool]:
        """Return the rate that is set, and whether the converters are synchronised."""
        answer = self._exchange(Kind.RATE, b'', lambda: _CLOCK.pack(*self._live.clock()))
        rate_hz, synchronised = _CLOCK.unpack(answer)
        return rate_hz, synchronised

    def start(self, channel: int) -> None:
        """Convert one channel until stopped."""
        self._do(Kind.START, _CHANNEL.pack(channel), 'start', channel)

    def scan(self, wait_s: float = 0.0) -> Scan:
        """Return what has been converted since the last call, waiting so long for some."""

        def live() -> bytes:
            codes, *flags = self._live.scan(wait_s)
            return _FLAGS.pack(*flags) + np.asarray(codes, dtype='<f8').tobytes()

        answer = self._exchange(Kind.SCAN, b'', live)
        return Scan(np.frombuffer(answer, '<f8', offset=_FLAGS.size), *_FLAGS.unpack_from(answer))

    def stop(self) -> None:
        """Stop converting and let go of the buffer; harmless when nothing runs."""
        self._do(Kind.STOP, b'', 'stop')


class TapedLine(_Taped):
    """An EdgeLine."""

    def edges(self) -> list[int]:
        """Return when it rose since the last call, ns; does not wait."""

        def live() -> bytes:
            return np.asarray(self._live.edges(), '<i8').tobytes()

        found: list[int] = np.frombuffer(self._exchange(Kind.EDGES, b'', live), '<i8').tolist()
        return found


class TapedOutput(_Taped):
    """An OutputLine."""

    def drive(self, high: bool) -> None:
        """Set the level."""
        self._do(Kind.DRIVE, bytes([high]), 'drive', high)


KINDS: dict[str, type[_Taped]] = {
    'registers': TapedRegisters,
    'frames': TapedFrames,
    'stream': TapedStream,
    'board': TapedBoard,
    'line': TapedLine,
    'output': TapedOutput,
}


def described(part: str, wire: Any) -> WireHead:
    """Return what a wire is."""
    if hasattr(wire, 'edges'):
        return WireHead(part, 'line', wire.name)
    if hasattr(wire, 'drive'):
        return WireHead(part, 'output', wire.name)
    if hasattr(wire, 'scan'):
        return WireHead(part, 'board', wire.name)
    if hasattr(wire, 'transfer'):
        return WireHead(part, 'frames', wire.name)
    if hasattr(wire, 'baud'):
        return WireHead(part, 'stream', wire.name, int(wire.baud))
    return WireHead(part, 'registers', wire.name)
