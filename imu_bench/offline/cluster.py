# SPDX-License-Identifier: Apache-2.0
"""The same work on a Dask cluster that is there already: one recording, one task."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from types import TracebackType
from typing import Any, TypeVar

from imu_bench.errors import BenchError, RecordingError

Answer = TypeVar('Answer')

_PATIENCE_S = 10


class Cluster:
    """
    Workers of a Dask scheduler.

    They must see the recordings under the same paths as this machine, and have the same
    version of this package.

    Parameters
    ----------
    address : str
        Of the scheduler, such as 'tcp://host:8786'.

    Raises
    ------
    RecordingError
        If dask.distributed is not installed, or the scheduler does not answer.
    """

    apart = True

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client
        except ImportError as problem:
            raise RecordingError(
                '--scheduler needs dask.distributed, which is not installed: '
                "pip install '.[cluster]' in the folder of imu_bench"
            ) from problem
        try:
            self._client = Client(address, timeout=_PATIENCE_S, set_as_default=False)
        except (OSError, ValueError, TypeError) as problem:
            reason = ' '.join(str(problem).split()) or type(problem).__name__
            raise RecordingError(
                f'--scheduler {address}: no scheduler there: {reason}'
            ) from problem
        self._executor = self._client.get_executor(pure=False)
        self.jobs = max(1, sum(self._client.nthreads().values()))

    def submit(self, function: Callable[..., Answer], *arguments: Any) -> Future[Answer]:
        """Begin a piece of work somewhere."""
        answer: Future[Answer] = Future()
        begun = self._executor.submit(function, *arguments)
        begun.add_done_callback(lambda done: _pass_on(done, answer))
        return answer

    def __enter__(self) -> Cluster:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._executor.shutdown(wait=False)
        self._client.close()


def _pass_on(done: Future[Answer], answer: Future[Answer]) -> None:
    if done.cancelled():
        answer.cancel()
    elif (problem := done.exception()) is None:
        answer.set_result(done.result())
    elif isinstance(problem, BenchError | OSError | MemoryError):
        answer.set_exception(problem)
    else:  # of the cluster: a worker died, or has another version
        reason = ' '.join(str(problem).split()) or type(problem).__name__
        answer.set_exception(RecordingError(f'the cluster could not do it: {reason}'))
