# SPDX-License-Identifier: Apache-2.0
"""Names of the bench's topics, for those who have no ROS 2 as well."""

from __future__ import annotations

from imu_bench.bags.sensor_messages import IMU, INCLINATION, MAGNETIC_FIELD, TEMPERATURE, TYPES
from imu_bench.nodes.live_analysis import METRICS
from imu_bench.samples import IMU_QUANTITIES

IMU_TYPE = TYPES[IMU]

ORIENTATION = 'imu/data'
ALLAN_DEVIATION = 'imu/allan_deviation'
DIAGNOSTICS = '/diagnostics'

SUFFIXES = (
    IMU,
    MAGNETIC_FIELD,
    TEMPERATURE,
    INCLINATION,
    ALLAN_DEVIATION,
    *(f'imu/{metric}/{quantity.name}' for metric in METRICS for quantity in IMU_QUANTITIES),
)
"""Last parts of the names of the topics that are recorded, in whatever namespace."""
