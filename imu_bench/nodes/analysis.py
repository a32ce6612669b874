# SPDX-License-Identifier: Apache-2.0
"""
The analysis node: rolling noise metrics of every Imu topic of the bench.

A thread takes messages raw, decodes them in blocks a few times a second, and publishes what
follows.  The fits of the sensors are spread over the publishing period.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from fnmatch import fnmatchcase
import math
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from imu_bench.account import SEVERAL, several
from imu_bench.config import ANALYSIS_SETTINGS, Setting
from imu_bench.errors import BenchError
from imu_bench.live.status import number
from imu_bench.nodes import discovery, parameters
from imu_bench.nodes.diagnostics import Diagnostics
from imu_bench.nodes.intake import Intake
from imu_bench.nodes.live_analysis import LiveAnalysis, LiveResult
from imu_bench.nodes.metric_topics import MetricTopics
from imu_bench.nodes.sequences import Sequences
from imu_bench.nodes.topic_names import IMU_TYPE, watched_name
from imu_bench.samples import Samples
from msg_conversions import building, cdr
from msg_conversions.cdr import ImuBlock
from msg_conversions.quantities import IMU, ORIENTATION_TOPIC
import numpy as np
import numpy.typing as npt
from rclpy.node import Node
from sensor_msgs.msg import Imu
from std_srvs.srv import Trigger

SETTINGS = (
    *ANALYSIS_SETTINGS,
    Setting(
        'topics',
        (),
        "Imu topics to analyse: names, or patterns such as '*/imu/data_raw'; none for every one "
        'there is, but imu/data beside an imu/data_raw.',
    ),
    Setting(
        'publish_rate_hz',
        1.0,
        'How often metrics are published at most: a hundredth of the window has to be new, and '
        'the metrics of all sensors take a twentieth of a core.',
        bounds=(0.01, 5.0),
        unit='Hz',
    ),
)

DIGEST_S = 0.5
"""Messages are decoded this often, and before metrics are made of them."""

SHARE = 0.05
"""
Share of a core that the metrics may take.  They cost 60 ms for a sensor at 1 kHz here, three
times as long on a Raspberry Pi 4, whose cores are for reading and recording first.
"""

FAULTS = (
    'malformed', 'not finite', 'missing', 'restarts', 'stamps of zero', 'jumps of the stamps',
    'not arrived',
)  # fmt: skip
"""What diagnostics warn of when there is more of it."""

PATTERN = set('*?[')

OUTLIERS = 'outliers in the window are in its metrics; imu-bench analyze leaves them out'

SEARCH_S = 0.25
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
        self.cost_s = 0.0
        self.followed = False
        self.several: list[str] = []
        self.malformed = 0
        self.error = ''
        self.heard_s = 0.0
        self.before: tuple[int, ...] = (0,) * len(FAULTS)
        self._published = 0  # samples there were when metrics were published last
        self._arrived: list[npt.NDArray[np.uint8]] = []
        self._digested_s = 0.0
        self._metrics = MetricTopics(node, topic)

    def reset(self) -> None:
        """Empty the window, of what has not been decoded yet, too."""
        self._arrived = []
        self.result = None
        self.analysis.reset()

    def take(self, messages: npt.NDArray[np.uint8]) -> None:
        """Take messages of one length, shape (n, bytes)."""
        self._arrived.append(messages)

    def digest(self, now_s: float) -> None:
        """Decode what has arrived, if it is time."""
        if not self._arrived or (self.due_s > now_s and now_s - self._digested_s < DIGEST_S):
            return
        self._digested_s = self.heard_s = now_s
        parts, self._arrived = self._arrived, []
        sizes = np.concatenate([np.full(len(part), part.shape[1]) for part in parts])
        data = b''.join(part.tobytes() for part in parts)
        offsets = np.cumsum(sizes) - sizes
        try:
            block = cdr.decode_imu_at(data, offsets, sizes)
        except ValueError:
            whole = self._whole(data, offsets, sizes)
            block = cdr.decode_imu_at(data, offsets[whole], sizes[whole])
        if len(block):
            self._attempt(lambda: self.analysis.add(samples_of(block), block.frame_ids[-1]))

    def _whole(
        self, data: bytes, offsets: npt.NDArray[np.int64], sizes: npt.NDArray[np.int64]
    ) -> npt.NDArray[np.bool_]:
        """Return which messages can be decoded; count the others."""
        starts, ends = offsets.tolist(), (offsets + sizes).tolist()
        blobs = [data[start:end] for start, end in zip(starts, ends, strict=True)]
        whole = np.array([_decodes(blob) for blob in blobs])
        self.malformed += int(np.count_nonzero(~whole))
        return whole

    def publish(self) -> None:
        """Compute and publish the metrics of the window, if there is one with something new."""
        if self._published == self.analysis.received:
            return
        began = time.thread_time()
        self._attempt(self._publish)
        self.cost_s = time.thread_time() - began

    def _publish(self) -> None:
        self._published = self.analysis.received
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
        """Counts that only grow, all of `FAULTS` but the last."""
        window = None if self.result is None else self.result.window
        left_out, missing = (0, 0) if window is None else (window.left_out, window.missing)
        analysis = self.analysis
        stamps = (analysis.zero_stamps, analysis.jumps)
        return (self.malformed, left_out, missing, analysis.restarts, *stamps)


def affordable_s(cost_s: float, sensors: int) -> float:
    """Return how often metrics may be computed that take so long, beside other sensors."""
    return sensors * cost_s / SHARE


def _decodes(blob: bytes) -> bool:
    try:
        cdr.decode_imu([blob])
    except ValueError:
        return False
    return True


def samples_of(block: ImuBlock) -> Samples:
    """Return what the messages report, by their covariances (REP-145)."""
    return Samples(
        block.stamps,
        block.acceleration if block.has_acceleration else None,
        block.angular_velocity if block.has_angular_velocity else None,
    )


class AnalysisNode(parameters.FromDump):
    """Watches Imu topics and publishes metrics beside them."""

    def __init__(self, **options: Any) -> None:
        super().__init__(
            'analysis_node', automatically_declare_parameters_from_overrides=True, **options
        )
        self.settings = parameters.read(self, SETTINGS)
        self.watches: dict[str, Watch] = {}
        self._busy_s = 0.0
        self._last = (time.monotonic(), time.process_time(), 0, 0.0)
        self._listed = [
            topic if PATTERN & set(topic) else self.resolve_topic_name(topic)
            for topic in self.settings['topics']
        ]
        for topic in self._listed:
            if not PATTERN & set(topic):
                self._watch(topic)
        self._reset_asked = False
        self.create_service(Trigger, '~/reset', self._reset)
        self._searched_s = -math.inf
        self.intake = Intake(self, self._wants, self._take, self._tend)
        self.ended = self.intake.ended  # done with an error that keeps it from going on
        self._diagnostics = Diagnostics(self, self._statuses)
        self.intake.start()

    def _wants(self, topic: str) -> bool:
        """Return whether a topic is analysed, by its name alone: that is known in blocks."""
        if topic in self._listed:
            return True
        raw = topic.endswith('/' + IMU)
        return raw and (not self._listed or self._chosen(topic, ()))

    def _chosen(self, topic: str, others: Container[str]) -> bool:
        """Return whether an Imu topic is analysed, among others."""
        if self._listed:
            return any(fnmatchcase(topic, pattern) for pattern in self._listed)
        same = topic.removesuffix(ORIENTATION_TOPIC) + IMU
        twice = topic.endswith('/' + ORIENTATION_TOPIC) and same in others
        return not twice and not discovery.hidden(topic)

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._reset_asked = True  # done by the thread that has the windows
        response.success = True
        response.message = f'{len(self.watches)} windows begin anew'
        return response

    def _search(self) -> None:
        """Follow the topics that somebody publishes by now."""
        found = discovery.find(self, IMU_TYPE)
        for topic in found:
            followed = topic in self.watches and self.watches[topic].followed
            if followed or not self._chosen(topic, found):
                continue
            publishers = discovery.publishers(self, topic, IMU_TYPE)
            if topic not in self.watches:
                self._watch(topic)
            if publishers:
                self.watches[topic].followed = True
                self.intake.follow(topic, Imu, publishers)

    def _watch(self, topic: str) -> None:
        untyped: Any = self  # rclpy of Jazzy has few type hints
        untyped.get_logger().info(f'analysing {topic}')
        phase = len(self.watches) * GOLDEN % 1.0 / self.settings['publish_rate_hz']
        due_s = time.monotonic() + phase
        self.watches[topic] = Watch(self, topic, self.settings, due_s)

    def _take(
        self, topic: str, receive_ns: npt.NDArray[np.int64], messages: npt.NDArray[np.uint8]
    ) -> None:
        self.watches[topic].take(messages)

    def _tend(self) -> None:
        now, began = time.monotonic(), time.thread_time()
        if now - self._searched_s >= SEARCH_S:
            self._searched_s = now
            self._search()
            for watch in self.watches.values():
                if watch.followed:
                    watch.several, _ = self.intake.several(watch.topic, Imu)
        if self._reset_asked:
            self._reset_asked = False
            for watch in self.watches.values():
                watch.reset()
        for watch in self.watches.values():
            watch.digest(now)
        for watch in self.watches.values():
            if watch.due_s <= now:
                period = max(
                    1.0 / self.settings['publish_rate_hz'],
                    watch.analysis.refresh_s,
                    affordable_s(watch.cost_s, len(self.watches)),
                )
                # a late one keeps its phase and skips what it has missed
                watch.due_s += period * max(1.0, (now - watch.due_s) // period + 1.0)
                watch.publish()
        self._busy_s += time.thread_time() - began

    def close(self) -> None:
        """Say the last of what is known."""
        self.intake.close(linger=True)
        for watch in self.watches.values():
            watch.digest(math.inf)
        if self.context.ok():
            self._diagnostics.publish()

    def _statuses(self) -> list[DiagnosticStatus]:
        return [self._load(), *(self._status(watch) for watch in self.watches.copy().values())]

    def _load(self) -> DiagnosticStatus:
        """Return how busy this process is."""
        received = sum(watch.analysis.received for watch in self.watches.copy().values())
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
        sequences = self.intake.sequences.get(watch.topic, Sequences())
        level, message = self._judge(watch, sequences.missed)
        values: dict[str, Any] = {
            'topic': watch.topic,
            'received': analysis.received,
            'missed': sequences.missed if sequences.known else 'not known',
            'first_sequence': sequences.before,
            'malformed': watch.malformed,
            'restarts': analysis.restarts,
            'zero_stamps': analysis.zero_stamps,
            'stamp_jumps': analysis.jumps,
            'publishers': self.count_publishers(watch.topic),
            **({SEVERAL + watch.topic: ', '.join(watch.several)} if watch.several else {}),
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
                'outliers': result.outliers,
                'duplicates': window.duplicates,
                'order_faults': window.order_faults,
            }
            for metric, axes in result.metrics.items():
                for axis, estimate in axes.items():
                    values |= number(f'{metric}.{axis}', estimate)
        return building.diagnostic_status(
            f'{watched_name(watch.topic)}: analysis', level, message, watch.topic, values
        )

    def _judge(self, watch: Watch, missed: int) -> tuple[str, str]:
        """Return level and one line about a watch."""
        faults, before = (*watch.faults, missed), watch.before
        watch.before = faults
        if watch.error:
            error, watch.error = watch.error, ''
            return 'error', error
        if watch.several:
            return 'error', several(watch.topic, ', '.join(watch.several))
        if time.monotonic() - watch.heard_s > SILENCE_S:
            return 'stale', f'no message for {SILENCE_S:g} s'
        grown = [
            f'{now - then} {name}'
            for name, then, now in zip(FAULTS, before, faults, strict=True)
            if now > then
        ]
        if grown:
            return 'warn', f'since the last report: {", ".join(grown)}'
        if watch.result is None:
            return 'ok', watch.analysis.reason
        if watch.result.outliers:
            return 'ok', f'analysing; {watch.result.outliers} {OUTLIERS}'
        return 'ok', 'analysing'
