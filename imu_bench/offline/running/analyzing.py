# SPDX-License-Identifier: Apache-2.0
"""From recordings in files to one result of all of them, also where an earlier run stopped."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
import json
import os
from pathlib import Path
from typing import Any, NamedTuple, TYPE_CHECKING

from imu_bench.config.json_file import read_json
from imu_bench.offline.analysis.pairing import joined
from imu_bench.offline.analysis.settings import Failure, Settings
from imu_bench.offline.recordings import find_recordings, grouped, ReadOptions
from imu_bench.offline.recordings.cache import fingerprint
from imu_bench.offline.running.mapped import MappedLimit
from imu_bench.offline.running.pipeline import (
    analyse_files,
    do_nothing,
    Idle,
    no_progress,
    Order,
    Outcome,
    Phase,
)
from imu_bench.offline.running.workers import MAPPED_BYTES, ThisProcess, Workers

# the estimators are imported while others work
if TYPE_CHECKING:
    from imu_bench.offline.analysis.results import Analysis, RecordingResult


class Kept(NamedTuple):
    """Folders for columns and for results of single recordings; whether both stay."""

    columns: Path | None = None
    results: Path | None = None
    stays: bool = False


class Watch(NamedTuple):
    """Who is told how the work goes."""

    phase: Phase = no_progress  # shows progress
    # called with each failure as soon as it is known
    failed: Callable[[Failure], None] = lambda failure: None
    # called with the number of recordings that an earlier run has finished, and of all
    resumed: Callable[[int, int], None] = lambda known, total: None
    idle: Idle = do_nothing  # called when work has been handed out and there is time


def analyze(
    inputs: Sequence[str | Path],
    options: ReadOptions | None = None,
    settings: Settings | None = None,
    *,
    pairs: Sequence[tuple[str, str]] = (),
    pool: bool | None = None,
    sheets: Mapping[str, Mapping[str, Any]] | None = None,
    workers: Workers | None = None,
    watch: Watch | None = None,
) -> Analysis:
    r"""
    Return what is measured on recordings, each Imu topic of them, and how they compare.

    Parameters
    ----------
    inputs : sequence of path
        Bags, text files, arrays, or folders of such.
    options : ReadOptions, optional
        How to read them: topics, columns, units, rate.
    settings : Settings, optional
        Which part is measured, and at which confidence level.
    pairs : sequence of (str, str)
        Streams of an accelerometer and a gyroscope that are one sensor.
    pool : bool, optional
        Whether recordings of one topic are one sensor; by default those of one serial number.
    sheets : mapping, optional
        Typical values by sensor, from `comparing.sensors.read_datasheets`.
    workers : Workers, optional
        Processes that share the work; this one alone by default.
    watch : Watch, optional
        Who is told how the work goes.

    Returns
    -------
    Analysis
        With a failure for every input that could not be read.

    Raises
    ------
    RecordingError
        If a path holds no recording, or the pairs or what is to be pooled do not fit.

    Examples
    --------
    >>> from tempfile import mkdtemp
    >>> file = Path(mkdtemp()) / 'chip.csv'
    >>> rows = [f'{k / 100},{(k * 7919 % 101 - 50) / 5e4}' for k in range(500)]
    >>> _ = file.write_text('\n'.join(['stamp_s,angular_velocity.z', *rows]))
    >>> analysis = analyze([file])
    >>> list(analysis.recordings[0].axes)
    ['angular_velocity.z']
    """
    settings = settings or Settings()
    found = [path for given in inputs for path in find_recordings(given)]
    paths, options = grouped(found, options or ReadOptions())
    order = Order(options, settings)
    results, failures = measured(paths, order, workers or ThisProcess(), watch=watch)
    return conclude(joined(results, pairs), failures, settings, sheets=sheets, pool=pool)


def measured(
    paths: Sequence[Path],
    order: Order,
    workers: Workers,
    kept: Kept | None = None,
    watch: Watch | None = None,
) -> tuple[list[RecordingResult], list[Failure]]:
    """Return the results of every topic of every recording, in their order, and what failed."""
    kept, watch = kept or Kept(), watch or Watch()
    finished = Finished(kept.results, order)
    if workers.apart:
        # others work in folders of their own
        paths = [path.absolute() for path in paths]
    outcomes: dict[int, Outcome] = {
        number: known
        for number, path in enumerate(paths)
        if (known := finished.get(path)) is not None
    }
    if outcomes:
        watch.resumed(len(outcomes), len(paths))
    to_do = [number for number in range(len(paths)) if number not in outcomes]

    def note(done: int, outcome: Outcome) -> None:
        outcomes[to_do[done]] = outcome
        for failure in outcome.failures:
            watch.failed(failure)
        finished.put(paths[to_do[done]], outcome)

    with MappedLimit(MAPPED_BYTES):
        pending = [paths[number] for number in to_do]
        analyse_files(pending, order, workers, note, watch.phase, watch.idle)
    if not kept.stays:
        finished.forget()
    in_order = [outcomes[number] for number in sorted(outcomes)]
    return (
        [result for outcome in in_order for result in outcome.results],
        [failure for outcome in in_order for failure in outcome.failures],
    )


def conclude(
    recordings: Sequence[RecordingResult],
    failures: Sequence[Failure],
    settings: Settings,
    *,
    sheets: Mapping[str, Mapping[str, Any]] | None = None,
    asked: Mapping[str, Any] | None = None,
    pool: bool | None = None,
) -> Analysis:
    """
    Return one result of all recordings, compared, with what the user asked for.

    Recordings of one sensor become one: those of a serial number, or as `pool` says.
    """
    from imu_bench.offline.analysis.results import Analysis
    from imu_bench.offline.comparing import pooling
    from imu_bench.offline.comparing.scales import doubted
    from imu_bench.offline.comparing.sensors import compare

    if pool is not False:
        join = pooling.pool if pool else pooling.pool_known
        recordings = join(recordings, settings.confidence)
    recordings = sorted(recordings, key=lambda recording: recording.foreign)
    compared = compare(recordings, settings.reference, sheets)
    recordings = doubted(recordings, compared)
    stated = settings.to_json() | dict(asked or {}) | {'datasheets': dict(sheets or {})}
    return Analysis(tuple(recordings), tuple(failures), stated, compared.to_json())


_SUFFIX = '.result'


class Finished:
    """Outcomes of recordings in a folder, one file each."""

    def __init__(self, folder: Path | None, order: Order) -> None:
        self._folder = folder
        self._order = order
        self._mine: list[Path] = []

    def get(self, path: Path) -> Outcome | None:
        """Return the outcome of a recording that has not changed since, None if there is none."""
        file = self._file(path)
        if file is None:
            return None
        try:
            document = read_json(file)
            from imu_bench.offline.running import outcome_json

            return outcome_json.outcome_from_json(document)
        except (OSError, KeyError, TypeError, AttributeError, ValueError, OverflowError):
            return None  # damaged, or of another version: then the work is done again

    def put(self, path: Path, outcome: Outcome) -> None:
        """Keep an outcome; one with failures is not kept, so that it is tried again."""
        file = self._file(path)
        if file is None or outcome.failures:
            return
        file.parent.mkdir(parents=True, exist_ok=True)
        unfinished = file.with_suffix(f'.{os.getpid()}')
        from imu_bench.offline.running import outcome_json

        document = outcome_json.outcome_to_json(outcome)
        unfinished.write_text(json.dumps(document, allow_nan=False), 'utf-8')
        unfinished.replace(file)

    def forget(self) -> None:
        """Remove what this run has kept or found."""
        for file in self._mine:
            file.unlink(missing_ok=True)
        if self._folder is not None:
            with suppress(OSError):  # others have left something there
                self._folder.rmdir()

    def _file(self, path: Path) -> Path | None:
        if self._folder is None:
            return None
        try:
            key = fingerprint(path, self._order.options, self._order.settings)
        except OSError:
            return None
        file = self._folder / f'{path.stem}-{key[:16]}{_SUFFIX}'
        self._mine.append(file)
        return file
