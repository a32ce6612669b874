# SPDX-License-Identifier: Apache-2.0
"""
The MTi-300 seen from its serial line: MT Low-Level Communication Protocol, MT0101P 2020.A.

It wakes up, may be configured, and measures at 400 Hz; each output has its own rate, and a frame
carries what is due.
"""

from __future__ import annotations

from collections.abc import Iterable
import struct

from imu_bench.bus.framing import xbus
from imu_bench.bus.framing.xbus import EVERY_FRAME, Mid, Output
from imu_bench.drivers.mti300 import BASE_HZ, Mti300
from imu_bench.emulators.ahead import Ahead, rows_of, Source
from imu_bench.emulators.attitude import Attitude
from imu_bench.emulators.register_map import or_zero
from imu_bench.emulators.socket import Socket
from imu_bench.emulators.stream import EmulatedStream, StreamDevice
from imu_bench.registers import Channel, Register
from imu_bench.samples import Samples
from imu_bench.units import DEGREE, GAUSS
import numpy as np

M = Mti300
START_UP_NS = 200_000_000  # until WakeUp; the document gives no time
PATIENCE_NS = 500_000_000  # LLCP: for WakeUpAck, then it measures
FILTER_START_NS = 100_000_000  # until the orientation is valid; the document gives no time
IDLE_NS = 10_000_000_000  # nobody asked for so long: the samples in between are skipped
FACTORY = (
    Output(M.PACKET_COUNTER.address),
    Output(M.SAMPLE_TIME_FINE.address),
    Output(M.QUATERNION.address, 100),
    Output(M.STATUS_WORD.address),
)
FASTEST = {M.TEMPERATURE: 1, M.QUATERNION: 400, M.ACCELERATION: 400, M.RATE_OF_TURN: 400,
           M.MAGNETIC_FIELD: 100}  # fmt: skip
"""LLCP, outputs of an MTi-300; the others come with every frame."""

BAUDS = {code: baud for baud, code in xbus.BAUD_CODES.items()}
PRODUCT, FOREIGN = b'MTI-300-2A8G4', b'MTI-30-2A8G4'
DEVICE_ID, FIRMWARE = bytes.fromhex('03780f2c'), bytes([1, 8, 2, *8 * (0,)])
_BY_ADDRESS = {register.address: register for register in M.declared(Register).values()}
# what clips, its full range (UM), its lowest bit of StatusWord
_CLIPS: tuple[tuple[Channel, float, int], ...] = (
    (M.acceleration, 200.0, 8),
    (M.angular_velocity, 450 * DEGREE, 11),
    (M.magnetic_field, 8 * GAUSS, 14),
)


class _Numbers:
    """How many samples were made, and what the packet counter shows next."""

    def __init__(self) -> None:
        self.made = self.frames = 0

    @property
    def state(self) -> tuple[int, int]:
        """Both."""
        return self.made, self.frames

    @state.setter
    def state(self, state: tuple[int, int]) -> None:
        self.made, self.frames = state


class Mti300Device(StreamDevice):
    """States, settings and frames."""

    def __init__(self, source: Source, start_ns: int, baud: int = 0) -> None:
        self.baud = self._next_baud = baud  # speed of its line; 0 for USB
        self.outputs: tuple[Output, ...] = FACTORY
        self._profile = 39
        self._source = Ahead(source, self.converted, lambda: (self._attitude, self._sent))
        self.power_up(start_ns)

    def power_up(self, at_ns: int) -> None:
        """Begin anew; outputs, profile and speed are kept without power."""
        self._decoder = xbus.Decoder()
        self._to_send: list[tuple[int, bytes]] = []
        self._now_ns = self._awake_ns = at_ns + START_UP_NS
        self._state = 'off'
        self._sent = _Numbers()
        self._attitude = Attitude(float(BASE_HZ))
        self._source.restart(self._awake_ns, float(BASE_HZ))

    # --- states --------------------------------------------------------------------------
    def advance(self, to_ns: int) -> Iterable[tuple[int, bytes]]:
        """Wake up, measure, answer."""
        if self._state == 'off' and to_ns >= self._awake_ns:
            self._state, self.baud = 'waking', self._next_baud
            self._send(self._awake_ns, Mid.WAKE_UP)
        if self._state == 'waking' and to_ns >= self._awake_ns + PATIENCE_NS:
            self._sample(self._awake_ns + PATIENCE_NS)
            self._source.rewind()
            self._state = 'measurement'
        if self._state != 'off':
            self._sample(to_ns)
        sent, self._to_send = self._to_send, []
        return sorted(sent)

    def receive(self, data: bytes, at_ns: int) -> None:
        """Answer every message."""
        if self._state == 'off':
            return
        self._source.rewind()
        for message in self._decoder.feed(data):
            self._answer(message, at_ns)

    def _send(self, at_ns: int, mid: int, data: bytes = b'') -> None:
        self._to_send.append((at_ns, xbus.encode(mid, data)))

    def _answer(self, message: xbus.Message, at_ns: int) -> None:
        mid, data = message
        if mid == Mid.RESET:
            self._send(at_ns, mid + 1)
            acknowledged = self._to_send
            self.power_up(at_ns)
            self._to_send = acknowledged[-1:]
        elif mid == Mid.WAKE_UP_ACK:
            if self._state == 'waking':
                self._state = 'config'
        elif mid == Mid.GO_TO_CONFIG:
            self._state = 'config'
            self._send(at_ns, mid + 1)
        elif self._state != 'config':
            self._send(at_ns, Mid.ERROR, b'\x04')
        elif mid == Mid.GO_TO_MEASUREMENT:
            self._state = 'measurement'
            self._send(at_ns, mid + 1)
        else:
            self._set(mid, data, at_ns)

    def _set(self, mid: int, data: bytes, at_ns: int) -> None:
        """Answer what is valid in the state config only."""
        fixed = {
            Mid.REQ_PRODUCT_CODE: FOREIGN if self.foreign else PRODUCT,
            Mid.REQ_DEVICE_ID: DEVICE_ID,
            Mid.REQ_FIRMWARE: FIRMWARE,
        }
        if mid in fixed:
            self._send(at_ns, mid + 1, fixed[Mid(mid)])
        elif mid == Mid.FILTER_PROFILE and data[1:] not in [bytes([k]) for k in range(39, 44)]:
            known = self._profile.to_bytes(2, 'big')
            self._send(at_ns, *((Mid.ERROR, b'\x21') if data else (mid + 1, known)))
        elif mid == Mid.FILTER_PROFILE:
            self._profile = data[1]
            self._send(at_ns, mid + 1)
        elif mid == Mid.BAUD_RATE:
            self._set_baud(data, at_ns)
        elif mid == Mid.OUTPUT_CONFIGURATION:
            self._set_outputs(data, at_ns)
        else:
            self._send(at_ns, Mid.ERROR, b'\x04')

    def _set_baud(self, data: bytes, at_ns: int) -> None:
        if not data:
            self._send(at_ns, Mid.BAUD_RATE + 1, bytes([xbus.BAUD_CODES.get(self.baud, 0x02)]))
        elif data[0] not in BAUDS:
            self._send(at_ns, Mid.ERROR, b'\x20')
        else:
            # LLCP: from the next reset on; on USB there is no speed
            self._next_baud = BAUDS[data[0]] if self.baud else 0
            self._send(at_ns, Mid.BAUD_RATE + 1)

    def _set_outputs(self, data: bytes, at_ns: int) -> None:
        """Take outputs at the rates that are possible, and acknowledge these."""
        if data:
            wanted = [
                (_BY_ADDRESS.get(output.identifier), output)
                for output in xbus.unpack_outputs(data)
            ]
            if any(register is None or output.rate == 0 for register, output in wanted):
                self._send(at_ns, Mid.ERROR, b'\x21')
                return
            self.outputs = tuple(
                Output(output.identifier, _possible(register, output.rate))
                for register, output in wanted
                if register is not None
            )
        self._send(at_ns, Mid.OUTPUT_CONFIGURATION + 1, xbus.pack_outputs(self.outputs))

    # --- measurement ---------------------------------------------------------------------
    def _sample(self, to_ns: int) -> None:
        """Take every sample that is due; send them in the state measurement."""
        if to_ns <= self._now_ns:
            return
        if to_ns - self._now_ns > IDLE_NS:
            kept_ns = to_ns - IDLE_NS // 10
            self._source.rewind()
            self._sent.made += round((kept_ns - self._now_ns) * 1e-9 * BASE_HZ)
            self._source.restart(kept_ns)
        self._now_ns = to_ns
        for samples, frames, first, last in self._source.until(to_ns):
            for k in range(first, last):
                if frames[k]:
                    self._to_send.append((int(samples.stamps[k]), frames[k]))

    def converted(self, samples: Samples) -> list[bytes]:
        """Return the message of each sample; none where nothing is due, or nobody measures."""
        n, numbers = len(samples), self._sent
        columns = self._columns(samples)
        made = np.arange(numbers.made + 1, numbers.made + n + 1)
        numbers.made += n
        timed = [output for output in self.outputs if output.rate != EVERY_FRAME]
        if self._state != 'measurement' or not timed:
            return [b''] * n
        due = {output: made % (BASE_HZ // output.rate) == 0 for output in timed}
        sent = np.asarray(np.any(list(due.values()), axis=0))
        counter = (numbers.frames + np.cumsum(sent) - 1) % 65536
        numbers.frames = (numbers.frames + int(sent.sum())) % 65536
        columns[M.PACKET_COUNTER.address] = counter.astype('>u2')
        ticks = made * (10_000 // BASE_HZ) % 864_000_000
        columns[M.SAMPLE_TIME_FINE.address] = ticks.astype('>u4')
        parts = {
            identifier: [struct.pack('>HB', identifier, len(row)) + row for row in rows_of(column)]
            for identifier, column in columns.items()
        }
        wanted = [
            (parts[output.identifier], due.get(output, sent).tolist()) for output in self.outputs
        ]
        return [
            xbus.encode(Mid.DATA, b''.join(part[k] for part, with_it in wanted if with_it[k]))
            if carries
            else b''
            for k, carries in enumerate(sent.tolist())
        ]

    def _columns(self, samples: Samples) -> dict[int, np.ndarray]:
        """Return the bytes of each output, row by row."""
        n = len(samples)
        status = np.full(n, 1 << 0, dtype=np.int64)
        status |= np.where(samples.stamps >= self._awake_ns + FILTER_START_NS, 2, 0)
        found: dict[int, np.ndarray] = {}
        for channel, full, bit in _CLIPS:
            si = or_zero(getattr(samples, channel.quantity), (n, 3))
            beyond = np.abs(si) > full
            status |= (beyond << np.arange(bit, bit + 3)).sum(axis=1)
            status |= beyond.any(axis=1).astype(np.int64) << 19
            found[channel.first.address] = channel.encode(np.clip(si, -full, full))
        orientation = samples.orientation
        if orientation is None:
            force = or_zero(samples.acceleration, (n, 3))
            orientation = self._attitude.follow(force, samples.magnetic_field)
        temperature = or_zero(samples.temperature, (n,))
        slow: tuple[tuple[Channel, np.ndarray], ...] = (
            (M.orientation, orientation),
            (M.temperature, temperature),
        )
        for channel, si in slow:
            found[channel.first.address] = channel.encode(si)
        found[M.STATUS_WORD.address] = status.astype('>u4')
        return found


def _possible(register: Register, rate: int) -> int:
    """Return the rate that the device makes of one asked for: a whole part of 400 Hz."""
    fastest = FASTEST.get(register)
    if fastest is None:
        return EVERY_FRAME
    rate = min(rate, fastest)
    return max(whole for whole in range(1, rate + 1) if BASE_HZ % whole == 0)


def create(at: Socket, *, baud: int = 0) -> dict[str, EmulatedStream]:
    """Return the line of an MTi-300: at a speed, or 0 for USB."""
    device = Mti300Device(at.source, at.clock.now_ns(), baud)
    return {'': EmulatedStream(at.name, at.clock, device, at.driver.wiring[''].serial_baud)}
