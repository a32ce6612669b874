# SPDX-License-Identifier: Apache-2.0
"""
The BNO055 seen from its wire: BST-BNO055-DS000-12 rev. 1.2.

Pages, operation modes with the times they take, registers that can be written in CONFIG only,
data that are overwritten sample by sample, and the serial protocol in front of all that.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from imu_bench.bus.framing import bosch_uart
from imu_bench.drivers.bno055 import Bno055, FIELD_HZ, FUSED_HZ, MEASURED, PLAIN_HZ
from imu_bench.emulators.ahead import rows_of, Source, Stateful
from imu_bench.emulators.attitude import Attitude
from imu_bench.emulators.register_map import EmulatedBus, or_zero
from imu_bench.emulators.sampling import SamplingChip
from imu_bench.emulators.socket import Socket
from imu_bench.emulators.stream import EmulatedStream, StreamDevice
from imu_bench.registers import Channel, Register
from imu_bench.samples import Samples
from imu_bench.units import DEGREE, STANDARD_GRAVITY
import numpy as np
from scipy.spatial.transform import Rotation

B = Bno055
BOOT_NS, RESET_NS = 400_000_000, 650_000_000  # DS table 0-2
TO_CONFIG_NS, FROM_CONFIG_NS = 19_000_000, 7_000_000  # DS table 3-6
CRYSTAL_NS = 600_000_000  # DS gives no time; drivers wait up to 650 ms
ANY_MODE = (B.PAGE_ID, B.OPR_MODE, B.SYS_TRIGGER)
_DATA = (B.ACC_DATA, B.MAG_DATA, B.GYR_DATA, B.EUL_DATA, B.QUA_DATA, B.LIA_DATA, B.GRV_DATA)
_PAGE = B.PAGE_ID.address
# what fusion finds: offsets of accelerometer, magnetometer and gyroscope, then the two radii;
# averages of nine calibrations of one board (forum.arduino.cc, topic 352421)
FOUND = np.array([-6, 3, 17, -2, 395, 112, 0, 1, 0, 1000, 832], dtype='<i2')
# LSB by the bit of UNIT_SEL (DS section 3.6.1), over those of the driver
_ACCELERATION = (1.0, STANDARD_GRAVITY / 1000 / 0.01)
_ROTATION = (1.0, 16 / 900 / DEGREE)


class Bno055Chip(SamplingChip):
    """Both pages."""

    def __init__(self, source: Source, start_ns: int) -> None:
        super().__init__(B.declared(Register).values(), source)
        self.power_up(start_ns)

    def power_up(self, at_ns: int) -> None:
        """Begin at the reset values; nothing answers at first."""
        self._boot(at_ns + BOOT_NS)

    def _boot(self, ready_ns: int) -> None:
        self.memory.reset()
        self._ready_ns = self._settled_ns = self._now_ns = ready_ns
        self._mode = 'config'
        self._restored = False
        self._crystal_ns = 0
        self._made = 0
        self._source.forget()

    # --- registers -----------------------------------------------------------------------
    def decode_address(self, first: int) -> tuple[int, bool]:
        """Return the register of the page that is selected."""
        page = self.memory.word(B.PAGE_ID) & 1
        return (_PAGE if first == _PAGE else page + 1 << 8 | first), True

    def following(self, number: int) -> int:
        """Return the next register; the page itself is on both pages."""
        following = number + 1
        if following & 0xFF == _PAGE:
            return _PAGE
        if number == _PAGE:
            return (self.memory.word(B.PAGE_ID) & 1) + 1 << 8 | following
        return following

    def refuses(self, first: int, at_ns: int) -> bool:
        """Return whether a write is ignored: configuration outside CONFIG, or during a change."""
        register = self.memory.owner(self.decode_address(first)[0])
        if register is B.PAGE_ID:
            return False
        if at_ns < self._settled_ns:
            return True
        return register not in ANY_MODE and self._mode != 'config'

    def write(self, first: int, data: bytes, at_ns: int) -> None:
        """Take what may be written now."""
        if not self.refuses(first, at_ns):
            super().write(first, data, at_ns)

    def written(self, register: Register, at_ns: int) -> None:
        """Change the mode, or reset."""
        memory = self.memory
        if register is B.OPR_MODE:
            self._change_mode(str(memory.value(B.mode)), at_ns)
        elif register is B.SYS_TRIGGER:
            if memory.code(B.reset_system):
                self._boot(at_ns + RESET_NS)
            elif memory.code(B.external_clock) and self._mode == 'config':
                self._crystal_ns = at_ns + CRYSTAL_NS
                memory.put(B.clock_busy, 1)
            memory.set(B.SYS_TRIGGER, 0)

    def _change_mode(self, mode: str, at_ns: int) -> None:
        if mode == self._mode:
            return
        self._mode = mode
        self._settled_ns = at_ns + (TO_CONFIG_NS if mode == 'config' else FROM_CONFIG_NS)
        self._fused = mode in FUSED_HZ
        self.memory.put(B.state, 0 if mode == 'config' else 5 if self._fused else 6)
        for register in _DATA:
            self.memory.set(register, 0)
        if mode == 'config':
            return
        held = self.memory.word(B.OFFSETS).to_bytes(B.OFFSETS.size, 'little')
        self._restored = self._fused and any(held)
        self._off = (np.frombuffer(held, '<i2') - FOUND[:9]) * self._restored
        self._made = 0
        self._rate_hz = FUSED_HZ.get(mode, PLAIN_HZ)
        field_hz = FIELD_HZ.get(mode) or float(self.memory.value(B.magnetometer_rate_hz))
        self._field_step = max(1, round(self._rate_hz / field_hz))
        self._attitude = Attitude(self._rate_hz)
        self._source.restart(self._settled_ns, self._rate_hz)
        self._now_ns = self._settled_ns

    def takes_silently(self, number: int, at_ns: int) -> bool:
        """Return that of its reset: adafruit/Adafruit_CircuitPython_BNO055 catches it."""
        return number == B.SYS_TRIGGER.number and not self.answers(at_ns)

    # --- sampling ------------------------------------------------------------------------
    def advance(self, to_ns: int) -> None:
        """Overwrite the data with every sample that is due."""
        if self._crystal_ns and to_ns >= self._crystal_ns:
            self._crystal_ns = 0
            self.memory.put(B.clock_busy, 0)
        if self._mode == 'config' or not self.pass_time(to_ns):
            return
        for _, rows, first, last in self._source.until(to_ns):
            self._take(rows[last - 1], last - first)

    def stateful(self) -> Iterable[Stateful]:
        """Return the filter of the fusion."""
        return (self._attitude,)

    def converted(self, samples: Samples) -> list[dict[Register, bytes]]:
        """Return the data registers of each sample."""
        n, letters = len(samples), MEASURED.get(self._mode, 'M')
        force = or_zero(samples.acceleration, (n, 3))
        rotation = or_zero(samples.angular_velocity, (n, 3))
        field = or_zero(samples.magnetic_field, (n, 3))
        celsius = or_zero(samples.temperature, (n,))
        # DS section 3.6.1: 1 °C, or 2 °F
        shown = (celsius * 1.8 + 32) / 2 if self._unit(4) else celsius
        words = {B.TEMP: self._words(B.temperature, shown)}
        if 'A' in letters:
            words[B.ACC_DATA] = self._force(force)
        if 'G' in letters:
            words[B.GYR_DATA] = self._rotation(rotation)
        if 'M' in letters:
            words[B.MAG_DATA] = self._words(B.magnetic_field, field)
        if self._fused:
            words |= self._fuse(samples, force, 'M' in letters)
        if self._restored:  # offsets that are not those of the chip leave a bias
            for k, register in enumerate((B.ACC_DATA, B.MAG_DATA, B.GYR_DATA)):
                if register in words:
                    words[register] = words[register] - self._off[3 * k : 3 * k + 3].astype('<i2')
        columns = [rows_of(found) for found in words.values()]
        return [dict(zip(words, row, strict=True)) for row in zip(*columns, strict=True)]

    def _take(self, newest: dict[Register, bytes], n: int) -> None:
        """Show the newest of samples; the field is measured more seldom."""
        before, self._made = self._made, self._made + n
        field_is_old = before // self._field_step == self._made // self._field_step
        for register, data in newest.items():
            if not (field_is_old and register is B.MAG_DATA):
                self.memory.fill(register, data)
        if self._fused:
            seconds = self._made / self._rate_hz
            # gyroscope first, then magnetometer, accelerometer, system: how fast is assumed
            waits = (0.0, 0.0, 0.0) if self._restored else (1.0, 3.0, 5.0)
            gyro, compass, system = (3 if seconds > wait else 0 for wait in waits)
            self.memory.set(B.CALIB_STAT, system << 6 | gyro << 4 | system << 2 | compass)
            if system and not self._restored:
                self.memory.fill(B.OFFSETS, FOUND[:9].tobytes())
                self.memory.fill(B.RADII, FOUND[9:].tobytes())

    def _fuse(
        self, samples: Samples, force: np.ndarray, with_field: bool
    ) -> dict[Register, np.ndarray]:
        """Return what only the fusion makes."""
        quaternions = samples.orientation
        if quaternions is None:
            field = samples.magnetic_field if with_field else None
            quaternions = self._attitude.follow(force, field)
        rotations = Rotation.from_quat(quaternions)
        down = rotations.inv().apply([0.0, 0.0, STANDARD_GRAVITY])
        ratio = _ACCELERATION[self._unit(0)]
        # heading, roll, pitch, 16 LSB per degree (DS section 3.6.5.4)
        yaw, pitch, roll = rotations.as_euler('ZYX', degrees=True).T
        return {
            B.QUA_DATA: self._words(B.orientation, quaternions),
            B.GRV_DATA: self._words(B.acceleration, down, ratio),
            B.LIA_DATA: self._words(B.acceleration, force - down, ratio),
            B.EUL_DATA: np.rint(16 * np.column_stack([-yaw % 360.0, roll, pitch])).astype('<i2'),
        }

    def _unit(self, bit: int) -> int:
        """Return a bit of UNIT_SEL."""
        return self.memory.word(B.UNIT_SEL) >> bit & 1

    def _words(self, channel: Channel, si: np.ndarray, ratio: float = 1.0) -> np.ndarray:
        return np.asarray(self.memory.quantise(channel, si, ratio))

    def _force(self, si: np.ndarray) -> np.ndarray:
        """Return acceleration; it ends at 9.81 m/s² times the range, as in Linux (bno055.c)."""
        full = 9.81 * float(self.memory.value(B.accelerometer_range))
        counts = np.clip(si, -full, full) / (0.01 * _ACCELERATION[self._unit(0)])
        return np.asarray(np.rint(counts), dtype='<i2')

    def _rotation(self, si: np.ndarray) -> np.ndarray:
        """Return angular velocity; outside fusion full scale over 2¹⁵, whatever the unit."""
        if self._fused:
            return self._words(B.angular_velocity, si, _ROTATION[self._unit(1)])
        return self._words(B.angular_velocity_plain, si)


class Bno055Uart(StreamDevice):
    """The serial protocol in front of the chip (DS section 4.7)."""

    baud = 115_200
    PATIENCE_NS = 30_000_000  # for the next character of a command: not in the document
    ANSWER_NS = 300_000  # not in the document

    def __init__(self, chip: Bno055Chip, overrun_every: int = 0) -> None:
        self.chip = chip
        self._overrun_every = overrun_every
        self._commands = 0
        self._heard_ns = 0
        self._command = b''
        self._to_send: list[tuple[int, bytes]] = []

    def power_up(self, at_ns: int) -> None:
        """Begin anew."""
        self.chip.power_up(at_ns)
        self._command = b''

    def advance(self, to_ns: int) -> Iterable[tuple[int, bytes]]:
        """Return the answers; a command that is not complete in time is refused."""
        if self._command and to_ns - self._heard_ns > self.PATIENCE_NS:
            self._command = b''
            self._say(0x0A, self._heard_ns + self.PATIENCE_NS)
        sent, self._to_send = self._to_send, []
        return sent

    def receive(self, data: bytes, at_ns: int) -> None:
        """Answer a command when its last byte is here."""
        if not self.chip.answers(at_ns):
            self._command = b''
            return
        self._heard_ns = at_ns
        self._command += data
        if self._command[0] != bosch_uart.START:
            self._command = b''
            self._say(0x06, at_ns)
            return
        if len(self._command) < 4:
            return
        direction, register, length = self._command[1:4]
        need = 4 if direction == bosch_uart.READ else 4 + length
        if len(self._command) < need:
            return
        content, self._command = self._command[4:need], b''
        self._commands += 1
        if self._overrun_every and self._commands % (self._overrun_every + 1) == 0:
            self._say(0x07, at_ns)
        else:
            self._obey(direction, register, length, content, at_ns)

    def _obey(
        self, direction: int, register: int, length: int, content: bytes, at_ns: int
    ) -> None:
        chip = self.chip
        known = chip.memory.owner(chip.decode_address(register)[0]) is not None
        if length == 0:
            self._say(0x09, at_ns)
        elif length > bosch_uart.LONGEST:
            self._say(0x08, at_ns)
        elif not known:
            self._say(0x04, at_ns)
        elif direction == bosch_uart.READ:
            read = chip.read(register, length, at_ns, 0.0)
            if self.foreign and register < 7:
                read = bytes(byte ^ 0x1E for byte in read)
            self._to_send.append((at_ns + self.ANSWER_NS, bytes([bosch_uart.DATA, length]) + read))
        elif chip.refuses(register, at_ns):
            self._say(0x05, at_ns)
        else:
            chip.write(register, content, at_ns)
            # a chip that resets has nothing more to say
            if chip.answers(at_ns):
                self._say(bosch_uart.SUCCESS, at_ns)

    def _say(self, code: int, at_ns: int) -> None:
        self._to_send.append((at_ns + self.ANSWER_NS, bytes([bosch_uart.STATUS, code])))


def create(at: Socket, **options: int) -> Mapping[str, EmulatedBus | EmulatedStream]:
    """Return the wire of a BNO055: I²C, or its serial line."""
    chip = Bno055Chip(at.source, at.clock.now_ns())
    if at.kind == 'serial':
        uart = Bno055Uart(chip, **options)
        return {'': EmulatedStream(at.name, at.clock, uart, at.driver.wiring[''].serial_baud)}
    return {'': at.bus(chip)}
