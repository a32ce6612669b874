# SPDX-License-Identifier: Apache-2.0
"""
The analysis node: rolling noise metrics of every Imu topic of the bench.

Messages are taken raw, only appended to a list when they arrive, and decoded in blocks a few
times a second.  On the events executor this costs about 10 µs per message; the default one
saturates a core at 8000 messages per second.  The fits of the sensors are spread over
the publishing period, so that no burst of them delays the taking of messages.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from imu_bench.bags.sensor_messages import IMU
from imu_bench.config import ANALYSIS_SETTINGS, Setting
from imu_bench.errors import BenchError
from imu_bench.nodes import discovery, parameters, qos
from imu_bench.nodes.diagnostics import Diagnostics, number
from imu_bench.nodes.live_analysis import LiveAnalysis, LiveResult
from imu_bench.nodes.metric_topics import MetricTopics
from imu_bench.nodes.topic_names import IMU_TYPE
from msg_conversions import building, cdr
from rclpy.node import Node
from sensor_msgs.msg import Imu

SETTINGS = (
    *ANALYSIS_SETTINGS,
    Setting('topics', (), 'Imu topics to analyse; none for every …/imu/data_raw there is.'),
    Setting('publish_rate_hz', 1.0, 'How often metrics are published.', (), (0.01, 5.0), 'Hz'),
    Setting(
        'reliability',
        'best_effort',
        'Of the subscriptions (REP-2003); qos_overrides change single ones.',
        allowed=tuple(qos.RELIABILITY),
    ),
    Setting('depth', 5000, 'Messages a subscription holds.', (), (1, 1_000_000)),
)

TICK_S = 0.1
"""Messages are decoded this often."""

SEARCH_S = 1.0
SILENCE_S = 3.0

GOLDEN = 0.6180339887498949
"""Fractional part of the golden ratio: its multiples spread any number of sensors evenly."""


class Watch:
    """One Imu topic: what arrived, what was made of it."""

    def __init__(self, node: Node, topic: str, settings: Mapping[str, Any], due_s: float) -> None:
        self.topic = topic
        self.analysis = LiveAnalysis(settings['window_s'], settings['confidence'])
        self.result: LiveResult | None = None
        self.due_s = due_s
        self.malformed = 0
        self.error = ''
        self.heard_s = 0.0
        self.before: tuple[int, ...] = (0, 0, 0, 0)
        self._blobs: list[bytes] = []
        self._metrics = MetricTopics(node, topic)
        profile = qos.keep_last(settings['depth'], settings['reliability'])
        # list.append itself is the callback: nothing is cheaper
        qos.create_subscription(node, Imu, topic, self._blobs.append, profile, raw=True)

    @property
    def name(self) -> str:
        """The sensor: the part of the topic before imu/data_raw."""
        return self.topic.removesuffix('/' + IMU).rpartition('/')[2] or self.topic

    def digest(self, now_s: float) -> None:
        """Decode what has arrived."""
        blobs = self._blobs[:]
        if not blobs:
            return
        del self._blobs[: len(blobs)]
        self.heard_s = now_s
        try:
            block = cdr.decode_imu(blobs)
        except ValueError:
            block = cdr.decode_imu([blob for blob in blobs if self._whole(blob)])
        self._attempt(lambda: self.analysis.add(block))

    def _whole(self, blob: bytes) -> bool:
        try:
            cdr.decode_imu([blob])
        except ValueError:
            self.malformed += 1
            return False
        return True

    def publish(self) -> None:
        """Compute and publish the metrics of the window, if there is one."""
        self._attempt(self._publish)

    def _publish(self) -> None:
        self.result = self.analysis.result()
        if self.result is not None:
            self._metrics.publish(self.result)

    def _attempt(self, action: Callable[[], None]) -> None:
        """One sensor whose data cannot be analysed must not stop the analysis of the others."""
        try:
            action()
        except BenchError as error:
            self.error = str(error)

    @property
    def faults(self) -> tuple[int, ...]:
        """Counts that only grow: malformed, not finite, missing in the window, restarts."""
        window = None if self.result is None else self.result.window
        left_out, missing = (0, 0) if window is None else (window.left_out, window.missing)
        return (self.malformed, left_out, missing, self.analysis.restarts)


class AnalysisNode(Node):
    """
    Watches Imu topics and publishes metrics beside them.

    Raises
    ------
    ConfigError
        If a parameter is wrong: each with its name, its value and what is allowed.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(
            'analysis_node', automatically_declare_parameters_from_overrides=True, **options
        )
        self.settings = parameters.read(self, SETTINGS)
        self.watches: dict[str, Watch] = {}
        self._busy_s = 0.0
        self._last = (time.monotonic(), time.process_time(), 0, 0.0)
        for topic in self.settings['topics']:
            self._watch(self.resolve_topic_name(topic))
        if not self.watches:
            self.create_timer(SEARCH_S, self._search)
        self.create_timer(TICK_S, self._tick)
        self._diagnostics = Diagnostics(self, self._statuses)

    def _search(self) -> None:
        for topic in discovery.find(self, IMU_TYPE, IMU):
            if topic not in self.watches:
                self._watch(topic)

    def _watch(self, topic: str) -> None:
        untyped: Any = self  # rclpy of Jazzy has few type hints
        untyped.get_logger().info(f'analysing {topic}')
        phase = len(self.watches) * GOLDEN % 1.0 / self.settings['publish_rate_hz']
        due_s = time.monotonic() + phase
        self.watches[topic] = Watch(self, topic, self.settings, due_s)

    def _tick(self) -> None:
        now, began = time.monotonic(), time.thread_time()
        for watch in self.watches.values():
            watch.digest(now)
        period = 1.0 / self.settings['publish_rate_hz']
        for watch in self.watches.values():
            if watch.due_s <= now:
                # a late one keeps its phase and skips what it has missed
                watch.due_s += period * max(1.0, (now - watch.due_s) // period + 1.0)
                watch.publish()
        self._busy_s += time.thread_time() - began

    def close(self) -> None:
        """Say the last of what is known."""
        if self.context.ok():
            self._diagnostics.publish()

    def _statuses(self) -> list[DiagnosticStatus]:
        return [self._load(), *(self._status(watch) for watch in self.watches.values())]

    def _load(self) -> DiagnosticStatus:
        """Return how busy this process is."""
        received = sum(watch.analysis.received for watch in self.watches.values())
        now = (time.monotonic(), time.process_time(), received, self._busy_s)
        wall, cpu, messages, busy = (b - a for a, b in zip(self._last, now, strict=True))
        self._last = now
        values = {
            'topics': len(self.watches),
            'messages_per_s': f'{messages / wall:.1f}',
            'cpu_share': f'{cpu / wall:.3f}',
            'analysis_share': f'{busy / wall:.3f}',
        }
        message = f'{len(self.watches)} topics' if self.watches else 'no Imu topic found yet'
        level = 'ok' if self.watches else 'warn'
        return building.diagnostic_status('analysis_node: load', level, message, '', values)

    def _status(self, watch: Watch) -> DiagnosticStatus:
        analysis, result = watch.analysis, watch.result
        level, message = self._judge(watch)
        values: dict[str, Any] = {
            'topic': watch.topic,
            'received': analysis.received,
            'malformed': watch.malformed,
            'restarts': analysis.restarts,
            'publishers': self.count_publishers(watch.topic),
            'rate_hz': f'{analysis.rate_hz:.9g}',
            'window_s': f'{analysis.window_s:g}',
        }
        if result is not None:
            window = result.window
            span_s = (window.end_ns - window.start_ns) * 1e-9
            values |= {
                'window_filled': f'{min(1.0, span_s / analysis.window_s):.4f}',
                'window_start_ns': window.start_ns,
                'window_end_ns': window.end_ns,
                'window_samples': window.samples,
                'window_missing': window.missing,
                'window_truncated': window.truncated,
                'not_finite': window.left_out,
                'duplicates': window.duplicates,
                'order_faults': window.order_faults,
            }
            for metric, axes in result.metrics.items():
                for axis, estimate in axes.items():
                    values |= number(f'{metric}.{axis}', estimate)
        return building.diagnostic_status(
            f'{watch.name}: analysis', level, message, watch.topic, values
        )

    def _judge(self, watch: Watch) -> tuple[str, str]:
        """Return level and one line about a watch."""
        faults, before = watch.faults, watch.before
        watch.before = faults
        if watch.error:
            error, watch.error = watch.error, ''
            return 'error', error
        if time.monotonic() - watch.heard_s > SILENCE_S:
            return 'stale', f'no message for {SILENCE_S:g} s'
        if self.count_publishers(watch.topic) > 1:
            return 'warn', 'several publishers: their samples are analysed as one sensor'
        names = ('malformed', 'not finite', 'missing', 'restarts')
        grown = [
            f'{now - then} {name}'
            for name, then, now in zip(names, before, faults, strict=True)
            if now > then
        ]
        if grown:
            return 'warn', f'since the last report: {", ".join(grown)}'
        if watch.result is None:
            return 'ok', watch.analysis.reason
        return 'ok', 'analysing'
