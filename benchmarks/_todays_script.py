# SPDX-License-Identifier: Apache-2.0
"""
What a user would write today: loop over the bag with rosbags, deviation with allantools.

Run as ``python -m benchmarks._todays_script BAG OUTPUT.json TAU,TAU,...``.
"""

from __future__ import annotations

import json
from pathlib import Path
import sys
from typing import Any

import allantools
import numpy as np
from rosbags.highlevel import AnyReader

IMU = 'sensor_msgs/msg/Imu'


def read(bag: Path) -> dict[str, np.ndarray]:
    """Return the stamps and the six axes of every Imu topic."""
    rows: dict[str, list[tuple[float, ...]]] = {}
    with AnyReader([bag]) as reader:
        connections = [c for c in reader.connections if c.msgtype == IMU]
        for connection, _, raw in reader.messages(connections=connections):
            message: Any = reader.deserialize(raw, connection.msgtype)
            stamp = message.header.stamp
            acceleration, rate = message.linear_acceleration, message.angular_velocity
            rows.setdefault(connection.topic, []).append(
                (
                    stamp.sec + stamp.nanosec * 1e-9,
                    acceleration.x, acceleration.y, acceleration.z,
                    rate.x, rate.y, rate.z,
                )
            )  # fmt: skip
    return {topic: np.array(values) for topic, values in rows.items()}


def main(bag: Path, output: Path, taus: list[float]) -> None:
    """Write mean, deviation and Allan deviation of every axis."""
    results: dict[str, list[dict[str, object]]] = {}
    for topic, table in read(bag).items():
        rate_hz = (len(table) - 1) / (table[-1, 0] - table[0, 0])
        for column in table.T[1:]:
            tau, deviation, _, _ = allantools.oadev(
                column, rate=rate_hz, data_type='freq', taus=taus
            )
            results.setdefault(topic, []).append(
                {
                    'mean': float(column.mean()),
                    'std': float(column.std()),
                    'tau': tau.tolist(),
                    'deviation': deviation.tolist(),
                }
            )
    output.write_text(json.dumps(results))


if __name__ == '__main__':
    main(Path(sys.argv[1]), Path(sys.argv[2]), [float(tau) for tau in sys.argv[3].split(',')])
