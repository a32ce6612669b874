# SPDX-License-Identifier: Apache-2.0
"""Who works on an analysis, and what is kept for the next one."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import replace
from importlib import import_module
from pathlib import Path
import sys
import threading
from typing import TYPE_CHECKING

from imu_bench.errors import NotReady, RecordingError
from imu_bench.offline.recordings.cache import LARGE
from imu_bench.offline.recordings.discovery import TEXT_SUFFIXES
from imu_bench.offline.recordings.loading import stored_bytes
from imu_bench.offline.running.analyzing import Kept, Watch
from imu_bench.offline.running.workers import (
    MOST_WITHIN_MEMORY,
    Processes,
    ThisProcess,
    usable_cores,
    Workers,
)
from imu_bench.terminal.progress import Bar
from imu_bench.terminal.words import complain

if TYPE_CHECKING:
    from imu_bench.config.campaign import BenchTest
    from imu_bench.offline.plans.result import PlanResult

NO_CACHE = 'none'
_FOLDER = 'imu_bench_cache'
_MANY = 16
_MOST_JOBS = 1024
_TEXT = 4
"""Bytes of a sample as text for each in a bag: six numbers of a dozen digits against zstd."""

_WORTH_KEEPING = 256 << 20
"""Bytes of a recording that takes more than a few seconds to read."""


def workers(
    arguments: argparse.Namespace, paths: Sequence[Path]
) -> AbstractContextManager[Workers]:
    """Return who works: this process for little, several for much, a cluster if asked."""
    if arguments.jobs is not None and not 1 <= arguments.jobs <= _MOST_JOBS:
        raise RecordingError(
            f'--jobs {arguments.jobs}: between 1 and {_MOST_JOBS} processes can share the work'
        )
    if arguments.scheduler is not None:
        from imu_bench.offline.running.workers import Cluster

        return Cluster(arguments.scheduler)
    jobs = arguments.jobs or usable_cores()
    if jobs == 1 or (len(paths) < _MANY and sum(map(_work, paths)) < LARGE):
        return nullcontext(ThisProcess())
    return Processes(within_memory(jobs))


def team(jobs: int | None = None) -> Processes:
    """Return so many processes, by default as many as there are cores, within 1 GB of memory."""
    return Processes(within_memory(jobs or usable_cores()))


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
    """
    if arguments.cache == NO_CACHE:
        return Kept()
    if arguments.cache is not None:
        folder = Path(arguments.cache)
        if folder.exists() and not folder.is_dir():
            raise RecordingError(f'--cache {folder}: this is a file; name a folder, or none')
        return Kept(folder, folder / 'results', stays=True)
    outputs = [output for output in (arguments.json, arguments.html) if output is not None]
    if not outputs:
        return Kept()
    beside = outputs[0].parent.resolve()
    homes = {path.resolve() if path.is_dir() else path.resolve().parent for path in paths}
    if beside in homes:
        return Kept()
    folder = beside / _FOLDER
    large = any(_bytes([path]) >= _WORTH_KEEPING for path in paths)
    return Kept(
        folder if large else None, folder / 'results' if len(paths) > 1 else None, stays=False
    )


def watch(bar: Bar) -> Watch:
    """Return who is told how the work goes: the terminal."""
    return Watch(
        bar.phase,
        lambda failure: complain(failure.error),
        lambda known, total: print(
            f'{known} of {total} recordings were finished by an earlier run'
        ),
        _import_meanwhile,
    )


def _import_meanwhile() -> None:
    """Import what will show the results while others work."""
    threading.Thread(target=_import_the_rest, daemon=True).start()


def _import_the_rest() -> None:
    for name in ('imu_bench.terminal.tables', 'imu_bench.offline.presentation.pages'):
        with suppress(NotReady):  # who needs it will say so
            import_module(name)


def _work(path: Path) -> int:
    """Return the bytes of a recording, those of text at the worth of their samples."""
    return _size(path) // _TEXT if path.suffix.lower() in TEXT_SUFFIXES else _size(path)


def _bytes(paths: Sequence[Path]) -> int:
    return sum(map(_size, paths))


def _size(path: Path) -> int:
    try:
        return stored_bytes(path)
    except OSError:
        return 0  # told when it is opened


def run_test_plan(
    test: BenchTest, paths: Sequence[Path], folder: Path, jobs: int | None = None
) -> PlanResult:
    """Run the plan of a bench's test on its recordings; write results.json and report.html."""
    from imu_bench import offline
    from imu_bench.offline import plans
    from imu_bench.offline.plans.result import write
    from imu_bench.offline.presentation.pages import write_plan
    from imu_bench.offline.running.pipeline import Order
    from imu_bench.offline.running.plan_runs import Job

    plan = plans.load(test.plan)(test.settings, reference=test.reference)
    order = Order(offline.ReadOptions(), offline.Settings(reference=test.reference))
    with team(jobs) as workers, Bar() as bar:
        job = Job(paths, order, workers, bar.phase, lambda found: complain(found.error))
        result = replace(offline.run_plan(plan, job), form=test.form)
    if test.title not in ('', result.title):
        result = replace(result, title=f'{result.title}: {test.title}')
    write(result, folder / 'results.json')
    write_plan(result, folder / 'report.html')
    return result
