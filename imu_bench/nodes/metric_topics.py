# SPDX-License-Identifier: Apache-2.0
"""Metrics of one sensor onto topics of their own."""

from __future__ import annotations

from collections.abc import Mapping
import math

from geometry_msgs.msg import Vector3Stamped
from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.estimate import Estimate
from imu_bench.nodes import qos
from imu_bench.nodes.live_analysis import LiveResult
from imu_bench.nodes.topic_names import METRICS, metrics_below
from msg_conversions import building
from msg_conversions.allan_layout import GIVEN
from msg_conversions.quantities import AXES, IMU_QUANTITIES
import numpy.typing as npt
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import Float64MultiArray

DEPTH = 10

AXIS_NAMES = tuple(f'{quantity.name}.{axis}' for quantity in IMU_QUANTITIES for axis in AXES)


class MetricTopics:
    """Publishes the metrics of a sensor."""

    def __init__(self, node: Node, data_topic: str) -> None:
        self._node = node
        self._base = metrics_below(data_topic)
        self._publishers: dict[str, Publisher] = {}

    def publish(self, result: LiveResult) -> None:
        """Publish everything; quantities that the sensor does not report have no topic."""
        window = result.window
        curves = {name: _fields(result.curves.get(name)) for name in AXIS_NAMES}
        message = building.allan_message(curves, window.start_ns, window.end_ns)
        self._publisher('allan_deviation', Float64MultiArray).publish(message)
        for metric in METRICS:
            for quantity in result.quantities:
                vector = [_number(result.metrics[metric].get(f'{quantity}.{a}')) for a in AXES]
                self._publisher(f'{metric}/{quantity}', Vector3Stamped).publish(
                    building.vector3(window.end_ns, result.frame_id, vector)
                )

    def _publisher(self, name: str, message: type) -> Publisher:
        if name not in self._publishers:
            topic = f'{self._base}/{name}'
            profile = qos.keep_last(DEPTH, 'reliable')
            self._publishers[name] = qos.create_publisher(self._node, message, topic, profile)
        return self._publishers[name]


def _fields(curve: DeviationCurve | None) -> Mapping[str, npt.ArrayLike] | None:
    return None if curve is None else {name: getattr(curve, name) for name in GIVEN}


def _number(estimate: Estimate | None) -> float:
    """Return a value; NaN for an axis that is not there or not observable."""
    if estimate is None or estimate.value is None:
        return math.nan
    return estimate.value
