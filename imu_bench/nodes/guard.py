# SPDX-License-Identifier: Apache-2.0
"""What others do to a sensor's node: publish on its topics, or stop it while it is recorded."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from datetime import datetime, timezone
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from imu_bench.account import ASKED, MORE_ASKED, SEVERAL, several
from imu_bench.nodes.publishers import named, recorders
from msg_conversions import blocks, building
from rclpy.node import Node

MOST = 100
"""Requests that are told one by one; who asks more often is known by then."""


class Guard:
    """Keeps a sensor that is recorded as it is, and says who meddled."""

    def __init__(self, node: Node, name: str) -> None:
        self._node: Any = node  # rclpy of Jazzy has few type hints
        self._name = name
        self._own = False
        self._asked: dict[str, str] = {}
        self._more = 0
        self._latest = ''

    @contextmanager
    def own(self) -> Iterator[None]:
        """Do what nobody but the node itself has asked for."""
        self._own = True
        try:
            yield
        finally:
            self._own = False

    def note(self, what: str, done: str) -> None:
        """Write down that somebody has asked for something, with the time."""
        at = datetime.now(timezone.utc).isoformat(timespec='milliseconds')
        self._latest = f'{what}: {done}'
        if len(self._asked) >= MOST or at in self._asked:
            self._more += 1  # counted, so that nobody fills the disk by asking
            return
        self._asked[at] = self._latest
        self._node.get_logger().warning(f'{self._name}: somebody asked to {self._latest}')

    def permits(self, what: str, *, stops: bool = True) -> bool:
        """
        Return whether a change may be made; it is written down if somebody else asks for it.

        While the sensor is recorded nobody else may do what `stops` it.
        """
        if self._own:
            return True
        names = self._recorders()
        refused = stops and bool(names)
        self.note(what, f'refused, recorded by {", ".join(names)}' if refused else 'done')
        return not refused

    def _recorders(self) -> list[str]:
        topics = (blocks.TOPIC, 'imu/data_raw')
        found = [
            each
            for topic in map(self._node.resolve_topic_name, topics)
            for each in self._node.get_subscriptions_info_by_topic(topic)
        ]
        return recorders(found)

    def status(self, topics: Iterable[str]) -> DiagnosticStatus:
        """Return who else publishes the sensor's topics, and what was asked of it."""
        found = {}
        for topic in map(self._node.resolve_topic_name, topics):
            if self._node.count_publishers(topic) > 1:
                every = self._node.get_publishers_info_by_topic(topic)
                names = sorted({named(each) for each in every})
                if len(names) > 1:  # one of its own name was killed, or the recorder tells
                    found[topic] = ', '.join(names)
        level, line = ('warn', self._latest) if self._asked else ('ok', 'alone')
        if found:
            level, line = 'error', several(*next(iter(found.items())))
        values: dict[str, object] = {f'{ASKED}{at}': what for at, what in self._asked.items()}
        values |= {MORE_ASKED: self._more} if self._more else {}
        values |= {SEVERAL + topic: names for topic, names in found.items()}
        return building.diagnostic_status(f'{self._name}: others', level, line, '', values)
