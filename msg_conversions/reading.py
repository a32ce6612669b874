# SPDX-License-Identifier: Apache-2.0
"""
Message objects to arrays, by attribute access only.

So messages of rclpy and of rosbags are read alike, and no ROS needs to be installed.
For serialised messages `msg_conversions.cdr` is a hundred times faster.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from msg_conversions import cdr, stamps
from msg_conversions.allan_layout import AllanCurves, unpack
import numpy as np

_COVARIANCES = (
    'orientation_covariance',
    'angular_velocity_covariance',
    'linear_acceleration_covariance',
)


def stamp_ns(message: Any) -> int:
    """Return the stamp of a message with a header, in nanoseconds since the epoch."""
    stamp = message.header.stamp
    return int(stamp.sec) * stamps.NANOSECONDS + int(stamp.nanosec)


def imu(messages: Iterable[Any], *, full: bool = False) -> cdr.ImuBlock:
    """
    Return sensor_msgs/Imu messages as arrays.

    Parameters
    ----------
    messages : iterable of sensor_msgs/Imu
        Of rclpy or of rosbags.
    full : bool
        Orientation and covariances, too.

    Examples
    --------
    >>> imu([]).acceleration.shape
    (0, 3)
    """
    every = list(messages)

    def vectors(name: str) -> cdr.Floats:
        found = [(v.x, v.y, v.z) for v in (getattr(message, name) for message in every)]
        return np.array(found, dtype=np.float64).reshape(-1, 3)

    def first_elements(name: str) -> cdr.Floats:
        return np.array([getattr(message, name)[0] for message in every], dtype=np.float64)

    orientation = covariances = None
    if full:
        turns = [message.orientation for message in every]
        found = [(turn.x, turn.y, turn.z, turn.w) for turn in turns]
        orientation = np.array(found, dtype=np.float64).reshape(-1, 4)
        rows = [np.concatenate([getattr(m, name) for name in _COVARIANCES]) for m in every]
        covariances = np.array(rows, dtype=np.float64).reshape(-1, 27)
    return cdr.ImuBlock(
        stamps=np.array([stamp_ns(message) for message in every], dtype=np.int64),
        acceleration=vectors('linear_acceleration'),
        angular_velocity=vectors('angular_velocity'),
        acceleration_covariance=first_elements('linear_acceleration_covariance'),
        angular_velocity_covariance=first_elements('angular_velocity_covariance'),
        frame_ids=_frame_ids(every),
        orientation=orientation,
        covariances=covariances,
    )


def magnetic_field(messages: Iterable[Any]) -> cdr.Stamped:
    """Return sensor_msgs/MagneticField messages as values (n, 3) in tesla; NaN is no axis."""
    every = list(messages)
    fields = [message.magnetic_field for message in every]
    return _stamped(every, [(field.x, field.y, field.z) for field in fields], 3)


def temperature(messages: Iterable[Any]) -> cdr.Stamped:
    """Return sensor_msgs/Temperature messages as values (n, 1) in °C."""
    every = list(messages)
    return _stamped(every, [(message.temperature,) for message in every], 1)


def vector3(messages: Iterable[Any]) -> cdr.Stamped:
    """Return geometry_msgs/Vector3Stamped messages as values (n, 3)."""
    every = list(messages)
    return _stamped(every, [(m.vector.x, m.vector.y, m.vector.z) for m in every], 3)


def allan_from_message(message: Any) -> AllanCurves:
    """
    Return the Allan deviation curves of an imu/allan_deviation message.

    Parameters
    ----------
    message : std_msgs/Float64MultiArray
        Of rclpy or of rosbags, laid out as `msg_conversions.allan_layout` says.
    """
    return unpack(message)


def _stamped(messages: list[Any], rows: list[tuple[float, ...]], width: int) -> cdr.Stamped:
    return cdr.Stamped(
        np.array([stamp_ns(message) for message in messages], dtype=np.int64),
        np.array(rows, dtype=np.float64).reshape(-1, width),
        _frame_ids(messages),
    )


def _frame_ids(messages: list[Any]) -> tuple[str, ...]:
    return tuple(sorted({message.header.frame_id for message in messages}))
