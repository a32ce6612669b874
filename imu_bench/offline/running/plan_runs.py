# SPDX-License-Identifier: Apache-2.0
"""Recordings through a test plan: one by one or side by side, and then the conclusion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

from imu_bench.bags.problems import code_of, SIMULATED
from imu_bench.errors import BenchError, os_error_text, RecordingError
from imu_bench.offline.analysis.pairing import halves, joined
from imu_bench.offline.analysis.results import RecordingResult, without_foreign
from imu_bench.offline.analysis.settings import Failure
from imu_bench.offline.health.stamps import simulation_finding
from imu_bench.offline.plans import recorded
from imu_bench.offline.plans.plan import AnyPlan, Plan
from imu_bench.offline.plans.recorded import Recorded
from imu_bench.offline.plans.result import PlanResult
from imu_bench.offline.recordings.cache import columns
from imu_bench.offline.running.pipeline import analyse_files, no_progress, Order, Outcome, Phase
from imu_bench.offline.running.workers import answer, ThisProcess, Workers

Measured = TypeVar('Measured')


class NothingMeasured(RecordingError):
    """No recording could be measured; why, is told of each."""


def ignore_failure(failure: Failure) -> None:
    """Tell nobody of a failure; it is in the result."""


@dataclass(frozen=True)
class Job:
    """Recordings for a plan, and how they are worked on."""

    paths: Sequence[Path]
    order: Order  # how they are read, and what a noise analysis is asked for
    workers: Workers = field(default_factory=ThisProcess)
    phase: Phase = no_progress  # shows progress
    # told of a recording that could not be measured, as soon as it is known
    failed: Callable[[Failure], None] = ignore_failure
    # streams of an accelerometer and a gyroscope that are one sensor, as for `joined`
    pairs: Sequence[tuple[str, str]] = ()


def run_plan(plan: AnyPlan[Any], job: Job) -> PlanResult:
    """
    Return what a plan finds in recordings; one that fails does not stop the others.

    Raises
    ------
    NothingMeasured
        If no recording could be measured.
    RecordingError
        If the plan misses something, or cannot use the pairs that are named.
    """
    if job.pairs and isinstance(plan, Plan):
        raise RecordingError(
            f'--pair: plan {plan.name} measures every stream by itself, at its own rate, and '
            'names it by its topic: leave --pair out'
        )
    failures: list[Failure] = []
    simulated: list[str] = []
    found: list[Recorded] = []

    def failed(failure: Failure) -> None:
        failures.append(failure)
        job.failed(failure)

    heard = replace(job, failed=failed)
    measured: Sequence[Any]
    if isinstance(plan, Plan):
        measured = _measured(plan, heard, simulated, found)
        doubts = recorded.doubts(found)
    else:
        measured = _analysed(heard)
        simulated += [each.simulated for each in measured if each.simulated]
        found += map(recorded.analysed, measured)
        doubts = []  # the plan says them itself
    if not measured:
        raise NothingMeasured(f'plan {plan.name}: none of the recordings could be measured')
    result = plan.conclude(measured)
    asked = {**plan.stated(), 'reference': plan.reference, 'confidence': plan.confidence}
    return replace(
        result,
        findings=(
            *(simulation_finding(words) for words in simulated[:1]),
            *doubts,
            *result.findings,
        ),
        recorded=tuple(found),
        document=plan.document,
        settings={**asked, **result.settings},
        sources=tuple(map(str, job.paths)),
        failures=(*result.failures, *failures),
    )


def _analysed(job: Job) -> list[RecordingResult]:
    """Return the noise analysis of every topic of every recording."""
    outcomes: dict[int, Outcome] = {}

    def finished(number: int, outcome: Outcome) -> None:
        outcomes[number] = outcome
        for failure in outcome.failures:
            if not failure.foreign:
                job.failed(failure)

    analyse_files(job.paths, job.order, job.workers, finished, job.phase)
    found = [result for number in sorted(outcomes) for result in outcomes[number].results]
    return joined(without_foreign(found), job.pairs)


def _measured(
    plan: Plan[Measured], job: Job, simulated: list[str], streams: list[Recorded]
) -> list[Measured]:
    """Return what a plan keeps of every recording, in the order given."""
    step = job.phase(f'plan {plan.name}')
    futures = {
        job.workers.submit(_measure, plan, path, job.order): number
        for number, path in enumerate(job.paths)
    }
    found: dict[int, Measured] = {}
    taken: dict[int, list[Recorded]] = {}
    for done, future in enumerate(as_completed(futures), 1):
        number = futures[future]
        try:
            found[number], made, taken[number] = answer(future)
            simulated += made
        except (BenchError, OSError, MemoryError) as error:
            job.failed(_failure(job.paths[number], error))
        step(done, len(futures))
    streams += [each for number in sorted(taken) for each in taken[number]]
    return [found[number] for number in sorted(found)]


def _measure(
    plan: Plan[Measured], path: Path, order: Order
) -> tuple[Measured, list[str], list[Recorded]]:
    with columns(path, order.options, keep=order.keep) as read:
        asked = [each for each in read.recordings if not each.foreign] or read.recordings
        notes = [note for recording in asked for note in recording.notes]
        made = [note for note in notes if code_of(note) == SIMULATED]
        measured = plan.measure(str(path), halves(asked))
        return measured, made, [recorded.examined(each, read.problems) for each in asked]


def _failure(path: Path, error: BenchError | OSError | MemoryError) -> Failure:
    if isinstance(error, MemoryError):
        text = 'not enough memory: analyse fewer recordings at once (--jobs)'
    elif isinstance(error, OSError) and not isinstance(error, BenchError):
        text = os_error_text(error)
    else:
        text = str(error)
    return Failure(str(path), text if str(path) in text else f'{path}: {text}')
