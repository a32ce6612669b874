# SPDX-License-Identifier: Apache-2.0
"""Recordings that the tests of reading share."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

from imu_bench.bags.topic_info import describe, OfferedQos
from imu_bench.bags.writer import BagWriter
import numpy as np
import pytest

IMU = 'sensor_msgs/msg/Imu'
START = 1_700_000_000_000_000_000


@cache
def _store(name: str):
    from rosbags.typesys import get_typestore, Stores

    return get_typestore(Stores[name])


def _message(store, stamp_ns, acceleration, angular_velocity, frame_id, covariances):
    types = store.types
    vector = types['geometry_msgs/msg/Vector3']
    header = types['std_msgs/msg/Header']
    stamp = types['builtin_interfaces/msg/Time'](*divmod(int(stamp_ns), 10**9))
    first = (stamp, frame_id) if 'seq' not in header.__dataclass_fields__ else (7, stamp, frame_id)
    full = [np.array([value, *[0.0] * 8]) for value in covariances]
    return types[IMU](
        header(*first),
        types['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0),
        np.zeros(9),
        vector(*map(float, angular_velocity)),
        full[1],
        vector(*map(float, acceleration)),
        full[0],
    )


@pytest.fixture(scope='session')
def serialize() -> Callable[..., bytes]:
    """Return a maker of serialized Imu messages that uses rosbags, not this project."""

    def make(
        stamp_ns, acceleration, angular_velocity, frame_id='imu', covariances=(0.0, 0.0), ros=2
    ) -> bytes:
        store = _store('ROS2_JAZZY' if ros == 2 else 'ROS1_NOETIC')
        message = _message(store, stamp_ns, acceleration, angular_velocity, frame_id, covariances)
        if ros == 2:
            return bytes(store.serialize_cdr(message, IMU))
        return bytes(store.serialize_ros1(message, IMU))

    return make


@pytest.fixture
def imu_bag(tmp_path, serialize) -> Callable[..., Path]:
    """Return a writer of bags with one Imu topic."""

    def write(acceleration, angular_velocity, stamps=None, **options) -> Path:
        count = len(acceleration)
        times = START + 10_000_000 * np.arange(count)
        stamps = times if stamps is None else stamps
        path = tmp_path / 'imu_bag'
        with BagWriter(path, options.pop('storage', 'mcap')) as bag:
            bag.add_topic(describe('/imu/data_raw', IMU, [OfferedQos()]))
            bag.add_topic(describe('/text', 'std_msgs/msg/String'))
            bag.write('/text', int(times[0]), b'\0\1\0\0\2\0\0\0a\0')
            for index in range(count):
                blob = serialize(
                    stamps[index], acceleration[index], angular_velocity[index], **options
                )
                bag.write('/imu/data_raw', int(times[index]) + 500_000, blob)
                if index % 100 == 99:
                    bag.flush()
        return path

    return write
