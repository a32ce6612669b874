# SPDX-License-Identifier: Apache-2.0
"""Every constant of a driver, changed one at a time in this process."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from importlib import import_module
from itertools import pairwise
from typing import Any, NamedTuple

from imu_bench.drivers.driver import Driver
from imu_bench.registers import Channel, Codes, Field, Register, Wait, Write

WRONG = 1.01
"""By so much scales are changed; sources differ by up to 0.5 % where they round."""


class Mutant(NamedTuple):
    """
    One changed constant: what, and a context in which it is changed.

    Of what is changed, `declares` and `attribute` say where it stands; None if that is not known.
    """

    kind: str
    what: str
    change: Callable[[], Any]
    declares: Any = None
    attribute: str = ''


# --- changing what is declared -----------------------------------------------------------
def forget(declaration: Any) -> None:
    """Throw away what was calculated from attributes."""
    for owner in type(declaration).__mro__:
        for name, item in vars(owner).items():
            if isinstance(item, cached_property):
                vars(declaration).pop(name, None)


def _mutant(kind: str, what: str, declaration: Any, name: str, value: Any) -> Mutant:
    @contextmanager
    def changed() -> Iterator[None]:
        before = getattr(declaration, name)
        object.__setattr__(declaration, name, value)
        forget(declaration)
        try:
            yield
        finally:
            object.__setattr__(declaration, name, before)
            forget(declaration)

    return Mutant(kind, what, changed, declaration, name)


def _items(table: dict[Any, Any], key: Any, value: Any) -> Callable[[], Any]:
    @contextmanager
    def changed() -> Iterator[None]:
        before, table[key] = table[key], value
        try:
            yield
        finally:
            table[key] = before

    return changed


def _codes(codes: Codes, one: Any, other: Any) -> Callable[[], Any]:
    @contextmanager
    def swapped() -> Iterator[None]:
        before = dict(vars(codes))
        table = dict(codes)
        table[one], table[other] = table[other], table[one]
        vars(codes).update(vars(Codes(table, aliases=codes.aliases)))
        try:
            yield
        finally:
            vars(codes).update(before)

    return swapped


# --- what is changed ---------------------------------------------------------------------
def mutants(driver: type[Driver]) -> Iterator[Mutant]:
    """Yield every mutant of a driver."""
    for name, register in driver.declared(Register).items():
        yield from _of_register(name, register)
    yield from _of_identities(driver)
    for name, field in driver.declared(Field).items():
        yield from _of_field(name, field)
    for channel in driver.declared(Channel).values():  # type: ignore[type-abstract]
        yield from _of_channel(channel)
    for name, steps in driver.sequences().items():
        for number, step in enumerate(steps):
            yield from _of_step(f'{name}[{number}]', step)
    codes = [dict(field.codes or {}).items() for field in driver.declared(Field).values()]
    for name, table in vars(import_module(driver.__module__)).items():
        # what codes were made from is changed with the codes
        made = isinstance(table, dict) and any(table.items() <= items for items in codes)
        if name.isupper() and isinstance(table, dict) and not made:
            numbers = {key: value for key, value in table.items() if type(value) in (int, float)}
            for key, value in numbers.items():
                yield Mutant('table', f'{name}[{key!r}]', _items(table, key, value + 1))


def _of_identities(driver: type[Driver]) -> Iterator[Mutant]:
    for identity in driver.identities:
        for table in (identity.expected, identity.others):
            for word in table:
                what = f'identity {word:#x} in {identity.register.name}'
                change = _renamed(table, word, word ^ 0x04)  # type: ignore[arg-type]
                yield Mutant('identity', what, change, identity, 'expected')


def _renamed(table: dict[Any, Any], before: Any, after: Any) -> Callable[[], Any]:
    @contextmanager
    def changed() -> Iterator[None]:
        kept = dict(table)
        table[after] = table.pop(before)
        try:
            yield
        finally:
            table.clear()
            table.update(kept)

    return changed


def _of_register(name: str, register: Register) -> Iterator[Mutant]:
    what = f'register {name}'
    yield _mutant('address', what, register, 'address', register.address ^ 0x01)
    if register.bank is not None:
        yield _mutant('bank', what, register, 'bank', register.bank ^ 1)
    if register.reset:
        yield _mutant('reset', f'reset of {name}', register, 'reset', 0)
    if register.size > 1:
        order = 'little' if register.order == 'big' else 'big'
        yield _mutant('order', f'order of {name}', register, 'order', order)
    if register.clear_on_read:
        yield _mutant('access', f'{name} emptied', register, 'clear_on_read', False)


def _of_field(name: str, field: Field) -> Iterator[Mutant]:
    step = 1 if field.high + 1 < 8 * field.register.size else -1
    if field.low + step >= 0:
        bits = field.high + step, field.low + step
        yield _mutant('bits', f'bits of {name}', field, 'bits', bits)
    values = list(field.codes or ())
    rule = len(values) > 200
    for one, other in pairwise(values[:2] if rule else values):
        what = f'codes of {name}' if rule else f'code of {name} {_key(one)}'
        change = _codes(field.codes, one, other)  # type: ignore[arg-type]
        yield Mutant('codes', what, change, field, 'codes')


def _of_channel(channel: Channel) -> Iterator[Mutant]:
    name, scale = channel.name, channel.si_per_lsb

    def scaled(value: Any) -> Any:
        return tuple(WRONG * v for v in value) if isinstance(value, tuple) else WRONG * value

    if isinstance(scale, dict):
        for range_, value in scale.items():
            yield _mutant(
                'scale',
                f'scale of {name} at {_key(range_)}',
                channel,
                'si_per_lsb',
                {**scale, range_: scaled(value)},
            )
    else:
        yield _mutant('scale', f'scale of {name}', channel, 'si_per_lsb', scaled(scale))
    if channel.offset:
        yield _mutant('offset', f'offset of {name}', channel, 'offset', channel.offset + 1)
    if channel.dtype[0] in '<>':
        other = {'<': '>', '>': '<'}[channel.dtype[0]] + channel.dtype[1:]
        yield _mutant('order', f'words of {name}', channel, 'dtype', other)
    if channel.shift:
        yield _mutant('shift', f'shift of {name}', channel, 'shift', channel.shift - 1)
    if isinstance(channel.limits, tuple):
        low, high = channel.limits
        yield _mutant('limits', f'limits of {name}', channel, 'limits', (low + 1, high - 1))
    if hasattr(channel, 'axes'):
        x, y, z = channel.axes
        turned = (tuple(-k for k in x), tuple(-k for k in y), z)
        yield _mutant('axes', f'axes of {name}', channel, 'axes', turned)


def _of_step(where: str, step: Any) -> Iterator[Mutant]:
    if isinstance(step, Wait):
        yield _mutant('wait', f'{where} {step.seconds:g} s', step, 'seconds', 0.0)
    elif isinstance(step, Write):
        for target, value in step.values.items():
            other = _other_value(target, value)
            if other is not None:
                what = f'{where} {target.name} {value!r} -> {other!r}'
                change = _items(step.values, target, other)  # type: ignore[arg-type]
                yield Mutant('write', what, change, step, 'values')
    else:
        yield _mutant('until', f'{where}', step, 'timeout_s', 0.0)


def _other_value(target: Any, value: Any) -> Any:
    if isinstance(target, Register):
        return int(value) ^ 0x01
    others = [one for one in target.allowed if one != value]
    return others[0] if others else None


def _key(value: object) -> str:
    return str(value).lower() if isinstance(value, (bool, str)) else f'{value:g}'
