# SPDX-License-Identifier: Apache-2.0
"""A device that talks by itself, on a serial line that takes its time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterable

from imu_bench.bus.interface import Clock
import numpy as np

HOST_BYTES = 4095
"""What Linux holds of a line that nobody reads: N_TTY_BUF_SIZE less one; new bytes are lost."""

USB_BYTE_NS = 1000.0
"""Full speed carries about 1 MB/s."""

USB_FRAME_NS = 1_000_000
"""Full speed delivers once in a millisecond: USB 2.0, section 5.3.3."""

STEP_NS = 1_000_000
"""Who waits for bytes looks so often."""


class StreamDevice(ABC):
    """What lives at the end of a line."""

    baud = 0  # speed at which it talks; 0 on USB, where any will do
    foreign = False  # whether it answers as another part

    @abstractmethod
    def power_up(self, at_ns: int) -> None:
        """Begin anew; what is kept without power is kept."""

    @abstractmethod
    def receive(self, data: bytes, at_ns: int) -> None:
        """Take bytes whose last one arrives at a time."""

    @abstractmethod
    def advance(self, to_ns: int) -> Iterable[tuple[int, bytes]]:
        """Live until a time; return what is sent meanwhile, each with the time it begins."""


class EmulatedStream:
    """
    A ByteStream with an emulated device at its other end.

    Bytes arrive when the line has carried them.  What the device wants to send while the line
    is busy waits in it; when more than `device_bytes` wait, a message is lost as a whole.
    """

    def __init__(
        self, name: str, clock: Clock, device: StreamDevice, baud: int, device_bytes: int = 512
    ) -> None:
        self.name = name  # for error texts and diagnostics; says that it is emulated
        self.chip = device
        self.baud = baud  # of this end
        self._clock = clock
        self._device_bytes = device_bytes
        self._coming: deque[tuple[float, float, bytes]] = deque()
        self._arrived = bytearray()
        self._free_ns = 0.0
        self._noise = np.random.default_rng(0)

    @property
    def acknowledges(self) -> bool:
        """Return whether this end notices that the device is gone: USB does."""
        return self.chip.baud == 0

    def read(self, timeout_s: float) -> bytes:
        """Return what has arrived, waiting up to `timeout_s` for the first byte."""
        deadline = self._clock.now_ns() + round(timeout_s * 1e9)
        while True:
            now = self._clock.now_ns()
            self._live(now)
            if self._arrived or now >= deadline:
                data = bytes(self._arrived)
                self._arrived.clear()
                return data
            self._clock.sleep_until(min(now + STEP_NS, deadline))

    def write(self, data: bytes) -> None:
        """Send bytes; return when they are on the line."""
        start = self._clock.now_ns()
        self._live(start)
        end = start + round(len(data) * self._byte_ns(self.baud))
        self._clock.sleep_until(end)
        self._live(end)
        if self._understood():
            self.chip.receive(data, end)

    def close(self) -> None:
        """Do nothing: the device stays where it is."""

    def _byte_ns(self, baud: int) -> float:
        """Return the time of start, eight data and stop bit."""
        return USB_BYTE_NS if self.chip.baud == 0 else 10e9 / baud

    def _understood(self) -> bool:
        return self.chip.baud in (0, self.baud)

    def _live(self, now: int) -> None:
        """Let the device send, and bytes arrive."""
        for at_ns, message in self.chip.advance(now):
            byte_ns = self._byte_ns(self.chip.baud)
            start = max(float(at_ns), self._free_ns)
            if start - at_ns > self._device_bytes * byte_ns:
                continue
            self._free_ns = start + len(message) * byte_ns
            self._coming.append((start, byte_ns, message))
        while self._coming:
            start, byte_ns, message = self._coming[0]
            edge = now // USB_FRAME_NS * USB_FRAME_NS if self.chip.baud == 0 else now
            whole = min(int((edge - start) / byte_ns), len(message))
            if whole <= 0:
                break
            self._arrive(message[:whole])
            self._coming.popleft()
            if whole < len(message):
                self._coming.appendleft((start + whole * byte_ns, byte_ns, message[whole:]))
                break

    def _arrive(self, data: bytes) -> None:
        if not self._understood():
            # another speed makes other bytes, more or fewer of them
            data = self._noise.bytes(max(1, len(data) * self.baud // self.chip.baud))
        self._arrived += data[: HOST_BYTES - len(self._arrived)]
