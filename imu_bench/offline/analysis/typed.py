# SPDX-License-Identifier: Apache-2.0
"""Results as JSON documents, and whether what was read from one is what was annotated."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from itertools import repeat
from types import NoneType, UnionType
from typing import Any, cast, get_args, get_origin, get_type_hints, Union

from imu_bench.errors import RecordingError
import numpy as np


def plain(value: Any) -> Any:
    """Return a value ready for JSON: by its own `to_json`, or a dataclass by its fields."""
    if hasattr(value, 'to_json'):
        return value.to_json()
    if is_dataclass(value):
        return fields_of(value)
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {name: plain(entry) for name, entry in value.items()}
    if isinstance(value, tuple | list):
        return [plain(entry) for entry in value]
    return value


def fields_of(value: Any, but: Collection[str] = (), **named: str) -> dict[str, Any]:
    """Return the fields of a dataclass ready for JSON, but some, and some under other names."""
    return {
        named.get(field.name, field.name): plain(getattr(value, field.name))
        for field in fields(value)
        if field.name not in but
    }


def check(value: object, where: str = '') -> None:
    """Raise unless every field of a dataclass, and of those in it, has its annotated type."""
    for name, kind in _fields(cast(Any, type(value))).items():
        _check(getattr(value, name), kind, f'{where}.{name}' if where else name)


@cache
def _fields(kind: Any) -> dict[str, Any]:
    hints = get_type_hints(kind)
    return {field.name: hints[field.name] for field in fields(kind)}


def _check(value: Any, kind: Any, where: str) -> None:
    origin, parts = get_origin(kind), get_args(kind)
    if hasattr(origin, '__value__'):  # numpy 2.5 names its NDArray with PEP 695
        _check(value, origin.__value__[parts], where)
    elif origin in (Union, UnionType):  # of something and None, nothing else
        if value is not None:
            _check(value, next(part for part in parts if part is not NoneType), where)
    elif origin is np.ndarray:
        (scalar,) = get_args(parts[1])
        good = isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype == scalar
        _require(good, value, 'row of numbers', where)
    elif isinstance(origin, type):
        _check_entries(value, origin, parts, where)
    elif is_dataclass(kind):
        _require(type(value) is kind, value, kind, where)
        check(value, where)
    elif kind is not Any:
        _require(_is(value, kind), value, kind, where)


def _check_entries(value: Any, origin: type, parts: Sequence[Any], where: str) -> None:
    """Check what is in a mapping, a tuple of known or any length, or a set."""
    if issubclass(origin, Mapping):
        _require(isinstance(value, Mapping), value, 'mapping', where)
        for name, entry in value.items():
            _check(name, parts[0], where)
            _check(entry, parts[1], f'{where}.{name}')
        return
    _require(isinstance(value, origin), value, origin, where)
    one = origin is not tuple or parts[1:] == (...,)
    _require(one or len(value) == len(parts), value, f'{origin.__name__} of {len(parts)}', where)
    for entry, part in zip(value, repeat(parts[0]) if one else parts, strict=False):
        _check(entry, part, where)


def _is(value: Any, kind: Any) -> bool:
    if kind is float:
        return isinstance(value, (int, float)) and not isinstance(value, bool) and value == value
    if kind is int:
        return isinstance(value, int) and not isinstance(value, bool)
    return isinstance(value, kind)


def _require(good: bool, value: object, kind: Any, where: str) -> None:
    if not good:
        shown = repr(value)
        shown = shown if len(shown) <= _LONGEST else f'{shown[:_LONGEST]}...'
        raise RecordingError(f'{where}: {shown} is no {getattr(kind, "__name__", kind)}')


_LONGEST = 40
