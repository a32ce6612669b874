# SPDX-License-Identifier: Apache-2.0
"""Conversations with an Xsens motion tracker."""

from __future__ import annotations

from collections import Counter

from imu_bench.bus.framing import xbus
from imu_bench.bus.framing.xbus import Message, Mid
from imu_bench.bus.interface import ByteStream, Clock
from imu_bench.errors import BusError, NoAnswer

SLICE_NS = 20_000_000


class XbusPort:
    """
    Requests with their acknowledges, and messages that come by themselves.

    Parameters
    ----------
    counters : Counter
        Counts 'bus_errors' (failed transfers, wrong checksums), 'checksum_errors',
        'garbage_bytes', 'device_errors', and as 'brown_outs' devices that wake up unasked.

    Examples
    --------
    >>> from imu_bench.bus.clock import SystemClock
    >>> from imu_bench.bus.scripted import ScriptedStream
    >>> with ScriptedStream([(bytes.fromhex('faff3000d1'), bytes.fromhex('faff3100d0'))]) as line:
    ...     XbusPort(line, SystemClock(), Counter()).request(Mid.GO_TO_CONFIG)
    b''
    """

    def __init__(self, line: ByteStream, clock: Clock, counters: Counter[str]) -> None:
        self.name = line.name
        self._line = line
        self._clock = clock
        self._counters = counters
        self._decoder = xbus.Decoder()
        # what came behind an acknowledge: the first data of a stream
        self._kept: list[Message] = []
        # it has answered since it was plugged in or reset: when it wakes up it was without power
        self._awake = False

    def set_baud(self, baud: int) -> None:
        """Change the speed of this end of the line; what arrived at the old one is forgotten."""
        if self._line.baud != baud:
            self._line.baud = baud
            self._decoder, self._kept = xbus.Decoder(), []

    def receive(self, timeout_s: float = 0.0) -> list[Message]:
        """Return the messages that have arrived, waiting for the first byte; counts the rest."""
        kept, self._kept = self._kept, []
        try:
            data = self._line.read(0.0 if kept else timeout_s)
        except BusError:
            self._counters['bus_errors'] += 1
            raise
        decoder = self._decoder
        wrong, garbage = decoder.checksum_errors, decoder.garbage
        messages = decoder.feed(data) if data or kept else decoder.give_up()
        wrong, garbage = decoder.checksum_errors - wrong, decoder.garbage - garbage
        self._counters['bus_errors'] += wrong
        self._counters['checksum_errors'] += wrong
        self._counters['garbage_bytes'] += garbage
        return kept + messages

    def send(self, mid: int, data: bytes = b'') -> None:
        """Send a message that nothing answers."""
        self._awake &= mid != Mid.RESET
        try:
            self._line.write(xbus.encode(mid, data))
        except BusError:
            self._counters['bus_errors'] += 1
            raise

    def request(
        self, mid: Mid, data: bytes = b'', *, timeout_s: float = 0.5, tries: int = 1
    ) -> bytes:
        """Return the data with which the device acknowledges; what arrives before is dropped."""
        for _ in range(tries):
            self.send(mid, data)
            deadline = self._clock.now_ns() + round(timeout_s * 1e9)
            while (now := self._clock.now_ns()) < deadline:
                # in slices, so that half a frame does not hide the acknowledge behind it
                slice_ns = min(deadline - now, SLICE_NS)
                messages = self.receive(slice_ns * 1e-9)
                for place, message in enumerate(messages, 1):
                    if message.mid == mid + 1:
                        self._kept, self._awake = messages[place:], True
                        return message.data
                    self._notice(message, f'answers {mid.name}')
                if not messages:
                    self._clock.sleep_until(now + slice_ns)
        self._counters['bus_errors'] += 1
        raise NoAnswer(
            f'{self.name}: no acknowledge of {mid.name} (0x{mid:02X}) in {tries * timeout_s:g} s; '
            'check plug, power and baud rate'
        )

    def _notice(self, message: Message, doing: str) -> None:
        if message.mid == Mid.ERROR:
            raise self.error_of(message, doing)
        if message.mid == Mid.WAKE_UP:
            self.woke_up()
            # without it the device measures half a second later (LLCP section 4)
            self.send(Mid.WAKE_UP_ACK)

    def woke_up(self) -> None:
        """Count a device that wakes up although nobody has reset it."""
        self._counters['brown_outs'] += self._awake
        self._awake = False

    def error_of(self, message: Message, doing: str = 'reports') -> BusError:
        """Count an error message; return what it says."""
        self._counters['device_errors'] += 1
        code = message.data[0] if message.data else 0
        meaning = xbus.ERRORS.get(code, 'which the document does not have')
        return BusError(f'{self.name}: the device {doing} with error 0x{code:02X}, {meaning}')

    def close(self) -> None:
        """Release the device."""
        self._line.close()
