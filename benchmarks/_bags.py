# SPDX-License-Identifier: Apache-2.0
"""Bags for the benchmarks: sensors at one rate, their messages interleaved one by one."""

from __future__ import annotations

from pathlib import Path

from imu_bench.bags.topic_info import describe
from imu_bench.bags.writer import BagWriter
from msg_conversions import covariance
from msg_conversions.encoding import ImuTemplate
import numpy as np

START_NS = 1_700_000_000_000_000_000
TRANSPORT_NS = 300_000
_SLICE = 8192
_TYPE = 'sensor_msgs/msg/Imu'


def topic(sensor: int) -> str:
    """Return the name of the topic of a sensor."""
    return f'/bench/imu_{sensor}/imu/data_raw'


def write_bag(
    path: Path,
    *,
    sensors: int = 6,
    rate_hz: float = 1000.0,
    duration_s: float = 600.0,
    storage: str = 'mcap',
    compression: str = 'zstd',
    seed: int = 1,
) -> int:
    """
    Write a bag of still sensors and return the number of messages.

    White noise and a slow random walk about gravity, in steps of a 16-bit converter, as most
    chips give; message by message the topics take turns, as a recorder of a bench sees them.
    """
    rng = np.random.default_rng(seed)
    samples = round(rate_hz * duration_s)
    templates = [
        ImuTemplate(
            f'imu_{k}_link',
            acceleration_covariance=covariance.UNKNOWN,
            angular_velocity_covariance=covariance.UNKNOWN,
        )
        for k in range(sensors)
    ]
    steps = np.array([9.80665 / 16384] * 3 + [np.radians(1.0 / 131)] * 3)
    sigma = np.array([0.02] * 3 + [0.002] * 3)
    bias = rng.normal(size=(sensors, 6)) * np.array([0.3] * 3 + [0.01] * 3)
    bias[:, 2] += 9.80665
    with BagWriter(path, storage, compression=compression) as bag:
        for k in range(sensors):
            bag.add_topic(describe(topic(k), _TYPE))
        for first in range(0, samples, _SLICE):
            count = min(_SLICE, samples - first)
            turn = (first + np.arange(count)) * round(1e9 / rate_hz) + START_NS
            blocks = []
            for k in range(sensors):
                walk = bias[k] + np.cumsum(rng.normal(size=(count, 6)), axis=0) * sigma * 1e-4
                bias[k] = walk[-1]
                values = np.rint((walk + rng.normal(size=(count, 6)) * sigma) / steps) * steps
                stamps = turn + k * 10_000 + rng.integers(0, 20_000, count)
                rows = templates[k].imu_rows(stamps, values[:, :3], values[:, 3:])
                received = (stamps + TRANSPORT_NS + rng.integers(0, 50_000, count)).tolist()
                blocks.append((topic(k), received, [row.tobytes() for row in rows]))
            for index in range(count):
                for name, received, blobs in blocks:
                    bag.write(name, received[index], blobs[index])
            bag.flush()
    return samples * sensors
