# SPDX-License-Identifier: Apache-2.0
"""
The MPU-9250 seen from the wire: RM-MPU-9250A-00 and PS-MPU-9250A-01.

It samples what the source gives, filters, quantises, fills data registers and FIFO, and
lets the magnetometer be reached through the bypass or the auxiliary master.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from imu_bench.drivers.mpu9250 import FIFO_BYTES, MAG, Mpu9250, MPU_6500
from imu_bench.emulators.ahead import Due, rows_of, Source, Stateful
from imu_bench.emulators.ak8963 import Ak8963
from imu_bench.emulators.low_pass import LowPass
from imu_bench.emulators.register_map import EmulatedBus, EmulatedChip, numbers, or_zero
from imu_bench.emulators.sampling import SamplingChip
from imu_bench.emulators.socket import Socket
from imu_bench.registers import Field, Frame, Register
from imu_bench.samples import Samples
import numpy as np

M = Mpu9250
START_UP_NS = 11_000_000  # PS table 3: 11 ms typical from power-up to register access
_PORT = M.FIFO_R_W.address
_COUNT = M.FIFO_COUNT.address
_RATE_REGISTERS = (M.SMPLRT_DIV, M.CONFIG, M.GYRO_CONFIG, M.ACCEL_CONFIG2, M.PWR_MGMT_1)
_DATA = Frame(M.acceleration, M.temperature, M.angular_velocity)
# bytes of the data registers by the FIFO_EN bit that puts them into the FIFO
_FIFO_BYTES_OF = ((3, range(6)), (7, (6, 7)), (6, (8, 9)), (5, (10, 11)), (4, (12, 13)))


class Mpu9250Chip(SamplingChip):
    """The main die."""

    ports = frozenset({_PORT})
    made = numbers(M.FIFO_COUNT, M.ACCEL_OUT, M.TEMP_OUT, M.GYRO_OUT)
    quiet = frozenset({_PORT, M.USER_CTRL.address, M.WHO_AM_I.address})

    def __init__(
        self, source: Source, start_ns: int, *, part: int = 0x71, **magnetometer: Any
    ) -> None:
        super().__init__((r for r in M.declared(Register).values() if r.part == ''), source)
        self._part = part
        self._fifo = ByteRing(FIFO_BYTES)
        self._field_stamps = np.zeros(1, dtype=np.int64)
        self._fields = np.zeros((1, 3))
        self.magnetometer = Ak8963(self._field_at, **magnetometer)
        self._nominal_hz = 0.0
        self.power_up(start_ns)

    def power_up(self, at_ns: int) -> None:
        """Begin at the reset values, both dies."""
        self.magnetometer.power_up(at_ns)
        self._reset(at_ns)

    def _reset(self, at_ns: int) -> None:
        """Begin at the reset values; the magnetometer does not see the reset bit."""
        self.memory.reset()
        self.memory.set(M.WHO_AM_I, self._part)
        self._fifo.clear()
        self._newest = b''
        self._now_ns = self._ready_ns = at_ns + START_UP_NS
        self._slave4_ns: int | None = None
        self._nominal_hz = 0.0
        self._change_rate(self._ready_ns)
        self._choose_columns()

    def bypassed(self, at_ns: int) -> bool:
        """Return whether the magnetometer is on the main bus."""
        memory = self.memory
        open_ = memory.code(M.bypass) and not memory.code(M.master_enable)
        return bool(open_) and self.answers(at_ns) and self._part != MPU_6500

    # --- sampling ------------------------------------------------------------------------
    def advance(self, to_ns: int) -> None:
        """Take every sample that is due."""
        if not self.pass_time(to_ns):
            return
        if not self.memory.code(M.sleep):
            for due in self._source.until(to_ns):
                self._take(due)
        if self._slave4_ns is not None and self._slave4_ns <= to_ns:
            self._slave4()

    def stateful(self) -> Iterable[Stateful]:
        """Return the filters."""
        return self._acceleration, self._rotation

    def converted(self, samples: Samples) -> list[bytes]:
        """Return the data registers of each sample."""
        n = len(samples)
        memory = self.memory
        words = {
            M.acceleration.quantity: memory.quantise(
                M.acceleration, self._acceleration.filter(or_zero(samples.acceleration, (n, 3)))
            ),
            M.angular_velocity.quantity: memory.quantise(
                M.angular_velocity,
                self._rotation.filter(or_zero(samples.angular_velocity, (n, 3))),
            ),
            M.temperature.quantity: memory.quantise(
                M.temperature, or_zero(samples.temperature, (n,))
            ),
        }
        return rows_of(np.frombuffer(_DATA.pack(words, n), np.uint8).reshape(n, -1))

    def _take(self, due: Due) -> None:
        samples, rows, first, last = due
        memory = self.memory
        if samples.magnetic_field is not None:
            self._field_stamps, self._fields = samples.stamps, samples.magnetic_field
        self._newest = rows[last - 1]
        slave = self._slave0(samples.stamps[first:last])
        self._raise_interrupt(M.data_ready, M.data_interrupt)
        if self.pin is not None and memory.code(M.data_interrupt):
            self.pin.rose(samples.stamps[first:last])
        if memory.code(M.fifo_enable) and not memory.fifo_stuck:
            self._fill_fifo(rows[first:last], slave)

    def _fill_fifo(self, frames: list[bytes], slave: list[bytes]) -> None:
        stops = bool(self.memory.code(M.fifo_stops_when_full))
        if len(self._columns) < _DATA.size:
            frames = [bytes([row[c] for c in self._columns]) for row in frames]
        if self.memory.code(M.fifo_slave0) and slave:
            frames = [a + b for a, b in zip(frames, slave, strict=True)]
        if self._fifo.push(b''.join(frames), stops_when_full=stops):
            self._raise_interrupt(M.fifo_overflow, M.overflow_interrupt)

    def _raise_interrupt(self, flag: Field, enable: Field) -> None:
        if self.memory.code(enable):
            self.memory.put(flag, 1)

    def _change_rate(self, at_ns: int) -> None:
        """Sample at the rate the registers ask for: RM registers 25, 26 and 27."""
        memory = self.memory
        if memory.code(M.gyroscope_filter_bypass):
            rate = 32000.0
        elif memory.code(M.gyroscope_bandwidth) in (0, 7):
            rate = 8000.0
        else:
            rate = 1000.0 / (1 + memory.word(M.SMPLRT_DIV))
        if rate != self._nominal_hz:
            self._nominal_hz = rate
            self._source.restart(at_ns, rate)
        self._acceleration = LowPass(float(memory.value(M.accelerometer_bandwidth)), rate)
        self._rotation = LowPass(float(memory.value(M.gyroscope_bandwidth)), rate)

    def _choose_columns(self) -> None:
        """Put the bytes of the enabled channels into the FIFO: RM register 35."""
        enabled = self.memory.word(M.FIFO_EN)
        self._columns = sorted(
            c for bit, part in _FIFO_BYTES_OF if enabled >> bit & 1 for c in part
        )
        self._frame_bytes = len(self._columns) + (24 if enabled & 7 else 0)

    # --- registers -----------------------------------------------------------------------
    def reading(self, number: int, at_ns: int) -> None:
        """Latch the count of the FIFO (RM register 114), or put the newest sample there."""
        memory = self.memory
        if number == _COUNT:
            memory.set(M.FIFO_COUNT, len(self._fifo))
        elif self._newest:
            memory.fill(M.ACCEL_OUT, self._newest[0:6])
            memory.fill(M.TEMP_OUT, self._newest[6:8])
            memory.fill(M.GYRO_OUT, self._newest[8:14])
            self._newest = b''

    def read_port(self, number: int, length: int, at_ns: int, byte_ns: float) -> bytes:
        """Empty the FIFO, byte by byte where it may run over meanwhile."""
        end_ns = at_ns + length * byte_ns
        frames = (end_ns - self._now_ns) * 1e-9 * self._nominal_hz * 1.1 + 2
        if length <= len(self._fifo) <= FIFO_BYTES - frames * self._frame_bytes:
            return self._fifo.pop(length)
        out = bytearray()
        while len(out) < length:
            self.advance(at_ns + round(len(out) * byte_ns))
            out += self._fifo.pop(min(16, length - len(out)))
        return bytes(out)

    def written(self, register: Register, at_ns: int) -> None:
        """Do what a written bit asks for."""
        memory = self.memory
        if register is M.PWR_MGMT_1 and memory.code(M.device_reset):
            self._reset(at_ns)
        elif register in _RATE_REGISTERS:
            self._change_rate(at_ns)
        elif register is M.FIFO_EN:
            self._choose_columns()
        elif register is M.USER_CTRL:
            if memory.code(M.fifo_reset):
                self._fifo.clear()
            # the three resets clear themselves: RM register 106
            memory.set(M.USER_CTRL, memory.word(M.USER_CTRL) & ~0x07)
        elif register is M.I2C_SLV4_CTRL and memory.word(M.I2C_SLV4_CTRL) & 0x80:
            self._slave4_ns = at_ns + round(1e9 / self._nominal_hz)

    # --- the auxiliary master (RM registers 36 to 54) ------------------------------------
    def _slave0(self, stamps: np.ndarray) -> list[bytes]:
        """Return what the master reads from slave 0 at each sample."""
        memory = self.memory
        control, address = memory.word(M.I2C_SLV0_CTRL), memory.word(M.I2C_SLV0_ADDR)
        there = address == 0x8C and self._part != MPU_6500
        if not (memory.code(M.master_enable) and control & 0x80 and there):
            return []
        length, first = control & 0x0F, memory.word(M.I2C_SLV0_REG)
        read = [self.magnetometer.read(first, length, int(t), 0.0) for t in stamps]
        memory.fill(M.EXT_SENS_DATA, read[-1])
        return read

    def _slave4(self) -> None:
        memory = self.memory
        at_ns, self._slave4_ns = self._slave4_ns, None
        if at_ns is None or not memory.code(M.master_enable):
            return
        address, number = memory.word(M.I2C_SLV4_ADDR), memory.word(M.I2C_SLV4_REG)
        if address & 0x7F != 0x0C or self._part == MPU_6500:
            memory.set(M.I2C_MST_STATUS, 0x50)
        elif address & 0x80:
            memory.fill(M.I2C_SLV4_DI, self.magnetometer.read(number, 1, at_ns, 0.0))
            memory.set(M.I2C_MST_STATUS, 0x40)
        else:
            self.magnetometer.write(number, bytes([memory.word(M.I2C_SLV4_DO)]), at_ns)
            memory.set(M.I2C_MST_STATUS, 0x40)
        memory.set(M.I2C_SLV4_CTRL, memory.word(M.I2C_SLV4_CTRL) & 0x7F)

    def _field_at(self, at_ns: int) -> np.ndarray:
        k = int(np.searchsorted(self._field_stamps, at_ns, side='right')) - 1
        return np.asarray(self._fields[max(k, 0)])


class _Bypass(EmulatedChip):
    """The magnetometer as the main bus sees it: there only while the bypass is closed."""

    def __init__(self, host: Mpu9250Chip) -> None:
        super().__init__(())
        self._host = host

    def answers(self, at_ns: int) -> bool:
        return self._host.bypassed(at_ns)

    def power_up(self, at_ns: int) -> None:
        """Leave it to the main die, whose supply it shares."""

    def read(self, first: int, length: int, at_ns: int, byte_ns: float) -> bytes:
        self._host.advance(at_ns)
        return self._host.magnetometer.read(first, length, at_ns, byte_ns)

    def write(self, first: int, data: bytes, at_ns: int) -> None:
        self._host.advance(at_ns)
        self._host.magnetometer.write(first, data, at_ns)


def create(at: Socket, **options: Any) -> dict[str, EmulatedBus]:
    """Return the buses of an MPU-9250: both dies on I²C, the main one on SPI."""
    chip = Mpu9250Chip(at.source, at.clock.now_ns(), **options)
    buses = {'': at.bus(chip)}
    if at.kind == 'i2c':
        buses[MAG] = at.bus(_Bypass(chip), MAG)
    return buses


class ByteRing:
    """Bytes in the order in which they came; full means lost bytes, not lost frames."""

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity  # bytes
        self._bytes = bytearray()
        self._last = 0

    def __len__(self) -> int:
        return len(self._bytes)

    def clear(self) -> None:
        """Empty it."""
        self._bytes.clear()

    def push(self, data: bytes, *, stops_when_full: bool = False) -> int:
        """Append bytes; return how many were lost."""
        self._bytes += data
        lost = max(len(self._bytes) - self.capacity, 0)
        if stops_when_full:
            del self._bytes[self.capacity :]
        else:
            del self._bytes[:lost]
        return lost

    def pop(self, length: int) -> bytes:
        """Return bytes from the front; an empty FIFO repeats the last byte."""
        out = bytes(self._bytes[:length])
        del self._bytes[:length]
        if out:
            self._last = out[-1]
        return out + bytes([self._last]) * (length - len(out))
