# SPDX-License-Identifier: Apache-2.0
"""A chip that samples by itself, whether it is asked or not."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Any

from imu_bench.emulators.ahead import Ahead, Source, Stateful
from imu_bench.emulators.pin import EmulatedPin
from imu_bench.emulators.register_map import EmulatedChip
from imu_bench.registers import Register
from imu_bench.samples import Samples

IDLE_NS = 10_000_000_000
"""Nobody asked for so long: the samples in between are skipped."""


class SamplingChip(EmulatedChip, ABC):
    """What such chips have in common: a start-up, and time that passes."""

    def __init__(self, registers: Iterable[Register], source: Source) -> None:
        super().__init__(registers)
        self._source = Ahead(source, self.converted, self.stateful)
        self._ready_ns = self._now_ns = 0
        self.pin: EmulatedPin | None = None

    @abstractmethod
    def converted(self, samples: Samples) -> Any:
        """Return what the chip shows of samples, row by row; changes nothing but filters."""

    def stateful(self) -> Iterable[Stateful]:
        """Return the filters of `converted`."""
        return ()

    def about_to_change(self) -> None:
        """What is not due yet is to be made with the new setting."""
        self._source.rewind()

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
