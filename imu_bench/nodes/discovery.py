# SPDX-License-Identifier: Apache-2.0
"""Finding topics in the ROS graph."""

from __future__ import annotations

from collections.abc import Iterable

from rclpy.node import Node


def matching(
    topics: Iterable[tuple[str, Iterable[str]]], type_name: str = '', suffix: str = ''
) -> dict[str, str]:
    """Return the topics of a type whose name ends in `suffix`, as name to type, sorted."""
    found = {}
    for name, types in topics:
        # a topic that two nodes use with two types cannot be subscribed to by name
        single = list(types)
        if len(single) != 1 or (type_name and single[0] != type_name):
            continue
        if not suffix or name == suffix or name.endswith('/' + suffix):
            found[name] = single[0]
    return dict(sorted(found.items()))


def find(node: Node, type_name: str = '', suffix: str = '') -> dict[str, str]:
    """Return the topics the node can see now that match; see `matching`."""
    return matching(node.get_topic_names_and_types(), type_name, suffix)


def hidden(topic: str) -> bool:
    """Return whether a topic is hidden: a part of its name begins with an underscore."""
    return '/_' in topic
