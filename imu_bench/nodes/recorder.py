# SPDX-License-Identifier: Apache-2.0
"""The recorder: everything the bench says, as it was said, into a bag of rosbag2."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from datetime import datetime
from importlib import import_module
from pathlib import Path
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from imu_bench.bags.background import BackgroundWriter
from imu_bench.bags.topic_info import describe, INFINITE_NS, OfferedQos
from imu_bench.bags.writer import BagWriter
from imu_bench.config import Setting
from imu_bench.config.bench import RECORDER_SETTINGS
from imu_bench.errors import RecordingError
from imu_bench.nodes import diagnostics, discovery, parameters, qos
from imu_bench.nodes.topic_names import DIAGNOSTICS, SUFFIXES
from msg_conversions import building
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

SETTINGS = (
    Setting(
        'output', '', 'Folder of the bag; must not exist. Named after the time when not given.'
    ),
    *RECORDER_SETTINGS,
    Setting(
        'topics',
        (),
        "Names of the topics to record; when none is given, the bench's own of every namespace.",
        kind='strs',
    ),
    Setting('all_topics', False, 'Record every topic there is.'),
    Setting(
        'max_bytes',
        0,
        'Size at which the next file of the bag begins; 0 for one file.',
        bounds=(0, 2**62),
        unit='B',
    ),
)

LOOK_S = 0.25
"""Seconds between two looks at the graph."""

DEPTH = 2000
"""Messages that the middleware holds per topic: two seconds of the fastest sensor."""


class RecorderNode(Node):
    """
    Records topics into a bag; the messages stay the bytes that came over the wire.

    Topics may come and go.  A thread writes and flushes at least once a second, so that a
    killed recorder loses no more than that second.

    Raises
    ------
    ConfigError
        If a parameter is wrong.
    RecordingError
        If the bag exists already or cannot be written; later, out of the spin, when the disk
        is full or fails.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(
            'recorder', automatically_declare_parameters_from_overrides=True, **options
        )
        untyped: Any = self  # rclpy of Jazzy has few type hints
        self.log = untyped.get_logger()
        settings = parameters.read(self, SETTINGS)
        self._only = {self.resolve_topic_name(name) for name in settings['topics']}
        self._all = settings['all_topics']
        self.path = Path(settings['output'] or f'imu_bench_{datetime.now():%Y_%m_%d-%H_%M_%S}')
        self.received: Counter[str] = Counter()
        self._recorded: dict[str, Subscription | None] = {}
        self._writer = BackgroundWriter(
            BagWriter(self.path, settings['storage'], max_bytes=settings['max_bytes'])
        )
        self.create_timer(LOOK_S, self._look)
        self._diagnostics = diagnostics.Diagnostics(self, self._statuses)
        self.log.info(f'recording into {self.path.resolve()}')

    def close(self) -> None:
        """Write everything that has come, finish the bag, and say how it went."""
        for subscription in self._recorded.values():
            if subscription is not None:
                self.destroy_subscription(subscription)
        try:
            self._finish()
        finally:
            if self.context.ok():
                self._diagnostics.last_words()

    def _finish(self) -> None:
        told = self._writer.error is not None
        try:
            self._writer.close()
        except RecordingError as problem:
            if not told:
                self.log.fatal(str(problem))
            return
        total = sum(self._writer.counts.values())
        self.log.info(f'{total} messages on {len(self._writer.counts)} topics in {self.path}')

    # --- topics ------------------------------------------------------------------------

    def _look(self) -> None:
        """Subscribe to what is new; stop when the bag cannot be written any more."""
        if self._writer.error is not None:
            raise self._writer.error
        for name, kind in self._wanted().items():
            if name not in self._recorded:
                publishers = self.get_publishers_info_by_topic(name)
                if publishers:
                    self._recorded[name] = self._subscribe(name, kind, publishers)

    def _wanted(self) -> dict[str, str]:
        graph = discovery.find(self)
        if self._all:
            return graph
        if self._only:
            return {name: kind for name, kind in graph.items() if name in self._only}
        return {
            name: kind
            for name, kind in graph.items()
            if name == DIAGNOSTICS or any(name.endswith('/' + end) for end in SUFFIXES)
        }

    def _subscribe(
        self, name: str, kind: str, publishers: list[TopicEndpointInfo]
    ) -> Subscription | None:
        message = message_class(kind)
        if message is None:
            self.log.warning(f'{name} is not recorded: its type {kind} is not installed here')
            return None
        offered = [publisher.qos_profile for publisher in publishers]
        self._writer.add_topic(
            describe(
                name,
                kind,
                [offered_qos(profile) for profile in offered],
                _type_hash(publishers),
            )
        )
        return qos.create_subscription(
            self, message, name, self._receiver(name), requested_qos(offered), raw=True
        )

    def _receiver(self, name: str) -> Callable[[bytes], None]:
        put, received, now_ns = self._writer.put, self.received, time.time_ns

        # The middleware's own time of reception would be better by a fraction of a millisecond,
        # but the events executor of the Jazzy wheels fails on callbacks that ask for it.
        def receive(data: bytes) -> None:
            received[name] += 1
            put(name, now_ns(), data)

        return receive

    # --- health ------------------------------------------------------------------------

    def _statuses(self) -> Iterable[DiagnosticStatus]:
        writer = self._writer
        stored = writer.counts
        level, line = 'ok', f'recording {len(stored)} topics'
        if writer.dropped:
            level, line = 'error', f'{writer.dropped} messages dropped: the disk is too slow'
        if writer.error is not None:
            level, line = 'error', str(writer.error)
        values: dict[str, object] = {
            'bag': self.path,
            'received': sum(self.received.values()),
            'stored': sum(stored.values()),
            'waiting': writer.waiting,
            'dropped': writer.dropped,
            **{f'stored.{name}': count for name, count in stored.items()},
        }
        name = f'{self.get_name()}: recording'
        return [building.diagnostic_status(name, level, line, str(self.path), values)]


def message_class(kind: str) -> type | None:
    """
    Return the Python class of a message type, None if it is not installed.

    Examples
    --------
    >>> message_class('sensor_msgs/msg/Imu').__name__, message_class('my_msgs/msg/Own')
    ('Imu', None)
    """
    package, _, name = kind.split('/')
    try:
        found: type = getattr(import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError):
        return None
    return found


def requested_qos(offered: Iterable[QoSProfile]) -> QoSProfile:
    """
    Return a profile that every publisher can serve and that asks for as much as all offer.

    As rosbag2 adapts its subscriptions (rosbag2_storage, ``Rosbag2QoS::adapt_request_to_offers``).
    """
    profiles = list(offered)
    reliable = all(profile.reliability == ReliabilityPolicy.RELIABLE for profile in profiles)
    kept = all(profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for profile in profiles)
    make: Any = QoSProfile  # without type hints in rclpy of Jazzy
    profile: QoSProfile = make(
        history=HistoryPolicy.KEEP_LAST,
        depth=DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if kept else DurabilityPolicy.VOLATILE,
    )
    return profile


def offered_qos(profile: Any) -> OfferedQos:
    """Return what a publisher offers, in the words of a bag."""
    return OfferedQos(
        history=profile.history.name.lower(),
        depth=profile.depth,
        reliability=profile.reliability.name.lower(),
        durability=profile.durability.name.lower(),
        deadline_ns=min(profile.deadline.nanoseconds, INFINITE_NS),
        lifespan_ns=min(profile.lifespan.nanoseconds, INFINITE_NS),
        liveliness=profile.liveliness.name.lower(),
        lease_ns=min(profile.liveliness_lease_duration.nanoseconds, INFINITE_NS),
    )


def _type_hash(publishers: list[TopicEndpointInfo]) -> str:
    """Return the hash of the type as the publishers announce it, '' if none does."""
    for publisher in publishers:
        text = str(publisher.topic_type_hash)
        if text.startswith('RIHS'):
            return text
    return ''
