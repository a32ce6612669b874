# SPDX-License-Identifier: Apache-2.0
"""The subscriber of every tutorial, for comparison: message objects on the default executor."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
import sys

from diagnostic_msgs.msg import DiagnosticArray
from imu_bench.nodes import discovery, qos
from msg_conversions import building
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import Imu


class PlainSubscriber(Node):
    """Counts messages per topic, and says so once a second."""

    def __init__(self) -> None:
        super().__init__('plain_subscriber')
        self._received: Counter[str] = Counter()
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self.create_timer(1.0, self._look)

    def _look(self) -> None:
        for topic in discovery.find(self, 'sensor_msgs/msg/Imu'):
            if topic.endswith('/imu/data_raw') and topic not in self._received:
                self._received[topic] = 0
                # as deep as the node it is compared with, so that only the executor differs
                profile = qos.keep_last(5000, 'best_effort')
                self.create_subscription(Imu, topic, self._counter(topic), profile)
        statuses = [
            building.diagnostic_status(topic, 'ok', '', '', {'received': count})
            for topic, count in self._received.items()
        ]
        self._diagnostics.publish(building.diagnostic_array(0, statuses))

    def _counter(self, topic: str) -> Callable[[Imu], None]:
        def count(message: Imu) -> None:
            self._received[topic] += 1

        return count


def main() -> int:
    """Run until it is interrupted."""
    rclpy.init()
    try:
        rclpy.spin(PlainSubscriber())
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    return 0


if __name__ == '__main__':
    sys.exit(main())
