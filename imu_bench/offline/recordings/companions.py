# SPDX-License-Identifier: Apache-2.0
"""Topics of a bag that lie beside an Imu topic: temperature, and the angles of an inclinometer."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from imu_bench.bags.bag import Bag, is_bag_folder, kind
from imu_bench.offline.recordings.loading import Recording
from imu_bench.offline.recordings.thermometers import belonging, decoded, offered
from msg_conversions.quantities import BY_NAME, TEMPERATURE
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]


class Companion(NamedTuple):
    """What a companion topic says: stamps (n,) in ns, values (n, k), and its name."""

    stamps: Integers
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
        topic = belonging(recording.topic, offered(bag.channels, quantity), name)
        if topic is None:
            return None
        found = [decoded(block, quantity) for block in bag.blocks({topic})]
        parts = [part for part in found if part is not None]
        if not parts:
            return None
        stamps, receive, values = map(np.concatenate, zip(*parts, strict=True))
        when = receive if recording.stamp_source == 'receive' else stamps
        return _sound(when, values, topic)
    finally:
        bag.close()


def _sound(when: Integers, what: Floats, topic: str) -> Companion | None:
    """Return the values that are numbers, in the order of time."""
    good = np.isfinite(what).all(axis=1)
    order = np.argsort(when[good], kind='stable')
    return Companion(when[good][order], what[good][order], topic) if order.size else None
