# SPDX-License-Identifier: Apache-2.0
"""From the raw blocks of a bag to samples, counting what does not become one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING

from imu_bench.bags.block import Block
from imu_bench.bags.problems import INCOMPLETE, Problem
from imu_bench.offline.recordings.decoding import decode
from imu_bench.offline.recordings.source import Chunk, IMU_TYPES, Topic

if TYPE_CHECKING:
    from imu_bench.offline.recordings.nested import Nested


def samples(
    blocks: Iterator[Block],
    topics: Collection[Topic],
    inside: Collection[Nested],
    problems: list[str],
    full: bool = False,
) -> Iterator[tuple[str, Chunk]]:
    """
    Yield topic names and samples of raw blocks.

    When the blocks end, what was odd about them is added to problems: messages that
    are no Imu, and counts that differ from the number stored.

    Parameters
    ----------
    blocks : iterator of Block
    topics : collection of Topic
        What is wanted.
    inside : collection of Nested
        Those of them that are a part of other messages.
    problems : list of str
    full : bool
        Orientations and covariances, too.
    """
    read: Counter[str] = Counter()
    undecodable: Counter[str] = Counter()
    wanted = {topic.name for topic in topics}
    for block in blocks:
        channel = block.channel
        mine = [found for found in inside if found.channel == channel]
        if channel.type not in IMU_TYPES and channel.topic in wanted:
            words = f'{channel.topic}: messages of type {channel.type} are left out'
            report(problems, Problem(words, INCOMPLETE, channel.topic))
        if not len(block):
            continue
        parts = [(found.topic, decode(block, found.path, full=full)) for found in mine]
        if channel.type in IMU_TYPES and channel.topic in wanted:
            parts.append((channel.topic, decode(block, full=full)))
        for name, found in parts:
            read[name] += len(block)
            undecodable[name] += found.undecodable
            for remark in found.remarks:
                report(problems, f'{name}: {remark}')
            if len(found.chunk):
                yield name, found.chunk
    _compare(topics, read, undecodable, problems)


def _compare(
    topics: Collection[Topic],
    read: Counter[str],
    undecodable: Counter[str],
    problems: list[str],
) -> None:
    for topic in topics:
        if undecodable[topic.name]:
            words = (
                f'{topic.name}: {undecodable[topic.name]} messages are no complete Imu '
                'and were left out'
            )
            report(problems, Problem(words, INCOMPLETE, topic.name))
        if read[topic.name] != topic.count:
            words = (
                f'{topic.name}: {topic.count} messages are stored, {read[topic.name]} were read'
            )
            report(problems, Problem(words, INCOMPLETE, topic.name))


def report(problems: list[str], problem: str) -> None:
    """Add a problem unless it is known already."""
    if problem not in problems:
        problems.append(problem)
