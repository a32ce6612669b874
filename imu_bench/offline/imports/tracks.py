# SPDX-License-Identifier: Apache-2.0
"""Recordings as topics of a bag: their names, and messages a block at a time as they arrived."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
import re

from imu_bench.bags.block import Messages
from imu_bench.bags.topic_info import describe, OfferedQos, TopicInfo
from imu_bench.errors import RecordingError
from imu_bench.offline.recordings import Recording
from imu_bench.offline.recordings.gathering import PIECE
from imu_bench.offline.recordings.sifting import choose, OUTER
from msg_conversions import covariance
from msg_conversions.encoding import SensorEncoder
from msg_conversions.quantities import (
    ANGULAR_VELOCITY,
    IMU_QUANTITIES,
    LINEAR_ACCELERATION,
    ORIENTATION,
    QUANTITIES,
    Quantity,
    TYPES,
)
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Step = Callable[[int], None]
"""Called with the number of samples that have become messages."""

BLOCK = 1 << 12
"""Messages that are made at once."""

_GRAIN_S = 0.1
"""Messages of different topics are interleaved at this grain."""

_FIRST_NS = -(2**31) * 1_000_000_000
"""builtin_interfaces/Time has 32 bits of seconds."""


@dataclass(frozen=True, eq=False)
class Track:
    """One topic of a bag that is written."""

    info: TopicInfo
    # a bag has no time of arrival before 1970: then it is written as that
    stamps: Integers
    receive_ns: Integers
    encoder: SensorEncoder  # knows what is the same in all messages
    # what is not, by the field of the quantity; shape (n, components) or (n,)
    columns: Mapping[str, Floats]

    def messages(self, step: Step) -> Iterator[Messages]:
        """Yield the messages, so many as arrive in a short time together."""
        size = self.stamps.size
        span_s = max(1, int(self.receive_ns[-1]) - int(self.receive_ns[0])) * 1e-9
        grain = int(np.clip(size / span_s * _GRAIN_S, 1, BLOCK))
        for start in range(0, size, BLOCK):
            part = slice(start, min(start + BLOCK, size))
            good = _fits(self.stamps[part])
            kept = np.flatnonzero(good) + start if not good.all() else part
            columns = {field: values[kept] for field, values in self.columns.items()}
            rows = self.encoder.rows(self.stamps[kept], columns)
            receive = np.maximum(self.receive_ns[kept], 0)
            for cut in range(0, len(rows), grain):
                few = slice(cut, cut + grain)
                yield Messages(self.info.name, receive[few], rows[few])
            step(part.stop - part.start)


def tracks(recording: Recording, names: Names) -> list[Track]:
    """
    Return the topics that a recording becomes, the one of Imu messages first.

    A topic of a bag keeps its name; a file becomes ``/<name>/imu/data_raw``, ``imu/mag`` and
    ``temperature``.

    Samples `without_room` are left out.
    """
    source = Path(recording.source)
    stamps, receive = recording.samples.stamps, received(recording)
    own = is_from_bag(recording)
    if own:
        space = topic(recording.topic)
    else:
        space = names.claim(f'/{label(recording)}', source, tuple(TYPES))
    frame_id = recording.frame_id if own else f'{space.strip("/").replace("/", "_")}_link'
    found = []
    encoder = SensorEncoder(frame_id, _covariances(recording))
    for last, columns in _contents(recording):
        full = names.claim(space, source) if own else f'{space}/{last}'
        info = describe(full, TYPES[last], [OfferedQos()])
        found.append(Track(info, stamps, receive, encoder, columns))
    return found


def reported(recording: Recording) -> bool:
    """Return whether a recording has an orientation that is declared, or looks like one."""
    turns = recording.samples.orientation
    if turns is None or not len(recording):
        return False
    declared = recording.covariances[0] if recording.covariances else None
    if declared is None or covariance.reported(declared[0]):
        return True
    first = turns[0]
    parts = (turns[start : start + BLOCK] for start in range(0, len(turns), BLOCK))
    return any((part != first).any() for part in parts)


def _contents(recording: Recording) -> Iterator[tuple[str, dict[str, Floats]]]:
    """Yield the last part of the name and the columns of every topic."""
    columns = recording.samples.columns
    turns = columns.pop(ORIENTATION.field, None)
    motion = {q.field: columns.pop(q.field) for q in IMU_QUANTITIES if q.field in columns}
    if motion:
        if turns is not None and reported(recording):
            motion[ORIENTATION.field] = turns
        yield LINEAR_ACCELERATION.topic, motion
    for quantity in QUANTITIES:
        if quantity.field in columns:
            yield quantity.topic, {quantity.field: columns[quantity.field]}


def _covariances(recording: Recording) -> dict[str, tuple[float, ...]]:
    """Return the covariances that the recording had, in the order of its message."""
    there = [quantity for quantity in QUANTITIES if quantity.field in recording.samples.columns]
    order: Sequence[Quantity] = there
    if LINEAR_ACCELERATION in there or ANGULAR_VELOCITY in there:
        order = (ORIENTATION, ANGULAR_VELOCITY, LINEAR_ACCELERATION)
    known = zip(order, recording.covariances, strict=False)
    return {quantity.name: values for quantity, values in known if values is not None}


def received(recording: Recording) -> Integers:
    """Return the times of arrival; the stamps where there are none that a bag can hold."""
    stamps, receive = recording.samples.stamps, recording.receive_ns
    if receive is None or int(receive.min()) < 0:
        return stamps
    # whoever reads the bag must choose the same ones, also without what was left out
    return receive if choose(stamps, receive, 'header')[1] == 'header' else stamps


def without_room(recording: Recording) -> int:
    """Return how many samples of a bag have stamps that no message can hold, damaged ones."""
    stamps = recording.samples.stamps
    parts = (slice(start, start + PIECE) for start in range(0, stamps.size, PIECE))
    lost = sum(int(np.count_nonzero(~_fits(stamps[part]))) for part in parts)
    low, high = int(stamps.min()), int(stamps.max())
    table = not is_from_bag(recording)
    if lost == stamps.size or (table and (lost or low < 0)):
        raise RecordingError(
            f'{recording.source}, topic {recording.topic}: the stamps go from '
            f'{low * 1e-9:.10g} to {high * 1e-9:.10g} s since 1970, and a bag has room for 0 to '
            '2147483647 s; --to csv and --to npy keep them as they are'
        )
    return lost


def _fits(stamps: Integers) -> npt.NDArray[np.bool_]:
    """Return which stamps fit a header."""
    return np.asarray((stamps >= _FIRST_NS) & (stamps < -_FIRST_NS), np.bool_)


_SEPARATOR = re.compile(r'[^A-Za-z0-9_]+')
_DIGIT = re.compile(r'^(?=\d)')
_OWN = ('imu', 'data_raw')
_NAMELESS = 'imu'

_LONGEST = 120
"""Letters of a label: file systems have room for 255, also for what comes before and after."""


def token(words: str) -> str:
    """
    Return words as one part of a topic name.

    Source: ROS 2 design, "Topic and Service name mapping to DDS", rules of names: letters,
    digits and underscores, no digit first, no two underscores in a row.
    """
    plain = re.sub('__+', '_', _SEPARATOR.sub('_', words)).strip('_')
    return _DIGIT.sub(f'{_NAMELESS}_', plain) or _NAMELESS


def topic(name: str) -> str:
    """Return the name of a topic as ROS 2 accepts it; one that it accepts stays as it is."""
    if re.fullmatch(r'(?:/(?!\d)\w+)+', name, re.ASCII) and '__' not in name:
        return name
    parts = [token(part) for part in name.split('/') if part]
    return '/' + '/'.join(parts or [_NAMELESS])


def is_from_bag(recording: Recording) -> bool:
    """Return whether a recording was a topic of a bag."""
    return recording.stamp_source in ('header', OUTER, 'receive')


def label(recording: Recording) -> str:
    """Return a name for files: that of the file, or that of the topic without what all have."""
    if not is_from_bag(recording):
        return token(recording.topic)[:_LONGEST]
    parts = recording.topic.strip('/').split('/')
    if tuple(parts[-2:]) == _OWN and len(parts) > len(_OWN):
        parts = parts[: -len(_OWN)]
    return token('_'.join(parts))[:_LONGEST]


class Names:
    """Hands out each name once."""

    def __init__(self) -> None:
        self._taken: set[str] = set()

    def claim(self, wanted: str, source: Path, below: Sequence[str] = ()) -> str:
        """Return a name; where it is taken, that of the source or its folder comes before it."""
        name = wanted
        if self._taken & _all(name, below):
            own, folder = token(source.stem), token(source.resolve().parent.name)
            said = own in wanted.strip('/').split('/')
            before = folder if said else own
            name = f'/{before}{wanted}' if wanted.startswith('/') else f'{before}_{wanted}'
        first, number = name, 1
        while self._taken & _all(name, below):
            number += 1
            name = f'{first}_{number}'
        self._taken |= _all(name, below)
        return name


def _all(name: str, below: Sequence[str]) -> set[str]:
    return {name, *(f'{name}/{last}' for last in below)}
