# SPDX-License-Identifier: Apache-2.0
"""A chip's whole map, checked when its class is created, and what else its document says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any, TypeVar

from imu_bench.errors import ConfigError
from imu_bench.registers.channels import Channel
from imu_bench.registers.fields import Field, Register, Value
from imu_bench.registers.fifo import Fifo

_T = TypeVar('_T')

Assignments = Mapping[Any, Value]
"""Values by the Field they are written to, or whole words by their Register."""


@dataclass(frozen=True, eq=False)
class Write:
    """
    Assign values to fields, or whole words to registers.

    Fields of one register become one transaction; registers are written in the order in
    which they first appear.
    """

    values: Assignments

    def by_register(self) -> dict[Register, dict[Field | Register, Value]]:
        """Return the assignments grouped by register, in the order of the first mention."""
        grouped: dict[Register, dict[Field | Register, Value]] = {}
        for target, value in self.values.items():
            register = target if isinstance(target, Register) else target.register
            grouped.setdefault(register, {})[target] = value
        return grouped


@dataclass(frozen=True)
class Wait:
    """Let the chip have the time its document asks for."""

    seconds: float
    reason: str = ''


@dataclass(frozen=True, eq=False)
class Until:
    """
    Read a field again and again until it has a value; an error after `timeout_s`.

    A chip that does not answer meanwhile is given that time too: it may be starting.
    """

    field: Field
    value: Value
    timeout_s: float
    period_s: float = 1e-3


Sequence = tuple[Write | Wait | Until, ...]
"""What has to be done in this order."""


class RegisterMap:
    """
    Base of every class that declares a chip; a wrong declaration is refused at once.

    Raises
    ------
    ConfigError
        While the subclass is being created: registers or fields that overlap, fields of a
        register that is not declared, sequences that write what cannot be written.
    """

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        try:
            _check_registers(cls)
            _check_fields(cls)
            _check_fifos(cls)
            _check_sequences(cls)
        except ConfigError as error:
            raise ConfigError(f'{cls.__name__}: {error}') from None

    @classmethod
    def declared(cls, kind: type[_T]) -> dict[str, _T]:
        """Return the declarations of a kind by name, bases first."""
        return {
            name: value
            for base in reversed(cls.__mro__)
            for name, value in vars(base).items()
            if isinstance(value, kind)
        }

    @classmethod
    def channels(cls) -> dict[str, Channel]:
        """Return the declared channels by name."""
        return cls.declared(Channel)  # type: ignore[type-abstract]  # only asked for, never made

    @classmethod
    def sequences(cls) -> dict[str, Sequence]:
        """Return the declared sequences by name."""
        return {
            name: steps
            for name, steps in cls.declared(tuple).items()
            if steps and all(isinstance(step, (Write, Wait, Until)) for step in steps)
        }

    @classmethod
    def fields_of(cls, register: Register) -> tuple[Field, ...]:
        """Return the fields of a register."""
        return tuple(f for f in cls.declared(Field).values() if f.register is register)


def _check_registers(owner: type[RegisterMap]) -> None:
    for one, other in combinations(owner.declared(Register).values(), 2):
        same_place = one.part == other.part and (
            one.bank == other.bank or one.bank is None or other.bank is None
        )
        if same_place and (
            one.address < other.address + other.span and other.address < one.address + one.span
        ):
            raise ConfigError(f'registers {one} and {other} overlap')


def _check_fields(owner: type[RegisterMap]) -> None:
    registers = set(owner.declared(Register).values())
    fields = owner.declared(Field).values()
    for one in fields:
        if one.register not in registers:
            raise ConfigError(f'{one.name} lies in a register that the map does not declare')
    for channel in owner.channels().values():
        if channel.first not in registers:
            raise ConfigError(f'{channel.name} lies in a register that the map does not declare')
    for one, other in combinations(fields, 2):
        if one.register is other.register and one.mask & other.mask:
            raise ConfigError(f'fields {one.name} and {other.name} of {one.register} overlap')


def _check_fifos(owner: type[RegisterMap]) -> None:
    registers = set(owner.declared(Register).values())
    for fifo in owner.declared(Fifo).values():
        fields = (fifo.overrun, fifo.rate, fifo.runs[0])
        if not {fifo.port, fifo.count, *(field.register for field in fields)} <= registers:
            raise ConfigError(f'{fifo.name} needs a register that the map does not declare')
        if len(fifo.marks) not in (0, fifo.frame.size) or fifo.frame.size % fifo.units:
            raise ConfigError(
                f'{fifo.name}: {len(fifo.marks)} bytes of marks and {fifo.units} units must fit '
                f'a frame of {fifo.frame.size} bytes'
            )
        check_value(*fifo.runs)


def _check_sequences(owner: type[RegisterMap]) -> None:
    for name, steps in owner.sequences().items():
        for step in steps:
            for target, value in step.values.items() if isinstance(step, Write) else ():
                register = target if isinstance(target, Register) else target.register
                if not register.writable:
                    raise ConfigError(f'sequence {name} writes {register}, which is read only')
                check_value(target, value)


def check_value(target: Field | Register, value: Value) -> None:
    """
    Refuse a value that cannot be written to a field or register.

    Raises
    ------
    ConfigError
        With the allowed values.
    """
    if isinstance(target, Field):
        target.encode(value)
    elif not isinstance(value, int) or not 0 <= value < 1 << 8 * target.size:
        raise ConfigError(
            f'{target}: {value!r} is not possible; allowed are 0 to {(1 << 8 * target.size) - 1}'
        )


@dataclass(frozen=True)
class Identity:
    """A register that says what the chip is."""

    register: Register
    expected: Mapping[int, str]
    # known relatives that this driver refuses, with what to know about them
    others: Mapping[int, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Typical:
    """
    Typical values of the document for one quantity, in SI; None where it gives none.

    Simulator defaults, and the yardstick of a comparison with the datasheet.
    """

    source: str  # document and table
    # one-sided, SI/√Hz; per axis (x, y, z) where they differ
    noise_density: float | tuple[float, float, float] | None = None
    bandwidth: float | None = None  # Hz, at the default settings
    high_pass: float | None = None  # Hz; a sensor that does not show constant values
    # range, resolution: at the default settings
    range: float | None = None
    resolution: float | None = None
    # bias, bias_per_kelvin: zero offset (the document's ± figure) and its change with temperature
    bias: float | tuple[float, float, float] | None = None
    bias_per_kelvin: float | None = None
    bias_instability: float | None = None
    # scale_error, scale_per_kelvin, nonlinearity, cross_axis: relative
    scale_error: float | None = None
    scale_per_kelvin: float | None = None
    nonlinearity: float | None = None
    cross_axis: float | None = None


@dataclass(frozen=True)
class Witness:
    """
    Bytes on the wire and what they mean, from a document or calculated by hand.

    It never comes from the channel it testifies for, so a mistake there cannot prove itself.
    """

    channel: Channel
    data: str  # hexadecimal, as they come over the wire
    expected: tuple[float, ...]  # SI, in the body frame
    source: str
    range: Value | None = None
    trim: float | tuple[float, ...] = 1.0
