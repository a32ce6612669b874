# SPDX-License-Identifier: Apache-2.0
"""What goes wrong on a desk, on purpose and at a given time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
import math
from typing import Any

from imu_bench.bus.interface import Clock, LINES
from imu_bench.config.faults import Fault, KINDS, ONCE, ONLY_ON
from imu_bench.drivers.driver import BurstDriver, Driver
from imu_bench.errors import BusBusy, BusError, NoAnswer, PermissionDenied
from imu_bench.registers import Field, Wait, Write
import numpy as np

BUSY_EVERY = 10
STRETCH_S = 0.035
"""So long a clock may be held low: SMBus 3.1, T_TIMEOUT is 25 ms to 35 ms."""

_SILENT = 'nothing answers; check power, wiring and address'
_OPEN = {'no_answer', 'unplugged'}
_REPLUGGED = {'unplugged', 'wrong_identity'}
_SUDDEN = {'brown_out', 'stuck_fifo'}
_FLIPS = {'bit_error', 'bit_errors'}
_ERRORS: dict[str, tuple[type[BusError], str]] = {
    'permission_denied': (PermissionDenied, 'this user may not open it'),
    'stuck': (BusBusy, 'a line is stuck; check pull-ups and power'),
    'stretched': (
        BusBusy,
        f'the clock was stretched for more than {STRETCH_S * 1e3:g} ms; lower the speed',
    ),
    **dict.fromkeys(_OPEN, (NoAnswer, _SILENT)),
}


class FaultyWire:
    """What is common to every kind of wire that plays faults."""

    def __init__(
        self,
        bus: Any,
        clock: Clock,
        faults: Iterable[Fault] = (),
        identity: Iterable[int] = (),
        seed: int = 0,
        start_ns: int | None = None,
    ) -> None:
        self.name = bus.name
        self._bus = bus
        self._clock = clock
        self._start_ns = clock.now_ns() if start_ns is None else start_ns
        self._faults = list(faults)
        self._done: set[Fault] = set()
        self._swapped: set[float] = set()
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
            elif fault.kind in _SUDDEN:
                self._happen(fault)
            else:
                self._swap(fault, over)
                if not over:
                    active.add(fault.kind)
            if over or fault.kind in ONCE or fault.kind == 'stall':
                self._done.add(fault)
        for kind in sorted(active & set(_ERRORS)):
            if kind not in _OPEN or self._bus.acknowledges:
                if kind == 'stretched':
                    self._clock.sleep(STRETCH_S)
                error, text = _ERRORS[kind]
                raise error(f'{self.name}: {text}')
        return active

    def _happen(self, fault: Fault) -> None:
        if fault.kind == 'brown_out':
            self._power_up(fault.at_s)
        else:
            self._bus.chip.memory.fifo_stuck = True

    def _swap(self, fault: Fault, over: bool) -> None:
        """Switch on what is plugged in: another chip where there was one, or the right one."""
        if fault.kind == 'wrong_identity' and fault.at_s not in self._swapped:
            self._swapped.add(fault.at_s)
            if fault.at_s > 0.0:
                self._power_up(fault.at_s)
        if over and fault.kind in _REPLUGGED:
            self._power_up(fault.at_s + fault.for_s)

    def _power_up(self, at_s: float) -> None:
        self._bus.chip.power_up(self._start_ns + round(at_s * 1e9))


@dataclass(frozen=True)
class StartUp:
    """How long a chip takes to start by its document."""

    start_up_s: float = 0.0
    # writes that reset it, and the time in s that a driver gives it then
    resets: Mapping[tuple[int, int], float] = field(default_factory=dict)


def _start_up(driver: type[Driver], part: str) -> StartUp:
    """Return what the sequences of a driver say: the first write, and the wait behind it."""
    resets = {}
    for name, steps in driver.sequences().items():
        if not name.endswith('reset_steps') or len(steps) < 2:
            continue
        write, wait = steps[:2]
        if not (isinstance(write, Write) and isinstance(wait, Wait)):
            continue
        for target, value in write.values.items():
            register = target.register if isinstance(target, Field) else target
            single = isinstance(target, Field)
            bits = target.encode(value) << target.low if single else int(value)
            if register.part == part and (not single or target.self_clearing):
                resets[register.number & 0xFF, bits] = wait.seconds
    return StartUp(driver.start_up_s, resets)


class FaultyBus(FaultyWire):
    """A RegisterBus around an emulated one that plays faults."""

    def __init__(self, *arguments: Any, start_up: StartUp | None = None) -> None:
        super().__init__(*arguments)
        self._asked = 0
        self._start_up = start_up or StartUp(0.0)
        self._silent_ns = 0

    def read(self, register: int, length: int) -> bytes:
        """Return what the chip answers, or what the fault makes of it."""
        kinds = self._play()
        if self._refuses(kinds) or not kinds.isdisjoint(_OPEN):
            return b'\xff' * length
        data = self._bus.read(register, length)
        if 'wrong_identity' in kinds and register in self._identity:
            return bytes(byte ^ 0x1E for byte in data)
        return self._disturbed(data, kinds)

    def write(self, register: int, data: bytes) -> None:
        """Write, unless the fault prevents it, or takes away the acknowledge."""
        kinds = self._play()
        if self._refuses(kinds):
            return
        if kinds.isdisjoint(_OPEN):
            self._bus.write(register, data)
        if 'slow_boot' in kinds:
            self._after_reset(register, data)
        if 'executes_without_ack' in kinds:
            raise NoAnswer(f'{self.name}: {_SILENT}')

    def _refuses(self, kinds: set[str]) -> bool:
        """Return whether the chip does not hear this; where it would acknowledge, raise."""
        refused = False
        if 'busy' in kinds:
            self._asked += 1
            refused = self._asked % BUSY_EVERY == 0
        if 'slow_boot' in kinds:
            if not self._silent_ns:
                self._power_up(self._elapsed_s())
                self._be_silent(self._start_up.start_up_s)
            refused |= self._clock.now_ns() < self._silent_ns
        if refused and self._bus.acknowledges:
            raise NoAnswer(f'{self.name}: {_SILENT}')
        return refused

    def _after_reset(self, register: int, data: bytes) -> None:
        for (number, bits), seconds in self._start_up.resets.items():
            if register & 0xFF == number and data[0] & bits == bits:
                self._be_silent(seconds)

    def _be_silent(self, seconds: float) -> None:
        self._silent_ns = self._clock.now_ns() + round(2e9 * seconds)


class FaultyFrames(FaultyWire):
    """A FrameBus around an emulated one that plays faults."""

    def transfer(self, frame: bytes) -> bytes:
        """Return what the chip answers, or what the fault makes of it."""
        kinds = self._play()
        if not kinds.isdisjoint(_OPEN):
            return b'\xff' * len(frame)
        self._bus.chip.foreign = 'wrong_identity' in kinds
        return self._disturbed(bytes(self._bus.transfer(frame)), kinds)


class FaultyStream(FaultyWire):
    """A ByteStream around an emulated one that plays faults."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._awaited: set[str] = set()

    @property
    def baud(self) -> int:
        """Speed of this end of the line."""
        return int(self._bus.baud)

    @baud.setter
    def baud(self, baud: int) -> None:
        self._bus.baud = baud

    def read(self, timeout_s: float) -> bytes:
        """Return what the device sent, or what the fault makes of it."""
        kinds = self._play()
        if not kinds.isdisjoint(_OPEN):
            deadline = self._clock.now_ns() + round(timeout_s * 1e9)
            self._bus.read(0.0)
            self._clock.sleep_until(deadline)
            self._bus.read(0.0)
            return b''
        self._bus.chip.foreign = 'wrong_identity' in kinds
        data = bytes(self._bus.read(timeout_s))
        # what happens once happens to bytes, and waits for some
        kinds |= self._awaited
        self._awaited = set() if data else kinds & ONCE
        return self._torn(self._disturbed(data, kinds), kinds) if data else data

    def write(self, data: bytes) -> None:
        """Send, unless the fault prevents it."""
        if self._play().isdisjoint(_OPEN):
            self._bus.write(data)

    def _torn(self, data: bytes, kinds: set[str]) -> bytes:
        """Cut out a byte in the middle, or all from the middle of a frame to near its end."""
        middle = len(data) // 2
        if 'dropped_byte' in kinds:
            return data[:middle] + data[middle + 1 :]
        if 'half_frame' in kinds:
            return data[:middle] + data[middle + min(40, len(data) // 3 + 1) :]
        return data


class FaultyBoard(FaultyWire):
    """A DaqBoard around an emulated one that plays faults."""

    def __getattr__(self, name: str) -> Any:
        """Return a method of the board that plays faults before it does its work."""
        method = getattr(self._bus, name)

        def played(*arguments: object) -> Any:
            self._play()
            return method(*arguments)

        return played


def _around(bus: Any) -> type[FaultyWire]:
    if hasattr(bus, 'scan'):
        return FaultyBoard
    if hasattr(bus, 'baud'):
        return FaultyStream
    return FaultyFrames if hasattr(bus, 'transfer') else FaultyBus


def possible(driver: type[Driver], bus_kind: str) -> tuple[str, ...]:
    """
    Return the kinds of fault that can happen to a sensor on a kind of bus.

    Examples
    --------
    >>> from imu_bench.drivers import load
    >>> [kind for kind in KINDS if kind not in possible(load('mpu9250'), 'spi')]
    ['stretched', 'executes_without_ack', 'busy', 'dropped_byte', 'half_frame']
    """
    # a device on a serial line without registers says in a message what it is
    named = bool(driver.identities) or bus_kind == 'serial'
    return tuple(
        kind
        for kind in KINDS
        if bus_kind in ONLY_ON.get(kind, (bus_kind,))
        and (named or kind != 'wrong_identity')
        and (issubclass(driver, BurstDriver) or kind != 'stuck_fifo')
    )


def wrap(
    buses: Mapping[str, Any],
    driver: type[Driver],
    clock: Clock,
    faults: Iterable[Fault] = (),
    seed: int = 0,
    start_ns: int | None = None,
) -> dict[str, Any]:
    """
    Return the buses of a sensor with the same faults on each of its dies.

    Parameters
    ----------
    buses : mapping of str to bus
        As `imu_bench.emulators.create` makes them.
    driver : type of Driver
        Whose identity, resets and start-up time are those of the chip.
    faults : iterable of Fault
        The script.
    seed : int
        Of the noise of 'garbage'.
    start_ns : int, optional
        When the sensor was switched on, from which the faults count; now by default.
    """
    planned = list(faults)
    wires: dict[str, Any] = {}
    for part, bus in buses.items():
        if part in LINES:  # their faults are those of the chip
            wires[part] = bus
            continue
        kind = _around(bus)
        identity = [i.register.address for i in driver.identities if i.register.part == part]
        more = {'start_up': _start_up(driver, part)} if kind is FaultyBus else {}
        wires[part] = kind(bus, clock, planned, identity, seed, start_ns, **more)
    return wires
