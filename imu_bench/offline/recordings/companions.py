# SPDX-License-Identifier: Apache-2.0
"""Topics of a bag that lie beside an Imu topic: temperature, and the angles of an inclinometer."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from imu_bench.bags.bag import Bag, is_bag_folder, kind
from imu_bench.offline.recordings.loading import Recording
from msg_conversions import cdr
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_TYPES = {
    'temperature': ('sensor_msgs/msg/Temperature', cdr.TEMPERATURE, cdr.TEMPERATURE_VALUE),
    'inclination': ('geometry_msgs/msg/Vector3Stamped', cdr.VECTOR3_STAMPED, cdr.VECTOR3_VECTOR),
}
_OWN = 'imu'


class Beside(NamedTuple):
    """What a companion topic says: stamps (n,) in ns, values (n, k), and its name."""

    stamps: npt.NDArray[np.int64]
    values: Floats
    topic: str


def beside(recording: Recording, name: str) -> Beside | None:
    """
    Return the temperature (°C) or inclination (rad) recorded beside an Imu topic.

    Of a text file or array the temperature is in the samples themselves.  In a bag it is a topic
    below the namespace of the sensor, such as /bench/scl3300/temperature beside
    /bench/scl3300/imu/data_raw; where the Imu topic has no namespace, the only one of its type.

    Parameters
    ----------
    recording : Recording
    name : {'temperature', 'inclination'}

    Returns
    -------
    Beside or None
        None if there is none; in the order of its stamps.
    """
    own = getattr(recording.samples, name)
    if own is not None:
        values = own.reshape(len(recording), -1)
        return Beside(recording.samples.stamps, values, recording.topic)
    path = Path(recording.source)
    if not (is_bag_folder(path) if path.is_dir() else kind(path)):
        return None
    message, count, part = _TYPES[name]
    bag = Bag(path)
    try:
        offered = [c.topic for c in bag.channels if c.type == message and c.serialization == 'cdr']
        topic = belonging(recording.topic, offered, name)
        return None if topic is None else _read(bag, topic, count, part, recording.stamp_source)
    finally:
        bag.close()


def belonging(imu: str, offered: Sequence[str], name: str) -> str | None:
    """
    Return the topic, among those of one type, that belongs to an Imu topic.

    Examples
    --------
    >>> offered = ['/bench/a/temperature', '/bench/b/temperature']
    >>> belonging('/bench/b/imu/data_raw', offered, 'temperature')
    '/bench/b/temperature'
    >>> belonging('/imu', offered, 'temperature') is None
    True
    """
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


def _read(bag: Bag, topic: str, count: int, part: slice, stamp_source: str) -> Beside | None:
    stamps, values = [], []
    for block in bag.blocks({topic}):
        if not len(block):
            continue
        try:
            found, columns, _ = cdr.decode_at(
                block.buffer, block.offsets, block.sizes, count, (part,)
            )
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
    return Beside(when[good][order], what[good][order], topic)
