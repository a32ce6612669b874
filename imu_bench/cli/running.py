# SPDX-License-Identifier: Apache-2.0
"""Who works on an analysis, and what is kept for the next one."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from importlib import import_module
from pathlib import Path
import sys
import threading
from typing import NamedTuple, TYPE_CHECKING

from imu_bench.cli.main import complain
from imu_bench.cli.progress import Bar
from imu_bench.errors import RecordingError
from imu_bench.offline.mapped import Residency
from imu_bench.offline.recordings.cache import LARGE
from imu_bench.offline.recordings.loading import stored_bytes
from imu_bench.offline.workers import (
    Here,
    MAPPED_BYTES,
    MOST_WITHIN_MEMORY,
    Processes,
    usable_cores,
    Workers,
)

if TYPE_CHECKING:
    from imu_bench.offline.failure import Failure
    from imu_bench.offline.recordings import ReadOptions
    from imu_bench.offline.results import RecordingResult
    from imu_bench.offline.settings import Settings

NO_CACHE = 'none'
_FOLDER = 'imu_bench_cache'
_MANY = 16
_MOST_JOBS = 1024
_WORTH_KEEPING = 256 << 20
"""Bytes of a recording that takes more than a few seconds to read."""


class Kept(NamedTuple):
    """Folders for columns and for results of single recordings; whether both stay."""

    columns: Path | None
    results: Path | None
    stays: bool


def workers(
    arguments: argparse.Namespace, paths: Sequence[Path]
) -> AbstractContextManager[Workers]:
    """
    Return who works: this process for little, several for much, a cluster if asked.

    Raises
    ------
    RecordingError
        If the cluster does not answer, the library for it is not installed, or --jobs is
        not possible.
    """
    if arguments.jobs is not None and not 1 <= arguments.jobs <= _MOST_JOBS:
        raise RecordingError(
            f'--jobs {arguments.jobs}: between 1 and {_MOST_JOBS} processes can share the work'
        )
    if arguments.scheduler is not None:
        from imu_bench.offline.cluster import Cluster

        return Cluster(arguments.scheduler)
    jobs = arguments.jobs or usable_cores()
    if jobs == 1 or (len(paths) < _MANY and _bytes(paths) < LARGE):
        return nullcontext(Here())
    return Processes(within_memory(jobs))


def within_memory(jobs: int) -> int:
    """Return how many of so many processes have room in 1 GB together; tell if it is fewer."""
    if jobs > MOST_WITHIN_MEMORY:
        print(
            f'--jobs {jobs}: {MOST_WITHIN_MEMORY} processes do the work, more would take over '
            '1 GB of memory together',
            file=sys.stderr,
        )
    return min(jobs, MOST_WITHIN_MEMORY)


def kept(arguments: argparse.Namespace, paths: Sequence[Path]) -> Kept:
    """
    Return where to keep what: in the folder asked for, else beside the output.

    Nothing is put beside a recording without being asked.

    Raises
    ------
    RecordingError
        If the folder asked for is a file.
    """
    if arguments.cache == NO_CACHE:
        return Kept(None, None, stays=False)
    if arguments.cache is not None:
        folder = Path(arguments.cache)
        if folder.exists() and not folder.is_dir():
            raise RecordingError(f'--cache {folder}: this is a file; name a folder, or none')
        return Kept(folder, folder / 'results', stays=True)
    outputs = [output for output in (arguments.json, arguments.html) if output is not None]
    if not outputs:
        return Kept(None, None, stays=False)
    beside = outputs[0].parent.resolve()
    homes = {path.resolve() if path.is_dir() else path.resolve().parent for path in paths}
    if beside in homes:
        return Kept(None, None, stays=False)
    folder = beside / _FOLDER
    large = any(_bytes([path]) >= _WORTH_KEEPING for path in paths)
    return Kept(
        folder if large else None, folder / 'results' if len(paths) > 1 else None, stays=False
    )


def analyse(
    arguments: argparse.Namespace,
    paths: Sequence[Path],
    options: ReadOptions,
    settings: Settings,
    team: Workers,
    failures: list[Failure],
) -> list[RecordingResult]:
    """Return the results of every topic of every recording; what fails is told and kept."""
    from imu_bench.offline.pipeline import analyse_files, Order, Outcome
    from imu_bench.offline.resume import Finished

    places = kept(arguments, paths)
    columns = None if places.columns is None else places.columns.absolute()
    order = Order(options, settings, columns)
    finished = Finished(places.results, order)
    outcomes: dict[int, Outcome] = {}
    if team.apart:
        # others work in folders of their own
        paths = [path.absolute() for path in paths]
    for number, path in enumerate(paths):
        if (known := finished.get(path)) is not None:
            outcomes[number] = known
    if outcomes:
        print(f'{len(outcomes)} of {len(paths)} recordings were finished by an earlier run')
    to_do = [number for number in range(len(paths)) if number not in outcomes]

    def told(done: int, outcome: Outcome) -> None:
        outcomes[to_do[done]] = outcome
        for failure in outcome.failures:
            complain(failure.error)
        finished.put(paths[to_do[done]], outcome)

    with Bar() as bar, Residency(MAPPED_BYTES):
        pending = [paths[number] for number in to_do]
        analyse_files(pending, order, team, told, bar.phase, _import_meanwhile)
    if not places.stays:
        finished.forget()
    in_order = [outcomes[number] for number in sorted(outcomes)]
    failures.extend(failure for outcome in in_order for failure in outcome.failures)
    return [result for outcome in in_order for result in outcome.results]


def _import_meanwhile() -> None:
    """Import what will show the results while others work."""
    threading.Thread(target=_import_the_rest, daemon=True).start()


def _import_the_rest() -> None:
    for name in ('imu_bench.cli.table', 'imu_bench.offline.report'):
        import_module(name)


def _bytes(paths: Sequence[Path]) -> int:
    return sum(map(_size, paths))


def _size(path: Path) -> int:
    try:
        return stored_bytes(path)
    except OSError:
        return 0  # told when it is opened
