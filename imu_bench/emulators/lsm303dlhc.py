# SPDX-License-Identifier: Apache-2.0
"""
The LSM303DLHC seen from the wire: Doc ID 018771 rev. 1 (DS).

Where DS is silent this is assumed: the FIFO has 32 slots and its overrun flag says that one
was overwritten, as in the LIS3DH (DocID17530 rev. 2, section 5.1); a reboot is over at once;
reading the field clears its ready flag, unless it is asked to stay as in the HMC5883L.
"""

from __future__ import annotations

from collections.abc import Iterable

from imu_bench.drivers.lsm303dlhc import Lsm303dlhc, MAG, SLOTS, TURN_ON
from imu_bench.emulators.ahead import Source, Stateful
from imu_bench.emulators.fifo_chip import FifoChip, SlotFifo
from imu_bench.emulators.low_pass import LowPass
from imu_bench.emulators.register_map import EmulatedBus, numbers, or_zero
from imu_bench.emulators.second_die import OutputRegisters, SecondDie, Surroundings, TurnOn
from imu_bench.emulators.socket import Socket
from imu_bench.registers import Register
from imu_bench.samples import Samples
import numpy as np

L = Lsm303dlhc
START_UP_NS = 5_000_000
WRITING_NS = 250_000  # HMC5883L data sheet, status register: not ready while new data are written
BURST = 0x80  # DS section 5.1.2
POINTER_END = 0x0C  # DS section 5.1.3: from here on the pointer goes to 0
_OUT = L.OUT_M.address
_MODES = {'bypass': 'off', 'fifo': 'stops'}


class InertialDie(FifoChip):
    """The accelerometer and its FIFO."""

    start_up_ns = START_UP_NS
    made = numbers(L.STATUS_REG_A, L.FIFO_SRC_REG_A)
    watched = numbers(L.OUT_A)
    slot_numbers = tuple(range(0x28, 0x2E))

    def __init__(self, source: Source, start_ns: int, *, repeats: bool = False) -> None:
        registers = [r for r in L.declared(Register).values() if r.part == '']
        super().__init__(registers, source, SlotFifo(SLOTS, repeats=repeats))
        self.field = Surroundings(3)
        self.warmth = Surroundings(1)
        self._output = OutputRegisters(self.memory, L.OUT_A)
        self.power_up(start_ns)

    def reset(self, at_ns: int) -> None:
        """Return to the reset values."""
        self._output.clear()
        super().reset(at_ns)
        self._choose()

    def rate_hz(self) -> float:
        """Return the rate of normal mode."""
        return float(self.memory.value(L.sample_rate))

    def fifo_mode(self) -> str:
        """Return what FIFO_EN and FM ask for; no trigger ever comes."""
        return self._mode

    def risen_at(self) -> int:
        """Return the watermark, if it is on the pin."""
        on_pin = self.memory.code(L.watermark_interrupt)
        return int(self.memory.code(L.fifo_threshold)) if on_pin else 0

    def settle(self, rate_hz: float) -> None:
        """Set up the filter: a ninth of the rate; the first samples are not settled."""
        self._filter = LowPass(rate_hz / 9, rate_hz)
        self._turning_on = TurnOn(TURN_ON)

    def surroundings(self, samples: Samples, first: int, last: int) -> None:
        """Keep field and temperature for the other die."""
        stamps = samples.stamps[first:last]
        if samples.magnetic_field is not None:
            self.field.add(stamps, samples.magnetic_field[first:last])
        if samples.temperature is not None:
            self.warmth.add(stamps, samples.temperature[first:last, np.newaxis])

    def filters(self) -> Iterable[Stateful]:
        """Return the filter, and what remains of the turn-on."""
        return self._filter, self._turning_on

    def slots(self, samples: Samples) -> np.ndarray:
        """Return three words of each sample; without high resolution they have 10 bit."""
        n = len(samples)
        force = self._filter.filter(or_zero(samples.acceleration, (n, 3)))
        force = self._turning_on.filter(force)
        words = self.memory.quantise(L.acceleration, force)
        if not self.memory.code(L.high_resolution):
            words &= np.int16(~0x3F)
        enabled = self.memory.code(L.axes_enabled)
        words *= np.array([enabled >> axis & 1 for axis in range(3)], dtype=words.dtype)
        return np.asarray(words.view(np.uint8).reshape(n, -1))

    def show(self, newest: bytes) -> None:
        """Put the newest sample into the output registers."""
        self._output.show(newest)

    # --- registers -----------------------------------------------------------------------
    def decode_address(self, first: int) -> tuple[int, bool]:
        """Increment with bit 7."""
        return first & ~BURST, bool(first & BURST)

    def reading(self, number: int, at_ns: int) -> None:
        """Make flags and level of what they stand for."""
        if number == L.STATUS_REG_A.address:
            self.memory.set(L.STATUS_REG_A, self._output.status)
        elif number == L.FIFO_SRC_REG_A.address:
            level, threshold = len(self.fifo), self.memory.code(L.fifo_threshold)
            flags = (level >= threshold) << 7 | self.fifo.overrun << 6 | (not level) << 5
            self.memory.set(L.FIFO_SRC_REG_A, flags | min(level, SLOTS - 1))

    def was_read(self, number: int, at_ns: int) -> None:
        """Clear flags; hold words that were read half."""
        self._output.was_read(number, bool(self.memory.code(L.block_update)))

    def written(self, register: Register, at_ns: int) -> None:
        """Do what a written bit asks for; a reboot leaves the control registers alone."""
        if register is L.CTRL_REG1_A:
            self.change_rate(at_ns)
        elif register in (L.CTRL_REG5_A, L.FIFO_CTRL_REG_A):
            self.memory.put(L.boot, 0)
            self._choose()

    def _choose(self) -> None:
        asked = str(self.memory.value(L.fifo_mode))
        running = self.memory.code(L.fifo_enable)
        self._mode = _MODES.get(asked, 'overwrites') if running else 'off'
        if asked == 'bypass':
            self.fifo.clear()
            self.memory.fifo_stuck = False  # this chip has no reset but the supply


class MagneticDie(SecondDie):
    """
    Magnetometer and thermometer.

    Once one byte of the field was read, no new data come before the sixth was.
    """

    made = numbers(L.SR_REG_M)
    watched = numbers(L.OUT_M)

    def __init__(
        self,
        inertial: InertialDie,
        start_ns: int,
        rate_error: float,
        *,
        ready_stays: bool,
    ) -> None:
        registers = [r for r in L.declared(Register).values() if r.part == MAG]
        super().__init__(registers, inertial.advance, rate_error)
        self._inertial = inertial
        self._ready_stays = ready_stays
        self.power_up(start_ns)

    def power_up(self, at_ns: int) -> None:
        """Begin at the reset values."""
        super().power_up(at_ns)
        self._unread = 0
        self._measured_ns: int | None = None

    def answers(self, at_ns: int) -> bool:
        """Return whether start-up is over; the supply is the same."""
        return self._inertial.answers(at_ns)

    def rate_hz(self) -> float:
        """Return the rate; in single mode one sample is due after its period."""
        awake = self.memory.value(L.magnetometer_mode) != 'sleep'
        return float(self.memory.value(L.magnetometer_rate)) if awake else 0.0

    def measure(self, at_ns: int) -> None:
        """Take a sample, unless the last one is being read."""
        memory = self.memory
        field = self._inertial.field.until(at_ns)[np.newaxis]
        if self._unread in (0, 0x3F):
            memory.fill(L.OUT_M, memory.quantise(L.magnetic_field, field).tobytes())
            self._unread, self._measured_ns = 0x3F, at_ns
        if memory.code(L.temperature_enable):
            degrees = self._inertial.warmth.until(at_ns)
            memory.fill(L.TEMP_OUT_M, memory.quantise(L.temperature, degrees).tobytes())
        if memory.value(L.magnetometer_mode) == 'single':
            memory.put(L.magnetometer_mode, L.magnetometer_mode.encode('sleep'))
            self.change_rate(at_ns)

    def following(self, number: int) -> int:
        """Go on as the pointer does: DS section 5.1.3."""
        if number == _OUT + 5:
            return _OUT
        return 0 if number >= POINTER_END else number + 1

    def reading(self, number: int, at_ns: int) -> None:
        """Make the status of what it stands for."""
        if number != L.SR_REG_M.address:
            return
        if self._ready_stays:
            ready = self._measured_ns is not None and at_ns - self._measured_ns >= WRITING_NS
        else:
            ready = self._unread == 0x3F
        locked = self._unread not in (0, 0x3F)
        self.memory.set(L.SR_REG_M, locked << 1 | ready)

    def was_read(self, number: int, at_ns: int) -> None:
        """Take note of the bytes of the field that were read."""
        if _OUT <= number < _OUT + 6:
            self._unread &= ~(1 << number - _OUT)

    def written(self, register: Register, at_ns: int) -> None:
        """Measure at another rate, or not at all."""
        if register in (L.CRA_REG_M, L.MR_REG_M):
            self.change_rate(at_ns)


def create(
    at: Socket,
    *,
    magnetometer_rate_error: float = 0.0,
    ready_stays: bool = False,
    repeats: bool = False,
) -> dict[str, EmulatedBus]:
    """Return the buses of both dies."""
    inertial = InertialDie(at.source, at.clock.now_ns(), repeats=repeats)
    magnetic = MagneticDie(
        inertial, at.clock.now_ns(), magnetometer_rate_error, ready_stays=ready_stays
    )
    return {'': at.bus(inertial), MAG: at.bus(magnetic, MAG)}
