# SPDX-License-Identifier: Apache-2.0
"""From the chunks of a topic to one recording: counts compared, stamps chosen, NaN left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from imu_bench.bags.problems import (
    code_of,
    COUNTS,
    FOREIGN,
    INCOMPLETE,
    Problem,
    PUBLISHERS,
    SIMULATED,
    STAMPS,
)
from imu_bench.counting import listed
from imu_bench.errors import RecordingError
from imu_bench.offline import stages
from imu_bench.offline.recordings import simulated
from imu_bench.offline.recordings.delivery import Delivery
from imu_bench.offline.recordings.gathering import Allocate, Gathered
from imu_bench.offline.recordings.sifting import check_span, choose, OUTER, sift
from imu_bench.offline.recordings.source import Covariance, Source, Topic
from imu_bench.offline.recordings.thermometers import Thermometer
from imu_bench.samples import Samples
from msg_conversions.quantities import BY_FIELD
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
    """One topic of a recording, ready for analysis."""

    # source, topic: path as given, topic name
    source: str
    topic: str
    # in the order recorded; samples with a value that is not a number are left out
    samples: Samples
    receive_ns: npt.NDArray[np.int64] | None  # time of arrival of the same samples
    frame_id: str  # of the first message
    announced: int | None  # messages according to the metadata of the recording
    stored: int  # messages read, including those left out
    left_out: int  # messages with NaN or infinite values
    # what the user must know: counts that disagree, values left out, stamps replaced
    notes: tuple[str, ...]
    # where the stamps come from: 'header', 'outer header', 'receive', 'column' or 'rate'
    stamp_source: str
    stamp_reason: str  # why these
    # of orientation, angular velocity and acceleration, if `ReadOptions.full` asks for them
    covariances: Sequence[Covariance] = ()
    # what became of its samples, if the sensor says so in the same bag
    delivery: Delivery | None = None
    serial: str = ''  # number of the part, if the bag tells it
    thermometer: Thermometer | None = None  # the temperature of the sensor in the same bag

    def __len__(self) -> int:
        return len(self.samples)

    @property
    def foreign(self) -> bool:
        """Whether it is of none of the sensors that were to be recorded."""
        return FOREIGN in map(code_of, self.notes)


def load(source: Source, topic: Topic | str, progress: Progress | None = None) -> Recording:
    """Return one topic of a recording in memory."""
    return load_all(source, (topic,), progress)[0]


@stages.stage('read')
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
        stages.count(len(chunk))
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
        named = listed(list(map(repr, frame_ids)), _NAMED)
        words = f'several frame_ids on one topic, which belongs to one sensor: {named}'
        notes.append(Problem(words, PUBLISHERS))
    if source.heard is not None:
        notes.extend(source.heard.meddling(topic.name))
        if source.heard.foreign(topic.name) and topic.name not in source.asked:
            words = 'nobody asked for this topic: it is of no sensor of the bench'
            notes.append(Problem(words, FOREIGN))
    made_by = source.heard.emulated(topic.name) if source.heard is not None else ''
    made_by = made_by or simulated.beside(source.path, topic.name)
    if made_by:
        notes.append(Problem(f'{made_by}: simulated data, nothing was measured', SIMULATED))
    delivery = None if source.heard is None else source.heard.delivery(topic.name, gathered.stamps)
    origin = source.reader.stamps_from
    outer = gathered.outer_ns
    _, chosen, reason = choose(gathered.stamps, gathered.receive_ns, origin, outer)
    if chosen == OUTER:
        notes.append(f'stamps are those of the message around the Imu: {reason}')
    elif chosen != origin:
        notes.append(Problem(f'stamps are the receive time: {reason}', STAMPS))
    there, good, finite_notes = sift({name: gathered.column(name) for name in BY_FIELD}, where)
    notes.extend(finite_notes)
    if good is not None:
        gathered.keep(good)
    receive = gathered.receive_ns
    stamps = gathered.stamps
    if chosen == OUTER and gathered.outer_ns is not None:
        stamps = gathered.outer_ns
    elif chosen != origin and receive is not None:
        stamps = receive
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
        delivery=delivery,
        serial='' if source.heard is None else source.heard.serial(topic.name),
        thermometer=None if source.thermometers is None else source.thermometers.of(topic.name),
    )


def _count_notes(topic: Topic, announced: int | None, stored: int) -> list[str]:
    if announced is not None and announced != stored:
        words = f'the metadata announces {announced} messages on {topic.name}, {stored} were read'
        return [Problem(words, COUNTS, topic.name)]
    return []
