# SPDX-License-Identifier: Apache-2.0
"""Others on the topics of a bench: who publishes, who records, what they ask for and add."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from datetime import datetime, timezone
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from imu_bench.account import ASKED, MORE_ASKED, SEVERAL, several
from imu_bench.counting import clean
from imu_bench.nodes.diagnostics import fresh
from msg_conversions import blocks, building, diagnostics
import numpy as np
import numpy.typing as npt
from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

_PARTICIPANT = 12
"""Bytes of a publisher's identity that all of one process share: OMG DDSI-RTPS 2.5, 8.2.4.1."""

QUIET_NS = 1_000_000_000
"""
A node that was killed comes back no sooner: importing ROS 2 alone takes longer.  Who speaks
while another of the same name still does is a second one.
"""

SETTLED_S = 1.0
"""A message goes out at once, and in a block 0.05 s later: by then both have come."""

KEPT_S = 10.0
"""So long what came in blocks is known; single messages that come later are taken for foreign."""


def process(publisher: TopicEndpointInfo) -> bytes:
    """Return what identifies the process of a publisher."""
    return bytes(publisher.endpoint_gid[:_PARTICIPANT])


RECORDERS = ('recorder', 'rosbag2_recorder')
"""Nodes that record: ours, and that of `ros2 bag record`."""

UNNAMED = 'a program that is no node of ROS 2'


def full_name(publisher: TopicEndpointInfo) -> str:
    """Return the full name of the node of a publisher."""
    name, space = publisher.node_name, publisher.node_namespace
    # rmw: _NODE_NAME_UNKNOWN_, _CREATED_BY_BARE_DDS_APP_
    if name.startswith(('_NODE_', '_CREATED_')):
        return UNNAMED
    return clean(f'{space.rstrip("/")}/{name}')


def recorders(subscribers: Iterable[TopicEndpointInfo]) -> list[str]:
    """Return the names of the nodes that record, one for each process."""
    found = {process(each): full_name(each) for each in subscribers if each.node_name in RECORDERS}
    return sorted(found.values())


def several_publishers(
    publishers: Iterable[TopicEndpointInfo],
    carriers: Iterable[TopicEndpointInfo] = (),
    *,
    interleaved: bool = False,
) -> list[str]:
    """
    Return the names of all who publish a topic, if they are several; else nothing.

    A node that was killed stays in the graph for a while, beside the one that was started in its
    place: two of one name are several only if their messages are `interleaved`.
    """
    own = {process(each) for each in carriers}
    every = list(publishers)
    names = sorted({full_name(each) for each in every})
    foreign = {full_name(each) for each in every if process(each) not in own}
    if foreign and (own or len(foreign) > 1):
        return names
    if not interleaved:
        return []
    return names if len(names) > 1 else [f'{name}, twice' for name in names]


class Ownership:
    """
    Whose blocks are those of a sensor.

    One who speaks after another is its node, started again.  Two who speak at once are two, and
    the first is the sensor.
    """

    def __init__(self) -> None:
        self.interleaved = False
        self._number: int | None = None
        self._heard_ns = 0
        self._before: set[int] = set()

    def admits(self, publisher: int, published_ns: int) -> bool:
        """Return whether a block is the sensor's own."""
        if publisher != self._number:
            quiet = published_ns - self._heard_ns > QUIET_NS
            same = self._number is not None and publisher >> 32 == self._number >> 32
            if not (self._number is None or quiet or same) or publisher in self._before:
                self.interleaved = True
                return False
            if self._number is not None:
                self._before.add(self._number)
            self._number = publisher
        self._heard_ns = max(self._heard_ns, published_ns)
        return True


class ForeignMessages:
    """
    Counts the messages of a topic that its sensor has not sent.

    The sensor's own come in blocks as well; what does not is of somebody else.
    """

    def __init__(self) -> None:
        self.foreign = 0
        self._own: Counter[int] = Counter()
        self._order: deque[tuple[float, int]] = deque()
        self._waiting: deque[tuple[float, int]] = deque()

    def own(self, messages: npt.NDArray[np.uint8], now_s: float | None = None) -> None:
        """Take note of messages that the sensor has sent, shape (n, bytes)."""
        now_s = time.monotonic() if now_s is None else now_s
        for row in messages:
            key = hash(row.tobytes())
            self._own[key] += 1
            self._order.append((now_s, key))
        while self._order and now_s - self._order[0][0] > KEPT_S:
            _, key = self._order.popleft()
            del self._own[key]

    def heard(self, messages: Iterable[bytes], now_s: float | None = None) -> None:
        """Take note of single messages; whose they are is known a little later."""
        now_s = time.monotonic() if now_s is None else now_s
        self._waiting.extend((now_s, hash(message)) for message in messages)
        self.settle(now_s)

    def settle(self, now_s: float | None = None) -> None:
        """Count those of others among the messages that have waited long enough."""
        now_s = time.monotonic() if now_s is None else now_s
        while self._waiting and now_s - self._waiting[0][0] > SETTLED_S:
            _, key = self._waiting.popleft()
            if self._own[key] > 0:
                self._own[key] -= 1
            else:
                self.foreign += 1


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
                names = sorted({full_name(each) for each in every})
                if len(names) > 1:  # one of its own name was killed, or the recorder tells
                    found[topic] = ', '.join(names)
        level, line = ('warn', self._latest) if self._asked else ('ok', 'alone')
        if found:
            level, line = 'error', several(*next(iter(found.items())))
        values: dict[str, object] = {f'{ASKED}{at}': what for at, what in self._asked.items()}
        values |= {MORE_ASKED: self._more} if self._more else {}
        values |= {SEVERAL + topic: names for topic, names in found.items()}
        return building.diagnostic_status(f'{self._name}: others', level, line, '', values)


MOST_BESIDE = 50
"""Topics of others that are recorded beside a bench, so that nobody makes it grow at will."""

BESIDE_BYTES = 2**20
"""What others publish may take this, and besides no more than the bench's own topics have."""

SAID_BYTES = 2**20
"""What the bench's own nodes may say at once on /diagnostics."""

SAID_BYTES_PER_S = 2**14
"""
And in the mean, for each of its sensors, recorder and analysis.  Those of `machine_vibration`, six
sensors, say 45 kB a second together; this is 2.8 times as much.
"""

SAID_AT_ONCE = 2**18
"""A message of the bench's nodes is smaller; the largest, of its analysis, has 3.3 kB a sensor."""

_RECORDING, _NODES = ': recording', ('recorder', 'analysis_node')


class Others:
    """
    Decides what of others goes into the bag of a bench.

    Parameters
    ----------
    sensors : iterable of str
        Namespaces of the bench's sensors; without any everything is asked for, and goes in.
    bag : str
        The recorder's own, as it says it on /diagnostics.
    """

    def __init__(self, sensors: Iterable[str], bag: str) -> None:
        self.beside: dict[str, int] = {}  # messages left out, by topic of others
        self.turned_away: set[str] = set()  # topics of others that are too many
        self.left_out = 0  # messages on /diagnostics that are too much
        self.bag = ''  # of another recorder that was heard
        names = {space.rpartition('/')[2] for space in sensors}
        self._bounded, self._own_bag = bool(names), bag
        self._names = names.union(_NODES)
        self._room = BESIDE_BYTES
        self._said, self._said_s = float(SAID_BYTES), time.monotonic()

    def lets_in(self, topic: str) -> bool:
        """Return whether one more topic of others is recorded."""
        if len(self.beside) < MOST_BESIDE:
            return True
        self.turned_away.add(topic)
        return False

    def note_own(self, size: int) -> None:
        """Take note of what the bench has measured, in bytes: others may have as much."""
        self._room += size

    def fitting(self, topic: str, rows: npt.NDArray[np.uint8]) -> int:
        """Return how many of the messages of a topic of others are recorded, shape (n, bytes)."""
        size = int(rows.shape[1])
        fitting = min(len(rows), max(0, self._room) // max(1, size))
        self.beside[topic] += len(rows) - fitting
        self._room -= fitting * size
        return fitting

    def recordable(self, rows: npt.NDArray[np.uint8]) -> npt.NDArray[np.bool_]:
        """
        Return which messages of /diagnostics are recorded.

        Those of the bench's nodes have room of their own: a crowd does not use it up.  Who speaks
        in their names shares that with them.
        """
        size = int(rows.shape[1])
        now = time.monotonic()
        rate = SAID_BYTES_PER_S * len(self._names)
        self._said = min(SAID_BYTES, self._said + rate * (now - self._said_s))
        self._said_s = now
        kept = np.ones(len(rows), bool)
        for index, row in enumerate(rows):
            own = size <= SAID_AT_ONCE and self._own(row.tobytes())
            if not self._bounded:
                continue
            room = self._said if own else self._room
            kept[index] = size <= room
            if own:
                self._said -= size if kept[index] else 0
            else:
                self._room -= size if kept[index] else 0
        self.left_out += int(np.count_nonzero(~kept))
        return kept

    def _own(self, message: bytes) -> bool:
        """Return whether a node of the bench says this, by its own account."""
        try:
            first = diagnostics.first(message)
        except ValueError:
            return False
        if first.name.endswith(_RECORDING) and first.hardware_id != self._own_bag:
            if fresh(first.stamp_ns):  # else it is played from a bag
                self.bag = first.hardware_id
            return False
        return first.name.partition(':')[0].rpartition('/')[2] in self._names
