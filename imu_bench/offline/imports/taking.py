# SPDX-License-Identifier: Apache-2.0
"""What is taken of one input: its Imu streams, what goes along, and what is to be said."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager, ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
import shutil
from tempfile import mkdtemp
from typing import NamedTuple

from imu_bench.bags import bag
from imu_bench.bags.bag import Bag
from imu_bench.bags.block import Block, Channel, Storage
from imu_bench.bags.ros1 import Ros1File
from imu_bench.counting import listed
from imu_bench.errors import RecordingError
from imu_bench.offline.imports.tracks import is_from_bag
from imu_bench.offline.recordings import ReadOptions, Recording
from imu_bench.offline.recordings.cache import columns
from imu_bench.offline.recordings.decoding import constant, decode_numbers
from imu_bench.offline.recordings.gathering import Allocate, Gathered
from imu_bench.offline.recordings.loading import Progress
from imu_bench.offline.recordings.sifting import choose
from imu_bench.offline.recordings.source import Chunk, IMU_TYPES, READABLE
from imu_bench.offline.recordings.thermometers import belonging
from imu_bench.offline.running.mapped import ArrayFolder
from imu_bench.offline.running.pipeline import no_progress, Phase
from imu_bench.samples import Samples
from msg_conversions.quantities import INCLINATION, MAGNETIC_FIELD, Quantity, TEMPERATURE


@dataclass(frozen=True, eq=False)
class Taken:
    """What was read of one input."""

    path: Path
    imus: list[Recording]  # one per stream
    beside: list[Recording]  # topics of a bag with one quantity of a sensor
    notes: list[str]


@contextmanager
def taken(path: Path, options: ReadOptions, phase: Phase = no_progress) -> Iterator[Taken]:
    """Give what is read of an input; columns of a large one lie in files until the end."""
    with ExitStack() as stack:
        try:
            read = stack.enter_context(
                columns(path, replace(options, full=True), progress=phase(f'reading {path.name}'))
            )
            imus, notes, more = read.recordings, list(read.problems), []
            if is_from_bag(imus[0]):
                folder = Path(mkdtemp(prefix='imu_bench_'))
                stack.callback(shutil.rmtree, folder, ignore_errors=True)
                names = [recording.topic for recording in imus]
                step = phase(f'reading {path.name}, other topics')
                found = others(
                    path, names, ArrayFolder(folder).empty, step, only=bool(options.topics)
                )
                more = found.recordings
                notes += found.notes
        except OSError as problem:
            raise RecordingError(f'{path}: cannot be read: {problem.strerror}') from problem
        for recording in (*imus, *more):
            notes += [
                note if recording.topic in note else f'{recording.topic}: {note}'
                for note in recording.notes
            ]
        notes = list(dict.fromkeys(notes))
        yield Taken(path, imus, more, notes)


_LISTED = 5


KINDS = {q.message.type: q for q in (MAGNETIC_FIELD, TEMPERATURE, INCLINATION)}
"""By the type's name in ROS 2."""


class Others(NamedTuple):
    """What goes along, and notes on what does not."""

    recordings: list[Recording]
    notes: list[str]


def others(
    path: Path, imus: Collection[str], allocate: Allocate, progress: Progress, *, only: bool
) -> Others:
    """Return the other topics of a bag that a sensor has."""
    storage: Bag | Storage = Bag(path) if path.is_dir() or bag.kind(path) else Ros1File(path)
    try:
        kinds = _kinds(storage, imus, only)
        gathered = {name: Gathered(1, allocate) for name in kinds}
        done, stored = 0, sum(storage.counts.get(name, 0) for name in kinds)
        for block in storage.blocks(set(kinds)):
            done += len(block)
            progress(done, stored)
            kind = kinds[block.channel.topic]
            if len(block) and _kind(block.channel) is kind:
                _add(gathered[block.channel.topic], kind, block)
        notes = [] if only else _others(storage, {*kinds, *imus})
        found = []
        for name, columns in gathered.items():
            lost = storage.counts.get(name, 0) - columns.size
            if lost > 0:
                notes.append(f'{path}: {lost} messages of {name} cannot be decoded: left out')
            if columns.size:
                found.append(_recording(path, name, kinds[name], columns))
        return Others(found, notes)
    finally:
        storage.close()


def field_of(recording: Recording) -> str:
    """Return the quantity of a recording that has only one."""
    fields = (kind.field for kind in KINDS.values())
    return next(field for field in fields if getattr(recording.samples, field) is not None)


def owned(imu: str, recordings: Collection[Recording]) -> dict[str, Recording]:
    """Return those that belong to an Imu topic, by quantity."""
    found = {}
    for kind in KINDS.values():
        offered = {other.topic: other for other in recordings if field_of(other) == kind.field}
        name = belonging(imu, list(offered), _last_word(kind))
        if name is not None:
            found[kind.field] = offered[name]
    return found


def _kinds(storage: Bag | Storage, imus: Collection[str], only: bool) -> dict[str, Quantity]:
    offered: dict[str, Quantity] = {}
    for channel in storage.channels:
        kind = _kind(channel)
        # of vectors only those that an inclinometer of ours names so
        if kind is not None and (
            kind is not INCLINATION or channel.topic.endswith(f'/{INCLINATION.topic}')
        ):
            offered[channel.topic] = kind
    if not only:
        return offered
    mine = {
        belonging(imu, [name for name, kind in offered.items() if kind is one], _last_word(one))
        for imu in imus
        for one in KINDS.values()
    }
    return {name: kind for name, kind in offered.items() if name in mine}


def _kind(channel: Channel) -> Quantity | None:
    if channel.serialization not in READABLE:
        return None
    package, _, rest = channel.type.partition('/')
    return KINDS.get(f'{package}/msg/{rest.removeprefix("msg/")}')


def _last_word(kind: Quantity) -> str:
    return kind.topic.rpartition('/')[2]


def _add(gathered: Gathered, kind: Quantity, block: Block) -> None:
    found, receive_ns = decode_numbers(block, kind.message.numbers)
    values = found.values[:, kind.values].reshape(-1, *kind.shape)
    rest = found.values[:, kind.covariance]
    samples = Samples(found.stamps, **{kind.field: values})
    covariances = constant(rest, rest.shape[1]) if rest.shape[1] else ()
    gathered.add(Chunk(samples, receive_ns, None, found.frame_ids, covariances))


def _recording(path: Path, name: str, kind: Quantity, gathered: Gathered) -> Recording:
    stamps, chosen, reason = choose(gathered.stamps, gathered.receive_ns, 'header')
    return Recording(
        source=str(path),
        topic=name,
        samples=Samples(stamps=stamps, **{kind.field: gathered.column(kind.field)}),
        receive_ns=gathered.receive_ns,
        frame_id=gathered.frame_ids[0] if gathered.frame_ids else '',
        announced=None,
        stored=gathered.size,
        left_out=0,
        notes=() if chosen == 'header' else (f'{name}: stamps are the receive time: {reason}',),
        stamp_source=chosen,
        stamp_reason=reason,
        covariances=gathered.covariances,
    )


def _others(storage: Bag | Storage, taken: Collection[str]) -> list[str]:
    """Return a note on the topics that are nothing an IMU has."""
    taken = {*taken, *(name.partition('.')[0] for name in taken)}  # /robot.imu is in /robot
    names = sorted({c.topic for c in storage.channels if c.type not in IMU_TYPES} - taken)
    left = [f'{name} ({storage.counts.get(name, 0)})' for name in names]
    return [f'{storage.path}: not taken over: {listed(left, _LISTED)}'] if left else []
