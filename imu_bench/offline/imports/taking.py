# SPDX-License-Identifier: Apache-2.0
"""What is taken of one input: its Imu streams, what goes along, and what is to be said."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
import shutil
from tempfile import mkdtemp

from imu_bench.errors import RecordingError
from imu_bench.offline.imports.beside import beside
from imu_bench.offline.imports.naming import is_from_bag
from imu_bench.offline.mapped import Shelf
from imu_bench.offline.pipeline import nobody, Phase
from imu_bench.offline.recordings import ReadOptions, Recording
from imu_bench.offline.recordings.cache import columns


@dataclass(frozen=True, eq=False)
class Taken:
    """
    What was read of one input.

    Attributes
    ----------
    path : Path
    imus : list of Recording
        One per stream.
    beside : list of Recording
        Topics of a bag with one quantity of a sensor.
    notes : list of str
    """

    path: Path
    imus: list[Recording]
    beside: list[Recording]
    notes: list[str]


@contextmanager
def taken(path: Path, options: ReadOptions, phase: Phase = nobody) -> Iterator[Taken]:
    """
    Give what is read of an input; columns of a large one lie in files until the end.

    Parameters
    ----------
    path : Path
    options : ReadOptions
    phase : callable, optional
        Shows progress.

    Raises
    ------
    RecordingError
        As `imu-bench analyze` of the same input.
    """
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
                found = beside(path, names, Shelf(folder).empty, step, only=bool(options.topics))
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
