# SPDX-License-Identifier: Apache-2.0
"""From the chunks of a topic to one recording: counts compared, stamps chosen, NaN left out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from imu_bench.bags.problems import COUNTS, INCOMPLETE, Problem, STAMPS
from imu_bench.errors import RecordingError
from imu_bench.offline.recordings.finite import sift
from imu_bench.offline.recordings.gathering import Allocate, Gathered, QUANTITIES
from imu_bench.offline.recordings.options import ReadOptions
from imu_bench.offline.recordings.source import Chunk, Covariance, Source, Topic
from imu_bench.offline.recordings.stamps import check_span, choose
from imu_bench.samples import Samples
import numpy as np
import numpy.typing as npt

Progress = Callable[[int, int], None]
"""Called with the number of messages read so far and the number expected."""

_NAMED = 5
"""Names spelled out in a note."""

_AT_LEAST, _LEAST_BYTES = 1 << 20, 8
"""Messages that are believed to be stored: a million, or one in so many bytes of the file."""


@dataclass(frozen=True, eq=False)
class Recording:
    """
    One topic of a recording, ready for analysis.

    Attributes
    ----------
    source, topic : str
        Path as given, topic name.
    samples : Samples
        In the order recorded; samples with a value that is not a number are left out.
    receive_ns : ndarray of int64, shape (n,), or None
        Time of arrival of the same samples.
    frame_id : str
        Of the first message.
    announced : int or None
        Messages according to the metadata of the recording.
    stored : int
        Messages read, including those left out.
    left_out : int
        Messages with NaN or infinite values.
    notes : tuple of str
        What the user must know: counts that disagree, values left out, stamps replaced.
    stamp_source : str
        Where the stamps come from: 'header', 'receive', 'column' or 'rate'.
    stamp_reason : str
        Why these.
    covariances : sequence of Covariance
        Of orientation, angular velocity and acceleration, if `ReadOptions.full` asks for them.
    """

    source: str
    topic: str
    samples: Samples
    receive_ns: npt.NDArray[np.int64] | None
    frame_id: str
    announced: int | None
    stored: int
    left_out: int
    notes: tuple[str, ...]
    stamp_source: str
    stamp_reason: str
    covariances: Sequence[Covariance] = ()

    def __len__(self) -> int:
        return len(self.samples)


def read_chunks(source: Source, topic: Topic | str) -> Iterator[Chunk]:
    """
    Yield the samples of one topic, chunk by chunk, nothing left out.

    Raises
    ------
    RecordingError
        If the topic is unknown or not an Imu topic, or the file cannot be read.
    """
    for _, chunk in source.reader.chunks((source.topic(topic),), source.problems):
        yield chunk


def load(
    source: Source,
    topic: Topic | str,
    options: ReadOptions | None = None,
    progress: Progress | None = None,
) -> Recording:
    """
    Return one topic of a recording in memory.

    Parameters
    ----------
    source : Source
        From ``open_source``, which has applied the options.
    topic : Topic or str
        Which topic.
    options : ReadOptions, optional
        Not needed here; accepted so that options can be passed along everywhere.
    progress : callable, optional
        Called with (messages read, messages expected) after every chunk.

    Raises
    ------
    RecordingError
        If the topic is unknown or not an Imu topic, the file cannot be read, or
        no message holds usable numbers.
    """
    return load_all(source, (topic,), progress)[0]


def load_all(
    source: Source,
    topics: Sequence[Topic | str],
    progress: Progress | None = None,
    allocate: Allocate = np.empty,
) -> list[Recording]:
    """
    Return several topics of a recording, read in one pass over the file.

    Parameters and errors are those of ``load``; `allocate` gives the arrays.  A topic of
    which nothing can be read is left out and reported in ``source.problems``, unless it is
    the only one.
    """
    wanted = {topic.name: topic for topic in map(source.topic, topics)}
    # a damaged file may claim any number of messages
    most = max(_AT_LEAST, stored_bytes(source.path) // _LEAST_BYTES)
    gathered = {name: Gathered(min(topic.count, most), allocate) for name, topic in wanted.items()}
    expected = sum(topic.count for topic in wanted.values())
    done = 0
    for name, chunk in source.reader.chunks(tuple(wanted.values()), source.problems):
        gathered[name].add(chunk)
        done += len(chunk)
        if progress is not None:
            progress(done, max(done, expected))
    missing = [topic for name, topic in wanted.items() if not gathered[name].size]
    if len(missing) == len(wanted):
        raise RecordingError(
            f'{source.path}: no message could be read from '
            f'{", ".join(map(str, missing))}{source.suspicion()}'
        )
    source.problems.extend(
        Problem(f'no message could be read from {topic}', INCOMPLETE, topic.name)
        for topic in missing
    )
    return [
        _recording(source, topic, gathered.pop(name))
        for name, topic in wanted.items()
        if topic not in missing
    ]


def stored_bytes(path: Path) -> int:
    """Return the size of a file, or of all files in a folder."""
    files = path.rglob('*') if path.is_dir() else (path,)
    return sum(file.stat().st_size for file in files if file.is_file())


def _recording(source: Source, topic: Topic, gathered: Gathered) -> Recording:
    where = f'{source.path}, topic {topic.name}'
    stored, announced = gathered.size, source.announced.get(topic.name)
    notes = _count_notes(topic, announced, stored)
    frame_ids = gathered.frame_ids
    if len(frame_ids) > 1:
        more = f' and {len(frame_ids) - _NAMED} more' if len(frame_ids) > _NAMED else ''
        named = ', '.join(map(repr, frame_ids[:_NAMED]))
        notes.append(f'several frame_ids on one topic: {named}{more}')
    origin = source.reader.stamps_from
    _, chosen, reason = choose(gathered.stamps, gathered.receive_ns, origin)
    if chosen != origin:
        notes.append(Problem(f'stamps are the receive time: {reason}', STAMPS))
    there, good, finite_notes = sift({name: gathered.column(name) for name in QUANTITIES}, where)
    notes.extend(finite_notes)
    if good is not None:
        gathered.keep(good)
    receive = gathered.receive_ns
    stamps = gathered.stamps if chosen == origin or receive is None else receive
    check_span(stamps, where)
    return Recording(
        source=str(source.path),
        topic=topic.name,
        samples=Samples(stamps=stamps, **{name: gathered.column(name) for name in there}),
        receive_ns=receive,
        frame_id=frame_ids[0] if frame_ids else '',
        announced=announced,
        stored=stored,
        left_out=stored - gathered.size,
        notes=tuple(notes),
        stamp_source=chosen,
        stamp_reason=reason,
        covariances=gathered.covariances,
    )


def _count_notes(topic: Topic, announced: int | None, stored: int) -> list[str]:
    if announced is not None and announced != stored:
        words = f'the metadata announces {announced} messages on {topic.name}, {stored} were read'
        return [Problem(words, COUNTS, topic.name)]
    return []
