# SPDX-License-Identifier: Apache-2.0
"""Topics of a bag that lie beside an Imu topic: temperature, and the angles of an inclinometer."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, TYPE_CHECKING

from imu_bench.bags.bag import Bag, is_bag_folder, kind
from imu_bench.bags.block import Block, Channel
from msg_conversions import cdr
from msg_conversions.quantities import BY_NAME, Quantity, TEMPERATURE
import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from imu_bench.offline.recordings.loading import Recording

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

_OWN = 'imu'


class Companion(NamedTuple):
    """What a companion topic says: stamps (n,) in ns, values (n, k), and its name."""

    stamps: Integers
    values: Floats
    topic: str


class Thermometer(NamedTuple):
    """The temperatures beside an Imu topic of a bag, in °C, with both times of each."""

    topic: str
    stamps: Integers
    receive_ns: Integers
    celsius: Floats


class Thermometers:
    """The temperatures of a bag, gathered while something else is read from it."""

    def __init__(self, channels: Iterable[Channel]) -> None:
        self.topics = frozenset(_offered(channels, TEMPERATURE))
        self._read: dict[str, list[tuple[Integers, Integers, Floats]]] = {}

    def without(self, blocks: Iterable[Block]) -> Iterator[Block]:
        """Yield blocks; those of temperatures are kept instead."""
        self._read = {}
        for block in blocks:
            if block.channel.topic not in self.topics:
                yield block
            elif (found := _decoded(block, TEMPERATURE)) is not None:
                self._read.setdefault(block.channel.topic, []).append(found)

    def of(self, imu: str) -> Thermometer | None:
        """Return the temperature that belongs to an Imu topic."""
        topic = belonging(imu, sorted(self.topics), TEMPERATURE.name)
        if topic is None or topic not in self._read:
            return None
        stamps, receive, values = map(np.concatenate, zip(*self._read[topic], strict=True))
        return Thermometer(topic, stamps, receive, values[:, 0])


def companion(recording: Recording, name: str) -> Companion | None:
    """
    Return the temperature (°C) or inclination (rad) recorded beside an Imu topic.

    Of a text file or array the temperature is in the samples themselves.  In a bag it is a topic
    below the namespace of the sensor, such as /bench/scl3300/temperature beside
    /bench/scl3300/imu/data_raw; where the Imu topic has no namespace, the only one of its type.
    """
    own = getattr(recording.samples, name)
    if own is not None:
        values = own.reshape(len(recording), -1)
        return Companion(recording.samples.stamps, values, recording.topic)
    if name != TEMPERATURE.name:
        return _beside(recording, name)
    if (warm := recording.thermometer) is None:
        return None
    when = warm.receive_ns if recording.stamp_source == 'receive' else warm.stamps
    return _sound(when, warm.celsius[:, None], warm.topic)


def _beside(recording: Recording, name: str) -> Companion | None:
    """Return what a bag has beside an Imu topic; None where the source is no bag of ROS 2."""
    path = Path(recording.source)
    if not (is_bag_folder(path) if path.is_dir() else kind(path)):
        return None
    quantity = BY_NAME[name]
    bag = Bag(path)
    try:
        topic = belonging(recording.topic, _offered(bag.channels, quantity), name)
        if topic is None:
            return None
        found = [_decoded(block, quantity) for block in bag.blocks({topic})]
        parts = [part for part in found if part is not None]
        if not parts:
            return None
        stamps, receive, values = map(np.concatenate, zip(*parts, strict=True))
        when = receive if recording.stamp_source == 'receive' else stamps
        return _sound(when, values, topic)
    finally:
        bag.close()


def _offered(channels: Iterable[Channel], quantity: Quantity) -> list[str]:
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


def _decoded(block: Block, quantity: Quantity) -> tuple[Integers, Integers, Floats] | None:
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


def _sound(when: Integers, what: Floats, topic: str) -> Companion | None:
    """Return the values that are numbers, in the order of time."""
    good = np.isfinite(what).all(axis=1)
    order = np.argsort(when[good], kind='stable')
    return Companion(when[good][order], what[good][order], topic) if order.size else None
