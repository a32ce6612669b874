# SPDX-License-Identifier: Apache-2.0
"""
Where imported recordings go, with one line on each stream of them.

It goes into a bag, tables as `analyze` reads them without options, or columns.  The line says how
much it is, what was left out, and what was kept.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
import heapq
from pathlib import Path
from typing import Protocol

from imu_bench.bags.columns import ColumnWriter
from imu_bench.bags.writer import BagWriter
from imu_bench.errors import DataError, RecordingError
from imu_bench.metrology.stamps import timing
from imu_bench.offline.imports.taking import field_of, owned, Taken
from imu_bench.offline.imports.tracks import (
    is_from_bag,
    label,
    Names,
    received,
    reported,
    Step,
    tracks,
    without_room,
)
from imu_bench.offline.notation import count, duration, number
from imu_bench.offline.recordings import Recording
from imu_bench.samples import Samples
from msg_conversions.quantities import AXES, BY_FIELD, IMU_QUANTITIES, ORIENTATION, TEMPERATURE
import numpy as np
import numpy.typing as npt

_FLUSHED = 8 << 20
"""Bytes of messages that are handed over together."""

_BLOCK = 1 << 16


class Output(Protocol):
    """Takes one input after the other."""

    def write(self, taken: Taken, step: Step) -> list[Entry]:
        """Write all of an input and return what became of it."""

    def close(self) -> None:
        """Finish."""


class BagOutput:
    """A bag of ROS 2."""

    def __init__(self, path: Path, storage: str, custom: Mapping[str, str]) -> None:
        self._bag = BagWriter(path, storage, custom=custom)
        self._names = Names()

    def write(self, taken: Taken, step: Step) -> list[Entry]:
        """Write all topics of an input in the order of their arrival."""
        entries, found = [], []
        for recording in (*taken.imus, *taken.beside):
            lost = without_room(recording)
            mine = tracks(recording, self._names)
            found += mine
            first, *more = (track.info.name for track in mine)
            remarks = kept_in_bag(recording) if recording in taken.imus else []
            if is_from_bag(recording) and first != recording.topic:
                remarks.append(f'was {recording.topic} in {taken.path.name}')
            remarks += [f'with {", ".join(more)}'] if more else []
            entries.append(entry(first, recording, remarks, lost))
        for track in found:
            self._bag.add_topic(track.info)
        pending = 0
        every = [track.messages(step) for track in found]
        for messages in heapq.merge(*every, key=lambda some: int(some.receive_ns[0])):
            self._bag.write_many(messages.topic, messages.receive_ns, messages.rows)
            pending += messages.rows.size
            if pending >= _FLUSHED:
                self._bag.flush()
                pending = 0
        return entries

    def close(self) -> None:
        """Finish the bag."""
        self._bag.close()


class TableOutput:
    """CSV: one file, or one per stream in a folder."""

    def __init__(self, path: Path, shown: Path) -> None:
        self._path = path
        self._shown = shown
        self._single = shown.suffix.lower() == '.csv'
        self._names = Names()
        self._count = 0
        if not self._single:
            path.mkdir()

    def write(self, taken: Taken, step: Step) -> list[Entry]:
        """Write one file per stream."""
        self._count += len(taken.imus)
        if self._single and self._count > 1:
            raise RecordingError(
                f'{self._shown}: one CSV holds one stream, and there are several: choose one with '
                '--topic, or name a folder with -o and --to csv'
            )
        entries = []
        for recording in taken.imus:
            name = f'{self._names.claim(label(recording), taken.path)}.csv'
            write_table(self._path if self._single else self._path / name, recording, step)
            remarks = lost_outside_bags(recording, 'CSV')
            shown = self._shown if self._single else self._shown / name
            entries.append(entry(str(shown), recording, remarks))
        for recording in taken.beside:
            taken.notes.append(
                f'{taken.path}: {recording.topic} has stamps of its own and is not in a CSV: '
                '--to mcap and --to npy keep it'
            )
        return entries

    def close(self) -> None:
        """Do nothing: every file is complete."""


class ColumnOutput:
    """Columns of NumPy, one folder per stream, as `simulate --storage npy` writes them."""

    def __init__(self, path: Path, shown: Path) -> None:
        self._path = path
        self._shown = shown
        self._names = Names()
        path.mkdir()

    def write(self, taken: Taken, step: Step) -> list[Entry]:
        """Write one folder per stream; what belongs to it goes into the same."""
        entries, gone = [], list(taken.beside)
        for recording in taken.imus:
            name = self._names.claim(label(recording), taken.path)
            mine = owned(recording.topic, gone)
            gone = [other for other in gone if other not in mine.values()]
            self._write(self._path / name, recording, mine, step)
            remarks = lost_outside_bags(recording, 'npy')
            remarks += (
                [f'with {", ".join(other.topic for other in mine.values())}'] if mine else []
            )
            entries.append(entry(str(self._shown / name), recording, remarks))
        for recording in gone:
            taken.notes.append(
                f'{taken.path}: {recording.topic} belongs to no Imu topic by its name and is not '
                'in the columns: --to mcap keeps it'
            )
        return entries

    def close(self) -> None:
        """Do nothing: every file is complete."""

    def _write(
        self, folder: Path, recording: Recording, mine: Mapping[str, Recording], step: Step
    ) -> None:
        writer = ColumnWriter(folder)
        try:
            for start in range(0, len(recording), _BLOCK):
                run = recording.samples[start : start + _BLOCK]
                writer.write([run])
                step(len(run))
            for other in mine.values():
                for start in range(0, len(other), _BLOCK):
                    run = other.samples[start : start + _BLOCK]
                    writer.write_beside(field_of(other), run)
                    step(len(run))
            writer.close()
        finally:
            writer.abandon()


BLOCK = 1 << 14
"""Rows that are written at once."""

_NANO = 1_000_000_000


def write_table(path: Path, recording: Recording, step: Callable[[int], None]) -> None:
    """Write a recording as the CSV that needs no option to be read."""
    columns = named_columns(recording.samples, turns=reported(recording))
    with path.open('w', encoding='ascii', newline='') as file:
        file.write(','.join(['stamp_s', *columns]) + '\n')
        for start in range(0, len(recording), BLOCK):
            part = slice(start, min(start + BLOCK, len(recording)))
            table = np.column_stack([column[part] for column in columns.values()])
            file.write(rows(recording.samples.stamps[part], table))
            step(part.stop - part.start)


def named_columns(samples: Samples, *, turns: bool = False) -> dict[str, npt.NDArray[np.float64]]:
    """Return the columns that hold numbers, by their names in the header."""
    found: dict[str, npt.NDArray[np.float64]] = {}
    for field, values in samples.columns.items():
        quantity = BY_FIELD[field]
        if quantity is TEMPERATURE:
            found['temperature_degC'] = values
        elif turns or quantity is not ORIENTATION:
            named = zip(quantity.columns, values.T, strict=True)
            # an axis is there in every sample or in none
            found |= {name: column for name, column in named if not np.isnan(column[:1]).any()}
    return found


def rows(stamps: npt.NDArray[np.int64], table: npt.NDArray[np.float64]) -> str:
    """Return rows of text from which the same bits come back."""
    lines = []
    for stamp, values in zip(stamps.tolist(), table.tolist(), strict=True):
        sec, nanosec = divmod(abs(stamp), _NANO)
        sign = '-' if stamp < 0 else ''
        # a list writes the shortest digits that give the same float again
        lines.append(f'{sign}{sec}.{nanosec:09d},{repr(values)[1:-1]}\n')
    return ''.join(lines).replace(', ', ',')


_LOOKED_AT = 1 << 20
"""Samples of which the rate is told."""

_DATES_NS = 1_000_000_000_000_000_000
"""In 2001: a clock that shows less does not count from 1970."""

_QUANTITIES = ('orientation', 'angular velocity', 'acceleration')


@dataclass(frozen=True)
class Entry:
    """One stream that was written."""

    name: str  # of the topic, file or folder
    samples: int
    words: str  # what the user must know of it

    def __str__(self) -> str:
        return f'{self.name}: {self.words}'


def entry(name: str, recording: Recording, remarks: list[str], lost: int = 0) -> Entry:
    """Return the entry of a recording written under a name."""
    stamps = recording.samples.stamps
    size = count(len(recording) - lost, 'sample')
    long = duration((int(stamps.max()) - int(stamps.min())) * 1e-9)
    words = [f'{size}, {long}{_rate(recording)}', _left_out(recording, lost)]
    if recording.stamp_source == 'rate':
        words.append('stamps count from 0 s at the given rate, since the source has no clock')
    elif int(stamps.max()) < _DATES_NS:
        words.append('stamps are those of a clock of its own, not dates')
    words += [remark for remark in remarks if remark]
    return Entry(name, len(recording) - lost, '; '.join(words))


def kept_in_bag(recording: Recording) -> list[str]:
    """Return remarks on what a bag has of a recording besides its values."""
    samples = recording.samples
    missing = [
        f'{quantity.name}.{axis}'
        for quantity in IMU_QUANTITIES
        if (values := getattr(samples, quantity.field)) is not None
        for axis, column in zip(AXES, values.T, strict=True)
        if np.isnan(column[:1]).any()
    ]
    absent = [q.name for q in IMU_QUANTITIES if getattr(samples, q.field) is None]
    remarks = [f'{", ".join(missing)} not measured: NaN'] if missing else []
    remarks += [f'{", ".join(absent)} not measured: covariance -1'] if absent else []
    if not is_from_bag(recording):
        return remarks
    turns = reported(recording)
    arrived = received(recording) is recording.receive_ns
    known = zip(_QUANTITIES, recording.covariances, strict=True)
    changing = [
        name for name, values in known if values is None and (turns or name != 'orientation')
    ]
    kept = {
        'receive times': arrived,
        'frame_id': True,
        'covariances': len(changing) < len(recording.covariances),
        'orientation': turns,
    }
    remarks.append(f'kept: {", ".join(name for name, there in kept.items() if there)}')
    if not arrived:
        remarks.append('not kept: receive times, which a bag cannot hold or nobody could use')
    if changing:
        remarks.append(f'not kept: covariance of {" and ".join(changing)}, which changes: now 0')
    return remarks


def lost_outside_bags(recording: Recording, form: str) -> list[str]:
    """Return a remark on what a table or columns have no place for."""
    if not is_from_bag(recording):
        return []
    return [f'{form} has no place for receive times, frame_id and covariances']


def _rate(recording: Recording) -> str:
    stamps = np.array(recording.samples.stamps[:_LOOKED_AT])
    try:
        return f' at {number(1.0 / timing.grid(stamps).period_s, 4)} Hz'
    except (DataError, ZeroDivisionError):
        return ''  # no rate in so few stamps, or such ones


def _left_out(recording: Recording, without_room: int) -> str:
    words = []
    if recording.left_out:
        words.append(f'{count(recording.left_out, "sample")} with values that are no numbers')
    if without_room:
        words.append(f'{count(without_room, "sample")} with stamps that a message cannot hold')
    lost = (recording.announced or 0) - recording.stored
    if lost > 0:
        words.append(f'{count(lost, "announced message")} that could not be read')
    return f'left out: {", ".join(words)}' if words else 'nothing left out'
