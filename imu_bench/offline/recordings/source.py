# SPDX-License-Identifier: Apache-2.0
"""What an opened recording shows before anything is read: topics, counts, problems."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
import difflib
from pathlib import Path
from typing import Protocol

from imu_bench.errors import RecordingError
import numpy as np
import numpy.typing as npt

IMU_TYPES = ('sensor_msgs/msg/Imu', 'sensor_msgs/Imu')
"""The type's name in ROS 2, and in ROS 1 and the first ROS 2 releases."""

Covariance = tuple[float, ...] | None
"""Its elements if all messages have the same ones, None if they change."""

_LISTED = 50
"""Topics spelled out in an error text."""

_TOLD = 3
"""Problems spelled out in an error text."""


@dataclass(frozen=True)
class Topic:
    """
    One stream of a recording.

    Attributes
    ----------
    name, type : str
        As the recording spells them; a text file is one stream named after the file.
    count : int
        Messages stored.
    is_imu : bool
        Whether ``load`` can make samples of it.
    """

    name: str
    type: str
    count: int
    is_imu: bool

    def __str__(self) -> str:
        return f'{self.name} ({self.type}, {self.count})'


@dataclass(frozen=True, eq=False)
class Chunk:
    """
    Consecutive samples as they are stored, in SI units, nothing left out.

    Attributes
    ----------
    stamps : ndarray of int64, shape (n,)
        Stamps of the measurement in ns: message headers or the time column.
    receive_ns : ndarray of int64, shape (n,), or None
        Time of arrival at the recorder in ns.
    acceleration, angular_velocity, magnetic_field, inclination : ndarray, (n, 3), or None
    temperature : ndarray, shape (n,), or None
    orientation : ndarray, shape (n, 4), or None
        Of a bag, if `ReadOptions.full` asks for it.
    frame_ids : tuple of str
        Each that occurs.
    covariances : tuple of Covariance
        Of a bag, in the order of the message, if asked for.
    """

    stamps: npt.NDArray[np.int64]
    receive_ns: npt.NDArray[np.int64] | None = None
    acceleration: npt.NDArray[np.float64] | None = None
    angular_velocity: npt.NDArray[np.float64] | None = None
    magnetic_field: npt.NDArray[np.float64] | None = None
    temperature: npt.NDArray[np.float64] | None = None
    inclination: npt.NDArray[np.float64] | None = None
    orientation: npt.NDArray[np.float64] | None = None
    frame_ids: tuple[str, ...] = ()
    covariances: tuple[Covariance, ...] = ()

    def __len__(self) -> int:
        return int(self.stamps.size)


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
    """
    An opened recording.

    Attributes
    ----------
    path : Path
        File or folder, as given.
    format : str
        For example 'rosbag2 mcap', 'rosbag1', 'text'.
    topics : tuple of Topic
        Everything stored, in the order stored.
    announced : mapping of str to int
        Messages per topic according to the metadata; empty without metadata.
    problems : list of str
        Incomplete file, counts that disagree, parts skipped: one line each.
    reader : Reader
        Hands out the samples.
    files : tuple of Path
        The files of a text recording, several if they continue each other; empty for others.
    """

    path: Path
    format: str
    topics: tuple[Topic, ...]
    reader: Reader
    announced: Mapping[str, int] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    files: tuple[Path, ...] = ()

    def select(self, names: Sequence[str] = ()) -> tuple[Topic, ...]:
        """
        Return the Imu topics with these names, or all Imu topics if no name is given.

        Raises
        ------
        RecordingError
            If a name is unknown or not an Imu topic, if there is no Imu topic,
            or if the topics hold no message.
        """
        if not self.topics:
            raise RecordingError(
                f'{self.path}: the recording is empty: no topic is stored in it{self.suspicion()}'
            )
        if names:
            chosen = tuple(self._named(name) for name in names)
        else:
            chosen = tuple(topic for topic in self.topics if topic.is_imu and topic.count)
        if not any(topic.is_imu for topic in self.topics):
            raise RecordingError(f'{self.path}: no Imu topic; {self._listing()}')
        if not chosen or not any(topic.count for topic in chosen):
            raise RecordingError(
                f'{self.path}: no Imu message stored; {self._listing()}{self.suspicion()}'
            )
        return chosen

    def topic(self, topic: Topic | str) -> Topic:
        """Return an Imu topic by name; raises as ``select`` does."""
        return topic if isinstance(topic, Topic) else self.select((topic,))[0]

    def _named(self, name: str) -> Topic:
        for topic in self.topics:
            if topic.name == name or topic.name == f'/{name}':
                if topic.is_imu:
                    return topic
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
        more = len(self.topics) - _LISTED
        return (
            'it holds '
            + ', '.join(str(topic) for topic in self.topics[:_LISTED])
            + (f' and {more} more topics' if more > 0 else '')
        )

    def suspicion(self) -> str:
        """Return the problems as an addition to an error text."""
        if not self.problems:
            return ''
        more = f'; and {len(self.problems) - _TOLD} more' if len(self.problems) > _TOLD else ''
        return f' ({"; ".join(self.problems[:_TOLD])}{more})'

    def close(self) -> None:
        """Give temporary files back; the source cannot be read afterwards."""
        self.reader.close()

    def __enter__(self) -> Source:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()
