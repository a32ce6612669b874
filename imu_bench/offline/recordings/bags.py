# SPDX-License-Identifier: Apache-2.0
"""
Bags of ROS 1 and ROS 2, and definitions of message types from `.msg` files beside them.

A bag may store none itself.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
import re
from typing import TYPE_CHECKING

from imu_bench.account import BENCH
from imu_bench.bags.bag import Bag
from imu_bench.bags.block import Block, Channel, Storage
from imu_bench.bags.problems import INCOMPLETE, Problem
from imu_bench.bags.ros1 import Ros1File
from imu_bench.counting import listed
from imu_bench.errors import NotReady, RecordingError
from imu_bench.offline.recordings.decoding import decode
from imu_bench.offline.recordings.delivery import Heard, speaks
from imu_bench.offline.recordings.source import Chunk, IMU_TYPES, READABLE, Source, Topic
from imu_bench.offline.recordings.thermometers import Thermometers

if TYPE_CHECKING:
    from imu_bench.offline.recordings.nested import Nested


def open_ros1(path: Path, *, full: bool = False) -> Source:
    """Open a bag of ROS 1."""
    return _source(path, 'rosbag1', Ros1File(path), {}, full)


def open_ros2(path: Path, *, full: bool = False) -> Source:
    """Open a bag of ROS 2, a folder or a single storage file."""
    bag = Bag(path)
    formats = {channel.serialization for channel in bag.channels}
    if formats and formats.isdisjoint(READABLE):
        raise RecordingError(
            f'{path}: the messages are serialized as {", ".join(sorted(formats))}; '
            f'only {" and ".join(READABLE)} can be read'
        )
    announced = {} if bag.announcement is None else bag.announcement.counts
    custom = {} if bag.announcement is None else bag.announcement.custom
    bench = custom.get(BENCH, '').split()
    return _source(path, bag.format, bag, announced, full, bench)


def _source(
    path: Path,
    kind: str,
    bag: Bag | Storage,
    announced: Mapping[str, int],
    full: bool,
    bench: Sequence[str] = (),
) -> Source:
    topics: dict[str, Topic] = {}
    described, files = definitions_beside(path, bag.channels)
    problems = [*bag.problems, *files]
    inside: dict[str, Nested] = {}
    for channel in (described.get(channel, channel) for channel in bag.channels):
        imu = channel.type in IMU_TYPES and channel.serialization in READABLE
        count = bag.counts[channel.topic]
        if imu or channel.topic not in topics:
            topics[channel.topic] = Topic(channel.topic, channel.type, count, imu)
        if channel.type in IMU_TYPES and channel.serialization not in READABLE:
            words = f'{channel.topic}: messages serialized as {channel.serialization} are left out'
            report(problems, Problem(words, INCOMPLETE, channel.topic))
        # imported late: other recordings need no type system
        if _may_hold_imu(channel):
            try:
                from imu_bench.offline.recordings import nested
            except NotReady as error:
                words = f'{channel.topic}: messages of {channel.type} are left out: {error}'
                report(problems, Problem(words, INCOMPLETE, channel.topic))
                continue
            for found in nested.find(channel):
                inside[found.topic] = found
                topics[found.topic] = Topic(found.topic, found.type, count, is_imu=True)
    heard = Heard(path, bench)
    warm = Thermometers(bag.channels)
    return Source(
        path=path,
        format=kind,
        topics=tuple(topics.values()),
        reader=_Reader(bag, inside, described, full, heard, warm),
        announced=announced,
        problems=problems,
        heard=heard,
        thermometers=warm,
        undefined=lambda: missing_definitions(set(bag.channels) - set(described)),
    )


def _may_hold_imu(channel: Channel) -> bool:
    text = channel.definition
    return channel.type not in IMU_TYPES and 'sensor_msgs' in text and 'Imu' in text


class _Reader:
    stamps_from = 'header'

    def __init__(
        self,
        bag: Bag | Storage,
        inside: Mapping[str, Nested],
        described: Mapping[Channel, Channel],
        full: bool,
        heard: Heard,
        warm: Thermometers,
    ) -> None:
        self._bag = bag
        self._heard = heard
        self._warm = warm
        self._inside = inside
        self._described = described
        self._full = full

    def chunks(
        self, topics: Collection[Topic], problems: list[str]
    ) -> Iterator[tuple[str, Chunk]]:
        before = self._bag.problems
        inside = [self._inside[topic.name] for topic in topics if topic.name in self._inside]
        names = {topic.name for topic in topics} | {found.channel.topic for found in inside}
        # in the same pass: they lie in the same chunks
        names |= {channel.topic for channel in self._bag.channels if speaks(channel)}
        stored = self._warm.without(self._bag.blocks(names | self._warm.topics))
        blocks = map(self._with_definition, self._heard.without(stored))
        yield from samples(blocks, topics, inside, problems, self._full)
        if self._heard.damaged:
            words = f'{self._heard.damaged} messages of diagnostics are damaged and were left out'
            report(problems, Problem(words, INCOMPLETE))
        now = self._bag.problems
        # counts of damaged places may have grown
        problems[:] = [line for line in problems if line not in before or line in now]
        for problem in now:
            report(problems, problem)

    def _with_definition(self, block: Block) -> Block:
        channel = self._described.get(block.channel)
        return block if channel is None else replace(block, channel=channel)

    def close(self) -> None:
        self._bag.close()


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
        if channel.serialization not in READABLE:
            words = f'{channel.topic}: messages serialized as {channel.serialization} are left out'
            report(problems, Problem(words, INCOMPLETE, channel.topic))
            continue
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


_TYPE = re.compile(r'(?P<package>[A-Za-z]\w*)/(?:msg/)?(?P<name>[A-Za-z]\w*)')
_SEPARATOR = '=' * 80
_LARGEST = 1 << 18
"""Bytes of a .msg file; the longest of the common interfaces has 15 000."""

_LISTED = 5


def definitions_beside(
    bag: Path, channels: Collection[Channel]
) -> tuple[dict[Channel, Channel], list[str]]:
    """
    Return the channels that the bag does not define, with definitions from files beside it.

    And what is wrong with these files.  A file is looked for in the folder of the bag and the one
    around it, as `State.msg`, `msg/State.msg` or below the name of its package.
    """
    described: dict[Channel, Channel] = {}
    problems: list[str] = []
    for channel in channels:
        if not _undefined(channel) or _file(bag, channel.type) is None:
            continue
        try:
            text = f'\n{_SEPARATOR}\n'.join(_texts(bag, channel))
            described[channel] = replace(channel, encoding='ros2msg', definition=text)
        except RecordingError as problem:
            if str(problem) not in problems:
                problems.append(str(problem))
    return described, problems


def missing_definitions(channels: Collection[Channel]) -> str:
    """Return a sentence on the types that nothing is known of, empty if there are none."""
    from imu_bench.offline.recordings import nested  # brings a type system along

    unknown = {
        channel.type: _TYPE.fullmatch(channel.type)
        for channel in channels
        if _undefined(channel) and nested.full_name(channel.type) not in nested.common(channel)
    }
    files = [f'{match["name"]}.msg' for match in unknown.values() if match is not None]
    if not files:
        return ''
    return (
        f'; the bag stores no definition of {listed(list(unknown), _LISTED)}: if an Imu is '
        f'inside, put {listed(files, _LISTED)} beside the bag, with those of the types in it'
    )


def _undefined(channel: Channel) -> bool:
    return (
        not channel.definition
        and channel.type not in IMU_TYPES
        and channel.serialization in READABLE
    )


def _texts(bag: Path, channel: Channel) -> Iterator[str]:
    """Yield the definition of a type and of what it is made of, as a bag would store them."""
    from imu_bench.offline.recordings import nested  # brings a type system along

    known = nested.common(channel)
    wanted, done = [(channel.type, '')], set()
    while wanted:
        kind, of = wanted.pop(0)
        if kind in done or nested.full_name(kind) in known:
            continue
        done.add(kind)
        file = _file(bag, kind)
        if file is None:
            name = kind.rpartition('/')[2]
            raise RecordingError(f'{of} is made of {kind}: put {name}.msg beside it')
        try:
            size = file.stat().st_size
            text = file.read_text(encoding='utf-8') if size <= _LARGEST else ''
            parts = nested.made_of(text, kind)
        except Exception as problem:  # the parser raises whatever a damaged text leads it to
            raise RecordingError(f'{file}: no definition of {kind} ({problem})') from problem
        if not text:
            raise RecordingError(f'{file}: no definition of {kind} ({size} bytes)')
        wanted += [(part, str(file)) for part in parts]
        yield f'MSG: {kind.replace("/msg/", "/")}\n{text}' if of else text


def _file(bag: Path, kind: str) -> Path | None:
    match = _TYPE.fullmatch(kind)
    if match is None:
        return None
    folder = bag if bag.is_dir() else bag.parent
    package, name = match['package'], f'{match["name"]}.msg'
    for place in (folder, folder.resolve().parent):
        for below in (f'{package}/msg', package, 'msg', '.'):
            file = place / below / name
            if file.is_file():
                return file
    return None
