# SPDX-License-Identifier: Apache-2.0
"""
Conversations with an Xsens motion tracker: requests, and what they do to its state and settings.

Document: MT Low-Level Communication Protocol, MT0101P 2020.A (LLCP).
"""

from __future__ import annotations

from collections import Counter
import struct

from imu_bench.bus.framing import xbus
from imu_bench.bus.framing.xbus import Message, Mid, Output
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


SLOT_S = 0.1
"""GoToConfig gets lost in a stream of data and is repeated so often."""

TRIES, SHORT_TRIES, RESET_TRIES = 17, 3, 10


class MotionTracker:
    """
    Config and measurement, speed of the line, identity, outputs; each checked.

    Parameters
    ----------
    baud : int
        Speed to which a device on a serial line is brought; 0 on USB.
    """

    def __init__(self, port: XbusPort, baud: int) -> None:
        self._port = port
        self._baud = baud
        self._met = False

    def go_to_config(self) -> None:
        """
        Stop the stream, whatever the device does, and at whatever speed it talks.

        Raises
        ------
        NoAnswer
            If nothing answers.
        """
        if self._baud:
            self._port.set_baud(self._baud)
        try:
            self._port.request(Mid.GO_TO_CONFIG, timeout_s=SLOT_S, tries=TRIES)
        except NoAnswer:
            if self._baud and not self._met:
                self._change_speed()
            else:
                self._port.send(Mid.RESET)
            self._port.request(Mid.GO_TO_CONFIG, timeout_s=SLOT_S, tries=RESET_TRIES)
        self._met = True

    def _change_speed(self) -> None:
        """Look for a device that talks at another speed; let it change, with a reset (LLCP)."""
        for baud in (115_200, 460_800, 230_400, 921_600):
            if baud == self._baud:
                continue
            self._port.set_baud(baud)
            try:
                self._port.request(Mid.GO_TO_CONFIG, timeout_s=SLOT_S, tries=SHORT_TRIES)
            except NoAnswer:
                continue
            self._port.request(Mid.BAUD_RATE, bytes([xbus.BAUD_CODES[self._baud]]))
            self._port.send(Mid.RESET)
            break
        self._port.set_baud(self._baud)

    def identity(self) -> tuple[str, str, str]:
        """Return product code, device id and firmware revision."""
        product = self._port.request(Mid.REQ_PRODUCT_CODE).decode('ascii', 'replace')
        number = self._port.request(Mid.REQ_DEVICE_ID).hex().upper()
        firmware = '.'.join(str(part) for part in self._port.request(Mid.REQ_FIRMWARE)[:3])
        return product.strip(' \0'), number, firmware

    def set_filter_profile(self, profile: int) -> None:
        """
        Choose the profile of the orientation filter, and compare with what the device has.

        Raises
        ------
        BusError
            If it has another one.
        """
        self._port.request(Mid.FILTER_PROFILE, struct.pack('>H', profile))
        # the document gives two bytes and not their meaning; a driver for ROS (ETH) sets the
        # second one
        self._compare('filter profile', profile, self._port.request(Mid.FILTER_PROFILE)[-1:])

    def set_outputs(self, outputs: tuple[Output, ...]) -> None:
        """
        Choose the outputs; compare with the acknowledge, and with what the device then holds.

        Raises
        ------
        BusError
            If the device gives something else, such as a lower rate.
        """
        for data in (xbus.pack_outputs(outputs), b''):
            given = xbus.unpack_outputs(self._port.request(Mid.OUTPUT_CONFIGURATION, data))
            self._compare('output configuration', outputs, given)

    def measure(self) -> None:
        """Start the stream."""
        self._port.request(Mid.GO_TO_MEASUREMENT)

    def _compare(self, what: str, asked: object, given: object) -> None:
        if isinstance(given, bytes):
            given = given[0] if given else None
        if asked != given:
            raise BusError(
                f'{self._port.name}: {what} was set to {asked!r}, but the device has {given!r}; '
                'is it an MTi of the 100 series?'
            )
