# SPDX-License-Identifier: Apache-2.0
"""What chips of ST with two dies have in common: output registers, turning on, the second die."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable

from imu_bench.emulators.register_map import EmulatedChip, RegisterMemory
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


class TurnOn:
    """Values that rise from nothing over the first samples."""

    def __init__(self, samples: int) -> None:
        self._samples = samples
        self.state = 0  # how many there were so far

    def filter(self, values: np.ndarray) -> np.ndarray:
        """Return what is shown of values, shape (n, axes)."""
        if self.state >= self._samples:
            return values
        risen = (self.state + np.arange(len(values))) / self._samples
        self.state += len(values)
        return np.asarray(values * np.minimum(risen, 1.0)[:, np.newaxis])


class OutputRegisters:
    """
    The newest sample, low byte first, and its flags.

    With block update a word stays as it is from the moment its low byte is read until its
    high byte is; without, the two may belong to different samples.
    """

    def __init__(self, memory: RegisterMemory, first: Register) -> None:
        self._memory = memory
        self._register = first
        self._words = first.size // 2
        self._all = (1 << self._words) - 1
        self.clear()

    def clear(self) -> None:
        """Begin without a sample."""
        self.waiting = self.overwritten = self._frozen = 0
        self._newest = bytes(2 * self._words)

    def show(self, data: bytes) -> None:
        """Take a new sample."""
        self.overwritten |= self.waiting
        self.waiting = self._all
        self._newest = data
        if not self._frozen:
            self._memory.fill(self._register, data)
            return
        for word in range(self._words):
            if not self._frozen >> word & 1:
                self._refresh(word)

    def was_read(self, number: int, block_update: bool) -> None:
        """React to a byte that was read; other registers' are let pass."""
        word, high = divmod(number - self._register.number, 2)
        if not 0 <= word < self._words:
            return
        bit = 1 << word
        if high:
            self.waiting &= ~bit
            self.overwritten &= ~bit
            if self._frozen & bit:
                self._frozen &= ~bit
                self._refresh(word)
        elif block_update:
            self._frozen |= bit

    @property
    def status(self) -> int:
        """The status byte of three axes: overrun in bits 7 to 4, new data in bits 3 to 0."""
        overrun = bool(self.overwritten) << 7 | self.overwritten << 4
        return overrun | bool(self.waiting) << 3 | self.waiting

    def _refresh(self, word: int) -> None:
        self._memory.fill(self._register, self._newest[2 * word : 2 * word + 2], 2 * word)
