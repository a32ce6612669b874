# SPDX-License-Identifier: Apache-2.0
"""Recordings through a test plan: one by one or side by side, and then the conclusion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

from imu_bench.errors import BenchError, os_error_text, RecordingError
from imu_bench.offline.failure import Failure
from imu_bench.offline.pairing import halves, joined
from imu_bench.offline.pipeline import analyse_files, nobody, Order, Outcome, Phase
from imu_bench.offline.plans.plan import AnyPlan, Plan
from imu_bench.offline.plans.result import PlanResult
from imu_bench.offline.recordings.cache import columns
from imu_bench.offline.results import RecordingResult
from imu_bench.offline.workers import answer, Here, Workers

Measured = TypeVar('Measured')


class NothingMeasured(RecordingError):
    """No recording could be measured; why, is told of each."""


def unheard(failure: Failure) -> None:
    """Tell nobody of a failure; it is in the result."""


@dataclass(frozen=True)
class Job:
    """
    Recordings for a plan, and how they are worked on.

    Attributes
    ----------
    paths : sequence of Path
    order : Order
        How they are read, and what a noise analysis is asked for.
    workers : Workers
    phase : callable
        Shows progress.
    failed : callable
        Told of a recording that could not be measured, as soon as it is known.
    pairs : sequence of (str, str)
        Streams of an accelerometer and a gyroscope that are one sensor, as for `joined`.
    """

    paths: Sequence[Path]
    order: Order
    workers: Workers = field(default_factory=Here)
    phase: Phase = nobody
    failed: Callable[[Failure], None] = unheard
    pairs: Sequence[tuple[str, str]] = ()


def run(plan: AnyPlan[Any], job: Job) -> PlanResult:
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

    def failed(failure: Failure) -> None:
        failures.append(failure)
        job.failed(failure)

    heard = replace(job, failed=failed)
    measured: Sequence[Any]
    measured = _measured(plan, heard) if isinstance(plan, Plan) else _analysed(heard)
    if not measured:
        raise NothingMeasured(f'plan {plan.name}: none of the recordings could be measured')
    result = plan.conclude(measured)
    asked = {**plan.stated(), 'reference': plan.reference, 'confidence': plan.confidence}
    return replace(
        result,
        settings={**asked, **result.settings},
        sources=tuple(map(str, job.paths)),
        failures=(*result.failures, *failures),
    )


def _analysed(job: Job) -> list[RecordingResult]:
    """Return the noise analysis of every topic of every recording."""
    outcomes: dict[int, Outcome] = {}

    def told(number: int, outcome: Outcome) -> None:
        outcomes[number] = outcome
        for failure in outcome.failures:
            job.failed(failure)

    analyse_files(job.paths, job.order, job.workers, told, job.phase)
    found = [result for number in sorted(outcomes) for result in outcomes[number].results]
    return joined(found, job.pairs)


def _measured(plan: Plan[Measured], job: Job) -> list[Measured]:
    """Return what a plan keeps of every recording, in the order given."""
    step = job.phase(f'plan {plan.name}')
    futures = {
        job.workers.submit(_measure, plan, path, job.order): number
        for number, path in enumerate(job.paths)
    }
    found: dict[int, Measured] = {}
    for done, future in enumerate(as_completed(futures), 1):
        number = futures[future]
        try:
            found[number] = answer(future)
        except (BenchError, OSError, MemoryError) as error:
            job.failed(_failure(job.paths[number], error))
        step(done, len(futures))
    return [found[number] for number in sorted(found)]


def _measure(plan: Plan[Measured], path: Path, order: Order) -> Measured:
    with columns(path, order.options, keep=order.keep) as read:
        return plan.measure(str(path), halves(read.recordings))


def _failure(path: Path, error: BenchError | OSError | MemoryError) -> Failure:
    if isinstance(error, MemoryError):
        text = 'not enough memory: analyse fewer recordings at once (--jobs)'
    elif isinstance(error, OSError) and not isinstance(error, BenchError):
        text = os_error_text(error)
    else:
        text = str(error)
    return Failure(str(path), text if str(path) in text else f'{path}: {text}')
