# SPDX-License-Identifier: Apache-2.0
"""Where imported recordings go: a bag, tables as `analyze` reads them without options, columns."""

from __future__ import annotations

from collections.abc import Callable, Mapping
import heapq
from pathlib import Path
from typing import Protocol

from imu_bench.bags.columns import ColumnWriter
from imu_bench.bags.writer import BagWriter
from imu_bench.errors import RecordingError
from imu_bench.offline.imports.entry import Entry, entry, kept_in_bag, lost_outside_bags
from imu_bench.offline.imports.naming import is_from_bag, label, Names
from imu_bench.offline.imports.taking import field_of, owned, Taken
from imu_bench.offline.imports.tracks import reported, Step, tracks, without_room
from imu_bench.offline.recordings import Recording
from imu_bench.samples import Samples
from msg_conversions.quantities import BY_FIELD, ORIENTATION, TEMPERATURE
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
