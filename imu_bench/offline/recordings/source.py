# SPDX-License-Identifier: Apache-2.0
"""What an opened recording shows before anything is read: topics, counts, problems."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
import difflib
import math
from pathlib import Path
from typing import Protocol

from imu_bench.bags.topic_info import meant, same_samples
from imu_bench.counting import listed
from imu_bench.errors import RecordingError
from imu_bench.offline.recordings.delivery import Heard
from imu_bench.offline.recordings.thermometers import Thermometers
from imu_bench.samples import Samples
import numpy as np
import numpy.typing as npt

IMU_TYPES = ('sensor_msgs/msg/Imu', 'sensor_msgs/Imu')
"""The type's name in ROS 2, and in ROS 1 and the first ROS 2 releases."""

READABLE = ('cdr', 'ros1')
"""Serialization formats of ROS 2 and ROS 1; the second is found in mcap files too."""

Covariance = tuple[float, ...] | None
"""Its elements if all messages have the same ones, None if they change."""

_MAX_RATE_HZ = 1e6
"""No inertial sensor comes near; a larger number is a period or a typing error."""

_LISTED = 50
"""Topics spelled out in an error text."""

_MOST = 3
"""Problems spelled out in an error text."""


@dataclass(frozen=True)
class ReadOptions:
    """
    How to read a recording.

    Raises
    ------
    RecordingError
        If the rate is not a positive number of Hz.

    Examples
    --------
    >>> ReadOptions(rate_hz=100).rate_hz
    100
    """

    topics: tuple[str, ...] = ()  # topics wanted; empty means every Imu topic
    rate_hz: float | None = None  # sample rate of a text file without a time column, in Hz
    # meaning of the columns of a text file: names in the order of the columns (``-`` for a column
    # to ignore), or ``header=name`` pairs; separated by commas
    columns: str | None = None
    # units of the columns of a text file: ``name=unit`` pairs separated by commas, the unit
    # optionally divided by counts per unit, as in
    # ``linear_acceleration=g/16384,angular_velocity=deg/s/131``
    units: str | None = None
    # numbers of a sample, where lines mean nothing: all on one line, say; 0 where lines are rows
    layout: int = 0
    # text files, by their resolved paths, that are read with the one they continue
    join: tuple[str, ...] = ()
    # orientations and covariances of Imu messages, too, which no analysis needs
    full: bool = False

    def __post_init__(self) -> None:
        if self.layout < 0:
            raise RecordingError(f'--layout {self.layout}: how many numbers make one sample')
        rate = self.rate_hz
        if rate is not None and not (math.isfinite(rate) and 0 < rate <= _MAX_RATE_HZ):
            raise RecordingError(
                f'--rate {rate:g}: the sample rate must be above 0 and at most '
                f'{_MAX_RATE_HZ:g} Hz, as in --rate 100'
            )


@dataclass(frozen=True)
class Topic:
    """One stream of a recording."""

    # name, type: as the recording spells them; a text file is one stream named after the file
    name: str
    type: str
    count: int  # messages stored
    is_imu: bool  # whether ``load`` can make samples of it

    def __str__(self) -> str:
        return f'{self.name} ({self.type}, {self.count})'


@dataclass(frozen=True, eq=False)
class Chunk:
    """Consecutive samples as they are stored, in SI units, nothing left out."""

    samples: Samples  # stamps as message headers or the time column have them
    receive_ns: npt.NDArray[np.int64] | None = None  # time of arrival at the recorder in ns
    # stamps of the header of the message around each, of an Imu within another message
    outer_ns: npt.NDArray[np.int64] | None = None
    frame_ids: tuple[str, ...] = ()  # each that occurs
    covariances: tuple[Covariance, ...] = ()  # of a bag, in the order of the message, if asked for

    def __len__(self) -> int:
        return len(self.samples)


class Reader(Protocol):
    """One container format: hands out the samples of a topic chunk by chunk."""

    stamps_from: str
    """Where the stamps of the chunks come from: 'header', 'column' or 'rate'."""

    def chunks(
        self, topics: Collection[Topic], problems: list[str]
    ) -> Iterator[tuple[str, Chunk]]:
        """
        Yield topic names and samples, in the order stored, in one pass over the recording.

        What goes wrong on the way is added to problems.
        """

    def close(self) -> None:
        """Give temporary files back."""


@dataclass(eq=False)
class Source:
    """An opened recording."""

    path: Path  # file or folder, as given
    format: str  # for example 'rosbag2 mcap', 'rosbag1', 'text'
    topics: tuple[Topic, ...]  # everything stored, in the order stored
    reader: Reader  # hands out the samples
    # messages per topic according to the metadata; empty without metadata
    announced: Mapping[str, int] = field(default_factory=dict)
    # incomplete file, counts that disagree, parts skipped: one line each
    problems: list[str] = field(default_factory=list)
    # the files of a text recording, several if they continue each other; empty for others
    files: tuple[Path, ...] = ()
    heard: Heard | None = None  # the diagnostics of a bag, once its messages have been read
    thermometers: Thermometers | None = None  # the temperatures of a bag, likewise
    # what to say, beside a list of topics, on types that nothing is known of
    undefined: Callable[[], str] = str
    asked: set[str] = field(default_factory=set)  # topics that were selected by their names

    def select(self, names: Sequence[str] = ()) -> tuple[Topic, ...]:
        """
        Return the Imu topics with these names, or all Imu topics if no name is given.

        Without a name `imu/data` is left out where `imu/data_raw` is there: REP-145 has the same
        samples in both, the first with the orientation.
        """
        if not self.topics:
            raise RecordingError(
                f'{self.path}: the recording is empty: no topic is stored in it{self.suspicion()}'
            )
        if names:
            chosen = tuple(dict.fromkeys(self._named(name) for name in names))
            self.asked.update(topic.name for topic in chosen)
        else:
            stored = [topic for topic in self.topics if topic.is_imu and topic.count]
            raw = {topic.name for topic in stored}
            chosen = tuple(topic for topic in stored if not same_samples(topic.name, raw))
            for left in sorted(raw - {topic.name for topic in chosen}):
                words = f'{left} is left out: {left}_raw has the same samples; --topic takes it'
                if words not in self.problems:
                    self.problems.append(words)
        if not any(topic.is_imu for topic in self.topics):
            raise RecordingError(f'{self.path}: no Imu topic; {self._listing()}{self.suspicion()}')
        if not chosen or not any(topic.count for topic in chosen):
            raise RecordingError(
                f'{self.path}: no Imu message stored; {self._listing()}{self.suspicion()}'
            )
        return chosen

    def topic(self, topic: Topic | str) -> Topic:
        """Return an Imu topic by name; raises as ``select`` does."""
        return topic if isinstance(topic, Topic) else self.select((topic,))[0]

    def _named(self, name: str) -> Topic:
        found = meant(name, (topic.name for topic in self.topics if topic.is_imu))
        if len(found) > 1:
            several = listed(found, _LISTED)
            raise RecordingError(f'{self.path}: {name!r} names several topics: {several}')
        for topic in self.topics:
            if topic.is_imu and [topic.name] == found:
                return topic
            if topic.name.lstrip('/') == name.lstrip('/'):
                raise RecordingError(
                    f'{self.path}: topic {name!r} holds {topic.type}, not Imu; {self._listing()}'
                )
        raise RecordingError(
            f'{self.path}: no topic {name!r}{self._meant(name)}; {self._listing()}'
        )

    def _meant(self, name: str) -> str:
        """Return the Imu topic that is probably meant: it holds the name, or looks like it."""
        known = [topic.name for topic in self.topics if topic.is_imu]
        holding = [topic for topic in known if name in topic]
        close = holding if len(holding) == 1 else difflib.get_close_matches(name, known, n=1)
        return f' (did you mean {close[0]!r}?)' if close else ''

    def _listing(self) -> str:
        more = ' topics' if len(self.topics) > _LISTED else ''
        return f'it holds {listed(self.topics, _LISTED)}{more}{self.undefined()}'

    def suspicion(self) -> str:
        """Return the problems as an addition to an error text."""
        return f' ({listed(self.problems, _MOST, "; ", "; and ")})' if self.problems else ''

    def close(self) -> None:
        """Give temporary files back; the source cannot be read afterwards."""
        self.reader.close()

    def __enter__(self) -> Source:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()
