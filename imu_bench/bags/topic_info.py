# SPDX-License-Identifier: Apache-2.0
"""What a bag says about a topic besides its messages: offered QoS, message definition, hash."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from imu_bench.errors import needed
import yaml

INFINITE_NS = 2**63 - 1
"""Duration that stands for "no limit": rmw, RMW_DURATION_INFINITE."""

NEVER = 2**63 - 1
"""First receive time of a bag without messages, as rosbag2 writes it."""

_SECOND = 1_000_000_000


@dataclass(frozen=True)
class OfferedQos:
    """
    Quality of service of one publisher, in the words of metadata version 9.

    History and depth of a remote publisher are not known to a recorder.
    """

    history: str = 'unknown'
    depth: int = 0
    reliability: str = 'reliable'
    durability: str = 'volatile'
    deadline_ns: int = INFINITE_NS
    lifespan_ns: int = INFINITE_NS
    liveliness: str = 'automatic'
    lease_ns: int = INFINITE_NS

    def entry(self) -> dict[str, Any]:
        """Return the entry of metadata.yaml."""
        return {
            'history': self.history,
            'depth': self.depth,
            'reliability': self.reliability,
            'durability': self.durability,
            'deadline': _duration(self.deadline_ns),
            'lifespan': _duration(self.lifespan_ns),
            'liveliness': self.liveliness,
            'liveliness_lease_duration': _duration(self.lease_ns),
            'avoid_ros_namespace_conventions': False,
        }


@dataclass(frozen=True)
class TopicInfo:
    """A topic to record."""

    # name, type: such as '/bench/mpu9250/imu/data_raw' and 'sensor_msgs/msg/Imu'
    name: str
    type: str
    # text of the message definition with everything it refers to; may be empty
    definition: str = ''
    type_hash: str = ''  # 'RIHS01_...': REP-2016
    qos: tuple[OfferedQos, ...] = ()  # one per publisher

    def qos_text(self) -> str:
        """Return the QoS as the storage files hold it: YAML in a string."""
        return qos_text(self.qos)


def describe(
    name: str, kind: str, qos: Sequence[OfferedQos] = (), type_hash: str = ''
) -> TopicInfo:
    """
    Return a topic with the definition and hash of its type in ROS 2 Jazzy.

    A type that is not one of the common interfaces has no definition here; its
    hash is the one given.

    Examples
    --------
    >>> info = describe('/imu', 'sensor_msgs/msg/Imu')
    >>> info.definition.splitlines()[0], info.type_hash[:14]
    ('std_msgs/Header header', 'RIHS01_7d9a00f')
    """
    definition, own = _definition(kind)
    return TopicInfo(name, kind, definition, type_hash or own, tuple(qos))


def qos_text(profiles: Sequence[OfferedQos]) -> str:
    """Return profiles as YAML text; empty without profiles."""
    if not profiles:
        return ''
    entries = [profile.entry() for profile in profiles]
    return yaml.safe_dump(entries, sort_keys=False).strip()


def meant(name: str, topics: Iterable[str]) -> list[str]:
    """
    Return the topics that a name stands for, best one: that of the name, or all it is a part of.

    A name with a slash in front is a whole one.  Without, it is any run of the parts of a topic:
    the name of a sensor, or the end of the topic.  Where a sensor has `imu/data_raw`, its
    `imu/data` are the same samples and not meant (REP 145).

    Examples
    --------
    >>> there = ['/bench/a/imu/data_raw', '/bench/a/imu/data', '/bench/b/imu/data_raw']
    >>> meant('a', there), meant('b/imu/data_raw', there), meant('/a', there)
    (['/bench/a/imu/data_raw'], ['/bench/b/imu/data_raw'], [])
    """
    known = list(dict.fromkeys(topics))
    for exact in (name, f'/{name}'):
        if exact in known:
            return [exact]
    if name.startswith('/') or not name:
        return []
    found = [topic for topic in known if f'/{name}/' in f'{topic}/']
    return [topic for topic in found if not same_samples(topic, found)]


def same_samples(topic: str, there: Collection[str]) -> bool:
    """Return whether a topic has the samples of another that is there, with the orientation."""
    return topic.endswith('imu/data') and f'{topic}_raw' in there


@cache
def _definition(kind: str) -> tuple[str, str]:
    """Return definition and hash of a type of Jazzy, empty if it is none."""
    # imported late: reading bags does not need it
    with needed('rosbags', 'a bag with the definitions of its types'):
        from rosbags.typesys import get_typestore, Stores

    store = get_typestore(Stores.ROS2_JAZZY)
    if kind not in store.fielddefs:
        return '', ''
    return store.generate_msgdef(kind, ros_version=2)[0], store.hash_rihs01(kind)


def _duration(nanoseconds: int) -> dict[str, int]:
    seconds, rest = divmod(nanoseconds, _SECOND)
    return {'sec': seconds, 'nsec': rest}
