# SPDX-License-Identifier: Apache-2.0
"""A chip that samples by itself, whether it is asked or not."""

from __future__ import annotations

from collections.abc import Iterable

from imu_bench.emulators.register_map import EmulatedChip, Source
from imu_bench.registers import Register

IDLE_NS = 10_000_000_000
"""Nobody asked for so long: the samples in between are skipped."""


class SamplingChip(EmulatedChip):
    """
    What such chips have in common: a start-up, and time that passes.

    Parameters
    ----------
    registers : iterable of Register
    source : Source
        Is told the rate the registers ask for, and samples at it times its own error.
    """

    def __init__(self, registers: Iterable[Register], source: Source) -> None:
        super().__init__(registers)
        self._source = source
        self._ready_ns = self._now_ns = 0

    def answers(self, at_ns: int) -> bool:
        """Return whether start-up is over."""
        return at_ns >= self._ready_ns

    def pass_time(self, to_ns: int) -> bool:
        """Go on to a time; return whether it lies ahead, so that samples may be due."""
        if to_ns <= self._now_ns:
            return False
        if to_ns - self._now_ns > IDLE_NS:
            self._source.restart(to_ns - IDLE_NS // 10)
        self._now_ns = to_ns
        return True
