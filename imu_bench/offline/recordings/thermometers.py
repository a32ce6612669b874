# SPDX-License-Identifier: Apache-2.0
"""The temperatures of a bag, read in one pass with what is measured beside them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from imu_bench.bags.block import Block, Channel
from msg_conversions import cdr
from msg_conversions.quantities import Quantity, TEMPERATURE
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

_OWN = 'imu'


class Thermometer(NamedTuple):
    """The temperatures beside an Imu topic of a bag, in °C, with both times of each."""

    topic: str
    stamps: Integers
    receive_ns: Integers
    celsius: Floats


class Thermometers:
    """The temperatures of a bag, gathered while something else is read from it."""

    def __init__(self, channels: Iterable[Channel]) -> None:
        self.topics = frozenset(offered(channels, TEMPERATURE))
        self._read: dict[str, list[tuple[Integers, Integers, Floats]]] = {}

    def without(self, blocks: Iterable[Block]) -> Iterator[Block]:
        """Yield blocks; those of temperatures are kept instead."""
        self._read = {}
        for block in blocks:
            if block.channel.topic not in self.topics:
                yield block
            elif (found := decoded(block, TEMPERATURE)) is not None:
                self._read.setdefault(block.channel.topic, []).append(found)

    def of(self, imu: str) -> Thermometer | None:
        """Return the temperature that belongs to an Imu topic."""
        topic = belonging(imu, sorted(self.topics), TEMPERATURE.name)
        if topic is None or topic not in self._read:
            return None
        stamps, receive, values = map(np.concatenate, zip(*self._read[topic], strict=True))
        return Thermometer(topic, stamps, receive, values[:, 0])


def offered(channels: Iterable[Channel], quantity: Quantity) -> list[str]:
    """Return the topics of the type of a quantity."""
    return [
        channel.topic
        for channel in channels
        if channel.type == quantity.message.type and channel.serialization == 'cdr'
    ]


def belonging(imu: str, offered: Sequence[str], name: str) -> str | None:
    """Return the topic, among those of one type, that belongs to an Imu topic."""
    parts = imu.strip('/').split('/')
    space = parts[: parts.index(_OWN)] if _OWN in parts else parts[:-1]
    if space:
        prefix = '/' + '/'.join(space) + '/'
        mine = [topic for topic in offered if topic.startswith(prefix)]
    else:
        mine = list(offered) if len(offered) == 1 else []
    # an inclinometer may stamp other vectors, too
    named = [topic for topic in mine if topic.rpartition('/')[2] == name]
    if named:
        return named[0]
    return mine[0] if len(mine) == 1 and name != 'inclination' else None


def decoded(block: Block, quantity: Quantity) -> tuple[Integers, Integers, Floats] | None:
    """Return stamps, times of arrival and values of a block; None of a damaged one."""
    if not len(block):
        return None
    try:
        stamps, columns, _ = cdr.decode_at(
            block.buffer, block.offsets, block.sizes, quantity.message.numbers,
            (quantity.values,),
        )  # fmt: skip
    except ValueError:  # what is left is enough for a slow quantity
        return None
    return stamps, block.receive_ns, columns[0]
