# SPDX-License-Identifier: Apache-2.0
"""Output registers of a chip of ST: words of two bytes, and what is known about them."""

from __future__ import annotations

from imu_bench.emulators.register_map import RegisterMemory
from imu_bench.registers import Register


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
