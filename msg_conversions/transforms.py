# SPDX-License-Identifier: Apache-2.0
"""Where things stand for good, as tf2_msgs/TFMessage on /tf_static, without ROS."""

from __future__ import annotations

from dataclasses import dataclass
import math
import struct

from msg_conversions import stamps

TF_STATIC, TF_TYPE = '/tf_static', 'tf2_msgs/msg/TFMessage'

LATCHED = 'transient_local'
"""Durability of /tf_static: who comes later hears it too (tf2_ros, StaticBroadcasterQoS)."""


@dataclass(frozen=True)
class Mounting:
    """Where a frame is in another one."""

    parent: str
    xyz: tuple[float, ...] = (0.0, 0.0, 0.0)  # m
    rpy: tuple[float, ...] = (0.0, 0.0, 0.0)  # rad, about the fixed axes x, y, z of the parent

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """
        The rotation as x, y, z, w: REP-103, roll, pitch and yaw about fixed axes in this order.

        Examples
        --------
        >>> x, y, z, w = Mounting('base_link', rpy=(0.0, 0.0, math.pi / 2)).quaternion
        >>> round(z, 6), round(w, 6)
        (0.707107, 0.707107)
        """
        (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a / 2), math.sin(a / 2)) for a in self.rpy)
        return (
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        )

    @property
    def up(self) -> tuple[float, float, float]:
        """
        How much each axis of the frame points along z of the parent: 1 for up, -1 for down.

        Examples
        --------
        >>> [round(part, 6) + 0.0 for part in Mounting('base', rpy=(math.pi, 0.0, 0.0)).up]
        [0.0, 0.0, -1.0]
        """
        x, y, z, w = self.quaternion
        return 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


def static_transform(stamp_ns: int, frame_id: str, mounting: Mounting) -> bytes:
    """
    Return tf2_msgs/TFMessage with one transform, little-endian XCDR1.

    Parameters
    ----------
    stamp_ns : int
        From when on it holds.
    frame_id : str
        The frame that is mounted.

    Raises
    ------
    ValueError
        If the stamp does not fit a message.

    Examples
    --------
    >>> len(static_transform(0, 'imu_link', Mounting('base_link')))
    108
    """
    sec, nanosec = stamps.split([stamp_ns])
    body = struct.pack('<IiI', 1, int(sec[0]), int(nanosec[0]))
    for name in (mounting.parent, frame_id):
        text = name.encode() + b'\0'
        body = body.ljust(-(-len(body) // 4) * 4, b'\0')
        body += struct.pack('<I', len(text)) + text
    body = body.ljust(-(-len(body) // 8) * 8, b'\0')
    return b'\0\1\0\0' + body + struct.pack('<7d', *mounting.xyz, *mounting.quaternion)
