# SPDX-License-Identifier: Apache-2.0
"""A die that samples at the rate of its registers, and its FIFO of whole samples as ST has it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterable

from imu_bench.emulators.ahead import rows_of, Source, Stateful
from imu_bench.emulators.sampling import SamplingChip
from imu_bench.registers import Register
from imu_bench.samples import Samples
import numpy as np


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


HOUSEKEEPING_HZ = 10.0
"""A die that is off still sees its surroundings, for the other die of the chip."""


class FifoChip(SamplingChip, ABC):
    """What such dies have in common; a chip adds its registers and is powered up when made."""

    start_up_ns = 0
    slot_numbers: tuple[int, ...]
    """The registers through which a slot is read, in this order."""

    def __init__(self, registers: Iterable[Register], source: Source, fifo: SlotFifo) -> None:
        super().__init__(registers, source)
        self.fifo = fifo
        self._asked_hz = 0.0

    # --- what a chip says about itself ---------------------------------------------------
    @abstractmethod
    def rate_hz(self) -> float:
        """Return the rate its registers ask for, 0 for none."""

    @abstractmethod
    def fifo_mode(self) -> str:
        """Return 'off', 'stops' when full, or 'overwrites'."""

    @abstractmethod
    def settle(self, rate_hz: float) -> None:
        """Set up filters for a rate."""

    @abstractmethod
    def filters(self) -> Iterable[Stateful]:
        """Return what `slots` carries from one sample to the next."""

    @abstractmethod
    def slots(self, samples: Samples) -> np.ndarray:
        """Return the bytes of samples, shape (n, bytes of a slot), dtype uint8."""

    @abstractmethod
    def show(self, newest: bytes) -> None:
        """Put the newest sample into registers."""

    def risen_at(self) -> int:
        """Return the level at which the data-ready pin rises, 0 if it does not."""
        return 0

    def surroundings(self, samples: Samples, first: int, last: int) -> None:
        """Take note of what the other die may ask for: of some samples."""

    # --- life ----------------------------------------------------------------------------
    def power_up(self, at_ns: int) -> None:
        """Begin at the reset values."""
        self._now_ns = self._ready_ns = at_ns + self.start_up_ns
        self.reset(self._ready_ns)

    def reset(self, at_ns: int) -> None:
        """Return to the reset values without a break."""
        self.memory.reset()
        self.fifo.clear()
        self._asked_hz = 0.0
        self.change_rate(at_ns)

    def change_rate(self, at_ns: int) -> None:
        """Sample at the rate the registers ask for."""
        rate = self.rate_hz()
        asked = rate or HOUSEKEEPING_HZ
        if asked != self._asked_hz:
            self._asked_hz = asked
            self._source.restart(at_ns, asked)
        if rate:
            self.settle(rate)

    def converted(self, samples: Samples) -> tuple[list[bytes], list[bytes]]:
        """Return the slots, and what registers show; none while only the surroundings are seen."""
        if not self.rate_hz():
            return [], []
        slots = rows_of(self.slots(samples))
        return slots, slots

    def stateful(self) -> Iterable[Stateful]:
        """Return the filters, if any were set up."""
        return self.filters() if self.rate_hz() else ()

    def advance(self, to_ns: int) -> None:
        """Take every sample that is due."""
        if not self.pass_time(to_ns):
            return
        for samples, (slots, shown), first, last in self._source.until(to_ns):
            self.surroundings(samples, first, last)
            if slots:
                mode = self.fifo_mode()
                if mode != 'off' and not self.memory.fifo_stuck:
                    missing = self.risen_at() - len(self.fifo)
                    if self.pin is not None and 0 < missing <= last - first:
                        self.pin.rose([int(samples.stamps[first + missing - 1])])
                    self.fifo.push(slots[first:last], stops_when_full=mode == 'stops')
                self.show(shown[last - 1])

    # --- the wire ------------------------------------------------------------------------
    def read(self, first: int, length: int, at_ns: int, byte_ns: float) -> bytes:
        """Return registers, or slots where those are read while the FIFO runs."""
        number, increments = self.decode_address(first)
        if not (increments and number in self.slot_numbers) or self.fifo_mode() == 'off':
            return super().read(first, length, at_ns, byte_ns)
        size = len(self.slot_numbers)
        end_ns = at_ns + length * byte_ns
        due = (end_ns - self._now_ns) * 1e-9 * self._asked_hz * 1.1 + 2
        whole = number == self.slot_numbers[0] and length % size == 0
        if whole and length // size <= len(self.fifo) <= self.fifo.depth - due:
            return self.fifo.take(length // size)
        return self._read_slots(self.slot_numbers.index(number), length, at_ns, byte_ns)

    def _read_slots(self, place: int, length: int, at_ns: int, byte_ns: float) -> bytes:
        """Read byte by byte where it may run over or dry meanwhile."""
        size = len(self.slot_numbers)
        out = bytearray()
        while len(out) < length:
            self.advance(at_ns + round(len(out) * byte_ns))
            front = self.fifo.front or bytes(size)
            part = front[place : place + length - len(out)]
            out += part
            place += len(part)
            if place == size:
                self.fifo.drop()
                place = 0
        return bytes(out)
