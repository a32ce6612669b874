# SPDX-License-Identifier: Apache-2.0
"""Names of the bench's topics, for those who have no ROS 2 as well."""

from __future__ import annotations

from msg_conversions.quantities import IMU, IMU_QUANTITIES, TYPES

IMU_TYPE = TYPES[IMU]

ROOT = '/bench'
"""Below it are the namespaces of the bench's sensors."""

METRICS = ('rms', 'noise_density', 'bias_instability')
"""What is published of each axis, in this order."""

ALLAN_DEVIATION = 'imu/allan_deviation'
DIAGNOSTICS = '/diagnostics'

MEASURED = tuple(TYPES)
"""Those that a sensor's own node publishes."""

SUFFIXES = (
    *MEASURED,
    ALLAN_DEVIATION,
    *(f'imu/{metric}/{quantity.name}' for metric in METRICS for quantity in IMU_QUANTITIES),
)
"""Last parts of the names of the topics that are recorded, in whatever namespace."""


def metrics_below(topic: str) -> str:
    """
    Return the name below which the metrics of an Imu topic are published.

    Examples
    --------
    >>> metrics_below('/bench/left/imu/data_raw'), metrics_below('/imu0')
    ('/bench/left/imu', '/imu0')
    """
    return topic.rpartition('/')[0] if topic.endswith(f'/{IMU}') else topic


def watched_name(topic: str) -> str:
    """
    Return what diagnostics call an Imu topic: the bench's sensor, or the whole name.

    Examples
    --------
    >>> watched_name('/bench/left/imu/data_raw'), watched_name('/robot/imu/data_raw')
    ('left', '/robot/imu/data_raw')
    """
    name = topic.removeprefix(f'{ROOT}/').removesuffix(f'/{IMU}')
    return topic if '/' in name else name
