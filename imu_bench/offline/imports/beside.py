# SPDX-License-Identifier: Apache-2.0
"""Topics of a bag that go along with its Imu topics: magnetic field, temperature, inclination."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

from imu_bench.bags import bag
from imu_bench.bags.bag import Bag
from imu_bench.bags.block import Block, Channel, Storage
from imu_bench.bags.ros1 import Ros1File
from imu_bench.bags.sensor_messages import INCLINATION, MAGNETIC_FIELD, TEMPERATURE, TYPES
from imu_bench.offline.recordings import Recording
from imu_bench.offline.recordings.bags import READABLE
from imu_bench.offline.recordings.companions import belonging
from imu_bench.offline.recordings.decoding import constant, decode_numbers
from imu_bench.offline.recordings.gathering import Allocate, Gathered
from imu_bench.offline.recordings.loading import Progress
from imu_bench.offline.recordings.source import Chunk, IMU_TYPES
from imu_bench.offline.recordings.stamps import choose
from imu_bench.samples import Samples
from msg_conversions import cdr

_LISTED = 5


class Kind(NamedTuple):
    """A type of message: its field in Samples, how many numbers, which are values, which not."""

    field: str
    numbers: int
    values: slice
    uncertainty: slice


KINDS = {
    TYPES[MAGNETIC_FIELD]: Kind(
        'magnetic_field',
        cdr.MAGNETIC_FIELD,
        cdr.MAGNETIC_FIELD_VECTOR,
        cdr.MAGNETIC_FIELD_COVARIANCE,
    ),
    TYPES[TEMPERATURE]: Kind(
        'temperature', cdr.TEMPERATURE, cdr.TEMPERATURE_VALUE, cdr.TEMPERATURE_VARIANCE
    ),
    TYPES[INCLINATION]: Kind('inclination', cdr.VECTOR3_STAMPED, cdr.VECTOR3_VECTOR, slice(3, 3)),
}
"""By the type's name in ROS 2."""

_LAST_WORD = {'magnetic_field': 'mag', 'temperature': TEMPERATURE, 'inclination': INCLINATION}


class Beside(NamedTuple):
    """What goes along, and notes on what does not."""

    recordings: list[Recording]
    notes: list[str]


def beside(
    path: Path, imus: Collection[str], allocate: Allocate, progress: Progress, *, only: bool
) -> Beside:
    """
    Return the other topics of a bag that a sensor has.

    Parameters
    ----------
    path : Path
        Of the bag.
    imus : collection of str
        The Imu topics that are taken.
    allocate : callable
        Gives the arrays.
    progress : callable
        Called with (messages read, messages stored).
    only : bool
        Only what belongs to these, not what else there is.

    Raises
    ------
    RecordingError
        If the bag cannot be read.
    """
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
        return Beside(found, notes)
    finally:
        storage.close()


def field_of(recording: Recording) -> str:
    """Return the quantity of a recording that has only one."""
    fields = (kind.field for kind in KINDS.values())
    return next(field for field in fields if getattr(recording.samples, field) is not None)


def owned(imu: str, recordings: Collection[Recording]) -> dict[str, Recording]:
    """Return those that belong to an Imu topic, by quantity."""
    found = {}
    for field, last in _LAST_WORD.items():
        offered = {other.topic: other for other in recordings if field_of(other) == field}
        name = belonging(imu, list(offered), last)
        if name is not None:
            found[field] = offered[name]
    return found


def _kinds(storage: Bag | Storage, imus: Collection[str], only: bool) -> dict[str, Kind]:
    offered: dict[str, Kind] = {}
    for channel in storage.channels:
        kind = _kind(channel)
        # of vectors only those that an inclinometer of ours names so
        vector = kind is not None and kind.field == INCLINATION
        if kind is not None and (not vector or channel.topic.endswith(f'/{INCLINATION}')):
            offered[channel.topic] = kind
    if not only:
        return offered
    mine = {
        belonging(imu, [name for name, kind in offered.items() if kind.field == field], last)
        for imu in imus
        for field, last in _LAST_WORD.items()
    }
    return {name: kind for name, kind in offered.items() if name in mine}


def _kind(channel: Channel) -> Kind | None:
    if channel.serialization not in READABLE:
        return None
    package, _, rest = channel.type.partition('/')
    return KINDS.get(f'{package}/msg/{rest.removeprefix("msg/")}')


def _add(gathered: Gathered, kind: Kind, block: Block) -> None:
    found, receive_ns = decode_numbers(block, kind.numbers)
    values = found.values[:, kind.values]
    if kind.field == 'temperature':
        values = values[:, 0]
    rest = found.values[:, kind.uncertainty]
    gathered.add(
        Chunk(
            stamps=found.stamps,
            receive_ns=receive_ns,
            frame_ids=found.frame_ids,
            covariances=constant(rest, rest.shape[1]) if rest.shape[1] else (),
            **{kind.field: values},
        )
    )


def _recording(path: Path, name: str, kind: Kind, gathered: Gathered) -> Recording:
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
    if not left:
        return []
    more = f' and {len(left) - _LISTED} more' if len(left) > _LISTED else ''
    return [f'{storage.path}: not taken over: {", ".join(left[:_LISTED])}{more}']
