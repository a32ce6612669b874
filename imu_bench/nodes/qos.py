# SPDX-License-Identifier: Apache-2.0
"""
Quality of service of the bench (REP-2003), open to overrides.

Drivers publish reliably; consumers subscribe with the best-effort sensor-data profile.
Both can be changed per topic with the standard read-only parameters
``qos_overrides.<topic>.<publisher|subscription>.<history|depth|reliability>``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from imu_bench.errors import ConfigError
from rcl_interfaces.msg import SetParametersResult
from rclpy.callback_groups import CallbackGroup
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
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


MEMORY = 64 * 2**20
"""Bytes that the middleware may hold for one subscription."""

MOST = 5000
"""
Messages that Fast DDS holds at most per topic, whatever the depth (its default of
``resource_limits.max_samples``); a deeper history refuses new messages instead of old ones.
"""

LARGE = 64 * 2**10
"""Bytes taken for a message whose type holds sequences: its size is not known before it comes."""


def depth(message: Any) -> int:
    """Return how many messages of a type a subscription may hold that wants all of them."""
    kinds = message.get_fields_and_field_types().values()
    return min(MOST, MEMORY // LARGE) if any('sequence<' in kind for kind in kinds) else MOST


def requested(offered: Iterable[QoSProfile], depth: int) -> QoSProfile:
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
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if kept else DurabilityPolicy.VOLATILE,
    )
    return profile


def create_publisher(node: Node, message: type, topic: str, profile: QoSProfile) -> Publisher:
    """Return a publisher whose profile the user can override."""
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
    callback_group: CallbackGroup | None = None,
) -> Subscription:
    """Return a subscription whose profile the user can override; raw ones hand over CDR bytes."""
    make = node.create_subscription
    options = {'raw': raw, 'callback_group': callback_group}
    made: Subscription = _create(make, node, topic, message, topic, callback, profile, **options)
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
