# SPDX-License-Identifier: Apache-2.0
"""A FIFO that counts whole samples: taken out in bursts, and believed only while it has room."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

from imu_bench.bus.edges import Edge, Edges
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
    """What was taken out of a FIFO."""

    words: npt.NDArray[Any]  # by the frame of a slot
    # first guess, ns: nominal periods back from the time at which the level was read
    stamps: npt.NDArray[np.int64]
    overrun: bool = False  # the chip says that it ran over
    # samples may have been lost before the first of these; always so after an overrun
    gap: bool = False
    latch_ns: int = 0  # so long took reading the level
    # when one of them was measured, counted back from the last, by the data-ready line
    edge: Edge | None = None


class SlotFifo:
    """
    The host's side of a FIFO whose level counts whole samples and whose slots never tear.

    Parameters
    ----------
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
    edges : Edges, optional
        A line that rises when the level reaches a watermark.
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
        edges: Edges | None = None,
    ) -> None:
        # a burst broke off: nobody knows what is left, so the stream has to start anew
        self.torn = False
        # so many slots are still thrown away: samples of a chip that has just been turned on
        self.skip = 0
        # the parts of a slot, each read by itself, where no burst goes on from slot to slot
        self.apart: tuple[Register, ...] = ()
        self._registers = registers
        self._clock = clock
        self._counters = counters
        self._control = control
        self._running = running
        self._edges = edges
        self.watermark = 0  # that level, in the lowest bits of `control`; 0 without a line
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

    def rise_at(self, watermark: int) -> None:
        """Take note of the level at which the line is to rise."""
        self._running |= watermark
        self.watermark = watermark

    def slots(self, count: int) -> bytes:
        """Return the bytes of so many slots."""
        if not self.apart:
            return self._registers.burst(self._first, count * self._frame.size)
        return b''.join(self._registers.burst(part) for _ in range(count) for part in self.apart)

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
        after = self._clock.now_ns()
        latched = (before + after) // 2
        level = (source & self._level.mask) >> self._level.low
        if level > self._depth:
            self._counters['bus_errors'] += 1
            raise BusError(
                f'{self._registers.where(self._control)}: {self._level} is {level} of '
                f'{self._depth}, control 0x{control:02X}; check the wiring'
            )
        if control != self._running:
            return None
        edge = None
        if self._edges is not None:
            edge = self._edges.reached(level, before, after, 1e9 / self._rate_hz)
        taken = max(level - KEPT, 0)
        if not taken:
            return Slots(self._frame.unpack(b''), self._ages[:0], latch_ns=after - before)
        self.torn = True
        data = self.slots(taken)
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
        if self._edges is not None:
            self._edges.drained(end)
        if gap or len(words) == skipped:
            edge = None
        elif edge is not None:
            edge = edge._replace(back=edge.back - (level - taken))
        return Slots(words[skipped:], stamps[skipped:], overrun, gap, after - before, edge)
