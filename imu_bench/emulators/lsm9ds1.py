# SPDX-License-Identifier: Apache-2.0
"""
The LSM9DS1 seen from the wire: DocID025715 rev. 2 (DS).

Where DS is silent this is assumed: a FIFO slot is taken out when its last byte, 2Dh, is read;
a reset is over at once; after power-up the chip answers within 10 ms.
"""

from __future__ import annotations

from collections.abc import Iterable

from imu_bench.drivers.lsm9ds1 import LOW_PASS_2, Lsm9ds1, MAG, SLOTS, TURN_ON
from imu_bench.emulators.ahead import Source, Stateful
from imu_bench.emulators.fifo_chip import FifoChip, SlotFifo
from imu_bench.emulators.low_pass import LowPass
from imu_bench.emulators.register_map import EmulatedBus, numbers, or_zero
from imu_bench.emulators.second_die import OutputRegisters, SecondDie, Surroundings, TurnOn
from imu_bench.emulators.socket import Socket
from imu_bench.registers import Frame, Register
from imu_bench.samples import Samples
import numpy as np

L = Lsm9ds1
START_UP_NS = 10_000_000
TEMPERATURE_NS = round(1e9 / 59.5)  # DS, temperature sensor characteristics
LOW_PASS_1 = {14.9: 5.0, 59.5: 19.0, 119.0: 38.0, 238.0: 76.0, 476.0: 100.0, 952.0: 100.0}
# DS section 3.1: the anti-alias filter that goes with a rate; the two lowest are not given
AUTOMATIC = {952.0: 408.0, 476.0: 211.0, 238.0: 105.0, 119.0: 50.0}
_SLOT = Frame(L.angular_velocity, L.acceleration)
_GYROSCOPE = tuple(range(0x18, 0x1E))
_ACCELEROMETER = tuple(range(0x28, 0x2E))
_RATE_REGISTERS = (L.CTRL_REG1_G, L.CTRL_REG2_G, L.CTRL_REG6_XL)
_FIFO_REGISTERS = (L.FIFO_CTRL, L.CTRL_REG9)
_MODES = {'bypass': 'off', 'fifo': 'stops', 'bypass to continuous': 'off'}


class InertialDie(FifoChip):
    """Accelerometer, gyroscope, thermometer and FIFO."""

    start_up_ns = START_UP_NS
    made = numbers(L.STATUS_REG, L.STATUS_REG_27, L.FIFO_SRC)
    watched = numbers(L.OUT_XL, L.OUT_G, L.OUT_TEMP)

    def __init__(
        self, source: Source, start_ns: int, *, repeats: bool = False, wraps: bool = True
    ) -> None:
        registers = [r for r in L.declared(Register).values() if r.part == '']
        self._wraps = wraps
        super().__init__(registers, source, SlotFifo(SLOTS, repeats=repeats))
        self.field = Surroundings(3)
        self._force = OutputRegisters(self.memory, L.OUT_XL)
        self._rotation = OutputRegisters(self.memory, L.OUT_G)
        self._warmth = OutputRegisters(self.memory, L.OUT_TEMP)
        self._outputs = (self._force, self._rotation, self._warmth)
        self.power_up(start_ns)

    def reset(self, at_ns: int) -> None:
        """Return to the reset values."""
        for output in self._outputs:
            output.clear()
        self._warmth_due_ns = at_ns
        super().reset(at_ns)
        self._choose()

    def rate_hz(self) -> float:
        """Return the gyroscope's rate, which both have, or the accelerometer's alone."""
        both = float(self.memory.value(L.sample_rate))
        return both or float(self.memory.value(L.accelerometer_rate))

    def fifo_mode(self) -> str:
        """Return what FIFO_EN and FMODE ask for; no interrupt ever comes."""
        return self._mode

    def risen_at(self) -> int:
        """Return the threshold, if it is on the pin."""
        on_pin = self.memory.code(L.threshold_interrupt)
        return int(self.memory.code(L.fifo_threshold)) if on_pin else 0

    def settle(self, rate_hz: float) -> None:
        """Set up the filters; the first samples after that are not settled."""
        memory = self.memory
        by_hand = memory.code(L.bandwidth_by_hand) or rate_hz not in AUTOMATIC
        bandwidth = float(memory.value(L.accelerometer_bandwidth))
        self._force_filter = LowPass(bandwidth if by_hand else AUTOMATIC[rate_hz], rate_hz)
        cut_off = LOW_PASS_1.get(rate_hz, 0.0)
        if memory.value(L.gyroscope_output) == 'low-pass 2' and LOW_PASS_2.get(rate_hz):
            cut_off = min(cut_off, LOW_PASS_2[rate_hz][memory.code(L.gyroscope_low_pass)])
        self._rotation_filter = LowPass(cut_off or rate_hz, rate_hz)
        rising = TURN_ON.get(rate_hz, 1)
        self._force_rises, self._rotation_rises = TurnOn(rising), TurnOn(rising)

    def surroundings(self, samples: Samples, first: int, last: int) -> None:
        """Keep the field for the other die, and the temperature."""
        if samples.magnetic_field is not None:
            self.field.add(samples.stamps[first:last], samples.magnetic_field[first:last])
        newest_ns = int(samples.stamps[last - 1])
        if samples.temperature is not None and newest_ns >= self._warmth_due_ns and self.rate_hz():
            self._warmth_due_ns = max(self._warmth_due_ns + TEMPERATURE_NS, newest_ns)
            celsius = samples.temperature[last - 1 : last]
            self._warmth.show(self.memory.quantise(L.temperature, celsius).tobytes())

    def filters(self) -> Iterable[Stateful]:
        """Return the filters, and what remains of the turn-on."""
        return self._force_filter, self._rotation_filter, self._force_rises, self._rotation_rises

    def slots(self, samples: Samples) -> np.ndarray:
        """Return gyroscope, then accelerometer, of each sample."""
        n = len(samples)
        rotation = or_zero(samples.angular_velocity, (n, 3))
        if not self.memory.code(L.sample_rate):
            rotation = np.zeros((n, 3))
        force = self._force_filter.filter(or_zero(samples.acceleration, (n, 3)))
        rotation = self._rotation_filter.filter(rotation)
        force, rotation = self._force_rises.filter(force), self._rotation_rises.filter(rotation)
        words = {
            L.acceleration.quantity: self.memory.quantise(L.acceleration, force),
            L.angular_velocity.quantity: self.memory.quantise(L.angular_velocity, rotation),
        }
        packed = np.frombuffer(_SLOT.pack(words, n), dtype=np.uint8).reshape(n, _SLOT.size)
        return packed[:, -len(self.slot_numbers) :]

    def show(self, newest: bytes) -> None:
        """Put the newest sample into the output registers."""
        self._force.show(newest[-6:])
        if len(newest) > 6:
            self._rotation.show(newest[:6])

    def read(self, first: int, length: int, at_ns: int, byte_ns: float) -> bytes:
        """Return registers or slots; one that does not wrap goes on with what lies behind."""
        number, _ = self.decode_address(first)
        if self._wraps or number not in self.slot_numbers or self.fifo_mode() == 'off':
            return super().read(first, length, at_ns, byte_ns)
        half = _GYROSCOPE if number in _GYROSCOPE else _ACCELEROMETER
        own = min(length, half[-1] + 1 - number)
        data = self._read_slots(self.slot_numbers.index(number), own, at_ns, byte_ns)
        rest = length - own
        return data + (super().read(half[-1] + 1, rest, at_ns, byte_ns) if rest else b'')

    # --- registers -----------------------------------------------------------------------
    def decode_address(self, first: int) -> tuple[int, bool]:
        """Increment if CTRL_REG8 says so."""
        return first, bool(self.memory.code(L.increment))

    def following(self, number: int) -> int:
        """Jump from one output to the other and back: DS section 3.3."""
        if number in (0x1D, 0x2D):
            place = self.slot_numbers.index(number) if number in self.slot_numbers else -1
            return self.slot_numbers[(place + 1) % len(self.slot_numbers)]
        return number + 1

    def reading(self, number: int, at_ns: int) -> None:
        """Make flags and level of what they stand for."""
        if number in (L.STATUS_REG.address, L.STATUS_REG_27.address):
            status = sum(int(out.waiting > 0) << bit for bit, out in enumerate(self._outputs))
            self.memory.set(L.STATUS_REG, status)
            self.memory.set(L.STATUS_REG_27, status)
        elif number == L.FIFO_SRC.address:
            level, threshold = len(self.fifo), self.memory.code(L.fifo_threshold)
            reached = 0 < threshold <= level
            self.memory.set(L.FIFO_SRC, reached << 7 | self.fifo.overrun << 6 | level)

    def was_read(self, number: int, at_ns: int) -> None:
        """Clear flags; hold words that were read half."""
        block_update = bool(self.memory.code(L.block_update))
        for output in self._outputs:
            output.was_read(number, block_update)

    def written(self, register: Register, at_ns: int) -> None:
        """Do what a written bit asks for."""
        memory = self.memory
        if register is L.CTRL_REG8:
            if memory.code(L.software_reset):
                self.reset(at_ns)
            memory.put(L.boot, 0)
        elif register in _RATE_REGISTERS:
            self.change_rate(at_ns)
            self._choose()
        elif register in _FIFO_REGISTERS:
            self._choose()

    def _choose(self) -> None:
        """Set up slots and FIFO."""
        memory = self.memory
        both = memory.code(L.sample_rate)
        self.slot_numbers = _GYROSCOPE + _ACCELEROMETER if both else _ACCELEROMETER
        stops = memory.code(L.fifo_stops_at_threshold)
        self.fifo.depth = memory.code(L.fifo_threshold) + 1 if stops else SLOTS
        asked = str(memory.value(L.fifo_mode))
        self._mode = _MODES.get(asked, 'overwrites') if memory.code(L.fifo_enable) else 'off'
        if asked == 'bypass':
            self.fifo.clear()


class MagneticDie(SecondDie):
    """The magnetometer."""

    made = numbers(L.STATUS_REG_M)
    watched = numbers(L.OUT_M)

    def __init__(self, inertial: InertialDie, start_ns: int, rate_error: float = 0.0) -> None:
        registers = [r for r in L.declared(Register).values() if r.part == MAG]
        super().__init__(registers, inertial.advance, rate_error)
        self._inertial = inertial
        self._output = OutputRegisters(self.memory, L.OUT_M)
        self.power_up(start_ns)

    def power_up(self, at_ns: int) -> None:
        """Begin at the reset values."""
        super().power_up(at_ns)
        self._output.clear()

    def answers(self, at_ns: int) -> bool:
        """Return whether start-up is over; the supply is the same."""
        return self._inertial.answers(at_ns)

    def rate_hz(self) -> float:
        """Return the rate in continuous mode."""
        running = self.memory.value(L.magnetometer_mode) == 'continuous'
        return float(self.memory.value(L.magnetometer_rate)) if running else 0.0

    def measure(self, at_ns: int) -> None:
        """Take a sample."""
        field = self._inertial.field.until(at_ns)[np.newaxis]
        self._output.show(self.memory.quantise(L.magnetic_field, field).tobytes())

    def decode_address(self, first: int) -> tuple[int, bool]:
        """Increment with bit 7 on I²C, with bit 6 on SPI: DS section 5."""
        return first & 0x3F, bool(first & 0xC0)

    def reading(self, number: int, at_ns: int) -> None:
        """Make the status of what it stands for."""
        if number == L.STATUS_REG_M.address:
            self.memory.set(L.STATUS_REG_M, self._output.status)

    def was_read(self, number: int, at_ns: int) -> None:
        """Clear flags; hold words that were read half."""
        self._output.was_read(number, bool(self.memory.code(L.magnetometer_block_update)))

    def written(self, register: Register, at_ns: int) -> None:
        """Do what a written bit asks for."""
        if register is L.CTRL_REG2_M and self.memory.code(L.magnetometer_reset):
            self.power_up(at_ns)
        elif register in (L.CTRL_REG1_M, L.CTRL_REG3_M):
            self.change_rate(at_ns)


def create(
    at: Socket,
    *,
    magnetometer_rate_error: float = 0.0,
    repeats: bool = False,
    wraps: bool = True,
) -> dict[str, EmulatedBus]:
    """Return the buses of both dies."""
    inertial = InertialDie(at.source, at.clock.now_ns(), repeats=repeats, wraps=wraps)
    magnetic = MagneticDie(inertial, at.clock.now_ns(), magnetometer_rate_error)
    return {'': at.bus(inertial), MAG: at.bus(magnetic, MAG)}
