# SPDX-License-Identifier: Apache-2.0
"""Topics of a bag that lie beside an Imu topic: temperature, and the angles of an inclinometer."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from imu_bench.bags.bag import Bag, is_bag_folder, kind
from imu_bench.offline.recordings.loading import Recording
from msg_conversions import cdr
from msg_conversions.quantities import BY_NAME, Quantity
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_OWN = 'imu'


class Companion(NamedTuple):
    """What a companion topic says: stamps (n,) in ns, values (n, k), and its name."""

    stamps: npt.NDArray[np.int64]
    values: Floats
    topic: str


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
    return beside(recording.source, recording.topic, recording.stamp_source, name)


def beside(source: str, imu: str, stamp_source: str, name: str) -> Companion | None:
    """Return what a bag has beside an Imu topic; None where the source is no bag of ROS 2."""
    path = Path(source)
    if not (is_bag_folder(path) if path.is_dir() else kind(path)):
        return None
    quantity = BY_NAME[name]
    bag = Bag(path)
    try:
        offered = [
            channel.topic
            for channel in bag.channels
            if channel.type == quantity.message.type and channel.serialization == 'cdr'
        ]
        topic = belonging(imu, offered, name)
        return None if topic is None else _read(bag, topic, quantity, stamp_source)
    finally:
        bag.close()


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


def _read(bag: Bag, topic: str, quantity: Quantity, stamp_source: str) -> Companion | None:
    stamps, values = [], []
    for block in bag.blocks({topic}):
        if not len(block):
            continue
        try:
            found, columns, _ = cdr.decode_at(
                block.buffer, block.offsets, block.sizes, quantity.message.numbers,
                (quantity.values,),
            )  # fmt: skip
        except ValueError:  # damaged: what is left is enough for a slow quantity
            continue
        stamps.append(block.receive_ns if stamp_source == 'receive' else found)
        values.append(columns[0])
    if not stamps:
        return None
    when, what = np.concatenate(stamps), np.concatenate(values)
    good = np.isfinite(what).all(axis=1)
    order = np.argsort(when[good], kind='stable')
    if not order.size:
        return None
    return Companion(when[good][order], what[good][order], topic)
