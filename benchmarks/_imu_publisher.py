# SPDX-License-Identifier: Apache-2.0
"""
One sensor of a benchmark: a process that publishes Imu messages in blocks.

``python -m benchmarks._imu_publisher TOPIC RATE_HZ SECONDS`` waits for a subscriber, says
'ready', starts at the line of text that gives the time to start (seconds of time.time), says how
many messages it sent, and stays until its input ends: a publisher that leaves takes
with it what readers have not fetched.
"""

from __future__ import annotations

import sys
import time
from typing import Any

from imu_bench.nodes import qos
from msg_conversions import covariance
from msg_conversions.encoding import ImuTemplate
import numpy as np
import rclpy
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.task import Future
from sensor_msgs.msg import Imu

BLOCK_S = 0.02
"""A block is what a FIFO holds when it is read 50 times a second."""

PATIENCE_S = 20.0

SIGMA = 0.02
"""m/s² and rad/s, of every axis."""


def main(topic: str, rate_hz: float, seconds: float) -> int:
    """Publish; see the module."""
    rclpy.init(args=[])
    node: Any = rclpy.create_node('imu_publisher')
    make_future: Any = Future  # rclpy of Jazzy has few type hints
    matched = make_future()
    publisher = node.create_publisher(
        Imu,
        topic,
        qos.keep_last(int(rate_hz), 'reliable'),
        event_callbacks=PublisherEventCallbacks(matched=matched.set_result),
    )
    rclpy.spin_until_future_complete(node, matched, timeout_sec=PATIENCE_S)
    if not matched.done():
        print(f'nobody subscribed to {topic} within {PATIENCE_S:g} s', file=sys.stderr)
        return 1
    template = ImuTemplate(
        'imu_link',
        acceleration_covariance=covariance.UNKNOWN,
        angular_velocity_covariance=covariance.UNKNOWN,
    )
    total = round(rate_hz * seconds)
    rng = np.random.default_rng(abs(hash(topic)) % 2**32)
    data = rng.normal(scale=SIGMA, size=(2, total, 3))
    print('ready', flush=True)
    start_s = float(sys.stdin.readline())
    stamps = int(start_s * 1e9) + np.rint(np.arange(total) * (1e9 / rate_hz)).astype(np.int64)
    sent = 0
    while sent < total:
        time.sleep(BLOCK_S)
        due = min(total, int((time.time() - start_s) * rate_hz))
        part = slice(sent, max(sent, due))
        for blob in template.encode_imu(stamps[part], data[0, part], data[1, part]):
            publisher.publish(blob)
        sent = part.stop
    print(sent, flush=True)
    sys.stdin.read()
    node.destroy_node()
    rclpy.shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1], float(sys.argv[2]), float(sys.argv[3])))
