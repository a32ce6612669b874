# SPDX-License-Identifier: Apache-2.0
"""A second die that shares the surroundings of the first and samples at a pace of its own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable

from imu_bench.emulators.register_map import EmulatedChip
from imu_bench.registers import Register
import numpy as np

KEPT_BLOCKS = 4096
LATE_PERIODS = 8


class Surroundings:
    """
    A quantity as a slower die sees it: the mean since it looked last.

    The mean of white noise has the density of what it is the mean of.
    """

    def __init__(self, columns: int) -> None:
        self._blocks: deque[tuple[np.ndarray, np.ndarray]] = deque(maxlen=KEPT_BLOCKS)
        self._mean = np.zeros(columns)

    def add(self, stamps: np.ndarray, values: np.ndarray) -> None:
        """Append samples, shape (n, columns)."""
        self._blocks.append((stamps, values))

    def until(self, t_ns: int) -> np.ndarray:
        """Return the mean of what came since the last call up to a time, shape (columns,)."""
        seen = []
        while self._blocks and self._blocks[0][0][0] <= t_ns:
            stamps, values = self._blocks.popleft()
            due = int(np.searchsorted(stamps, t_ns, side='right'))
            seen.append(values[:due])
            if due < len(stamps):
                self._blocks.appendleft((stamps[due:], values[due:]))
                break
        if seen:
            self._mean = np.concatenate(seen).mean(axis=0)
        return self._mean


class SecondDie(EmulatedChip, ABC):
    """What such dies have in common; a chip adds its registers and is powered up when made."""

    def __init__(
        self,
        registers: Iterable[Register],
        look: Callable[[int], None],
        rate_error: float = 0.0,
    ) -> None:
        super().__init__(registers)
        self._look = look
        self._stretch = 1e9 / (1.0 + rate_error)

    @abstractmethod
    def rate_hz(self) -> float:
        """Return the rate its registers ask for, 0 for none."""

    @abstractmethod
    def measure(self, at_ns: int) -> None:
        """Take a sample."""

    def power_up(self, at_ns: int) -> None:
        """Begin at the reset values."""
        self.memory.reset()
        self.change_rate(at_ns)

    def change_rate(self, at_ns: int) -> None:
        """Sample at the rate the registers ask for; the first one comes after one period."""
        rate = self.rate_hz()
        self._period_ns = round(self._stretch / rate) if rate else 0
        self._due_ns = at_ns + self._period_ns

    def advance(self, to_ns: int) -> None:
        """Take every sample that is due; after a long absence only the last ones."""
        self._look(to_ns)
        if self._period_ns:
            late = (to_ns - self._due_ns) // self._period_ns
            self._due_ns += max(late - LATE_PERIODS, 0) * self._period_ns
        while self._period_ns and self._due_ns <= to_ns:
            at_ns, self._due_ns = self._due_ns, self._due_ns + self._period_ns
            self.measure(at_ns)
