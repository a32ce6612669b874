# SPDX-License-Identifier: Apache-2.0
"""Definitions of message types from `.msg` files beside a bag, which may store none itself."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path
import re

from imu_bench.bags.block import Channel
from imu_bench.counting import listed
from imu_bench.errors import RecordingError
from imu_bench.offline.recordings.source import IMU_TYPES, READABLE

_TYPE = re.compile(r'(?P<package>[A-Za-z]\w*)/(?:msg/)?(?P<name>[A-Za-z]\w*)')
_SEPARATOR = '=' * 80
_LARGEST = 1 << 18
"""Bytes of a .msg file; the longest of the common interfaces has 15 000."""

_LISTED = 5


def from_files(
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


def missing(channels: Collection[Channel]) -> str:
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
