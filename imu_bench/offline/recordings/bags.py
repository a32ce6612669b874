# SPDX-License-Identifier: Apache-2.0
"""Bags of ROS 1 and ROS 2."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from imu_bench.bags.bag import Bag
from imu_bench.bags.block import Channel, Storage
from imu_bench.bags.ros1 import Ros1File
from imu_bench.errors import RecordingError
from imu_bench.offline.recordings.bag_samples import report, samples
from imu_bench.offline.recordings.source import Chunk, IMU_TYPES, Source, Topic

if TYPE_CHECKING:
    from imu_bench.offline.recordings.nested import Nested

READABLE = ('cdr', 'ros1')
"""Serialization formats of ROS 2 and ROS 1; the second is found in mcap files too."""


def open_ros1(path: Path, *, full: bool = False) -> Source:
    """
    Open a bag of ROS 1.

    Raises
    ------
    RecordingError
        If it is of a version before 2.0.
    """
    return _source(path, 'rosbag1', Ros1File(path), {}, full)


def open_ros2(path: Path, *, full: bool = False) -> Source:
    """
    Open a bag of ROS 2, a folder or a single storage file.

    Raises
    ------
    RecordingError
        If it is no bag, or none of its messages is serialized in a known way.
    """
    bag = Bag(path)
    formats = {channel.serialization for channel in bag.channels}
    if formats and formats.isdisjoint(READABLE):
        raise RecordingError(
            f'{path}: the messages are serialized as {", ".join(sorted(formats))}; '
            f'only {" and ".join(READABLE)} can be read'
        )
    announced = {} if bag.announcement is None else bag.announcement.counts
    return _source(path, bag.format, bag, announced, full)


def _source(
    path: Path, kind: str, bag: Bag | Storage, announced: Mapping[str, int], full: bool
) -> Source:
    topics: dict[str, Topic] = {}
    inside: dict[str, Nested] = {}
    for channel in bag.channels:
        imu = channel.type in IMU_TYPES and channel.serialization in READABLE
        count = bag.counts[channel.topic]
        if imu or channel.topic not in topics:
            topics[channel.topic] = Topic(channel.topic, channel.type, count, imu)
        # imported late: other recordings need no type system
        if _may_hold_imu(channel):
            from imu_bench.offline.recordings import nested

            for found in nested.find(channel):
                inside[found.topic] = found
                topics[found.topic] = Topic(found.topic, found.type, count, is_imu=True)
    return Source(
        path=path,
        format=kind,
        topics=tuple(topics.values()),
        reader=_Reader(bag, inside, full),
        announced=announced,
        problems=list(bag.problems),
    )


def _may_hold_imu(channel: Channel) -> bool:
    text = channel.definition
    return channel.type not in IMU_TYPES and 'sensor_msgs' in text and 'Imu' in text


class _Reader:
    stamps_from = 'header'

    def __init__(self, bag: Bag | Storage, inside: Mapping[str, Nested], full: bool) -> None:
        self._bag = bag
        self._inside = inside
        self._full = full

    def chunks(
        self, topics: Collection[Topic], problems: list[str]
    ) -> Iterator[tuple[str, Chunk]]:
        before = self._bag.problems
        inside = [self._inside[topic.name] for topic in topics if topic.name in self._inside]
        names = {topic.name for topic in topics} | {found.channel.topic for found in inside}
        yield from samples(self._bag.blocks(names), topics, inside, problems, self._full)
        now = self._bag.problems
        # counts of damaged places may have grown
        problems[:] = [line for line in problems if line not in before or line in now]
        for problem in now:
            report(problems, problem)

    def close(self) -> None:
        self._bag.close()
