# SPDX-License-Identifier: Apache-2.0
"""
A chip's registers seen from the wire: the declared map run backwards.

What is common to all chips with registers is here; a chip's own file adds what it does.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce
from operator import and_
from typing import Any

from imu_bench.emulators.line import Line
from imu_bench.errors import NoAnswer
from imu_bench.registers import Channel, Field, Register, Value
import numpy as np


def or_zero(values: np.ndarray | None, shape: tuple[int, ...]) -> np.ndarray:
    """Return what a source has of a quantity, or zeros: registers always show something."""
    return np.zeros(shape) if values is None else values


def numbers(*registers: Register) -> frozenset[int]:
    """Return the number of every byte of some registers."""
    return frozenset(register.number + k for register in registers for k in range(register.size))


class RegisterMemory:
    """The bytes of one die."""

    def __init__(self, registers: Iterable[Register]) -> None:
        self._registers = tuple(registers)
        self._owner = {
            register.number + k: register
            for register in self._registers
            for k in range(register.size)
        }
        self._plain = frozenset(
            number
            for number, register in self._owner.items()
            if register.access != 'wo' and not register.clear_on_read
        )
        self._bytes: dict[int, int] = {}
        self.reset()

    def reset(self) -> None:
        """Give every register its value after power-up."""
        self.fifo_stuck = False
        for register in self._registers:
            self.set(register, register.reset or 0)

    def owner(self, number: int) -> Register | None:
        """Return the register that a byte belongs to."""
        return self._owner.get(number)

    def read(self, number: int) -> int:
        """Return a byte as the wire sees it; a register that empties on read is emptied."""
        if number in self._plain:
            return self._bytes[number]
        register = self._owner.get(number)
        if register is None or register.access == 'wo':
            return 0
        byte = self._bytes[number]
        if register.clear_on_read:
            self._bytes[number] = 0
        return byte

    def write(self, number: int, byte: int) -> None:
        """Take a byte from the wire; a register that is read only keeps its own."""
        register = self._owner.get(number)
        if register is not None and register.writable:
            self._bytes[number] = byte

    def word(self, register: Register) -> int:
        """Return the word of a register, from inside the chip."""
        first = register.number
        if register.size == 1:
            return self._bytes[first]
        return register.unpack(bytes(self._bytes[first + k] for k in range(register.size)))

    def set(self, register: Register, word: int) -> None:
        """Set the word of a register, from inside the chip."""
        if register.size == 1:
            self._bytes[register.number] = word
        else:
            self.fill(register, register.pack(word))

    def fill(self, register: Register, data: bytes, start: int = 0) -> None:
        """Set the bytes of a register, from inside the chip; the first ones, or from `start`."""
        first = register.number + start
        self._bytes.update(zip(range(first, first + len(data)), data, strict=True))

    def code(self, field: Field) -> int:
        """Return the code in a field, from inside the chip."""
        return (self.word(field.register) & field.mask) >> field.low

    def value(self, field: Field) -> Value:
        """Return the value of a field, from inside the chip."""
        return field.decode(self.code(field))

    def put(self, field: Field, code: int) -> None:
        """Set the code of a field, from inside the chip."""
        word = self.word(field.register) & ~field.mask | code << field.low
        self.set(field.register, word)

    def quantise(self, channel: Channel, si: Any, trim: Any = 1.0) -> Any:
        """Return the words of a channel for SI values at the range the registers are set to."""
        range_ = self.value(channel.scaled_by) if channel.scaled_by is not None else None
        return channel.encode(si, range_, trim)


class EmulatedChip:
    """
    One die: registers that answer, and hooks for what the chip does.

    A chip overrides `advance` to make samples, `written` to react to settings, `reading` to
    refresh what is about to be read.  `ports` are the registers that do not increment, `quiet`
    those where a burst starts that time does not change, `made` those that are made when they
    are read, `watched` those of which the chip notices that they were.
    """

    ports: frozenset[int] = frozenset()
    quiet: frozenset[int] = frozenset()
    made: frozenset[int] = frozenset()
    watched: frozenset[int] = frozenset()

    def __init__(self, registers: Iterable[Register]) -> None:
        self.memory = RegisterMemory(registers)

    def power_up(self, at_ns: int) -> None:
        """Begin at the reset values."""
        self.memory.reset()

    def answers(self, at_ns: int) -> bool:
        """Return whether the chip acknowledges its address."""
        return True

    def takes_silently(self, number: int, at_ns: int) -> bool:
        """Return whether what was just written took effect without an acknowledge."""
        return False

    def advance(self, to_ns: int) -> None:
        """Let the chip live until a time."""

    def about_to_change(self) -> None:
        """Prepare for another setting."""

    def decode_address(self, first: int) -> tuple[int, bool]:
        """Return the register number of an address byte, and whether it increments."""
        return first, True

    def following(self, number: int) -> int:
        """Return the register with which a burst goes on."""
        return number + 1

    def reading(self, number: int, at_ns: int) -> None:
        """Prepare a byte that is about to be read, of those in `made`."""

    def was_read(self, number: int, at_ns: int) -> None:
        """React to a byte that was read, of those in `watched`."""

    def written(self, register: Register, at_ns: int) -> None:
        """React to a register that was written."""

    def read_port(self, number: int, length: int, at_ns: int, byte_ns: float) -> bytes:
        """Return bytes from a register that does not increment."""
        return bytes(self.memory.read(number) for _ in range(length))

    def read(self, first: int, length: int, at_ns: int, byte_ns: float) -> bytes:
        """Return what the chip drives onto the wire."""
        number, increments = self.decode_address(first)
        if number not in self.quiet:
            self.advance(at_ns)
        out = bytearray()
        for _ in range(length):
            if number in self.ports:
                out += self.read_port(number, length - len(out), at_ns, byte_ns)
                break
            if number in self.made:
                self.reading(number, at_ns)
            out.append(self.memory.read(number))
            if number in self.watched:
                self.was_read(number, at_ns)
            number = self.following(number) if increments else number
        return bytes(out)

    def write(self, first: int, data: bytes, at_ns: int) -> None:
        """Take what the wire brings."""
        self.advance(at_ns)
        self.about_to_change()
        number, increments = self.decode_address(first)
        for byte in data:
            self.memory.write(number, byte)
            register = self.memory.owner(number)
            if register is not None and register.writable:
                self.written(register, at_ns)
            number = self.following(number) if increments else number


class EmulatedBus:
    """
    A RegisterBus on which an emulated chip lives.

    Chips at the same address of one I²C wire all do what is asked of any, and answer at once: a
    line is low while anybody pulls it down (NXP UM10204 rev. 7, section 3.1.1).
    """

    def __init__(
        self,
        name: str,
        line: Line,
        chip: EmulatedChip,
        increment: int = 0,
        *,
        acknowledges: bool = True,
        stretch_s: float = 0.0,
        address: int | None = None,
    ) -> None:
        self.name = name  # for error texts and diagnostics; says that it is emulated
        self.line = line  # shared by the chips on one wire
        self.chip = chip
        # I²C notices that nobody is there; SPI reads ones from an open line
        self.acknowledges = acknowledges
        self._increment = increment
        self._stretch_ns = stretch_s * 1e9
        self._here = [] if address is None else line.wire.chips_at(address)
        self._here.append(chip)

    def read(self, register: int, length: int) -> bytes:
        """Return `length` bytes from `register` on, in one transaction."""
        first = register | self._increment if length > 1 else register

        def answer(at_ns: int, byte_ns: float) -> bytes:
            heard = [
                chip.read(first, length, at_ns, byte_ns) for chip in self._answering(at_ns)
            ] or [b'\xff' * length]
            if len(heard) == 1:
                return heard[0]
            return bytes(reduce(and_, together) for together in zip(*heard, strict=True))

        return self.line.read(length, answer, self._stretch_ns)

    def write(self, register: int, data: bytes) -> None:
        """Write bytes from `register` on, in one transaction."""
        first = register | self._increment if len(data) > 1 else register

        def answer(at_ns: int, byte_ns: float) -> None:
            number, _ = self.chip.decode_address(first)
            silent = self.acknowledges
            for chip in self._answering(at_ns):
                chip.write(first, data, at_ns)
                silent = silent and chip.takes_silently(number, at_ns)
            if silent:
                raise self._silence()

        self.line.write(len(data), answer, self._stretch_ns)

    def close(self) -> None:
        """Take the chip off the wire; who opens this sensor again gets another one."""
        with self.line.wire.lock:
            if self.chip in self._here:
                self._here.remove(self.chip)
            self._here = [self.chip]

    def _answering(self, at_ns: int) -> list[EmulatedChip]:
        answering = [chip for chip in self._here if chip.answers(at_ns)]
        if self.acknowledges and not answering:
            raise self._silence()
        return answering

    def _silence(self) -> NoAnswer:
        return NoAnswer(f'{self.name}: nothing answers; check power, wiring and address')
