# SPDX-License-Identifier: Apache-2.0
"""Registers, their fields and the code tables of the fields."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
import math
from typing import Any

from imu_bench.errors import ConfigError
import numpy as np

Value = float | str | bool
"""What a field means in the document: a number in the field's unit, a word, or a flag."""


class Declaration:
    """Anything that gets its name from the class attribute it is assigned to."""

    name: str = ''

    def __set_name__(self, owner: type, name: str) -> None:
        object.__setattr__(self, 'name', name)

    def __set__(self, instance: object, value: object) -> None:
        raise AttributeError(
            f'{self.name} is a declaration; write the chip with registers.write({{...}})'
        )


@dataclass(frozen=True, eq=False)
class Register(Declaration):
    """One register, or a run of data registers that is read in one burst."""

    address: int  # as printed in the document, without read, increment or bank bits
    reset: int | None = 0  # value after power-up and reset; None where the document gives none
    access: str = 'rw'
    size: int = 1  # bytes
    # how many addresses it takes; default one per byte.  1 where a register is a 16-bit word
    # (SCL3300) or a data identifier (Xbus)
    addresses: int | None = None
    order: str = 'big'  # byte order of a register of more than one byte
    # bank or page that has to be selected first; None: visible in every bank
    bank: int | None = None
    part: str = ''  # the die on which it lives, '' for the main one; each part has its own bus
    clear_on_read: bool = False  # reading empties it

    def __post_init__(self) -> None:
        if self.access not in ('rw', 'ro', 'wo') or self.order not in ('big', 'little'):
            raise ConfigError(
                f'register 0x{self.address:02X}: access {self.access!r} must be rw, ro or wo, '
                f'order {self.order!r} must be big or little'
            )
        if self.reset is not None and not 0 <= self.reset < 1 << 8 * self.size:
            raise ConfigError(
                f'register 0x{self.address:02X}: reset value 0x{self.reset:X} does not fit '
                f'{self.size} byte(s)'
            )

    @cached_property
    def span(self) -> int:
        """Return how many addresses it takes."""
        return self.size if self.addresses is None else self.addresses

    @cached_property
    def number(self) -> int:
        """Return the register number that travels on a bus: the bank, if any, above bit 8."""
        return self.address if self.bank is None else (self.bank + 1) << 8 | self.address

    @cached_property
    def writable(self) -> bool:
        """Return whether the document lets it be written."""
        return self.access != 'ro'

    def pack(self, word: int) -> bytes:
        """Return the bytes of a word in the register's byte order."""
        return word.to_bytes(self.size, 'big' if self.order == 'big' else 'little')

    def unpack(self, data: bytes) -> int:
        """Return the word that bytes of the register make."""
        return int.from_bytes(data, 'big' if self.order == 'big' else 'little')

    def __str__(self) -> str:
        where = '' if self.bank is None else f' of bank {self.bank}'
        return f'{self.part + " " if self.part else ""}{self.name} (0x{self.address:02X}{where})'


class Codes(Mapping[Value, int]):
    """
    The code table of a field: value in the document's unit to code, one to one.

    A second code with the same meaning is an alias; it is declared with its value and the
    reason, is understood when read, and is never written.

    Examples
    --------
    >>> gyro_range = Codes({250: 0, 500: 1}, aliases={3: (500, 'printed twice in table 7')})
    >>> gyro_range[500], gyro_range.value(3)
    (1, 500)
    """

    def __init__(
        self,
        codes: Mapping[Any, int],
        *,
        aliases: Mapping[int, tuple[Value, str]] | None = None,
    ) -> None:
        self._codes: dict[Value, int] = dict(codes)
        self._values: dict[int, Value] = {}
        for value, code in self._codes.items():
            if code in self._values:
                raise ConfigError(
                    f'code {code:#x} stands for both {self._values[code]!r} and {value!r}; '
                    'declare a real alias with aliases={code: (value, reason)}'
                )
            self._values[code] = value
        self.aliases = dict(aliases or {})
        for code, (value, reason) in self.aliases.items():
            if code in self._values or value not in self._codes or not reason:
                raise ConfigError(
                    f'alias {code:#x} of {value!r} needs a code of its own, a declared value '
                    'and a reason'
                )
            self._values[code] = value

    def __getitem__(self, value: Value) -> int:
        return self._codes[value]

    def __iter__(self) -> Iterator[Value]:
        return iter(self._codes)

    def __len__(self) -> int:
        return len(self._codes)

    def value(self, code: int) -> Value:
        """Return the meaning of a code; KeyError if the document gives it none."""
        return self._values[code]

    @property
    def all_codes(self) -> tuple[int, ...]:
        """Return every code with a meaning, aliases included."""
        return tuple(self._values)

    def find(self, value: object) -> Value:
        """
        Return the declared value equal to `value`; KeyError if there is none.

        A float is allowed its rounding (1000/3 may be written 333.33333), never a neighbour.
        """
        kind = type(value)
        for known in self._codes:
            if isinstance(known, (bool, str)) or kind in (bool, str):
                if type(known) is kind and known == value:
                    return known
            elif isinstance(value, (int, float)) and math.isclose(known, value, rel_tol=1e-6):
                return known
        raise KeyError(value)


def describe(allowed: Mapping[Value, int] | tuple[Value, ...], unit: str = '') -> str:
    """Return allowed values as text for errors, parameter descriptors and tables."""
    values = list(allowed)
    if len(values) > 16 and not isinstance(values[0], str):
        values = sorted(values)
        head, tail = (', '.join(f'{v:g}' for v in part) for part in (values[:3], values[-3:]))
        text = f'{head}, … {tail} ({len(values)} values)'
    else:
        text = ', '.join(v if isinstance(v, str) else f'{v:g}' for v in values)
    return f'{text} {unit}'.rstrip()


@dataclass(frozen=True, eq=False)
class Field(Declaration):
    """Some bits of a register and what they mean."""

    register: Register
    bits: int | tuple[int, int]  # as the document prints them: one bit, or (highest, lowest)
    codes: Codes | None = None  # without a table the value is the code itself
    unit: str = ''  # unit of the values in the table
    # the chip changes it by itself; it is not compared after configuration
    self_clearing: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.low <= self.high < 8 * self.register.size:
            raise ConfigError(
                f'bits {self.bits} do not fit register 0x{self.register.address:02X} '
                f'of {self.register.size} byte(s)'
            )
        for code in self.codes.all_codes if self.codes else ():
            if not 0 <= code < 1 << self.width:
                raise ConfigError(
                    f'code {code:#x} does not fit bits {self.bits} of register '
                    f'0x{self.register.address:02X}'
                )

    @cached_property
    def high(self) -> int:
        """Return the highest bit."""
        return self.bits if isinstance(self.bits, int) else self.bits[0]

    @cached_property
    def low(self) -> int:
        """Return the lowest bit."""
        return self.bits if isinstance(self.bits, int) else self.bits[1]

    @cached_property
    def width(self) -> int:
        """Return the number of bits."""
        return self.high - self.low + 1

    @cached_property
    def mask(self) -> int:
        """Return the bits of the field within the register's word."""
        return ((1 << self.width) - 1) << self.low

    @property
    def allowed(self) -> tuple[Value, ...]:
        """Return every value that may be written."""
        return tuple(self.codes) if self.codes else tuple(range(1 << self.width))

    def encode(self, value: object) -> int:
        """
        Return the code of a value.

        Raises
        ------
        ConfigError
            If the value is not one of the table; nothing is ever rounded to a neighbour.
        """
        if self.codes is not None:
            try:
                return self.codes[self.codes.find(value)]
            except KeyError:
                raise ConfigError(
                    f'{self}: {value!r} is not possible; allowed are '
                    f'{describe(self.codes, self.unit)}'
                ) from None
        if not isinstance(value, (int, np.integer)) or not 0 <= value < 1 << self.width:
            raise ConfigError(
                f'{self}: {value!r} is not possible; allowed are 0 to {(1 << self.width) - 1}'
            )
        return int(value)

    def decode(self, code: int) -> Value:
        """
        Return the value of a code.

        Raises
        ------
        ConfigError
            If the document gives the code no meaning.
        """
        if self.codes is None:
            return code
        try:
            return self.codes.value(code)
        except KeyError:
            raise ConfigError(f'{self}: code {code:#x} has no meaning in the document') from None

    def insert(self, word: int, value: object) -> int:
        """Return a register's word with this field set to a value."""
        return word & ~self.mask | self.encode(value) << self.low

    def extract(self, word: int) -> Value:
        """Return this field's value from a register's word."""
        return self.decode((word & self.mask) >> self.low)

    def __str__(self) -> str:
        return f'{self.name} in register {self.register}'
