# SPDX-License-Identifier: Apache-2.0
"""Declared registers and fields, read and written over a bus."""

from __future__ import annotations

from collections.abc import Mapping

from imu_bench.bus.interface import Clock, RegisterBus
from imu_bench.errors import BusError, ConfigError, NotReady
from imu_bench.registers import (
    Assignments,
    check_value,
    Field,
    Register,
    Sequence,
    Until,
    Value,
    Wait,
    Write,
)


class Registers:
    """
    A chip's registers by their declarations.

    Every method is one transaction per register, or says so; nothing is cached, so what is
    read is what the chip holds.

    Parameters
    ----------
    buses : mapping of part name to RegisterBus
        The main die is ''.
    clock : Clock
    """

    def __init__(self, buses: Mapping[str, RegisterBus], clock: Clock) -> None:
        self._buses = buses
        self._clock = clock

    @property
    def parts(self) -> tuple[str, ...]:
        """The dies that can be reached."""
        return tuple(self._buses)

    def where(self, register: Register) -> str:
        """Return the name of the bus on which a register is."""
        return self._bus(register).name

    def burst(self, register: Register, length: int | None = None) -> bytes:
        """Return bytes from a register on; its own size unless a length is given."""
        if register.access == 'wo':
            raise ConfigError(f'{register} is write only')
        return self._bus(register).read(register.number, length or register.size)

    def bytewise(self, register: Register) -> bytes:
        """Return the bytes of a register, each in a transaction of its own."""
        bus = self._bus(register)
        return b''.join(bus.read(register.number + k, 1) for k in range(register.size))

    def word(self, register: Register) -> int:
        """Return the word a register holds."""
        return register.unpack(self.burst(register))

    def read(self, field: Field) -> Value:
        """Return the value of a field."""
        return field.extract(self.word(field.register))

    def write(self, values: Assignments) -> None:
        """
        Write fields and whole registers; fields of one register in one transaction.

        Bits that belong to none of the fields given keep what the chip holds, because
        documents ask for reserved bits to be left alone.

        Raises
        ------
        ConfigError
            If a register is read only or a value is not allowed; nothing is written then.
        """
        planned = [
            (register, self._base(register, group), group)
            for register, group in Write(values).by_register().items()
        ]
        for register, base, group in planned:
            word = self.word(register) if base is None else base
            for target, value in group.items():
                word = target.insert(word, value) if isinstance(target, Field) else int(value)
            self._bus(register).write(register.number, register.pack(word))

    def verify(self, values: Assignments) -> None:
        """
        Read back what was written and compare.

        Raises
        ------
        BusError
            Naming register, what was written and what it holds.
        """
        if difference := self.difference(values):
            raise BusError(f'{difference}; check wiring and supply, then configure again')

    def difference(self, values: Assignments) -> str:
        """Return the first register that does not hold its values, '' if all do."""
        for register, group in Write(values).by_register().items():
            if register.access == 'wo':
                continue
            held = self.word(register)
            for target, value in group.items():
                if isinstance(target, Field):
                    # bits the chip clears by itself say nothing
                    same = target.self_clearing or target.insert(held, value) == held
                else:
                    same = held == value
                if not same:
                    return (
                        f'{self._bus(register).name}: {target} was set to {value!r}, but the '
                        f'register holds 0x{held:02X}'
                    )
        return ''

    def run(self, steps: Sequence) -> None:
        """
        Do a declared sequence.

        Raises
        ------
        NotReady
            If a field does not reach its value in time.
        """
        for step in steps:
            if isinstance(step, Write):
                self.write(step.values)
            elif isinstance(step, Wait):
                self._clock.sleep(step.seconds)
            else:
                self._wait_for(step)

    def _wait_for(self, step: Until) -> None:
        deadline = self._clock.now_ns() + round(step.timeout_s * 1e9)
        while (found := self.read(step.field)) != step.value:
            if self._clock.now_ns() >= deadline:
                raise NotReady(
                    f'{self._bus(step.field.register).name}: {step.field} is {found!r} after '
                    f'{step.timeout_s:g} s instead of {step.value!r}'
                )
            self._clock.sleep(step.period_s)

    def _bus(self, register: Register) -> RegisterBus:
        return self._buses[register.part]

    @staticmethod
    def _base(register: Register, group: Assignments) -> int | None:
        """Return the word to start from, or None if the chip has to be asked."""
        if not register.writable:
            raise ConfigError(f'{register} is read only')
        covered = 0
        for target, value in group.items():
            check_value(target, value)
            covered |= target.mask if isinstance(target, Field) else (1 << 8 * register.size) - 1
        if covered == (1 << 8 * register.size) - 1 or register.access == 'wo':
            return register.reset or 0
        return None
