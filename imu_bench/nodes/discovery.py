# SPDX-License-Identifier: Apache-2.0
"""Finding topics in the ROS graph."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib import import_module
import re
from types import MappingProxyType

from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

_NAME = re.compile(r'(?=.{,247}$)(/[A-Za-z_]\w*)+', re.ASCII)
_TYPE = re.compile(r'[A-Za-z]\w*/\w+/\w+', re.ASCII)
"""
What ROS 2 can subscribe to: rmw, validate_full_topic_name.c, and rosidl.  Other programs of the
domain may call their topics and types whatever DDS permits.
"""


def matching(
    topics: Iterable[tuple[str, Iterable[str]]],
    type_name: str = '',
    known: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, str]:
    """
    Return the topics of a type, as name to type, sorted.

    A topic that somebody uses with another type than the one that is asked for, or that it is
    known to have, has the right one all the same; of others with two types none is the right one.
    """
    found = {}
    for name, types in topics:
        kinds = {kind for kind in types if _TYPE.fullmatch(kind)}
        own = type_name or known.get(name, '')
        if own:
            kinds &= {own}
        if len(kinds) == 1 and _NAME.fullmatch(name):
            found[name] = kinds.pop()
    return dict(sorted(found.items()))


def find(
    node: Node, type_name: str = '', known: Mapping[str, str] = MappingProxyType({})
) -> dict[str, str]:
    """Return the topics the node can see now that match; see `matching`."""
    return matching(node.get_topic_names_and_types(), type_name, known)


def publishers(node: Node, topic: str, type_name: str) -> list[TopicEndpointInfo]:
    """Return who publishes a topic with its type; somebody may have another there."""
    every = node.get_publishers_info_by_topic(topic)
    return [each for each in every if each.topic_type == type_name]


def hidden(topic: str) -> bool:
    """Return whether a topic is hidden: a part of its name begins with an underscore."""
    return '/_' in topic


def message_class(kind: str) -> type | None:
    """Return the Python class of a message type, None if it is not installed."""
    package, _, name = kind.split('/')
    try:
        found: type = getattr(import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError):
        return None
    return found
