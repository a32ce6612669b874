# SPDX-License-Identifier: Apache-2.0
"""
Quality of service of the bench (REP-2003), open to overrides.

Drivers publish reliably; consumers subscribe with the best-effort sensor-data profile.
Both can be changed per topic with the standard read-only parameters
``qos_overrides.<topic>.<publisher|subscription>.<history|depth|reliability>``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from imu_bench.errors import ConfigError
from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from rclpy.subscription import Subscription

RELIABILITY = {
    'reliable': ReliabilityPolicy.RELIABLE,
    'best_effort': ReliabilityPolicy.BEST_EFFORT,
}


def keep_last(depth: int, reliability: str) -> QoSProfile:
    """Return a volatile profile; `reliability` is 'reliable' or 'best_effort'."""
    profile: Any = QoSProfile  # without type hints in rclpy of Jazzy
    made: QoSProfile = profile(
        history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=RELIABILITY[reliability]
    )
    return made


def create_publisher(node: Node, message: type, topic: str, profile: QoSProfile) -> Publisher:
    """
    Return a publisher whose profile the user can override.

    Raises
    ------
    ConfigError
        If an override is not acceptable.
    """
    make = node.create_publisher
    publisher: Publisher = _create(make, node, topic, message, topic, profile)
    return publisher


def create_subscription(
    node: Node,
    message: type,
    topic: str,
    callback: Callable[..., None],
    profile: QoSProfile,
    *,
    raw: bool = False,
) -> Subscription:
    """
    Return a subscription whose profile the user can override; raw ones hand over CDR bytes.

    Raises
    ------
    ConfigError
        If an override is not acceptable.
    """
    make = node.create_subscription
    made: Subscription = _create(make, node, topic, message, topic, callback, profile, raw=raw)
    return made


def _create(make: Callable[..., Any], node: Node, topic: str, *args: Any, **options: Any) -> Any:
    policies = QoSOverridingOptions.with_default_policies(callback=_acceptable)
    try:
        return make(*args, qos_overriding_options=policies, **options)
    except (ParameterException, InvalidQosOverridesError, RuntimeError) as error:
        if not node.context.ok():
            raise
        raise ConfigError(
            f'qos_overrides.{node.resolve_topic_name(topic)}: {error}; allowed are history '
            'keep_last or keep_all, depth 1 or more, reliability reliable or best_effort'
        ) from error


def _acceptable(profile: QoSProfile) -> SetParametersResult:
    depth = int(profile.depth)
    return SetParametersResult(successful=depth > 0, reason=f'a depth of {depth} holds nothing')
