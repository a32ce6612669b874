# SPDX-License-Identifier: Apache-2.0
"""A FIFO that counts whole samples: taken out in bursts, and believed only while it has room."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

from imu_bench.bus.interface import Clock
from imu_bench.bus.register_access import Registers
from imu_bench.errors import BusError
from imu_bench.registers import Field, Frame, Register
import numpy as np
import numpy.typing as npt

FASTEST = 1.1
"""No oscillator runs faster than nominal by more than this."""

KEPT = 1
"""
Slots that stay in the FIFO.

Once it was emptied, some chips of ST give the last slot again with the next burst (LSM303C
datasheet, page 19, on stream mode); whether a relative does is not always said.
"""


@dataclass(frozen=True)
class Slots:
    """
    What was taken out of a FIFO.

    Attributes
    ----------
    words : structured ndarray, shape (n,)
        By the frame of a slot.
    stamps : ndarray of int64, shape (n,)
        First guess, ns: nominal periods back from the time at which the level was read.
    overrun : bool
        The chip says that it ran over.
    gap : bool
        Samples may have been lost before the first of these; always so after an overrun.
    """

    words: npt.NDArray[Any]
    stamps: npt.NDArray[np.int64]
    overrun: bool = False
    gap: bool = False


class SlotFifo:
    """
    The host's side of a FIFO whose level counts whole samples and whose slots never tear.

    Parameters
    ----------
    registers : Registers
    clock : Clock
    counters : Counter
        Receives 'bus_errors' when the level is impossible.
    control : Register
        Mode of the FIFO; the register after it holds the level.
    running : int
        What `control` holds while the stream runs.
    level, overrun : Field
        Of the register after `control`.
    first : Register
        Where a burst starts; the chip goes on with the next slot by itself.
    frame : Frame
        One slot.
    depth : int
        Slots.
    rate_hz : float
        Nominal.

    Attributes
    ----------
    torn : bool
        A burst broke off: nobody knows what is left, so the stream has to start anew.
    skip : int
        So many slots are still thrown away: samples of a chip that has just been turned on.
    """

    def __init__(
        self,
        registers: Registers,
        clock: Clock,
        counters: Counter[str],
        *,
        control: Register,
        running: int,
        level: Field,
        overrun: Field,
        first: Register,
        frame: Frame,
        depth: int,
        rate_hz: float,
    ) -> None:
        self.torn = False
        self.skip = 0
        self._registers = registers
        self._clock = clock
        self._counters = counters
        self._control = control
        self._running = running
        self._level = level
        self._overrun = overrun
        self._first = first
        self._frame = frame
        self._depth = depth
        self._rate_hz = rate_hz
        ages = np.arange(depth - 1, -1, -1) * (1e9 / rate_hz)
        self._ages = np.rint(ages).astype(np.int64)

    def begin(self) -> None:
        """Take note that the stream starts; the first slot after a change of mode is no good."""
        self.torn = False
        self.skip = max(self.skip, 1)

    def take(self) -> Slots | None:
        """
        Return what is in it but for the newest, None if it is not in the mode it was set to.

        Raises
        ------
        BusError
            If the level is more than the chip has slots, or a transfer fails.
        """
        before = self._clock.now_ns()
        control, source = self._registers.burst(self._control, 2)
        latched = (before + self._clock.now_ns()) // 2
        level = (source & self._level.mask) >> self._level.low
        if level > self._depth:
            self._counters['bus_errors'] += 1
            raise BusError(
                f'{self._registers.where(self._control)}: {self._level} is {level} of '
                f'{self._depth}, control 0x{control:02X}; check the wiring'
            )
        if control != self._running:
            return None
        taken = max(level - KEPT, 0)
        if not taken:
            return Slots(self._frame.unpack(b''), self._ages[:0])
        self.torn = True
        data = self._registers.burst(self._first, taken * self._frame.size)
        # a chip that lost its supply meanwhile has answered with something else
        if self._registers.word(self._control) != self._running:
            return None
        self.torn = False
        end = self._clock.now_ns()
        # as if nothing had been taken out before the end: then certainly nothing ran over
        most = level + (end - before) * 1e-9 * self._rate_hz * FASTEST
        overrun = level == self._depth or bool(source & self._overrun.mask)
        gap = overrun or most > self._depth
        # after a loss a stamp may be late but not early: others come that are less late
        stamps = (end if gap else latched) - self._ages[-level:][:taken]
        skipped = min(self.skip, taken)
        self.skip -= skipped
        words = self._frame.unpack(data)
        return Slots(words[skipped:], stamps[skipped:], overrun, gap)
