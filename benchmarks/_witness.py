# SPDX-License-Identifier: Apache-2.0
"""
What a bag holds and what it lacks, found without any of our readers or counts of the recorder.

The bag is read by rosbags.  The sensors' own stamps tell how many samples are missing, whoever
lost them: a sensor keeps its period, and a span of time holds so many of it.  What the sensors
say to have published until when tells, beside the messages that are there, how many were lost
after that.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
import struct
from typing import Any

import numpy as np
import numpy.typing as npt
from rosbags.highlevel import AnyReader
from rosbags.typesys import get_typestore, Stores

MAIN = 'imu/data_raw'
DIAGNOSTICS = '/diagnostics'
PUBLISHED, UNTIL = 'published.', 'published_until_ns.'

SLOPE = 2e-4
"""
Steps that differ by less from the median are taken for the period of the sensor: stamps move by
1e-3 of it while they make up for an offset, and a gap is at least a whole one.
"""

WOBBLE = 0.05
"""Stamps of a sensor that is read in time are this near to its period, as a share of it."""

Stamps = npt.NDArray[np.int64]
Statuses = list[dict[str, str]]


@dataclass(frozen=True)
class Found:
    """
    One sensor in a bag.

    Attributes
    ----------
    messages : int
        On its main topic.
    missing : int
        Samples of the main topic between the first and the last that are not there.
    gaps : int
        Places where they are missing.
    on_the_way, main_on_the_way : int
        Messages of all its topics, and of the main one, that were published and are not there.
    regular : float
        Share of its stamps that are the period apart: of a sensor that is read too late again and
        again the computer has to date samples, and the stamps tell less.
    stamps : array of int64, shape (n,)
        Of the main topic, ns.
    """

    messages: int
    missing: int
    gaps: int
    on_the_way: int
    main_on_the_way: int
    regular: float
    stamps: Stamps

    @property
    def before_the_way(self) -> int:
        """Samples of the main topic that were never published."""
        return self.missing - self.main_on_the_way


def sensors(bag: Path) -> dict[str, Found]:
    """Return what there is of each sensor, by its name."""
    stamps, statuses = _read(bag)
    found = {}
    for topic, own in stamps.items():
        space = topic.removesuffix(f'/{MAIN}')
        if space == topic:
            continue
        name = space.rpartition('/')[2]
        missing, gaps = missing_in(own)
        said = statuses[f'{name}: acquisition']
        lost = {
            each.removeprefix(f'{space}/'): lost_after_publishing(
                times, said, each.removeprefix(f'{space}/')
            )
            for each, times in stamps.items()
            if each.startswith(f'{space}/')
        }
        steps = np.diff(own)
        regular = float(np.mean(np.abs(steps / np.median(steps) - 1.0) < WOBBLE))
        on_the_way = sum(lost.values()), lost[MAIN]
        found[name] = Found(len(own), missing, gaps, *on_the_way, regular, own)
    return found


def _read(bag: Path) -> tuple[dict[str, Stamps], dict[str, Statuses]]:
    """Return stamps by topic, and statuses by name, both in the order of the bag."""
    store = get_typestore(Stores.ROS2_JAZZY)
    stamps: dict[str, list[int]] = defaultdict(list)
    statuses: dict[str, Statuses] = defaultdict(list)
    with AnyReader([bag], default_typestore=store) as reader:
        for connection, _, raw in reader.messages():
            if connection.topic == DIAGNOSTICS:
                message: Any = reader.deserialize(raw, connection.msgtype)
                for status in message.status:
                    values = {pair.key: pair.value for pair in status.values}
                    statuses[status.name].append(values)
            else:
                # every one of these begins with its header, and a header with the stamp
                order = '<' if raw[1] else '>'
                seconds, ns = struct.unpack_from(f'{order}iI', raw, 4)
                stamps[connection.topic].append(seconds * 10**9 + ns)
    return {topic: np.array(own, np.int64) for topic, own in stamps.items()}, statuses


def missing_in(stamps: Stamps) -> tuple[int, int]:
    """
    Return how many samples are missing, and in how many places.

    A single gap is a whole number of periods only if the stamps were right on both sides of it;
    from the first to the last sample their errors do not add up.

    Examples
    --------
    >>> missing_in(np.array([0, 100, 200, 300, 600, 700, 800, 900, 1100]))
    (3, 2)
    """
    steps = np.diff(stamps)
    if not len(steps):
        return 0, 0
    relative = steps / np.median(steps) - 1.0
    period = steps[np.abs(relative) <= max(SLOPE, np.abs(relative).min())].mean()
    missing = round((stamps[-1] - stamps[0]) / period) + 1 - len(stamps)
    return missing, int(np.count_nonzero(relative > 0.5))


def lost_after_publishing(stamps: Stamps, statuses: Iterable[dict[str, str]], topic: str) -> int:
    """
    Return how many messages of a topic were published and are not among the stamps.

    Parameters
    ----------
    stamps : array of int64, shape (n,)
        What is there, ns.
    statuses : iterable of dict
        What the sensor said of itself: how many messages were published until which stamp.
    topic : str
        As the statuses call it.

    Examples
    --------
    >>> said = {'published.a': '4', 'published_until_ns.a': '400'}
    >>> lost_after_publishing(np.array([100, 300, 400, 500]), [said], 'a')
    1
    """
    said = [
        (int(values[UNTIL + topic]), int(values[PUBLISHED + topic]))
        for values in statuses
        if int(values.get(PUBLISHED + topic, 0))
    ]
    lives: list[list[tuple[int, int]]] = [[]]
    # the order of the bag is that of the clock of the system, which may have jumped
    for until, count in sorted(said):
        if lives[-1] and count < lives[-1][-1][0]:
            lives.append([])
        lives[-1].append((count, until))
    lost, ended = 0, None
    for life in filter(None, lives):
        (count, until), first_until = life[-1], life[0][1]
        begun = stamps[0] if ended is None else _restart(stamps, ended, first_until)
        lost += count - int(np.count_nonzero((stamps >= begun) & (stamps <= until)))
        ended = until
    return lost


def _restart(stamps: Stamps, after_ns: int, before_ns: int) -> int:
    """Return the first stamp behind the longest pause between two times."""
    inside = stamps[(stamps > after_ns) & (stamps <= before_ns)]
    edges = np.concatenate([[after_ns], inside])
    return int(edges[1 + np.argmax(np.diff(edges))])
