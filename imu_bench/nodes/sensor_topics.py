# SPDX-License-Identifier: Apache-2.0
"""Samples of one sensor onto its topics, a block at a time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
import math

from geometry_msgs.msg import Vector3Stamped
from imu_bench.bags.sensor_messages import IMU, INCLINATION, MAGNETIC_FIELD, TEMPERATURE
from imu_bench.config import SensorConfig
from imu_bench.nodes import qos
from imu_bench.nodes.topic_names import ORIENTATION
from imu_bench.samples import Samples
from msg_conversions import cdr, covariance
from msg_conversions.templates import ImuTemplate, Template
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import Imu, MagneticField, Temperature

HISTORY_S = 3.0
"""
So much a publisher keeps for those who want every sample: after a recovery up to a second of
samples, held back until their stamps are known, goes out at once, and may do so twice in a row.
"""

DELIVERY = Duration(seconds=2.0)
"""What a reliable reader has not taken by then it does not get: a publisher forgets as it goes."""

_MESSAGES = {
    IMU: Imu,
    ORIENTATION: Imu,
    MAGNETIC_FIELD: MagneticField,
    TEMPERATURE: Temperature,
    INCLINATION: Vector3Stamped,
}


class SensorTopics:
    """
    Publishes Samples as serialised messages: no message object is ever made.

    A topic exists as soon as the sensor has something for it.  Of the temperature, which
    changes slowly and comes with every sample, the newest of each block is published.

    Parameters
    ----------
    node : Node
    config : SensorConfig
        frame_id and standard deviations (REP-145).
    rate_hz : float
        Of the sensor; publishers hold one second.

    Attributes
    ----------
    published : Counter
        Messages per topic.
    """

    def __init__(self, node: Node, config: SensorConfig, rate_hz: float) -> None:
        self.published: Counter[str] = Counter()
        self._node = node
        self._config = config
        self._depth = max(10, math.ceil(HISTORY_S * rate_hz))
        self._publishers: dict[str, Publisher] = {}
        self._templates: dict[tuple[bool, bool, bool], ImuTemplate] = {}
        self._magnetic_field = Template(
            config.frame_id,
            (0.0, 0.0, 0.0, *covariance.diagonal(config.stddevs['magnetic_field'])),
        )
        self._temperature = Template(config.frame_id, (0.0, 0.0))
        self._inclination = Template(config.frame_id, (0.0, 0.0, 0.0))
        self._publisher(IMU)

    def publish(self, run: Samples) -> None:
        """Publish everything a run carries, in the order of its stamps."""
        if not len(run):
            return
        moves, turns = run.acceleration is not None, run.angular_velocity is not None
        if moves or turns:
            template = self._imu_template(moves, turns)
            blobs = template.encode_imu(run.stamps, run.acceleration, run.angular_velocity)
            self._send(IMU, blobs)
        if run.orientation is not None:
            template = self._imu_template(moves, turns, orientation=True)
            motion = run.acceleration, run.angular_velocity
            blobs = template.encode_imu(run.stamps, *motion, run.orientation)
            self._send(ORIENTATION, blobs)
        if run.magnetic_field is not None:
            part = (cdr.MAGNETIC_FIELD_VECTOR, run.magnetic_field)
            self._send(MAGNETIC_FIELD, self._magnetic_field.encode(run.stamps, part))
        if run.temperature is not None:
            newest = (cdr.TEMPERATURE_VALUE, run.temperature[-1:, None])
            self._send(TEMPERATURE, self._temperature.encode(run.stamps[-1:], newest))
        if run.inclination is not None:
            part = (cdr.VECTOR3_VECTOR, run.inclination)
            self._send(INCLINATION, self._inclination.encode(run.stamps, part))

    def close(self) -> None:
        """Take the topics down, once everybody who wants every sample has the last one."""
        for publisher in self._publishers.values():
            if self._node.context.ok():
                publisher.wait_for_all_acked(DELIVERY)
            self._node.destroy_publisher(publisher)
        self._publishers.clear()

    def _send(self, topic: str, blobs: list[bytes]) -> None:
        publish: Callable[[bytes], None] = self._publisher(topic).publish
        for blob in blobs:
            publish(blob)
        self.published[topic] += len(blobs)

    def _publisher(self, topic: str) -> Publisher:
        if topic not in self._publishers:
            profile = qos.keep_last(self._depth, 'reliable')
            self._publishers[topic] = qos.create_publisher(
                self._node, _MESSAGES[topic], topic, profile
            )
        return self._publishers[topic]

    def _imu_template(
        self, acceleration: bool, angular_velocity: bool, orientation: bool = False
    ) -> ImuTemplate:
        key = (acceleration, angular_velocity, orientation)
        if key not in self._templates:
            stddevs = self._config.stddevs
            names = 'linear_acceleration', 'angular_velocity', 'orientation'
            covariances = [
                covariance.diagonal(stddevs[name]) if present else covariance.NOT_REPORTED
                for name, present in zip(names, key, strict=True)
            ]
            self._templates[key] = ImuTemplate(
                self._config.frame_id,
                acceleration_covariance=covariances[0],
                angular_velocity_covariance=covariances[1],
                orientation_covariance=covariances[2],
            )
        return self._templates[key]
