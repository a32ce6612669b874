# SPDX-License-Identifier: Apache-2.0
"""
Imu inside of other messages, found by the definitions of their types.

rosbags decodes these messages one by one; only messages that are an Imu as a whole are fast.
"""

from __future__ import annotations

from collections.abc import Container, Iterator
from dataclasses import dataclass
from functools import cache
from operator import attrgetter
from typing import Any

from imu_bench.bags.block import Block, Channel
from imu_bench.errors import needed
from imu_bench.offline.recordings.source import IMU_TYPES
from msg_conversions import reading
from msg_conversions.cdr import ImuBlock
import numpy as np
import numpy.typing as npt

with needed('rosbags', 'an Imu inside of other messages'):
    from rosbags.interfaces import Nodetype
    from rosbags.typesys import get_types_from_idl, get_types_from_msg, get_typestore, Stores

_IMU = IMU_TYPES[0]
_DEEPEST = 8
_STORES = {'cdr': Stores.ROS2_JAZZY, 'ros1': Stores.ROS1_NOETIC}


@dataclass(frozen=True)
class Nested:
    """An Imu within the messages of a channel: the name it gets, and where it is."""

    topic: str
    channel: Channel
    path: str

    @property
    def type(self) -> str:
        """The type in words."""
        return f'{_IMU} in {self.channel.type}'


def find(channel: Channel) -> tuple[Nested, ...]:
    """Return every Imu within the messages of a channel; none where no definition is stored."""
    if channel.type in IMU_TYPES or not channel.definition or channel.serialization not in _STORES:
        return ()
    try:
        paths = tuple(_paths(_store(channel), full_name(channel.type)))
    except Exception:  # a definition may be damaged in any way; then nothing is known of the type
        return ()
    return tuple(Nested(f'{channel.topic}.{path}', channel, path) for path in paths)


def decode(
    block: Block, path: str, *, full: bool = False
) -> tuple[ImuBlock, npt.NDArray[np.int64], npt.NDArray[np.int64] | None]:
    """
    Return the Imu at a path of the messages of a block, and which messages have one.

    And the stamps in ns of the next header around them, None where there is none.
    """
    channel = block.channel
    store, name = _store(channel), full_name(channel.type)
    deserialize = (
        store.deserialize_ros1 if channel.serialization == 'ros1' else store.deserialize_cdr
    )
    pick = attrgetter(path)
    found, kept, outer = [], [], []
    for index, blob in enumerate(block.blobs()):
        try:
            whole = deserialize(blob, name)
            message = pick(whole)
            reading.imu([message])
            around = _header_around(whole, path)
        except Exception:  # the decoder raises whatever a damaged message leads it to
            continue
        found.append(message)
        kept.append(index)
        outer += [] if around is None else [around.stamp.sec * 10**9 + around.stamp.nanosec]
    stamps = np.array(outer, np.int64) if len(outer) == len(kept) else None
    return reading.imu(found, full=full), np.array(kept, np.int64), stamps


def _header_around(message: Any, path: str) -> Any:
    """Return the header of the message that a path leads to last, or of one around that."""
    around = None
    for name in path.split('.'):
        around = getattr(message, 'header', around)
        message = getattr(message, name)
    return around if hasattr(around, 'stamp') else None


def _paths(store: Any, name: str, prefix: str = '', depth: int = 0) -> Iterator[str]:
    """Yield the paths of Imu fields below a type; lists of messages are not looked into."""
    if depth > _DEEPEST or name not in store.fielddefs:
        return
    _, fields = store.fielddefs[name]
    for field, (kind, of) in fields:
        if kind != Nodetype.NAME:
            continue
        if of == _IMU:
            yield prefix + field
        else:
            yield from _paths(store, of, f'{prefix}{field}.', depth + 1)


def common(channel: Channel) -> Container[str]:
    """Return the names of the types that need no definition."""
    names: Container[str] = get_typestore(_STORES[channel.serialization]).fielddefs
    return names


def made_of(text: str, name: str) -> list[str]:
    """Return the types of the fields of a definition, raising what the parser raises."""
    parsed: Any = get_types_from_msg(text, full_name(name))
    _, fields = parsed[full_name(name)]
    found: list[str] = []
    for _, (kind, of) in fields:
        # an array is (element, length), and its element again (kind, of)
        kind, of = of[0] if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE) else (kind, of)
        found += [of] if kind == Nodetype.NAME else []
    return found


@cache
def _store(channel: Channel) -> Any:
    """Return a type store that knows the type of a channel."""
    store = get_typestore(_STORES[channel.serialization])
    if channel.encoding == 'ros2idl':
        types = get_types_from_idl(channel.definition)
    else:
        types = get_types_from_msg(channel.definition, full_name(channel.type))
    store.register({name: found for name, found in types.items() if name not in store.fielddefs})
    return store


def full_name(name: str) -> str:
    """Return the name of a type as ROS 2 spells it; ROS 1 has no 'msg' in it."""
    package, _, rest = name.partition('/')
    return name if rest.startswith('msg/') else f'{package}/msg/{rest}'
