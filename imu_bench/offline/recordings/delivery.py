# SPDX-License-Identifier: Apache-2.0
"""
How many messages should be in a bag: what sensors and recorder said of themselves in it.

A sensor's status says how many messages it has published on a topic, and the stamp of the last.
Two of them tell exactly how many messages lie between two stamps, whoever has recorded the bag.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
import re
from typing import NamedTuple

from imu_bench.account import (
    ASKED,
    BESIDE,
    counts,
    fell_back,
    FIRST,
    flooded,
    FOREIGN,
    LEFT_OUT,
    MISSED,
    MORE_ASKED,
    own_topics,
    PUBLISHED,
    RECORDERS,
    SECOND,
    SEVERAL,
    several,
    several_record,
    UNTIL,
)
from imu_bench.bags.block import Block, Channel, printable
from imu_bench.bags.problems import FLOODED, Problem, PUBLISHERS
from imu_bench.bags.problems import RECORDERS as RECORDERS_CODE
from imu_bench.counting import count
from imu_bench.offline.recordings.simulated import EMULATED
from msg_conversions import diagnostics
from msg_conversions.quantities import TYPES
import numpy as np
import numpy.typing as npt

Integers = npt.NDArray[np.int64]

_NUMBER = re.compile(r'(?:_\d+)?\.(?:mcap|db3).*$')
"""What the name of a file has behind that of its bag."""

_SERIAL = re.compile(r'[^,]*, serial number ([^\s,]+)')
"""In what a chip says it is, as a driver reads it; behind a second name it is that of a board."""

_SHOWN = 3
"""Stretches that are named."""


class Stretch(NamedTuple):
    """Messages that are missing between two stamps in ns."""

    start_ns: int
    end_ns: int
    missing: int


@dataclass(frozen=True)
class Delivery:
    """What became of the samples of one sensor, by what is said in the bag."""

    published: int  # messages that were published while the topic was recorded
    missing: int = 0  # of these, those that are not in the bag
    at_end: int = 0  # of those, the ones behind the last message of the bag
    # published before the first status and not in the bag: nobody said whether the recording had
    # begun
    unclear: int = 0
    # sensor, scripted, queue, disk: samples lost in the sensor, to scripted faults, and between
    # reading and publishing; messages that the disk did not take
    sensor: int = 0
    scripted: int = 0
    queue: int = 0
    disk: int = 0
    restarts: int = 0  # how often the counts began again
    # the longest of the stretches in which messages are missing, in the order of time
    worst: tuple[Stretch, ...] = ()

    @property
    def whole(self) -> bool:
        """Whether everything that the sensor has measured is known to be in the bag."""
        lost = self.missing, self.unclear, self.sensor, self.scripted, self.queue, self.disk
        return not any((*lost, self.restarts))


class Heard:
    """
    The diagnostics of a bag, gathered while something else is read from it.

    Names of bag and files tell its recorder from others that were heard: a folder may be renamed,
    the files in it hardly ever are.  `bench` are namespaces of sensors, if its metadata tells.
    """

    def __init__(self, path: Path, bench: Sequence[str] = ()) -> None:
        self._path = path.resolve()
        files = path.glob('*') if path.is_dir() else [path]
        self._names = {path.name, *(_NUMBER.sub('', each.name) for each in files)}
        self._own = own_topics(bench, TYPES)
        self._begin()

    def _begin(self) -> None:
        self.damaged = 0
        self._sensors: dict[str, list[dict[str, int]]] = {}
        self._faults: dict[str, dict[str, int]] = {}
        self._recorders: dict[str, dict[str, str]] = {}
        self._several: dict[str, str] = {}
        self._asked: dict[str, dict[str, str]] = {}
        self._more_asked: dict[str, int] = {}
        self._hardware: dict[str, str] = {}
        self._parts: dict[str, str] = {}
        self._beside: set[str] = set()

    def without(self, blocks: Iterable[Block]) -> Iterator[Block]:
        """Yield blocks; those of diagnostics are heard instead."""
        self._begin()
        for block in blocks:
            if speaks(block.channel):
                self._hear(block)
            else:
                yield block

    def _hear(self, block: Block) -> None:
        for blob in block.blobs():
            try:
                found = diagnostics.statuses(blob)
            except ValueError:
                self.damaged += 1
                continue
            for status in found:
                self._note(status)

    def _note(self, status: diagnostics.Status) -> None:
        path, _, kind = status.name.rpartition(': ')
        name = path.rpartition('/')[2]
        if kind == 'acquisition':
            self._sensors.setdefault(name, []).append(counts(status.values))
            self._hardware[name] = status.hardware_id
            self._parts[name] = status.values.get('part') or self._parts.get(name, '')
        elif kind == 'faults':
            self._faults[name] = counts(status.values)
        elif kind == 'others':
            asked = (key for key in status.values if key.startswith(ASKED))
            self._asked.setdefault(name, {}).update({key: status.values[key] for key in asked})
            self._more_asked[name] = counts(status.values).get(MORE_ASKED, 0)
        elif kind == 'recording':
            self._recorders[status.hardware_id] = status.values
        for key, value in status.values.items():
            if key.startswith(SEVERAL):
                self._several[key.removeprefix(SEVERAL)] = value
            elif key.startswith(BESIDE):
                self._beside.add(key.removeprefix(BESIDE))

    def delivery(self, topic: str, stamps: Integers) -> Delivery | None:
        """Return what became of the samples of a topic."""
        for name, said in self._sensors.items():
            suffix = _suffix(topic, name, said)
            if suffix:
                lives = _lives((each for each in said if UNTIL + suffix in each), suffix)
                faults = self._faults.get(name, {})
                scripted = sum(n for key, n in faults.items() if key.endswith('.lost'))
                if lives:
                    return _compared(topic, suffix, stamps, lives, self._recorder(), scripted)
        return None

    def foreign(self, topic: str) -> bool:
        """Return whether a topic is of none of the sensors that the bag was made for."""
        return topic not in self._own if self._own else topic in self._beside

    def meddling(self, topic: str) -> Iterator[Problem]:
        """Yield who else published a topic, and what was asked of its sensor meanwhile."""
        if topic in self._several:
            words = printable(several(topic, self._several[topic]))
            foreign = self._recorder().get(FOREIGN + topic, 0)
            if foreign:
                words += f'; {count(foreign, "message")} not of the sensor kept out of the bag'
            yield Problem(words, PUBLISHERS)
        said = self._recorder_said()
        if RECORDERS in said:
            second = said.get(SECOND, '')
            words = printable(several_record(said[RECORDERS], second))
            yield Problem(words, RECORDERS_CODE) if second else Problem(words)
        if self._recorder().get(LEFT_OUT):
            yield Problem(flooded(self._recorder()[LEFT_OUT]), FLOODED)
        for name, asked in self._asked.items():
            if f'/{name}/' in topic:
                first = sorted(asked.items())[:_SHOWN]
                left = len(asked) - len(first) + self._more_asked[name]
                more = f', and {left} more' if left else ''
                told = '; '.join(f'{at.removeprefix(ASKED)}: {what}' for at, what in first)
                if told:
                    yield Problem(printable(f'somebody asked of the sensor: {told}{more}'))

    def emulated(self, topic: str) -> str:
        """Return what its sensor says of itself if its chip was emulated; empty otherwise."""
        said = (what for name, what in self._hardware.items() if f'/{name}/' in topic)
        return next((printable(what) for what in said if EMULATED in what.split()), '')

    def serial(self, topic: str) -> str:
        """Return the serial number that the chip of a topic's sensor has told; empty if none."""
        parts = (part for name, part in self._parts.items() if f'/{name}/' in topic)
        found = _SERIAL.match(next(parts, ''))
        return printable(found[1]) if found else ''

    def _recorder(self) -> dict[str, int]:
        """Return the last counts of the recorder of this bag; none if it is not known."""
        return counts(self._recorder_said())

    def _recorder_said(self) -> dict[str, str]:
        """Return what the recorder of this bag said last."""
        own = {bag: said for bag, said in self._recorders.items() if Path(bag).name in self._names}
        if len(own) > 1:
            own = {bag: said for bag, said in own.items() if Path(bag) == self._path}
        return next(iter(own.values()), {})


def speaks(channel: Channel) -> bool:
    """Return whether a channel holds diagnostics that can be read, as they were published."""
    own = channel.topic.rpartition('/')[2] == 'diagnostics'
    return own and channel.type == diagnostics.TYPE and channel.serialization == 'cdr'


def _suffix(topic: str, name: str, said: Iterable[dict[str, int]]) -> str:
    """Return the last part of a topic that a sensor counts; empty if it does not."""
    suffixes = {key.removeprefix(UNTIL) for each in said for key in each if key.startswith(UNTIL)}
    # the sensor's namespace ends in its name
    return next((end for end in suffixes if topic.endswith(f'/{name}/{end}')), '')


Life = list[dict[str, int]]


def _lives(said: Iterable[dict[str, int]], suffix: str) -> list[Life]:
    """Return counts in runs that only grow; a new one begins when a sensor is started again."""
    # Before it has published anything there is no stamp to look for.
    lives: list[Life] = []
    for each in said:
        if not lives or fell_back(lives[-1][-1], each):
            lives.append([])
        lives[-1].append(each)
    begun = [[each for each in life if each.get(PUBLISHED + suffix)] for life in lives]
    return [life for life in begun if life]


def _compared(
    topic: str,
    suffix: str,
    stamps: Integers,
    lives: list[Life],
    recorder: dict[str, int],
    scripted: int,
) -> Delivery:
    until = np.array([each[UNTIL + suffix] for life in lives for each in life], np.int64)
    sent = np.array([each.get(PUBLISHED + suffix, 0) for life in lives for each in life])
    starts = np.cumsum([0, *(len(life) for life in lives)])
    first_of_life = np.isin(np.arange(until.size), starts)
    # what lies between two statuses, or before the first one of a life
    expected = np.where(first_of_life, sent, np.diff(sent, prepend=0))
    places = _places(stamps, until)
    lacking = np.zeros_like(expected) if places is None else expected - np.diff(places, prepend=0)
    # of the end of one life and the beginning of the next only the sum is known
    lacking[starts[:-1]] = np.maximum(lacking[starts[:-1]], 0)
    before = recorder.get(FIRST + topic)
    # a recorder may hear statuses before it hears the topic
    early = 1 if places is None else int(np.searchsorted(places, 0, 'right')) + 1
    unclear = int(lacking[:early].sum()) if before is None else 0
    left = unclear if before is None else before
    for stretch in range(min(early, lacking.size)):
        unheard = min(int(lacking[stretch]), left)
        lacking[stretch] -= unheard
        left -= unheard
    missing = max(0, int(lacking.sum()), recorder.get(MISSED + topic, 0))
    baseline = lives[0][0] if before or unclear else {}
    sums = {
        key: sum(life[-1].get(key, 0) for life in lives) - baseline.get(key, 0)
        for key in ('lost', 'dropped')
    }
    scripted = min(scripted, max(0, sums['lost'] - sums['dropped']))
    return Delivery(
        published=stamps.size + missing,
        missing=missing,
        at_end=min(missing, _at_end(stamps, until, expected, lacking)),
        unclear=unclear,
        sensor=max(0, sums['lost'] - sums['dropped'] - scripted),
        scripted=scripted,
        queue=sums['dropped'],
        disk=recorder.get(f'dropped.{topic}', 0),
        restarts=len(lives) - 1,
        worst=_worst(until, lacking),
    )


def _places(stamps: Integers, until: Integers) -> Integers | None:
    """Return how many messages of the bag come before each status, by their stamps."""
    # A clock that is set back while it records lets both step back together; None if they do not.
    cuts = [0, *(np.flatnonzero(np.diff(stamps) < 0) + 1).tolist(), stamps.size]
    steps = [0, *(np.flatnonzero(np.diff(until) < 0) + 1).tolist(), until.size]
    if len(steps) == 2:  # messages may be out of order for other reasons
        return np.searchsorted(np.sort(stamps), until, 'right')
    if len(cuts) != len(steps):
        return None
    return np.concatenate(
        [
            cuts[k] + np.searchsorted(stamps[cuts[k] : cuts[k + 1]], until[a:b], 'right')
            for k, (a, b) in enumerate(pairwise(steps))
        ]
    )


def _at_end(stamps: Integers, until: Integers, expected: Integers, lacking: Integers) -> int:
    """Return how many of the missing ones come behind the last message of the bag."""
    last = int(stamps[-1])
    behind = np.flatnonzero(until > last)
    if not behind.size:
        return 0
    first = int(behind[0])
    wholly = int(lacking[behind[1:]].sum())
    if not first:
        return wholly
    span = int(until[first] - until[first - 1])
    # samples come evenly: so many are between the last message and the status behind it
    share = (int(until[first]) - max(last, int(until[first - 1]))) / span if span > 0 else 0.0
    return wholly + max(0, min(int(lacking[first]), round(share * int(expected[first]))))


def _worst(until: Integers, lacking: Integers) -> tuple[Stretch, ...]:
    """Return the stretches that lack most; statuses next to each other make one."""
    runs: list[Stretch] = []
    for k in np.flatnonzero(lacking > 0).tolist():
        start = int(until[k - 1]) if k else int(until[0])
        if runs and runs[-1].end_ns == start and k:
            last = runs.pop()
            start, more = last.start_ns, last.missing
        else:
            more = 0
        runs.append(Stretch(start, int(until[k]), more + int(lacking[k])))
    largest = sorted(runs, key=lambda run: -run.missing)[:_SHOWN]
    return tuple(sorted(largest))
