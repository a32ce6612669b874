# SPDX-License-Identifier: Apache-2.0
"""
Many serialised messages of one publisher in one message of ROS.

A middleware asks the same price for a message of 300 bytes and for one of 100 kB.  A sensor
therefore hands over what it has published within a few hundredths of a second once more, as
one ``std_msgs/msg/UInt8MultiArray``, to those who want all of it.  Its data are little-endian:

======================  ==================================================================
``IBB1``                four bytes that say what this is
u64, u32                publisher, number of parts; then for every part
u16, text               length of the topic in bytes, topic in UTF-8
u64, i64                sequence, time of publication in ns
u32, u32                number of messages, bytes of each; then the messages, end to end
======================  ==================================================================
"""

from __future__ import annotations

from collections.abc import Sequence
import struct
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

TOPIC = '_blocks'
"""Last part of the topic's name; ROS hides names that begin with an underscore."""

TYPE = 'std_msgs/msg/UInt8MultiArray'

_MAGIC = b'IBB1'
_ENCAPSULATION = b'\x00\x01\x00\x00'
"""Plain CDR, little-endian (OMG DDSI-RTPS 2.5, table 10.3)."""

_ARRAY = struct.Struct('<4sIII')
"""Encapsulation, number of dimensions (none), offset of the data (0), bytes of the data."""
_HEAD = struct.Struct('<4sQI')
_NAME = struct.Struct('<H')
_PART = struct.Struct('<QqII')

_PADDING = 3
"""Bytes that a middleware may put behind a message to make its length a multiple of four."""


class Part(NamedTuple):
    """Consecutive messages of one topic."""

    topic: str  # name below the namespace of the publisher, such as 'imu/data_raw'
    sequence: int  # how many messages of this topic the publisher had published before these
    published_ns: int  # time of publication by the system clock, ns since the epoch
    messages: npt.NDArray[np.uint8]  # serialised messages of one length


class Block(NamedTuple):
    """What one publisher published together."""

    # number below 2**64, drawn when the publisher was created, its upper half by the process:
    # tells one that was started again, or a second one of the same name, from the first
    publisher: int
    parts: list[Part]


def encode(publisher: int, parts: Sequence[Part]) -> bytes:
    """
    Return the complete CDR message of a block.

    Raises
    ------
    ValueError
        If a number or a name does not fit its field, or messages are not rows of bytes.

    Examples
    --------
    >>> rows = np.frombuffer(b'onetwo', np.uint8).reshape(2, 3)
    >>> found = decode(encode(7, [Part('text', 40, 1_000, rows)]))
    >>> found.publisher, found.parts[0].sequence, found.parts[0].messages[1].tobytes()
    (7, 40, b'two')
    """
    pieces = []
    try:
        pieces.append(_HEAD.pack(_MAGIC, publisher, len(parts)))
        for topic, sequence, published_ns, messages in parts:
            if messages.ndim != 2 or messages.dtype != np.uint8:
                raise ValueError(
                    f'messages of {topic} must be rows of uint8, '
                    f'not {messages.dtype} of shape {messages.shape}'
                )
            name = topic.encode()
            pieces.append(_NAME.pack(len(name)) + name)
            pieces.append(_PART.pack(sequence, published_ns, *messages.shape))
            pieces.append(messages.tobytes())
        size = sum(map(len, pieces))
        return b''.join([_ARRAY.pack(_ENCAPSULATION, 0, 0, size), *pieces])
    except struct.error as error:
        raise ValueError(f'a block cannot hold this: {error}') from error


def decode(data: bytes) -> Block:
    """
    Return the block in a CDR message; its arrays are views of that message.

    Raises
    ------
    ValueError
        If the message is damaged or not a block.

    Examples
    --------
    >>> decode(encode(7, []))
    Block(publisher=7, parts=[])
    >>> decode(b'?')
    Traceback (most recent call last):
    ...
    ValueError: not a block of messages: it ends after 1 bytes, within the array
    """
    encapsulation, dimensions, offset, size = _unpack(_ARRAY, data, 0, 'the array')
    if encapsulation != _ENCAPSULATION or dimensions or offset:
        raise ValueError('not a block of messages: not a plain array of bytes')
    end = _ARRAY.size + size
    if not end <= len(data) <= end + _PADDING:
        raise ValueError(
            f'not a block of messages: {len(data)} bytes, but its array ends at {end}'
        )
    array = memoryview(data)[:end]
    magic, publisher, count = _unpack(_HEAD, array, _ARRAY.size, 'the head')
    if magic != _MAGIC:
        raise ValueError(f'not a block of messages: starts with {magic!r}, not {_MAGIC!r}')
    at = _ARRAY.size + _HEAD.size
    parts = []
    for index in range(count):
        part, at = _part(array, at, f'part {index}')
        parts.append(part)
    if at != end:
        raise ValueError(f'not a block of messages: {end - at} bytes behind its last part')
    return Block(publisher, parts)


def _part(data: memoryview, at: int, where: str) -> tuple[Part, int]:
    (length,) = _unpack(_NAME, data, at, where)
    at += _NAME.size
    try:
        topic = bytes(data[at : at + length]).decode()
    except UnicodeDecodeError as error:
        raise ValueError(f'not a block of messages: name of {where} is not UTF-8') from error
    at += length
    sequence, published_ns, rows, size = _unpack(_PART, data, at, where)
    at += _PART.size
    end = at + rows * size
    if end > len(data):
        raise ValueError(
            f'not a block of messages: it ends after {len(data)} bytes, within {where}'
        )
    if rows and not size:
        raise ValueError(f'not a block of messages: {where} has messages of no bytes')
    messages = np.frombuffer(data, np.uint8, rows * size, at).reshape(rows, size)
    return Part(topic, sequence, published_ns, messages), end


def _unpack(
    layout: struct.Struct, data: bytes | memoryview, at: int, where: str
) -> tuple[Any, ...]:
    if len(data) < at + layout.size:
        raise ValueError(
            f'not a block of messages: it ends after {len(data)} bytes, within {where}'
        )
    return layout.unpack_from(data, at)
