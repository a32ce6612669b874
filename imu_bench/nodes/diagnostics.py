# SPDX-License-Identifier: Apache-2.0
"""Health on /diagnostics, once a second, as diagnostic_msgs/DiagnosticArray."""

from __future__ import annotations

from collections.abc import Callable, Iterable
import threading
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from imu_bench.nodes.topic_names import DIAGNOSTICS
from msg_conversions import building
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.node import Node

PERIOD_S = 1.0
SOON_NS = 100_000_000
"""News go out at once, but no more often than this."""

KEPT = 100
"""Messages for a listener that is away: a recorder that was stopped for a minute gets all."""

FRESH_NS = 30_000_000_000
"""
What a node says is stamped by the clock of this machine; what is older is played from a bag, and
says nothing of what runs now.
"""

LISTENING = Duration(seconds=1.0)
"""So long a node waits for those who have not heard its last words."""


def fresh(stamp_ns: int) -> bool:
    """Return whether something was said just now; what has no stamp is taken as it comes."""
    return not stamp_ns or abs(time.time_ns() - stamp_ns) <= FRESH_NS


def steady_timer(node: Node, period_s: float, callback: Callable[[], None]) -> None:
    """
    Call something again and again, whatever the clock of the system does.

    The timers of rclpy follow the clock of ROS: one that is set back by an hour stops them, and
    with them the executor that waits for them, for as long.
    """
    node.create_timer(period_s, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


class Diagnostics:
    """
    Publishes the statuses of a node, every `PERIOD_S` and when asked.

    Before that it calls `first` every time: a timer of its own would cost as much again, for an
    executor that wakes up looks at everything that all its nodes have, and then once more.
    """

    def __init__(
        self,
        node: Node,
        statuses: Callable[[], Iterable[DiagnosticStatus]],
        first: Callable[[], None] | None = None,
    ) -> None:
        self._first = first
        self._node = node
        self._statuses = statuses
        self._publisher = node.create_publisher(DiagnosticArray, DIAGNOSTICS, KEPT)
        self._one = threading.RLock()
        self._said_ns = 0
        self._soon = False
        steady_timer(node, PERIOD_S, self._turn)

    def _turn(self) -> None:
        if self._first is not None:
            self._first()
        self.publish()

    def publish_soon(self) -> None:
        """Publish now, or with the next `catch_up` if that was just done; from any thread."""
        self._soon = True
        self.catch_up()

    def catch_up(self) -> None:
        """Publish what could not be published at once; call often."""
        if self._soon and time.monotonic_ns() - self._said_ns >= SOON_NS:
            self.publish()

    def publish(self) -> None:
        """Publish now."""
        with self._one:
            self._soon, self._said_ns = False, time.monotonic_ns()
            now_ns = self._node.get_clock().now().nanoseconds
            self._publisher.publish(building.diagnostic_array(now_ns, self._statuses()))

    def last_words(self) -> None:
        """Publish, and wait a little until everybody who listens has heard it."""
        self.publish()
        self._publisher.wait_for_all_acked(LISTENING)
