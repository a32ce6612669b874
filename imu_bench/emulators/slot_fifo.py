# SPDX-License-Identifier: Apache-2.0
"""A FIFO of whole samples, as it is inside a chip of ST."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable


class SlotFifo:
    """Samples in the order in which they came, one to a slot."""

    def __init__(self, depth: int, *, repeats: bool = False) -> None:
        self.depth = depth  # slots
        self.overrun = False  # a slot was overwritten, and none taken out since
        self._repeats = repeats
        self._slots: deque[bytes] = deque()
        self._last = b''
        self._again = self._stopped = False

    def __len__(self) -> int:
        return len(self._slots)

    @property
    def front(self) -> bytes:
        """The slot that is read next; an empty FIFO shows the last one."""
        return self._slots[0] if self._slots and not self._again else self._last

    def clear(self) -> None:
        """Empty it."""
        self._slots.clear()
        self.overrun = self._again = self._stopped = False

    def push(self, slots: Iterable[bytes], *, stops_when_full: bool = False) -> None:
        """Append slots; a full FIFO drops the oldest, or takes no more until it is cleared."""
        if not self._stopped:
            self._slots.extend(slots)
        self._stopped |= stops_when_full and len(self._slots) >= self.depth
        while len(self._slots) > self.depth:
            self.overrun = True
            self._slots.pop() if stops_when_full else self._slots.popleft()

    def drop(self) -> None:
        """Take the slot out that was read."""
        self.overrun = False
        if self._again:
            self._again = False
        elif self._slots:
            self._last = self._slots.popleft()
            self._again = self._repeats and not self._slots

    def take(self, count: int) -> bytes:
        """Return slots from the front, and take them out."""
        out = []
        for _ in range(count):
            out.append(self.front)
            self.drop()
        return b''.join(out)
