# SPDX-License-Identifier: Apache-2.0
"""From the raw blocks of a bag to samples, counting what does not become one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator

from imu_bench.bags.block import Block
from imu_bench.offline.recordings.decoding import decode
from imu_bench.offline.recordings.source import Chunk, IMU_TYPES, Topic


def samples(
    blocks: Iterator[Block], topics: Collection[Topic], problems: list[str]
) -> Iterator[tuple[str, Chunk]]:
    """
    Yield topic names and samples of raw blocks.

    When the blocks end, what was odd about them is added to problems: messages that
    are no Imu, and counts that differ from the number stored.
    """
    read: Counter[str] = Counter()
    undecodable: Counter[str] = Counter()
    for block in blocks:
        channel = block.channel
        if channel.type not in IMU_TYPES:
            report(problems, f'{channel.topic}: messages of type {channel.type} are left out')
            continue
        if not len(block):
            continue
        found = decode(block)
        read[channel.topic] += len(block)
        undecodable[channel.topic] += found.undecodable
        for remark in found.remarks:
            report(problems, f'{channel.topic}: {remark}')
        if len(found.chunk):
            yield channel.topic, found.chunk
    _compare(topics, read, undecodable, problems)


def _compare(
    topics: Collection[Topic],
    read: Counter[str],
    undecodable: Counter[str],
    problems: list[str],
) -> None:
    for topic in topics:
        if undecodable[topic.name]:
            report(
                problems,
                f'{topic.name}: {undecodable[topic.name]} messages are no complete Imu '
                'and were left out',
            )
        if read[topic.name] != topic.count:
            report(
                problems,
                f'{topic.name}: {topic.count} messages are stored, {read[topic.name]} were read',
            )


def report(problems: list[str], problem: str) -> None:
    """Add a problem unless it is known already."""
    if problem not in problems:
        problems.append(problem)
