# SPDX-License-Identifier: Apache-2.0
"""The magnetometer AK8963 seen from its I²C wire (AK8963 MS1356-E-02)."""

from __future__ import annotations

from collections.abc import Callable

from imu_bench.drivers.mpu9250 import MAG, Mpu9250
from imu_bench.emulators.register_map import EmulatedChip
from imu_bench.registers import Register
import numpy as np

SINGLE, TRIM = 1, 15
PERIOD_NS = {2: 125_000_000, 6: 10_000_000}
SINGLE_NS = 7_200_000  # AK section 5.3: 7.2 ms typical
MODE_CHANGE_NS = 100_000  # AK section 6.3
OVERFLOW_T = 4912e-6  # AK section 6.4.3.6: sum of the magnitudes

_ST1, _OUT, _ST2, _ASA = (
    Mpu9250.ST1.address,
    Mpu9250.MAG_OUT.address,
    Mpu9250.ST2.address,
    Mpu9250.ASA.address,
)


class Ak8963(EmulatedChip):
    """Modes, data ready and overrun, data held until ST2 is read, fuse ROM."""

    made = frozenset({_ASA})
    watched = frozenset(range(_OUT, _ST2 + 1))

    def __init__(
        self,
        field_at: Callable[[int], np.ndarray],
        asa: tuple[int, int, int] = (176, 178, 166),
        rate_error: float = 0.0,
    ) -> None:
        mine = [r for r in Mpu9250.declared(Register).values() if r.part == MAG]
        super().__init__(mine)
        self._field_at = field_at
        self._asa = asa
        self._trim = (np.array(asa) - 128) * 0.5 / 128 + 1  # AK section 8.3.11
        self._stretch = 1.0 / (1.0 + rate_error)
        self.power_up(0)

    def power_up(self, at_ns: int) -> None:
        """Begin at the reset values."""
        self.memory.reset()
        self._mode = 0
        self._off_ns = at_ns - MODE_CHANGE_NS
        self._due_ns: int | None = None
        self._held = False
        self._again: tuple[int, int, bytes] | None = None

    def read(self, first: int, length: int, at_ns: int, byte_ns: float) -> bytes:
        """Return what the chip drives onto the wire: until something happens, the same again."""
        due = self._due_ns is not None and self._due_ns <= at_ns
        if self._again is not None and self._again[:2] == (first, length) and not due:
            return self._again[2]
        self.advance(at_ns)
        idle = not self._held and not self.memory.word(Mpu9250.ST1)
        data = super().read(first, length, at_ns, byte_ns)
        self._again = (first, length, data) if idle and not self._held else None
        return data

    def advance(self, to_ns: int) -> None:
        """Make the measurements that are due."""
        while self._due_ns is not None and self._due_ns <= to_ns:
            self._again = None
            self._measure(self._due_ns)
            period = PERIOD_NS.get(self._mode)
            if period is None:
                self._mode, self._due_ns = 0, None
                self.memory.put(Mpu9250.magnetometer_mode, 0)
            else:
                self._due_ns += round(period * self._stretch)

    def _measure(self, at_ns: int) -> None:
        memory = self.memory
        if memory.code(Mpu9250.magnetometer_ready):
            memory.put(Mpu9250.magnetometer_overrun, 1)
        if self._held:
            return
        field = np.asarray(self._field_at(at_ns))[np.newaxis]
        words = Mpu9250.magnetic_field.encode(field, trim=self._trim)
        if not memory.code(Mpu9250.magnetometer_bits):
            words = (words // 4).astype(words.dtype)
        memory.fill(Mpu9250.MAG_OUT, words.tobytes())
        memory.put(Mpu9250.magnetometer_overflow, int(np.abs(field).sum() >= OVERFLOW_T))
        memory.put(Mpu9250.magnetometer_ready, 1)

    def reading(self, number: int, at_ns: int) -> None:
        """Open the fuse ROM in its mode only."""
        if number == _ASA:
            self.memory.fill(Mpu9250.ASA, bytes(self._asa if self._mode == TRIM else 3))

    def was_read(self, number: int, at_ns: int) -> None:
        """Hold the data from their first byte until ST2."""
        if _OUT <= number <= _ST2:
            self._held = number != _ST2
            self.memory.set(Mpu9250.ST1, 0)

    def written(self, register: Register, at_ns: int) -> None:
        """Reset, or change the mode by way of power-down."""
        self._again = None
        if register is Mpu9250.CNTL2 and self.memory.code(Mpu9250.magnetometer_reset):
            self.power_up(at_ns)
            self._off_ns = at_ns
        elif register is Mpu9250.CNTL1:
            self._change_mode(self.memory.code(Mpu9250.magnetometer_mode), at_ns)

    def _change_mode(self, mode: int, at_ns: int) -> None:
        if mode == 0:
            self._mode, self._due_ns, self._off_ns = 0, None, at_ns
        elif self._mode == 0 and at_ns - self._off_ns >= MODE_CHANGE_NS:
            self._mode = mode
            period = SINGLE_NS if mode == SINGLE else PERIOD_NS.get(mode)
            self._due_ns = at_ns + period if period else None
        self.memory.put(Mpu9250.magnetometer_mode, self._mode)
