# SPDX-License-Identifier: Apache-2.0
"""
The IIM-42652 seen from the wire: DS-000401 rev. 1.2 (DS).

Both sensors run at one rate, that of the gyroscope where it is on; slower packets of the other
are not emulated, nor is low power.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from imu_bench.bus.framing.fifo_packets import (
    HEADERS,
    INVALID,
    LIMIT_20,
    PACKET_16,
    PACKET_20,
)
from imu_bench.drivers.iim42652 import (
    ACCELERATION_20,
    ANGULAR_VELOCITY_20,
    FIFO_BYTES,
    Iim42652,
)
from imu_bench.emulators.ahead import rows_of, Source, Stateful
from imu_bench.emulators.low_pass import LowPass
from imu_bench.emulators.register_map import EmulatedBus, or_zero
from imu_bench.emulators.sampling import SamplingChip
from imu_bench.emulators.socket import Socket
from imu_bench.registers import Channel, Register
from imu_bench.samples import Samples
import numpy as np

C = Iim42652
START_UP_NS = 1_000_000  # DS table 3
ACCELEROMETER_NS, GYROSCOPE_NS = 20_000_000, 45_000_000  # DS tables 1 and 2, maximum
SETTLE_NS = 200_000  # DS section 14.34: no register write after a change of power mode
TICK = 32 / 30  # DS section 12.7: µs per tick of 1 µs, without an external clock
LOW_NOISE = 3

# DS section 5.5: -3 dB per Hz of the rate by order, least rate that counts
_BANDWIDTH = {
    'ODR/2': ((0.4983, 0.4933, 0.4929), 25.0), 'ODR/4': ((0.2272, 0.2307, 0.2347), 400.0),
    'ODR/5': ((0.1889, 0.1916, 0.1958), 400.0), 'ODR/8': ((0.111, 0.1175, 0.1189), 400.0),
    'ODR/10': ((0.0924, 0.0971, 0.0979), 400.0), 'ODR/16': ((0.0596, 0.0596, 0.0608), 400.0),
    'ODR/20': ((0.0488, 0.048, 0.0468), 400.0), 'ODR/40': ((0.0239, 0.0213, 0.0252), 400.0),
    'low latency': ((0.262,) * 3, 400.0), 'low latency x8': ((2.096,) * 3, 25.0),
}  # fmt: skip
_FAST_HZ = 2000.0  # from here on all settings are alike

_SINGLE = np.dtype([('header', 'u1'), ('words', '>i2', 3), ('temperature', 'i1')])
_BANK = C.REG_BANK_SEL.number
_COUNT, _PORT = C.FIFO_COUNT.number, C.FIFO_DATA.number
_POWER_AND_RATE = (C.PWR_MGMT0, C.GYRO_CONFIG0, C.ACCEL_CONFIG0, C.GYRO_ACCEL_CONFIG0)
# DS section 12.9: what may be written while a sensor is on
_WHILE_ON = frozenset(
    {*_POWER_AND_RATE[:3], C.REG_BANK_SEL, C.DEVICE_CONFIG, C.FIFO_CONFIG, C.SIGNAL_PATH_RESET}
)


def bandwidth_hz(rate_hz: float, bandwidth: str, order: int = 2) -> float:
    """
    Return the -3 dB frequency of the filter of an order from 1 to 3 (DS section 5.5).

    Below 400 Hz most settings keep the bandwidth of 400 Hz, which lets the band above half
    the rate fold back; from 2 kHz on all are alike.
    """
    if rate_hz >= _FAST_HZ:
        return 0.262 * rate_hz
    factors, least = _BANDWIDTH[bandwidth]
    return factors[order - 1] * max(rate_hz, least)


class _Made(NamedTuple):
    """What the chip makes of samples, row by row: data registers, and packets if it makes any."""

    shown: list[bytes]
    packets: list[bytes]


class _Elapsed:
    """The time since power-up, µs, by the samples."""

    state = 0.0

    def samples(self, n: int, period_us: float) -> np.ndarray:
        """Return the times of the next samples, shape (n,)."""
        times = self.state + period_us * np.arange(1, n + 1)
        self.state = float(times[-1])
        return times


class Iim42652Chip(SamplingChip):
    """Banks, power, filters, data registers and the FIFO of packets."""

    ports = frozenset({_PORT})
    quiet = frozenset({_PORT})
    made = frozenset({_COUNT, C.FIFO_LOST_PKT.number})

    def __init__(self, source: Source, start_ns: int, *, tick: float = TICK) -> None:
        super().__init__(C.declared(Register).values(), source)
        self._tick = tick
        self._fifo: deque[bytes] = deque()
        self.improper: list[str] = []  # writes at a time at which the document forbids them
        self.power_up(start_ns)

    def takes_silently(self, number: int, at_ns: int) -> bool:
        """Return that of a spike filter: torvalds/linux inv_icm42600_i2c.c, b5d6ba09b10d."""
        return number == C.INTF_CONFIG6.number

    def power_up(self, at_ns: int) -> None:
        """Begin at the reset values: bank 0, sensors off."""
        self.memory.reset()
        self._fifo.clear()
        self._ready_ns = self._now_ns = at_ns + START_UP_NS
        self._quiet_ns = 0
        self._valid_ns: dict[str, int] = {}
        self._rate_hz = 0.0
        self._elapsed = _Elapsed()
        self._source.forget()
        self._lost = 0
        self._update(self._ready_ns)

    # --- sampling ------------------------------------------------------------------------
    def advance(self, to_ns: int) -> None:
        """Take every sample that is due."""
        if not self.pass_time(to_ns):
            return
        if not self._rate_hz:
            return
        memory = self.memory
        for samples, made, first, last in self._source.until(to_ns):
            newest = made.shown[last - 1]
            memory.fill(C.ACCEL_DATA, newest[0:6])
            memory.fill(C.GYRO_DATA, newest[6:12])
            memory.fill(C.TEMP_DATA, newest[12:14])
            memory.put(C.data_ready, 1)
            if self.pin is not None and memory.code(C.data_ready_interrupt) and self._drives():
                self.pin.rose(samples.stamps[first:last])
            self._store(made.packets[first:last])

    def _drives(self) -> bool:
        """Return whether the pin is driven, and its edge the right one (DS section 14.5)."""
        driven = C.interrupt_push_pull, C.interrupt_active_high
        released = not self.memory.code(C.asynchronous_reset)
        return released and all(self.memory.code(field) for field in driven)

    def _update(self, at_ns: int) -> None:
        """Run the sensors that are on at the rate and with the filters the registers ask for."""
        memory = self.memory
        on = {
            'gyroscope': memory.code(C.gyroscope_mode) == LOW_NOISE,
            'accelerometer': memory.code(C.accelerometer_mode) == LOW_NOISE,
        }
        for name, delay in (('gyroscope', GYROSCOPE_NS), ('accelerometer', ACCELEROMETER_NS)):
            if not on[name]:
                self._valid_ns.pop(name, None)
            else:
                self._valid_ns.setdefault(name, at_ns + delay)
        rate = 0.0
        if on['gyroscope']:
            rate = float(memory.value(C.gyroscope_rate))
        elif on['accelerometer']:
            rate = float(memory.value(C.accelerometer_rate))
        if rate and rate != self._rate_hz:
            self._source.restart(at_ns, rate)
        self._rate_hz = rate
        if rate:
            self._acceleration, self._rotation = (
                LowPass(
                    bandwidth_hz(rate, str(memory.value(band)), order),
                    rate,
                    order,
                    of_samples=True,
                )
                for band, order in (
                    (C.accelerometer_bandwidth, int(memory.value(C.accelerometer_order))),
                    (C.gyroscope_bandwidth, int(memory.value(C.gyroscope_order))),
                )
            )

    def stateful(self) -> Iterable[Stateful]:
        """Return the filters, and the time that the timestamps tell."""
        return self._acceleration, self._rotation, self._elapsed

    def converted(self, samples: Samples) -> _Made:
        """Return data registers and packets."""
        n = len(samples)
        force = self._acceleration.filter(or_zero(samples.acceleration, (n, 3)))
        rotation = self._rotation.filter(or_zero(samples.angular_velocity, (n, 3)))
        celsius = or_zero(samples.temperature, (n,))
        awake = {
            name: samples.stamps >= self._valid_ns.get(name, samples.stamps[-1] + 1)
            for name in ('accelerometer', 'gyroscope')
        }
        words = {
            'acceleration': self._words(C.acceleration, force, awake['accelerometer']),
            'angular_velocity': self._words(C.angular_velocity, rotation, awake['gyroscope']),
        }
        memory = self.memory
        heat = memory.quantise(C.temperature, celsius)
        columns = [rows_of(column) for column in (*words.values(), heat)]
        times = self._elapsed.samples(n, 1e6 / self._rate_hz)
        packets = np.zeros(0, _SINGLE)
        if memory.value(C.fifo_mode) != 'bypass':
            tick_us = self._tick * float(memory.value(C.timestamp_tick))
            ticks = (times // tick_us).astype(np.int64) & 0xFFFF
            if memory.value(C.fifo_bits) == 20:
                packets = self._packets_20(force, rotation, awake)
                packets['temperature'], packets['timestamp'] = heat, ticks
            else:
                packets = self._packets_16(words, celsius, ticks)
        return _Made(list(map(b''.join, zip(*columns, strict=True))), rows_of(packets))

    def _words(self, channel: Channel, si: np.ndarray, awake: np.ndarray) -> np.ndarray:
        return np.where(awake[:, np.newaxis], self.memory.quantise(channel, si), INVALID).astype(
            channel.dtype
        )

    def _packets_16(
        self, words: dict[str, np.ndarray], celsius: np.ndarray, ticks: np.ndarray
    ) -> np.ndarray:
        """Return packets 1, 2 or 3, whatever is enabled."""
        eighth = np.clip(np.rint((celsius - 25.0) * 2.07), -128, 127)  # DS section 6.1
        both = self.memory.code(C.fifo_accelerometer), self.memory.code(C.fifo_gyroscope)
        packets = np.zeros(len(ticks), PACKET_16 if all(both) else _SINGLE)
        packets['temperature'] = eighth
        if all(both):
            packets['header'] = HEADERS[16]
            packets['timestamp'] = ticks
            for name, values in words.items():
                packets[name] = values
        elif any(both):
            packets['header'] = 0x40 if both[0] else 0x20
            packets['words'] = words['acceleration' if both[0] else 'angular_velocity']
        else:
            packets = packets[:0]
        return packets

    @staticmethod
    def _packets_20(
        force: np.ndarray, rotation: np.ndarray, awake: dict[str, np.ndarray]
    ) -> np.ndarray:
        """Return packets 4: 18 and 19 bits that matter, at full scale."""
        packets = np.zeros(len(force), PACKET_20)
        packets['header'] = HEADERS[20]
        lows = []
        for name, si, lsb, step, on in (
            ('acceleration', force, ACCELERATION_20, 4, awake['accelerometer']),
            ('angular_velocity', rotation, ANGULAR_VELOCITY_20, 2, awake['gyroscope']),
        ):
            words = np.clip(np.rint(si / lsb / step) * step, -LIMIT_20, LIMIT_20).astype(np.int64)
            words = np.where(on[:, np.newaxis], words, INVALID * 16)
            packets[name] = words >> 4
            lows.append(words & 0x0F)
        packets['low'] = lows[0] << 4 | lows[1]
        return packets

    def _store(self, packets: list[bytes]) -> None:
        if not packets or self.memory.fifo_stuck:
            return
        room = FIFO_BYTES // len(packets[0]) - 1
        stops = self.memory.value(C.fifo_mode) == 'stop'
        for packet in packets:
            if len(self._fifo) >= room:
                self._lost += 1
                if stops:
                    continue
                self._fifo.popleft()
            self._fifo.append(packet)
        if len(self._fifo) >= room:
            self.memory.put(C.fifo_full, 1)

    # --- registers -----------------------------------------------------------------------
    def decode_address(self, first: int) -> tuple[int, bool]:
        """Return the register of the bank that is selected."""
        bank = self.memory.word(C.REG_BANK_SEL) & 7
        return (first if first == _BANK else bank + 1 << 8 | first), True

    def reading(self, number: int, at_ns: int) -> None:
        """Latch the count of the FIFO, and of the packets lost."""
        if number == _COUNT:
            in_records = self.memory.value(C.count_unit) == 'records'
            count = len(self._fifo) if in_records else sum(map(len, self._fifo))
            self.memory.set(C.FIFO_COUNT, count)
        elif number == C.FIFO_LOST_PKT.number:
            self.memory.set(C.FIFO_LOST_PKT, min(self._lost, 0xFFFF))

    def read_port(self, number: int, length: int, at_ns: int, byte_ns: float) -> bytes:
        """Empty the FIFO; beyond its end there are ones, and part of a packet is not taken out."""
        out = bytearray()
        while len(out) < length:
            self.advance(at_ns + round(len(out) * byte_ns))
            if not self._fifo:
                out += b'\xff' * (length - len(out))
            elif len(self._fifo[0]) > length - len(out):
                out += self._fifo[0][: length - len(out)]
            else:
                out += self._fifo.popleft()
        return bytes(out)

    def written(self, register: Register, at_ns: int) -> None:
        """Do what a written bit asks for."""
        memory = self.memory
        if at_ns < self._quiet_ns or (self._rate_hz and register not in _WHILE_ON):
            self.improper.append(str(register))
        if register is C.DEVICE_CONFIG and memory.code(C.soft_reset):
            self.power_up(at_ns)
        elif register in _POWER_AND_RATE:
            if register is C.PWR_MGMT0:
                self._quiet_ns = at_ns + SETTLE_NS
            self._update(at_ns)
        elif register is C.SIGNAL_PATH_RESET:
            if memory.code(C.fifo_flush):
                self._fifo.clear()
                self._lost = 0
            memory.set(C.SIGNAL_PATH_RESET, 0)
        elif register is C.FIFO_CONFIG and memory.value(C.fifo_mode) == 'bypass':
            self._fifo.clear()


def create(at: Socket, **options: float) -> dict[str, EmulatedBus]:
    """Return the bus of an IIM-42652."""
    return {'': at.bus(Iim42652Chip(at.source, at.clock.now_ns(), **options))}
