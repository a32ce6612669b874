# SPDX-License-Identifier: Apache-2.0
"""What goes wrong on a desk, on purpose and at a given time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
import math
from typing import Any

from imu_bench.bus.interface import Clock
from imu_bench.drivers.driver import Driver
from imu_bench.errors import BusBusy, BusError, ConfigError, NoAnswer, PermissionDenied
import numpy as np

KINDS = {
    'no_answer': 'a wire is open; the chip keeps its supply',
    'unplugged': 'no answer, and afterwards the chip is at its reset values',
    'stuck': 'a data line is held low, or the clock stretched without end',
    'permission_denied': 'the device may not be opened any more',
    'wrong_identity': 'another chip answers',
    'brown_out': 'the chip is back at its reset values, silently',
    'stall': 'somebody else holds the bus for the time given: FIFOs run over',
    'garbage': 'what is read is noise',
    'bit_error': 'one bit of what is read is wrong, once',
    'bit_errors': 'a bit of every transfer is wrong',
}
"""Every fault there is, and what it stands for."""


_OPEN = {'no_answer', 'unplugged'}
_FLIPS = {'bit_error', 'bit_errors'}
_ERRORS: dict[str, tuple[type[BusError], str]] = {
    'permission_denied': (PermissionDenied, 'this user may not open it'),
    'stuck': (BusBusy, 'a line is stuck or the clock stretched too long'),
    **dict.fromkeys(_OPEN, (NoAnswer, 'nothing answers; check power, wiring and address')),
}


@dataclass(frozen=True)
class Fault:
    """
    One fault.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    at_s : float
        Start, in seconds after the bus was made.
    for_s : float
        Duration; brown_out happens once whatever it says.

    Raises
    ------
    ConfigError
        If the kind is not known.
    """

    kind: str
    at_s: float = 0.0
    for_s: float = math.inf

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ConfigError(f'fault {self.kind!r} is not known; there are {", ".join(KINDS)}')


class FaultyBus:
    """
    A RegisterBus around an emulated one that plays faults.

    Parameters
    ----------
    bus : EmulatedBus or EmulatedFrameBus
    clock : Clock
    faults : iterable of Fault
    identity : iterable of int
        Numbers of the registers that 'wrong_identity' changes.
    seed : int
        Of the noise of 'garbage'.
    """

    def __init__(
        self,
        bus: Any,
        clock: Clock,
        faults: Iterable[Fault] = (),
        identity: Iterable[int] = (),
        seed: int = 0,
    ) -> None:
        self.name = bus.name
        self._bus = bus
        self._clock = clock
        self._start_ns = clock.now_ns()
        self._faults = list(faults)
        self._done: set[Fault] = set()
        self._identity = frozenset(identity)
        self._noise = np.random.default_rng(seed)

    def inject(self, kind: str, for_s: float = math.inf) -> None:
        """Begin a fault now."""
        self._faults.append(Fault(kind, self._elapsed_s(), for_s))

    def clear(self) -> None:
        """End every fault now."""
        now = self._elapsed_s()
        self._faults = [
            Fault(fault.kind, fault.at_s, min(fault.for_s, max(now - fault.at_s, 0.0)))
            for fault in self._faults
            if fault not in self._done
        ]

    def read(self, register: int, length: int) -> bytes:
        """Return what the chip answers, or what the fault makes of it."""
        kinds = self._play()
        if not kinds.isdisjoint(_OPEN):
            return b'\xff' * length
        data = self._bus.read(register, length)
        if 'wrong_identity' in kinds and register in self._identity:
            return bytes(byte ^ 0x1E for byte in data)
        return self._disturbed(data, kinds)

    def write(self, register: int, data: bytes) -> None:
        """Write, unless the fault prevents it."""
        if self._play().isdisjoint(_OPEN):
            self._bus.write(register, data)

    def close(self) -> None:
        """Release the device."""
        self._bus.close()

    def _disturbed(self, data: bytes, kinds: set[str]) -> bytes:
        if 'garbage' in kinds:
            return self._noise.bytes(len(data))
        if kinds.isdisjoint(_FLIPS):
            return data
        flip = 1 << int(self._noise.integers(8 * len(data)))
        return (int.from_bytes(data, 'big') ^ flip).to_bytes(len(data), 'big')

    def _elapsed_s(self) -> float:
        return (self._clock.now_ns() - self._start_ns) * 1e-9

    def _play(self) -> set[str]:
        """Let faults happen that happen once; raise those that raise; return the others."""
        now = self._elapsed_s()
        active = set()
        for fault in self._faults:
            if fault in self._done or now < fault.at_s:
                continue
            over = now >= fault.at_s + fault.for_s
            if fault.kind == 'stall':
                self._clock.sleep(max(fault.at_s + fault.for_s - now, 0.0))
                over = True
            elif fault.kind == 'brown_out' or (fault.kind == 'unplugged' and over):
                self._bus.chip.power_up(self._clock.now_ns())
                over = True
            elif not over:
                active.add(fault.kind)
                over = fault.kind == 'bit_error'
            if over:
                self._done.add(fault)
        for kind in sorted(active & set(_ERRORS)):
            if kind not in _OPEN or self._bus.acknowledges:
                error, text = _ERRORS[kind]
                raise error(f'{self.name}: {text}')
        return active


class FaultyFrames(FaultyBus):
    """A FrameBus around an emulated one that plays faults."""

    def transfer(self, frame: bytes) -> bytes:
        """Return what the chip answers, or what the fault makes of it."""
        kinds = self._play()
        if not kinds.isdisjoint(_OPEN):
            return b'\xff' * len(frame)
        self._bus.chip.foreign = 'wrong_identity' in kinds
        return self._disturbed(bytes(self._bus.transfer(frame)), kinds)


class FaultyBoard(FaultyBus):
    """A DaqBoard around an emulated one that plays faults."""

    def __getattr__(self, name: str) -> Any:
        """Return a method of the board that plays faults before it does its work."""
        method = getattr(self._bus, name)

        def played(*arguments: object) -> Any:
            self._play()
            return method(*arguments)

        return played


def _around(bus: Any) -> type[FaultyBus]:
    if hasattr(bus, 'scan'):
        return FaultyBoard
    return FaultyFrames if hasattr(bus, 'transfer') else FaultyBus


def wrap(
    buses: Mapping[str, Any],
    driver: type[Driver],
    clock: Clock,
    faults: Iterable[Fault] = (),
    seed: int = 0,
) -> dict[str, Any]:
    """Return the buses of a sensor with the same faults on each of its dies."""
    planned = list(faults)
    return {
        part: _around(bus)(
            bus,
            clock,
            planned,
            [i.register.address for i in driver.identities if i.register.part == part],
            seed,
        )
        for part, bus in buses.items()
    }
