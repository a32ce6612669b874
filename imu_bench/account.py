# SPDX-License-Identifier: Apache-2.0
"""
One account of every sample, from the chip into the bag, and one verdict on it.

A sample passes four borders: the chip makes it and the driver reads it; it is published; the
recorder gets it; it is on the disk.  At each border somebody counts.  What was counted before a
border and not behind it was lost there, and what to do about it depends on which border it was.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from imu_bench.counting import count, grouped

RATE_TOLERANCE = 0.01
"""
Share of its rate that a sensor may miss and still be said to keep it.

Samples come in bursts: of a FIFO of 30 at 1 kHz one burst more or less is 0.3 % of the 10 s over
which a rate is taken, and two readings of a polled sensor of 100 Hz are 0.2 %.  Three times that
is no accident; what was lost is counted and said whatever its share.
"""


class Border(NamedTuple):
    """A place where samples can be lost."""

    short: str  # its name in a table
    where: str  # continues 'lost'
    advice: str  # what to do about it


CHIP = Border(
    'sensor',
    'in the sensor',
    'it was not read in time, or its bus failed: end other programs, let the bench read at '
    'real-time priority, or lower its rate; `imu-bench doctor BENCH` says what this machine holds',
)
QUEUE = Border(
    'queue',
    'between reading and publishing',
    'the process of the sensors was stopped, or kept from running for longer than its queue '
    'holds: end other programs',
)
TRANSPORT = Border(
    'way',
    'on the way to the recorder',
    'the recorder was stopped, or kept from running for longer than the history holds: end '
    'other programs, or record fewer topics',
)
DISK = Border(
    'disk',
    'in front of the disk',
    'the disk takes less than is recorded: record to a faster one, or fewer topics',
)
ANALYSIS = Border(
    'analysis',
    'on the way to the analysis',
    'its live figures leave them out, the bag has them: end other programs',
)
NOTHING = 'nothing lost'

BORDERS = (CHIP, QUEUE, TRANSPORT, DISK, ANALYSIS)
"""In the order in which a sample passes them."""

PUBLISHED = 'published.'
"""Diagnostics of a sensor: messages on a topic, below its namespace, since it was started."""

UNTIL = 'published_until_ns.'
"""Diagnostics of a sensor: stamp of the last of them."""

STORED, MISSED, FIRST = 'stored.', 'missed.', 'first_sequence.'
"""
Diagnostics of the recorder: messages of a topic on the disk; sent since it first heard the topic
and never received; sent before the first one it stored.
"""

BENCH = 'bench'
"""Custom data of a bag: the namespaces of the sensors it was made for, with spaces between."""

BESIDE, TURNED_AWAY = 'beside.', 'turned_away'
"""
Diagnostics of the recorder of a bench: of each topic of others that it records as well, how many
messages it has left out; and how many such topics it does not record.
"""

RECORDERS, SECOND = 'recorders', 'second_bag'
"""
Diagnostics of the recorder: the names of all who record the same, where they are several; and the
bag of another one of ours, which says so itself.
"""

LEFT_OUT = 'left_out./diagnostics'
"""Diagnostics of the recorder: messages of /diagnostics that were too much to be recorded."""

ASKED, MORE_ASKED = 'asked.', 'more_asked'
"""Diagnostics of a sensor's node: what somebody else wanted of it, by time; how often more."""

SEVERAL, FOREIGN = 'several.', 'foreign.'
"""
Diagnostics of whoever takes messages: the names of all who publish a topic that belongs to one
sensor, where they are several; how many messages were not the sensor's, and are not in the bag.
"""


def own_topics(spaces: Iterable[str], ends: Iterable[str]) -> frozenset[str]:
    """
    Return the names of the topics of sensors, by their namespaces and the last parts.

    Examples
    --------
    >>> own_topics(['/bench/tilt'], ['imu/data_raw'])
    frozenset({'/bench/tilt/imu/data_raw'})
    """
    lasts = tuple(ends)
    return frozenset(f'{space}/{end}' for space in spaces for end in lasts)


def several(topic: str, names: str) -> str:
    """
    Say that a topic of one sensor has several publishers.

    Examples
    --------
    >>> several('/bench/tilt/imu/data_raw', '/bench/tilt/sensor_node, /visitor')
    'several publish /bench/tilt/imu/data_raw: /bench/tilt/sensor_node, /visitor'
    """
    return f'several publish {topic}: {names}'


def several_record(names: str, bag: str = '') -> str:
    """
    Say that several record the same; `bag` is that of another recorder of ours.

    Examples
    --------
    >>> several_record('/recorder, /recorder', '/home/ann/night')
    'several record this: /recorder, /recorder, another into /home/ann/night'
    """
    return f'several record this: {names}' + (f', another into {bag}' if bag else '')


def flooded(number: int) -> str:
    """
    Say how much of /diagnostics is not in the bag.

    Examples
    --------
    >>> flooded(120)
    '/diagnostics: flooded, 120 messages left out of the bag'
    """
    return f'/diagnostics: flooded, {count(number, "message")} left out of the bag'


def counts(values: Mapping[str, str]) -> dict[str, int]:
    """
    Return those values of a diagnostic status that are whole numbers.

    Examples
    --------
    >>> counts({'samples': '2000', 'rate_hz': '400.2', 'state': 'running'})
    {'samples': 2000}
    """
    return {key: int(value) for key, value in values.items() if value.isdecimal()}


class Tally:
    """
    Counters of somebody who may be started again, summed over all of his lives.

    Examples
    --------
    >>> tally = Tally()
    >>> for samples in (100, 250, 30):
    ...     tally.hear({'samples': samples})
    >>> tally['samples'], tally['lost'], tally.restarts
    (280, 0, 1)
    """

    def __init__(self) -> None:
        self.restarts = 0  # how often the counters began again
        self._before: Counter[str] = Counter()
        self._now: dict[str, int] = {}

    def hear(self, now: Mapping[str, int]) -> None:
        """Take note of the counters, as `counts` returns them."""
        if fell_back(self._now, now):
            self.restarts += 1
            self._before.update(self._now)
        self._now = dict(now)

    def __getitem__(self, key: str) -> int:
        return self._before[key] + self._now.get(key, 0)


def fell_back(before: Mapping[str, int], now: Mapping[str, int]) -> bool:
    """Return whether counts of samples or messages have begun again since."""
    return any(
        now.get(key, 0) < value
        for key, value in before.items()
        if key == 'samples' or key.startswith(PUBLISHED)
    )


class Topic(NamedTuple):
    """The messages of one topic on their way into the bag."""

    name: str
    published: int | None = None  # None if its publisher does not count
    stored: int | None = None  # messages in the bag; None if it was not finished
    before: int = 0  # published before the recorder could hear it
    missed: int = 0  # never received, as the recorder knows without the publisher's count
    dropped: int = 0  # received and not stored
    # published by somebody else, and kept out of the bag; in none of the other counts
    foreign: int = 0

    @property
    def lost(self) -> int:
        """Messages that were published while it was recorded and did not reach the recorder."""
        if self.published is None or self.stored is None:
            return self.missed
        return max(self.missed, self.published - self.before - self.stored - self.dropped)


@dataclass(frozen=True)
class Account:
    """Where the samples of one sensor, or the messages of one topic, have got to."""

    name: str
    read: int = 0  # samples that the driver has read
    # chip, queue: samples lost at the first two borders
    chip: int = 0
    queue: int = 0
    scripted: int = 0  # samples that scripted faults have cost; not among those of `chip`
    topics: tuple[Topic, ...] = ()  # the main one first
    unanalysed: int = 0  # messages that did not reach the analysis

    @property
    def made(self) -> int:
        """Samples that the chip has made."""
        return self.read + self.chip + self.scripted

    @property
    def lost(self) -> dict[Border, int]:
        """What was lost where, in the order of the borders; those without loss are left out."""
        found = {
            CHIP: self.chip,
            QUEUE: self.queue,
            TRANSPORT: sum(topic.lost for topic in self.topics),
            DISK: sum(topic.dropped for topic in self.topics),
            ANALYSIS: self.unanalysed,
        }
        return {border: number for border, number in found.items() if number}

    @property
    def before(self) -> int:
        """Messages published before the recorder could hear them."""
        return sum(topic.before for topic in self.topics)

    @property
    def foreign(self) -> int:
        """Messages of somebody else that were kept out of the bag."""
        return sum(topic.foreign for topic in self.topics)

    @property
    def faults(self) -> list[str]:
        """
        What was read and is not in the bag, one text per border: a fault from the first on.

        Whether a sensor loses too much is told by its rate.
        """
        return [
            f'lost {grouped(number)} {border.where}'
            for border, number in self.lost.items()
            if border in (QUEUE, TRANSPORT, DISK)
        ]

    @property
    def words(self) -> str:
        """
        Say how many were lost at which border.

        Examples
        --------
        >>> Account('tilt', 2000).words
        'nothing lost'
        >>> Account('tilt', 2000, chip=3, topics=(Topic('/a', 2000, 1995),)).words
        '8 lost: 3 in the sensor, 5 on the way to the recorder'
        """
        lost = {border: number for border, number in self.lost.items() if border is not ANALYSIS}
        said = NOTHING
        if len(lost) == 1:
            said = ' '.join(f'{grouped(number)} lost {b.where}' for b, number in lost.items())
        elif lost:
            where = ', '.join(f'{grouped(number)} {b.where}' for b, number in lost.items())
            said = f'{grouped(sum(lost.values()))} lost: {where}'
        if self.scripted:
            others = said if lost else 'none otherwise'
            said = f'{count(self.scripted, "sample")} lost to the scripted faults, {others}'
        if self.before:
            said += f', {grouped(self.before)} published before the recorder heard of it'
        if self.foreign:
            said += f', {grouped(self.foreign)} of somebody else kept out'
        if self.unanalysed:
            said += f', {grouped(self.unanalysed)} not seen by the analysis'
        return said


def of_sensor(
    name: str,
    said: Tally,
    space: str,
    recorder: Mapping[str, int],
    stored: Mapping[str, int] | None,
    suffixes: Sequence[str],
    *,
    scripted: int = 0,
    unanalysed: int = 0,
) -> Account:
    """
    Return the account of a sensor from what its node and the recorder say.

    Parameters
    ----------
    said : Tally
        Of the sensor's acquisition.
    space : str
        Its namespace, such as '/bench/mpu9250'.
    recorder : mapping of str to int
        Counters of the recorder.
    stored : mapping of str to int or None
        Messages of the finished bag by topic; None while it is written, or if it was not finished.
    suffixes : sequence of str
        Last parts of the topics that are recorded, such as 'imu/data_raw'; the main one first.
    scripted : int
        Samples that scripted faults have cost.
    unanalysed : int
        Messages that did not reach the analysis.

    Examples
    --------
    >>> tally = Tally()
    >>> tally.hear({'samples': 200, 'lost': 3, 'dropped': 1, 'published.imu/data_raw': 200})
    >>> account = of_sensor('a', tally, '/a', {}, {'/a/imu/data_raw': 198}, ['imu/data_raw'])
    >>> {border.where: number for border, number in account.lost.items()}
    {'in the sensor': 2, 'between reading and publishing': 1, 'on the way to the recorder': 2}
    """
    dropped = said['dropped']
    return Account(
        name,
        read=said['samples'] + dropped,
        chip=max(0, said['lost'] - dropped - scripted),
        queue=dropped,
        scripted=scripted,
        unanalysed=unanalysed,
        topics=tuple(
            topic(f'{space}/{suffix}', recorder, stored, said[PUBLISHED + suffix])
            for suffix in suffixes
            if suffix == suffixes[0] or said[PUBLISHED + suffix]
        ),
    )


def topic(
    name: str,
    recorder: Mapping[str, int],
    stored: Mapping[str, int] | None,
    published: int | None = None,
) -> Topic:
    """Return the messages of a topic from what recorder and publisher say; see `of_sensor`."""
    return Topic(
        name,
        published,
        None if stored is None else stored.get(name, 0),
        recorder.get(FIRST + name, 0),
        recorder.get(MISSED + name, 0),
        recorder.get(f'dropped.{name}', 0),
        recorder.get(FOREIGN + name, 0),
    )


TOO_SMALL = 0.05
"""
Share of what chips made that is lost at the first border when the machine is too small.  On cores
that were enough, ten busy programs beside the bench cost at most 2 %, on one of 1.2 needed 10 %.
"""


def advice(accounts: Iterable[Account]) -> list[str]:
    """Return what to do, once for each border at which anything was lost."""
    every = list(accounts)
    losing = {border for account in every for border in account.lost}
    lines = [f'lost {border.where}: {border.advice}' for border in BORDERS if border in losing]
    if sum(account.chip for account in every) > TOO_SMALL * sum(each.made for each in every):
        lines.append('this machine is too small for this bench, or has too much else to do')
    return lines
