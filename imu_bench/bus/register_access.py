# SPDX-License-Identifier: Apache-2.0
"""Declared registers and fields, read and written over a bus."""

from __future__ import annotations

from collections.abc import Mapping

from imu_bench.bus.interface import Clock, RegisterBus
from imu_bench.errors import BusError, ConfigError, NoAnswer, NotReady
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

CLEARED_S = 1.0
"""So long a chip is given to clear a bit that it clears by itself; ten times what any needs."""


class Registers:
    """
    A chip's registers by their declarations.

    Every method is one transaction per register, or says so; nothing is cached, so what is
    read is what the chip holds.

    Parameters
    ----------
    buses : mapping of part name to RegisterBus
        The main die is ''.
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
        """
        Return the word a register holds.

        What is not acknowledged is asked for once more, because some chips are busy now and then
        (BNO055): of a register that loses nothing by it.
        """
        try:
            return register.unpack(self.burst(register))
        except NoAnswer:
            if register.clear_on_read:
                raise
            return register.unpack(self.burst(register))

    def read(self, field: Field) -> Value:
        """Return the value of a field."""
        return field.extract(self.word(field.register))

    def write(self, values: Assignments) -> None:
        """
        Write fields and whole registers; fields of one register in one transaction.

        Bits that belong to none of the fields given keep what the chip holds, because
        documents ask for reserved bits to be left alone.

        A write may take effect and not be acknowledged: some change the interface itself, and a
        reset cuts its own acknowledge.  What can be read back is, and what was not taken is
        written once more; of a reset, the steps that follow find out whether the chip is there.

        Raises
        ------
        ConfigError
            If a register is read only or a value is not allowed; nothing is written then.
        NoAnswer
            If a write was not acknowledged and the register does not hold it.
        """
        planned = [
            (register, self._base(register, group), group)
            for register, group in Write(values).by_register().items()
        ]
        for register, base, group in planned:
            word = self.word(register) if base is None else base
            for target, value in group.items():
                word = target.insert(word, value) if isinstance(target, Field) else int(value)
            try:
                self._bus(register).write(register.number, register.pack(word))
            except NoAnswer:
                if not self._was_taken(register, word, group):
                    self._bus(register).write(register.number, register.pack(word))

    def _was_taken(self, register: Register, word: int, group: Assignments) -> bool:
        """Return whether a write that was not acknowledged may have had its effect."""
        cleared = sum(f.mask for f in group if isinstance(f, Field) and f.self_clearing)
        if register.access == 'wo' or word & cleared:
            return True
        try:
            return self.word(register) == word
        except BusError:
            return False  # nobody is there

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

    def run(self, steps: Sequence, *, until_cleared: bool = False) -> None:
        """
        Do a declared sequence.

        With `until_cleared`, for resets, a wait behind a write of bits that the chip clears by
        itself goes on until it did: a chip may be slower than its document.

        Raises
        ------
        NotReady
            If a field does not reach its value in time.
        """
        clearing: list[Field] = []
        for step in steps:
            if isinstance(step, Write):
                self.write(step.values)
                fields = [target for target in step.values if isinstance(target, Field)]
                clearing = [field for field in fields if field.self_clearing and until_cleared]
            elif isinstance(step, Wait):
                self._clock.sleep(step.seconds)
                self._wait_until_cleared(clearing)
            else:
                self._wait_for(step)

    def _wait_until_cleared(self, fields: list[Field]) -> None:
        for field in fields:
            register = field.register
            if register.access == 'wo':
                continue
            try:
                self._wait_for(Until(field, 0, CLEARED_S))
            except NotReady:
                # ones alone: nobody drives the line, as the check of the identity says better
                if self.word(register) != (1 << 8 * register.size) - 1:
                    raise

    def _wait_for(self, step: Until) -> None:
        deadline = self._clock.now_ns() + round(step.timeout_s * 1e9)
        while True:
            late = self._clock.now_ns() >= deadline
            try:
                if (found := self.read(step.field)) == step.value:
                    return
            except NoAnswer:  # a chip that starts does not answer yet
                if late:
                    raise
            else:
                if late:
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
