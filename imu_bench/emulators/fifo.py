# SPDX-License-Identifier: Apache-2.0
"""A FIFO of bytes, as it is inside a chip."""

from __future__ import annotations


class ByteRing:
    """Bytes in the order in which they came; full means lost bytes, not lost frames."""

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity  # bytes
        self._bytes = bytearray()
        self._last = 0

    def __len__(self) -> int:
        return len(self._bytes)

    def clear(self) -> None:
        """Empty it."""
        self._bytes.clear()

    def push(self, data: bytes, *, stops_when_full: bool = False) -> int:
        """Append bytes; return how many were lost."""
        self._bytes += data
        lost = max(len(self._bytes) - self.capacity, 0)
        if stops_when_full:
            del self._bytes[self.capacity :]
        else:
            del self._bytes[:lost]
        return lost

    def pop(self, length: int) -> bytes:
        """Return bytes from the front; an empty FIFO repeats the last byte."""
        out = bytes(self._bytes[:length])
        del self._bytes[:length]
        if out:
            self._last = out[-1]
        return out + bytes([self._last]) * (length - len(out))
