# SPDX-License-Identifier: Apache-2.0
"""Samples of one sensor onto its topics, a block at a time."""

from __future__ import annotations

from collections.abc import Iterable
import math
import secrets
import threading
import time
from typing import Any

from geometry_msgs.msg import Vector3Stamped
from imu_bench.bus.interface import Clock
from imu_bench.config import SensorConfig
from imu_bench.nodes import qos
from imu_bench.nodes.discovery import message_class
from imu_bench.samples import Samples
from msg_conversions import blocks
from msg_conversions.encoding import independent, SensorEncoder
from msg_conversions.quantities import IMU, TYPES
from msg_conversions.transforms import Mounting, static_transform, TF_STATIC, TF_TYPE
import numpy as np
import numpy.typing as npt
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy
from sensor_msgs.msg import Imu, MagneticField, Temperature
from std_msgs.msg import UInt8MultiArray

HISTORY_S = 3.0
"""
So much a publisher keeps for those who want every sample: after a recovery up to a second of
samples, held back until their stamps are known, goes out at once, and may do so twice in a row.
A longer history of single messages would take the machine down when a reader stops: Fast DDS
copies a list of all that is not acknowledged with every message.
"""

BLOCK_S = 0.03
BLOCK_BYTES = 32 << 10
"""
A block has so much time in it, or so many bytes: it fits into one datagram of UDP.  Samples of a
reading process come twenty times a second, give or take a burst: each time makes a block, and ten
seconds of a sensor are two hundred of them.
"""

BLOCKS_KEPT = 64 << 20
"""Bytes of blocks that a publisher keeps for a recorder that is away: 3 min at 1 kHz."""

FIRST_S = 10.0
"""
So long the first blocks wait for somebody to take them: a recorder that was started before the
sensor finds it within that time, and has it from the first sample on.
"""

_PROCESS = secrets.randbits(32)

DELIVERY = Duration(seconds=2.0)
"""What a reliable reader has not taken by then it does not get: a publisher forgets as it goes."""

_MESSAGES = {
    f'{type_.__module__.partition(".")[0]}/msg/{type_.__name__}': type_
    for type_ in (Imu, MagneticField, Temperature, Vector3Stamped)
}


class SensorTopics:
    """
    Publishes Samples as serialised messages: no message object is ever made.

    A topic exists as soon as the sensor has something for it.  Single messages are published
    while somebody has subscribed to them; to the recorder and the analysis the same messages
    go as blocks, on a hidden topic (`msg_conversions.blocks`).
    """

    def __init__(self, node: Node, config: SensorConfig, rate_hz: float, clock: Clock) -> None:
        # by topic how many messages, and the stamp of the last
        self.published: dict[str, tuple[int, int]] = {}
        self._node, self._clock = node, clock
        self._depth = max(10, math.ceil(HISTORY_S * rate_hz))
        self._publishers: dict[str, Publisher] = {}
        self._encoder = SensorEncoder(config.frame_id, independent(config.stddevs))
        self._one = threading.Lock()
        # the process in its upper half: a sensor that is configured anew is no second one
        self._number = _PROCESS << 32 | secrets.randbits(32)
        profile = qos.keep_last(BLOCKS_KEPT // BLOCK_BYTES, 'reliable')
        self._blocks: Publisher = node.create_publisher(UInt8MultiArray, blocks.TOPIC, profile)
        self._parts: list[blocks.Part] = []
        self._bytes = 0
        self._began_s = self._flushed_s = time.monotonic()
        self._publisher(IMU)
        if config.mounting is not None:
            self._place(config.frame_id, config.mounting)

    def _place(self, frame_id: str, mounting: Mounting) -> None:
        """Say once and for all who ask where the sensor is."""
        message = message_class(TF_TYPE)
        if message is None:
            untyped: Any = self._node  # rclpy of Jazzy has few type hints
            untyped.get_logger().warning(f'no {TF_STATIC}: tf2_msgs is not installed here')
            return
        profile = qos.keep_last(1, 'reliable')
        profile.durability = DurabilityPolicy.TRANSIENT_LOCAL
        self._publishers[TF_STATIC] = self._node.create_publisher(message, TF_STATIC, profile)
        told = static_transform(self._clock.now_ns(), frame_id, mounting)
        self._publishers[TF_STATIC].publish(told)

    @property
    def heard(self) -> bool:
        """Whether a recorder takes the blocks."""
        topic = self._blocks.topic_name
        found = self._node.get_subscriptions_info_by_topic(topic)
        return any(each.node_name.startswith('recorder') for each in found)

    def publish(self, runs: Iterable[Samples]) -> None:
        """Publish everything that runs carry, in the order of their stamps."""
        with self._one:
            for run in runs:
                for topic, stamps, rows in self._encoder.encode(run.stamps, run.columns):
                    self._send(topic, int(stamps[-1]), rows)
            if time.monotonic() - self._flushed_s >= BLOCK_S:
                self._flush()

    def flush(self) -> None:
        """Hand over the block that is not full yet."""
        with self._one:
            self._flush()

    def close(self) -> None:
        """Take the topics down, once everybody who wants every sample has the last one."""
        self.flush()
        for publisher in (*self._publishers.values(), self._blocks):
            if self._node.context.ok():
                publisher.wait_for_all_acked(DELIVERY)
            self._node.destroy_publisher(publisher)
        self._publishers.clear()

    def _send(self, topic: str, until_ns: int, rows: npt.NDArray[np.uint8]) -> None:
        publisher = self._publisher(topic)
        count, _ = self.published.get(topic, (0, 0))
        now_ns, most = self._clock.now_ns(), max(1, BLOCK_BYTES // rows.shape[1])
        for start in range(0, len(rows), most):
            part = rows[start : start + most]
            self._parts.append(blocks.Part(topic, count + start, now_ns, part))
        self._bytes += rows.nbytes
        self.published[topic] = count + len(rows), until_ns
        if publisher.get_subscription_count():
            joined, size = rows.tobytes(), rows.shape[1]
            for edge in range(0, len(joined), size):
                publisher.publish(joined[edge : edge + size])
        if self._bytes >= BLOCK_BYTES:
            self._flush()

    def _flush(self) -> None:
        now = self._flushed_s = time.monotonic()
        if not self._parts or not self._node.context.ok():
            return
        heard = self._blocks.get_subscription_count()
        if not heard and now - self._began_s < FIRST_S:
            return
        if heard:
            for parts in _blocks(self._parts):
                self._blocks.publish(blocks.encode(self._number, parts))
        self._parts, self._bytes = [], 0

    def _publisher(self, topic: str) -> Publisher:
        if topic not in self._publishers:
            profile = qos.keep_last(self._depth, 'reliable')
            self._publishers[topic] = qos.create_publisher(
                self._node, _MESSAGES[TYPES[topic]], topic, profile
            )
        return self._publishers[topic]


def _blocks(parts: Iterable[blocks.Part]) -> Iterable[list[blocks.Part]]:
    """Yield so many parts together as fit into a block."""
    held: list[blocks.Part] = []
    size = 0
    for part in parts:
        if held and size + part.messages.nbytes > BLOCK_BYTES:
            yield held
            held, size = [], 0
        held.append(part)
        size += part.messages.nbytes
    yield held
