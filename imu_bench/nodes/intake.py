# SPDX-License-Identifier: Apache-2.0
"""
The way in of those who want every message: taken by a thread of its own, many at a time.

An executor calls back once per message, waits for each anew, and starves when the machine is
busy: histories in the middleware then overflow in silence.  Here the middleware gathers
messages while nobody looks, and a few dozen times a second all of them are taken at once, with
the numbers that tell what is missing.

A sensor of the bench publishes the messages of all its topics once more, in blocks, on a hidden
topic (`msg_conversions.blocks`).  Where there is such a topic, messages come from there.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from itertools import groupby
import threading
import time
from typing import Any, NamedTuple

from imu_bench.nodes import qos
from imu_bench.nodes.others import ForeignMessages, Ownership, process, several_publishers
from imu_bench.nodes.sequences import Sequences
from msg_conversions import blocks
import numpy as np
import numpy.typing as npt
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.topic_endpoint_info import TopicEndpointInfo
from std_msgs.msg import UInt8MultiArray

PERIOD_S = 0.05
"""
Seconds between two looks at what has come: as long as a block is.  The middleware gathers 5 s of
a sensor at 1 kHz.
"""

AT_ONCE = 1000
"""Messages taken from one topic before the others have their turn."""

TURNS = 10
"""Turns of all topics in a row: whoever floods one does not keep the graph from being seen."""

BLOCKS = qos.MEMORY // (32 << 10)
"""Blocks that the middleware may hold for a namespace; those of our sensors are of 32 kB."""

EARLY = 64 * 2**20
"""Bytes of blocks that are kept for topics that the graph does not show yet."""

QUIET_S = 0.3
"""After so long without a message everything that was sent before the stop has come."""

LINGER_S = 2.0
"""So long at most is waited for that."""

Deliver = Callable[[str, npt.NDArray[np.int64], npt.NDArray[np.uint8]], None]


class _Untouched(CallbackGroup):
    """Of subscriptions that no executor waits for or takes from."""

    def can_execute(self, entity: object) -> bool:
        return False

    def beginning_execution(self, entity: object) -> bool:
        return False

    def ending_execution(self, entity: object) -> None:
        """Do nothing: nothing is ever executed."""


class _Source(NamedTuple):
    """A subscription; of a single topic, or of the blocks of a namespace."""

    subscription: Any
    message: type
    digest: Callable[[list[bytes], list[dict[str, Any]]], None]

    def take(self) -> int:
        """Take what has come, at most `AT_ONCE`; return how many messages."""
        handle, message = self.subscription.handle, self.message
        data: list[bytes] = []
        infos: list[dict[str, Any]] = []
        with handle:
            take = handle.take_message
            while len(data) < AT_ONCE and (found := take(message, True)) is not None:
                data.append(found[0])
                infos.append(found[1])
        if data:
            self.digest(data, infos)
        return len(data)


class Intake:
    """Takes the messages of some topics in a thread."""

    def __init__(
        self,
        node: Node,
        wanted: Callable[[str], bool],
        deliver: Deliver,
        tend: Callable[[], None],
    ) -> None:
        make_future: Any = Future  # without type hints in rclpy of Jazzy
        self.ended = make_future()  # done with the exception that ended the thread, if one has
        self.sequences: dict[str, Sequences] = {}  # what came and what is missing, by topic
        self.damaged = 0  # blocks that could not be read
        self.dropped = 0  # messages of topics that did not appear in the graph for too long
        # messages in blocks of somebody else, by topic; they are not delivered
        self.foreign: Counter[str] = Counter()
        self._node = node
        self._wanted, self._deliver, self._tend = wanted, deliver, tend
        self._group = _Untouched()
        self._sources: list[_Source] = []
        self._in_blocks: dict[str, str] = {}
        self._owners: dict[str, Ownership] = {}
        self._apart: dict[str, ForeignMessages] = {}
        self._publishers: dict[str, set[bytes]] = {}
        self._early: list[tuple[str, npt.NDArray[np.int64], npt.NDArray[np.uint8]]] = []
        self._linger_s = 0.0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='intake', daemon=True)

    def start(self) -> None:
        """Begin to take, and to tend."""
        self._thread.start()

    def follow(self, topic: str, message: type, publishers: list[TopicEndpointInfo]) -> None:
        """Take the messages of a topic from now on; to be called when tending."""
        namespace = self.carrier(topic, publishers)
        if namespace is None:
            self._follow_plain(topic, message, publishers)
            return
        if namespace not in self._owners:
            self._owners[namespace] = Ownership()
            self._subscribe_blocks(namespace)
        self._in_blocks[topic] = namespace
        self._hand_over_early(topic)

    def several(self, topic: str, message: type) -> tuple[list[str], int]:
        """Return who publishes a topic that is followed, if they are several."""
        namespace = self._in_blocks.get(topic)
        foreign, apart = self.foreign[topic], self._apart.get(topic)
        if namespace is None:
            interleaved = topic in self.sequences and self.sequences[topic].interleaved
        else:
            interleaved = bool(foreign)
        if self._node.count_publishers(topic) < 2 and not interleaved and apart is None:
            return [], 0
        publishers = self._node.get_publishers_info_by_topic(topic)
        carriers = [] if namespace is None else self._carriers(namespace)
        names = several_publishers(publishers, carriers, interleaved=interleaved)
        if namespace is None:
            return names, 0
        if {process(each) for each in publishers} - {process(each) for each in carriers}:
            apart = self._count_apart(topic, message, publishers)
        return names, foreign + (apart.foreign if apart else 0)

    def listeners(self, topic: str) -> list[TopicEndpointInfo]:
        """Return who takes a topic that is followed, or the blocks that it comes in."""
        namespace = self._in_blocks.get(topic)
        names = [topic] if namespace is None else [topic, f'{namespace}/{blocks.TOPIC}']
        ask = self._node.get_subscriptions_info_by_topic
        return [each for name in names for each in ask(name)]

    def _count_apart(
        self, topic: str, message: type, publishers: list[TopicEndpointInfo]
    ) -> ForeignMessages:
        """Count what others publish on a topic that comes in blocks; deliver none of it."""
        if topic not in self._apart:
            apart = self._apart[topic] = ForeignMessages()
            profile = qos.requested([each.qos_profile for each in publishers], qos.depth(message))
            subscription = self._subscription(topic, message, profile)
            heard = _Source(subscription, message, lambda data, infos: apart.heard(data))
            self._sources.append(heard)
        self._apart[topic].settle()
        return self._apart[topic]

    def close(self, *, linger: bool = False) -> None:
        """End the thread and the subscriptions; first take what is still on its way, if asked."""
        self._linger_s = LINGER_S if linger else 0.0
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join()
        for source in self._sources:
            self._node.destroy_subscription(source.subscription)
        self._sources = []

    # --- subscriptions -------------------------------------------------------------------

    def carrier(self, topic: str, publishers: Iterable[TopicEndpointInfo]) -> str | None:
        """Return the namespace in whose blocks a publisher of a topic sends its messages, too."""
        processes = {process(publisher) for publisher in publishers}
        namespace = topic
        while namespace:
            namespace = namespace.rpartition('/')[0]
            if processes & {process(each) for each in self._carriers(namespace)}:
                return namespace
        return None

    def _carriers(self, namespace: str) -> list[TopicEndpointInfo]:
        found = self._node.get_publishers_info_by_topic(f'{namespace}/{blocks.TOPIC}')
        return [each for each in found if each.topic_type == blocks.TYPE]

    def _subscription(self, topic: str, message: type, profile: QoSProfile) -> Subscription:
        """Return a subscription from which a thread takes what comes, as bytes."""
        return qos.create_subscription(
            self._node, message, topic, _unused_callback, profile,
            callback_group=self._group, raw=True,
        )  # fmt: skip

    def _subscribe_blocks(self, namespace: str) -> None:
        topic = f'{namespace}/{blocks.TOPIC}'
        profile = qos.keep_last(BLOCKS, 'reliable')
        subscription = self._node.create_subscription(
            UInt8MultiArray, topic, _unused_callback, profile, callback_group=self._group, raw=True
        )

        def digest(data: list[bytes], infos: Sequence[object]) -> None:
            for message in data:
                self._digest_block(namespace, message)

        self._sources.append(_Source(subscription, UInt8MultiArray, digest))

    def _follow_plain(
        self, topic: str, message: type, publishers: list[TopicEndpointInfo]
    ) -> None:
        profile = qos.requested([each.qos_profile for each in publishers], qos.depth(message))
        subscription = self._subscription(topic, message, profile)
        self._publishers[topic] = {bytes(each.endpoint_gid) for each in publishers}
        sequences = self.sequences[topic] = Sequences(lambda: self._around(topic))

        def digest(data: list[bytes], infos: list[dict[str, Any]]) -> None:
            sequences.take([_number(info) for info in infos])
            stamps = np.array([info['received_timestamp'] or time.time_ns() for info in infos])
            start = 0
            for size, group in groupby(data, key=len):
                run = list(group)
                rows = np.frombuffer(b''.join(run), np.uint8).reshape(len(run), size)
                self._deliver(topic, stamps[start : start + len(run)], rows)
                start += len(run)

        self._sources.append(_Source(subscription, message, digest))

    def _around(self, topic: str) -> int:
        """Return how many publishers a topic has had so far."""
        seen = self._publishers[topic]
        for publisher in self._node.get_publishers_info_by_topic(topic):
            seen.add(bytes(publisher.endpoint_gid))
        return len(seen)

    # --- the thread ------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            self._tend()
            while not self._stop.wait(PERIOD_S):
                self._round()
                self._tend()
            self._take_the_rest()
        except Exception as problem:
            # whoever takes the context down does not wait for this thread
            if self._node.context.ok():
                self.ended.set_exception(problem)

    def _take_the_rest(self) -> None:
        """Take until nothing has come for a while."""
        heard = time.monotonic()
        end = heard + self._linger_s
        while (now := time.monotonic()) < end and now - heard < QUIET_S:
            if self._round():
                heard = time.monotonic()
            time.sleep(PERIOD_S)

    def _round(self) -> int:
        """Take from every topic until none is full, or long enough; return how many came."""
        total = 0
        for _ in range(TURNS):
            taken = [source.take() for source in self._sources]
            total += sum(taken)
            if AT_ONCE not in taken:
                break
        return total

    def _digest_block(self, namespace: str, data: bytes) -> None:
        try:
            block = blocks.decode(data)
        except ValueError as error:
            if not self.damaged:
                untyped: Any = self._node  # rclpy of Jazzy has few type hints
                untyped.get_logger().error(f'{namespace}/{blocks.TOPIC}: {error}')
            self.damaged += 1
            return
        for part in block.parts:
            topic = part.topic if part.topic.startswith('/') else f'{namespace}/{part.topic}'
            followed = self._in_blocks.get(topic) == namespace
            known = topic in self._publishers or topic in self._in_blocks
            if not followed and (known or not self._wanted(topic)):
                continue
            count = len(part.messages)
            if not self._owners[namespace].admits(block.publisher, part.published_ns):
                self.foreign[topic] += count
                continue
            if topic in self._apart:
                self._apart[topic].own(part.messages)
            if topic not in self.sequences:
                self.sequences[topic] = Sequences()
            self.sequences[topic].take_run(block.publisher, part.sequence, count)
            stamps = np.full(count, part.published_ns)
            if followed:
                self._deliver(topic, stamps, part.messages)
            elif sum(rows.nbytes for _, _, rows in self._early) < EARLY:
                self._early.append((topic, stamps, part.messages))
            else:
                self.dropped += count

    def _hand_over_early(self, topic: str) -> None:
        """Deliver what has come of a topic before it was followed."""
        early, self._early = self._early, []
        for item in early:
            if item[0] == topic:
                self._deliver(*item)
            else:
                self._early.append(item)


def _unused_callback(data: bytes) -> None:
    """Stand in for the callback that a subscription must have."""


def _number(info: dict[str, Any]) -> int | None:
    """Return how many messages the publisher had sent before, None if that is not known."""
    number: int | None = info['publication_sequence_number']
    return number - 1 if number else None
