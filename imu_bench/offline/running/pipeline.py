# SPDX-License-Identifier: Apache-2.0
"""From paths to results: recordings one after the other or side by side, axes side by side."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed, FIRST_COMPLETED, Future, wait
from dataclasses import dataclass, replace
from pathlib import Path
import shutil
from tempfile import mkdtemp
from typing import Any, NamedTuple, TYPE_CHECKING

from imu_bench.counting import listed
from imu_bench.errors import BenchError, DataError, os_error_text, TooShort
from imu_bench.metrology import workspace
from imu_bench.offline.analysis.pairing import halves
from imu_bench.offline.analysis.settings import Failure, Settings
from imu_bench.offline.recordings import ReadOptions, Recording
from imu_bench.offline.recordings.cache import columns, Read
from imu_bench.offline.recordings.loading import stored_bytes
from imu_bench.offline.running.mapped import ArrayFolder, locate, MappedLimit, release
from imu_bench.offline.running.workers import (
    answer,
    killed,
    MAPPED_BYTES,
    Sealed,
    ThisProcess,
    Workers,
)

# The estimators are imported where they are used: while this process reads a recording, the
# others import them, and this one when it has nothing else to do.
if TYPE_CHECKING:
    from imu_bench.offline.analysis.axis_result import AxisResult
    from imu_bench.offline.analysis.recording import Prepared
    from imu_bench.offline.analysis.results import RecordingResult

Phase = Callable[[str], Callable[[int, int], None]]
"""Begins a phase of the work; returns the function that takes what is done, and the total."""

Idle = Callable[[], None]

SMALL = 64 << 20
"""Bytes of a recording below which one process does all of it when there are several."""

_NAMED = 4
"""Topics that one line names."""

_AT_ONCE = 100_000_000
"""Samples that are worked on at once: each costs a few bytes, in whatever process."""


@dataclass(frozen=True)
class Order:
    """What is to be done with every recording."""

    options: ReadOptions
    settings: Settings
    keep: Path | None = None  # folder in which columns of large recordings are kept


@dataclass(frozen=True, eq=False)
class Outcome:
    """What became of one recording: results of its topics, and what failed."""

    results: tuple[RecordingResult, ...]
    failures: tuple[Failure, ...] = ()


def do_nothing() -> None:
    """Do nothing with the time."""


def no_progress(title: str) -> Callable[[int, int], None]:
    """Begin a phase that nobody watches."""
    return lambda done, total: None


def analyse_files(
    paths: Sequence[Path],
    order: Order,
    workers: Workers,
    finished: Callable[[int, Outcome], None],
    phase: Phase = no_progress,
    idle: Idle = do_nothing,
) -> None:
    """Analyse recordings, many small ones side by side."""
    whole = [
        number
        for number, path in enumerate(paths)
        if workers.apart or (len(paths) > 1 and workers.jobs > 1 and _bytes(path) < SMALL)
    ]
    again = _side_by_side(whole, paths, order, workers, finished, phase, idle) if whole else []
    for number in sorted({*range(len(paths))} - {*whole} | {*again}):
        finished(number, analyse_file(paths[number], order, workers, phase, idle))


def _side_by_side(
    numbers: Sequence[int],
    paths: Sequence[Path],
    order: Order,
    workers: Workers,
    finished: Callable[[int, Outcome], None],
    phase: Phase,
    idle: Idle,
) -> list[int]:
    """Analyse recordings, each as a whole; return those to be tried again."""
    # When a process is killed, nobody knows which of the recordings under way was to blame.
    again = []
    step = phase(f'analysing {len(numbers)} recordings')
    task = _elsewhere if workers.apart else analyse_file
    futures = {workers.submit(task, paths[number], order): number for number in numbers}
    idle()
    for done, future in enumerate(as_completed(futures), 1):
        number = futures[future]
        if killed(future):
            again.append(number)
        else:
            finished(number, _outcome(paths[number], future))
        step(done, len(futures))
    return again


def _elsewhere(path: Path, order: Order) -> Outcome:
    """Return what becomes of a recording, in a process that others have started."""
    with MappedLimit(MAPPED_BYTES):
        return analyse_file(path, order)


def analyse_file(
    path: Path,
    order: Order,
    workers: Workers | None = None,
    phase: Phase = no_progress,
    idle: Idle = do_nothing,
) -> Outcome:
    """Return what becomes of one recording; what fails is in the outcome."""
    reading = phase(f'reading {path.name}')
    try:
        with columns(path, order.options, keep=order.keep, progress=reading) as read:
            read = replace(read, recordings=halves(read.recordings))
            run = _Run(path, read, order.settings, workers or ThisProcess())
            return run.outcome(phase(f'analysing {path.name}'), idle)
    except (BenchError, OSError, MemoryError) as error:
        return Outcome((), (_failure(path, error),))


class _Run:
    """The topics of one recording on their way through the workers."""

    def __init__(self, path: Path, read: Read, settings: Settings, workers: Workers) -> None:
        self._path = path
        self._read = read
        self._settings = settings
        self._workers = workers
        self._mapped = any(locate(r.samples.stamps) is not None for r in read.recordings)
        self._scratch: Path | None = None
        self._prepared: dict[int, _Ready] = {}
        self._axes: dict[int, dict[str, Sealed[AxisResult]]] = {}
        self._results: dict[int, RecordingResult] = {}
        self._failures: dict[int, Failure] = {}
        self._short: list[int] = []
        self._waiting: deque[tuple[int, str]] = deque()
        self._running: dict[Future[Any], tuple[int, str]] = {}

    def outcome(self, step: Callable[[int, int], None], idle: Idle) -> Outcome:
        """Do all of it."""
        release()  # what was written is not needed here: others look at it
        if self._mapped:
            self._scratch = Path(mkdtemp(prefix='imu_bench_'))
        try:
            self._waiting.extend((number, '') for number in range(len(self._read.recordings)))
            self._begin_some()
            idle()
            while self._running:
                for future in wait(self._running, return_when=FIRST_COMPLETED).done:
                    self._take(future, *self._running.pop(future))
                self._begin_some()
                done = sum(map(len, self._axes.values()))
                step(done, max(1, sum(len(p.axes) for p in self._prepared.values())))
        finally:
            if self._scratch is not None:
                shutil.rmtree(self._scratch, ignore_errors=True)
        for foreign in (False, True):
            self._merge_the_short(foreign)
        return Outcome(
            tuple(self._results[number] for number in sorted(self._results)),
            tuple(self._failures[number] for number in sorted(self._failures)),
        )

    def _merge_the_short(self, foreign: bool) -> None:
        """Say in one line which topics are too short: a bag may have dozens of somebody else."""
        recordings = self._read.recordings
        short = [n for n in sorted(self._short) if recordings[n].foreign == foreign]
        if len(short) < 2:
            return
        whose = 'topics of others' if foreign else 'topics'
        text = f'{self._path}: {len(short)} {whose} have too few samples to analyse: '
        text += listed([recordings[number].topic for number in short], _NAMED)
        for number in short:
            del self._failures[number]
        self._failures[short[0]] = Failure(str(self._path), text, foreign)

    def _begin_some(self) -> None:
        """Hand out work as long as somebody is free and there is memory for it."""
        while self._waiting and len(self._running) <= 2 * self._workers.jobs:
            number, name = self._waiting[0]
            recording = self._read.recordings[number]
            busy = sum(len(self._read.recordings[k]) for k, _ in self._running.values())
            if self._running and busy + len(recording) > _AT_ONCE:
                return
            self._waiting.popleft()
            future = self._begin(number, name, recording)
            self._running[future] = (number, name)

    def _begin(self, number: int, name: str, recording: Recording) -> Future[Any]:
        folder = None if self._scratch is None else self._scratch / str(number)
        if not name:
            problems = tuple(self._read.problems)
            return self._workers.submit(_prepare, recording, self._settings, problems, folder)
        return self._workers.submit(_measure, self._prepared[number].sealed, name, folder)

    def _take(self, future: Future[Any], number: int, name: str) -> None:
        try:
            found = answer(future)
        except (BenchError, OSError, MemoryError) as error:
            if isinstance(error, DataError) and number in self._prepared:
                recording = self._read.recordings[number]
                error = DataError(f'{recording.source}, topic {recording.topic}: {error}')
            if isinstance(error, TooShort):
                self._short.append(number)
            failure = _failure(self._path, error)
            foreign = self._read.recordings[number].foreign
            self._failures.setdefault(number, replace(failure, foreign=foreign))
            self._waiting = deque(item for item in self._waiting if item[0] != number)
            return
        if not name:
            self._prepared[number] = found
            self._axes[number] = {}
            self._waiting.extend((number, axis) for axis in found.axes)
            return
        self._axes[number][name] = found
        ready = self._prepared[number]
        if len(self._axes[number]) == len(ready.axes):
            from imu_bench.offline.analysis.recording import finish

            axes = {name: axis.open() for name, axis in self._axes[number].items()}
            self._results[number] = finish(ready.sealed.open(), axes)
            if self._scratch is not None:
                shutil.rmtree(self._scratch / str(number), ignore_errors=True)


class _Ready(NamedTuple):
    """The names of the axes to be measured, and all that is known of them."""

    axes: tuple[str, ...]
    sealed: Sealed[Prepared]


def _prepare(
    recording: Recording, settings: Settings, problems: Sequence[str], scratch: Path | None
) -> _Ready:
    from imu_bench.offline.analysis.recording import prepare

    if scratch is None:
        ready = prepare(recording, settings, problems)
    else:
        arrays = ArrayFolder(scratch)
        with workspace.borrowing(lambda size, dtype: arrays.empty((size,), dtype)):
            ready = prepare(recording, settings, problems)
        index, keep = arrays.put(ready.grid.index), arrays.put(ready.grid.keep)
        ready = replace(ready, grid=replace(ready.grid, index=index, keep=keep))
    return _Ready(tuple(axis.name for axis in ready.axes), Sealed(ready))


def _measure(sealed: Sealed[Prepared], name: str, scratch: Path | None) -> Sealed[AxisResult]:
    ready = sealed.open()
    axis = next(axis for axis in ready.axes if axis.name == name)
    if scratch is None:
        return Sealed(ready.measure(axis))
    with workspace.borrowing(ArrayFolder(scratch).lend):
        return Sealed(ready.measure(axis))


def _outcome(path: Path, future: Future[Outcome]) -> Outcome:
    try:
        return answer(future)
    except BenchError as error:
        return Outcome((), (_failure(path, error),))


def _failure(path: Path, error: BenchError | OSError | MemoryError) -> Failure:
    if isinstance(error, BenchError):
        return Failure(str(path), str(error))
    if isinstance(error, OSError):
        return Failure(str(path), os_error_text(error))
    return Failure(str(path), f'{path}: not enough memory: analyse a part of it (--start, --end)')


def _bytes(path: Path) -> int:
    try:
        return stored_bytes(path)
    except OSError:
        return 0
