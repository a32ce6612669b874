# SPDX-License-Identifier: Apache-2.0
"""The topics of a sensor, their types, and blocks of their messages."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

IMU = 'imu/data_raw'
MAGNETIC_FIELD = 'imu/mag'
TEMPERATURE = 'temperature'
INCLINATION = 'inclination'

TYPES = {
    IMU: 'sensor_msgs/msg/Imu',
    MAGNETIC_FIELD: 'sensor_msgs/msg/MagneticField',
    TEMPERATURE: 'sensor_msgs/msg/Temperature',
    INCLINATION: 'geometry_msgs/msg/Vector3Stamped',
}


class Messages(NamedTuple):
    """Messages of one topic, all of one length, in the order of their time of arrival."""

    topic: str
    receive_ns: npt.NDArray[np.int64]
    rows: npt.NDArray[np.uint8]
