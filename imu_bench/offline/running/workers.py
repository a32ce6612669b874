# SPDX-License-Identifier: Apache-2.0
"""Who does the work of an analysis: processes of this machine, or a cluster."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
import gc
import multiprocessing
from multiprocessing import connection, forkserver
from multiprocessing.context import BaseContext
from multiprocessing.reduction import ForkingPickler
import os
import pickle
import signal
import threading
from typing import Any, cast, Generic, Protocol, TypeVar

from imu_bench.errors import BenchError, RecordingError
from imu_bench.offline import stages
from imu_bench.offline.running import keep_freed_memory, one_thread_each
from imu_bench.offline.running.mapped import attach, locate, MappedLimit
import numpy as np
import numpy.typing as npt

Answer = TypeVar('Answer')

MAPPED_BYTES = 96 << 20
"""Pages of mapped columns that one process may hold."""

MOST_JOBS = 6
"""Processes if nobody says how many: each may take 150 MB, and 1 GB is to be enough."""

MOST_WITHIN_MEMORY = 10
"""Processes, if somebody asks for many: each then takes 75 MB, of columns 32 MB among them."""

_ALL_MAPPED_BYTES, _LEAST_MAPPED_BYTES = 320 << 20, 16 << 20
"""What the processes together may hold, and what each needs to get on."""

_PRELOADED = (
    'imu_bench.offline.analysis.recording',
    'scipy.special',
    'scipy.fft',
    'scipy.ndimage',
)
"""SciPy loads its parts when they are first used: here once for all processes."""


class Workers(Protocol):
    """Somebody who works: here, in processes of this machine, or in a cluster."""

    jobs: int
    """How much is worked on at once."""
    apart: bool
    """Whether this happens on other machines, which had better read a recording themselves."""

    def submit(self, function: Callable[..., Answer], *arguments: Any) -> Future[Answer]:
        """Begin a piece of work."""


class ThisProcess:
    """
    Does the work at once, in this process.

    Examples
    --------
    >>> ThisProcess().submit(len, 'abc').result()
    3
    """

    jobs = 1
    apart = False

    def submit(self, function: Callable[..., Answer], *arguments: Any) -> Future[Answer]:
        """Do a piece of work; what goes wrong is in its result."""
        done: Future[Answer] = Future()
        try:
            done.set_result(function(*arguments))
        except Exception as error:  # as an executor does: it is raised where the result is taken
            done.set_exception(error)
        return done


class Processes:
    """
    Processes of this machine.

    Mapped arrays in arguments and answers are not copied: their files are opened.

    Parameters
    ----------
    jobs : int
        Number of processes.
    """

    apart = False

    def __init__(self, jobs: int) -> None:
        self.jobs = jobs
        self._others = set(multiprocessing.active_children())
        self._pool = _pool(jobs)

    def submit(self, function: Callable[..., Answer], *arguments: Any) -> Future[Answer]:
        """Begin a piece of work in one of the processes; in new ones if one was killed."""
        try:
            begun = self._pool.submit(stages.accounted, function, *arguments)
        except BrokenProcessPool:
            self._pool = _pool(self.jobs)
            begun = self._pool.submit(stages.accounted, function, *arguments)
        answer: Future[Answer] = Future()
        begun.add_done_callback(lambda done: _answered(done, answer))
        return answer

    def __enter__(self) -> Processes:
        if _context().get_start_method() == 'forkserver':
            # it imports everything once, while this process opens the recording
            one_thread_each()
            forkserver.ensure_running()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:  # stopped: nobody waits for what is under way
            for process in set(multiprocessing.active_children()) - self._others:
                process.terminate()
        # they end while the results are shown; the interpreter waits for them when it ends
        self._pool.shutdown(wait=False, cancel_futures=True)


class Sealed(Generic[Answer]):
    """
    Something that passes through a process which need not know what it is.

    What came out of another process stays packed until it is opened: whoever hands out the
    work then need not wait for the imports that it takes to unpack answers.
    """

    def __init__(self, content: Answer) -> None:
        self._content: Answer | None = content
        self._packed = b''

    def open(self) -> Answer:
        """Return what is in it."""
        if self._packed:
            return cast(Answer, pickle.loads(self._packed))
        return cast(Answer, self._content)

    def __getstate__(self) -> bytes:
        return self._packed or bytes(ForkingPickler.dumps(self._content))

    def __setstate__(self, packed: bytes) -> None:
        self._content, self._packed = None, packed


def usable_cores() -> int:
    """Return the number of cores to use: those this process may use, or fewer to save memory."""
    if hasattr(os, 'sched_getaffinity'):
        return min(MOST_JOBS, len(os.sched_getaffinity(0)))
    return min(MOST_JOBS, os.cpu_count() or 1)


def killed(future: Future[Any]) -> bool:
    """Return whether a process was killed, perhaps not the one that did this piece of work."""
    return isinstance(future.exception(), BrokenProcessPool)


def answer(future: Future[Answer]) -> Answer:
    """Return what came of a piece of work."""
    try:
        return future.result()
    except BrokenProcessPool as problem:
        raise RecordingError(
            'a process of the analysis was killed, most likely for want of memory: '
            'try again with fewer --jobs'
        ) from problem


def _pool(jobs: int) -> ProcessPoolExecutor:
    mapped = min(MAPPED_BYTES, max(_LEAST_MAPPED_BYTES, _ALL_MAPPED_BYTES // jobs))
    return ProcessPoolExecutor(jobs, mp_context=_context(), initializer=_begin, initargs=(mapped,))


def _context() -> BaseContext:
    methods = multiprocessing.get_all_start_methods()
    if 'forkserver' not in methods:
        return multiprocessing.get_context('spawn')
    context = multiprocessing.get_context('forkserver')
    context.set_forkserver_preload(list(_PRELOADED))
    return context


def _begin(mapped: int) -> None:
    """Prepare a process that may hold so many bytes of mapped columns."""
    gc.freeze()  # what was imported stays, and results hold no cycles to look for
    gc.set_threshold(100_000, 20, 100)
    keep_freed_memory()
    # Ctrl-C is for the one who gave the work
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()
    MappedLimit(mapped).__enter__()


def _end_with(sentinel: int) -> None:
    """End this process when the one who gave the work has been killed."""
    connection.wait([sentinel])
    os._exit(1)


def _answered(done: Future[tuple[Answer, stages.Account]], answer: Future[Answer]) -> None:
    """Pass on what came of a piece of work, and book what it took."""
    if done.cancelled():
        answer.cancel()
    elif (problem := done.exception()) is not None:
        answer.set_exception(problem)
    else:
        found, spent = done.result()
        stages.book(spent)
        answer.set_result(found)


def _reduced(array: npt.NDArray[Any]) -> Any:
    """Return how an array is sent to another process: of a mapped one, where it lies."""
    place = locate(array)
    return array.__reduce__() if place is None else (attach, (place,))


ForkingPickler.register(np.ndarray, _reduced)


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
        begun = self._executor.submit(stages.accounted, function, *arguments)
        begun.add_done_callback(lambda done: _pass_on(done, answer))
        return answer

    def __enter__(self) -> Cluster:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown(wait=False)
        self._client.close()


def _pass_on(done: Future[tuple[Answer, stages.Account]], answer: Future[Answer]) -> None:
    problem = None if done.cancelled() else done.exception()
    if problem is None or isinstance(problem, BenchError | OSError | MemoryError):
        _answered(done, answer)
    else:  # of the cluster: a worker died, or has another version
        reason = ' '.join(str(problem).split()) or type(problem).__name__
        answer.set_exception(RecordingError(f'the cluster could not do it: {reason}'))
