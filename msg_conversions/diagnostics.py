# SPDX-License-Identifier: Apache-2.0
"""diagnostic_msgs/DiagnosticArray from its bytes on the wire, where there is no ROS."""

from __future__ import annotations

import struct
from typing import NamedTuple

TYPE = 'diagnostic_msgs/msg/DiagnosticArray'

_BEGIN = 4
"""Bytes of the encapsulation, from whose end alignment counts (OMG DDS-XTypes 1.3, 7.4.3)."""

_STAMP = 8
_NS = 1_000_000_000


class Status(NamedTuple):
    """One status of an array."""

    name: str
    hardware_id: str
    values: dict[str, str]


class First(NamedTuple):
    """Who says a message, by its first status."""

    stamp_ns: int
    name: str
    hardware_id: str


def first(data: bytes) -> First:
    r"""
    Return what tells whose message a serialised DiagnosticArray is, without the rest of it.

    Raises
    ------
    ValueError
        If the message is damaged, or without a status.

    Examples
    --------
    >>> first(b'\0\1\0\0' + bytes(8) + b'\1' + bytes(7) + bytes(4))
    Traceback (most recent call last):
    ...
    ValueError: not a DiagnosticArray: without a status
    """
    reader = _Reader(data, _BEGIN)
    try:
        stamp_ns = reader.number() * _NS + reader.number()
        reader.skip_text()
        if not reader.number():
            raise ValueError('not a DiagnosticArray: without a status')
        name, hardware_id = reader.whose()
    except (struct.error, UnicodeDecodeError) as error:
        raise ValueError(f'not a DiagnosticArray: damaged at byte {reader.at}') from error
    return First(stamp_ns, name, hardware_id)


def statuses(data: bytes) -> list[Status]:
    r"""
    Return the statuses in a serialised DiagnosticArray.

    Raises
    ------
    ValueError
        If the message is damaged.

    Examples
    --------
    >>> statuses(bytes(4) + bytes(20))
    Traceback (most recent call last):
    ...
    ValueError: not a DiagnosticArray: a text of no bytes at byte 12
    >>> statuses(b'\0\1\0\0' + bytes(8) + b'\1' + bytes(7) + bytes(4))
    []
    """
    reader = _Reader(data, _BEGIN + _STAMP)
    try:
        reader.skip_text()
        found = [reader.status() for _ in range(reader.number())]
    except (struct.error, UnicodeDecodeError) as error:
        raise ValueError(f'not a DiagnosticArray: damaged at byte {reader.at}') from error
    return found


class _Reader:
    """A place in a message."""

    def __init__(self, data: bytes, at: int) -> None:
        self.at = at
        self._data = data
        # bit 0 of the second byte: little-endian
        little = len(data) > 1 and data[1] & 1
        self._number = struct.Struct('<I' if little else '>I')

    def number(self) -> int:
        self.at += -(self.at - _BEGIN) % 4
        (value,) = self._number.unpack_from(self._data, self.at)
        self.at += 4
        return int(value)

    def skip_text(self) -> tuple[int, int]:
        """Go behind a text; return where it begins and ends, without the NUL at its end."""
        length = self.number()
        begin = self.at
        if not length or begin + length > len(self._data):
            size = f'{length} bytes' if length else 'no bytes'
            raise ValueError(f'not a DiagnosticArray: a text of {size} at byte {begin - 4}')
        self.at = begin + length
        return begin, self.at - 1

    def text(self) -> str:
        begin, end = self.skip_text()
        return self._data[begin:end].decode()

    def whose(self) -> tuple[str, str]:
        """Return name and hardware_id of a status, which begins here."""
        self.at += 1  # level
        name = self.text()
        self.skip_text()  # message
        return name, self.text()

    def status(self) -> Status:
        name, hardware_id = self.whose()
        pairs = self.number()
        if pairs > len(self._data):
            raise ValueError(f'not a DiagnosticArray: {pairs} values at byte {self.at - 4}')
        return Status(name, hardware_id, {self.text(): self.text() for _ in range(pairs)})
