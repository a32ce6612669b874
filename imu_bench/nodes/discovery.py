# SPDX-License-Identifier: Apache-2.0
"""Finding topics in the ROS graph."""

from __future__ import annotations

from collections.abc import Iterable

from rclpy.node import Node


def matching(
    topics: Iterable[tuple[str, Iterable[str]]], type_name: str = '', suffix: str = ''
) -> dict[str, str]:
    """
    Return the topics of a type whose name ends in `suffix`, as name to type, sorted.

    Parameters
    ----------
    topics : iterable of (str, iterable of str)
        Names and types as ``Node.get_topic_names_and_types()`` gives them.
    type_name : str
        Such as 'sensor_msgs/msg/Imu'; empty for every type.
    suffix : str
        Whole last parts of the name, such as 'imu/data_raw'; empty for every name.

    Examples
    --------
    >>> graph = [('/bench/b/imu/data_raw', ['sensor_msgs/msg/Imu']), ('/rosout', ['rcl/Log'])]
    >>> matching(graph, 'sensor_msgs/msg/Imu', 'imu/data_raw')
    {'/bench/b/imu/data_raw': 'sensor_msgs/msg/Imu'}
    """
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
