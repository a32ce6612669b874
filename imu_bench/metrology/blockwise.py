# SPDX-License-Identifier: Apache-2.0
"""
Long arrays, block by block, on some threads.

A block is large enough that threads rarely meet at the lock of the interpreter.  Blocks do
not depend on the number of threads, so threads cannot change a result.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
import os
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

BLOCK = 1 << 18
"""Items per block."""

_WORTH_THREADS = 1 << 20
"""Samples below which threads cost more than they gain."""

_DOT = 1 << 13
"""Length of one dot product."""

Run = Callable[[Callable[[Any], Any], Sequence[Any]], list[Any]]
"""Calls a function with each of some jobs and returns the answers in their order."""


def in_turn(function: Callable[[Any], Any], jobs: Sequence[Any]) -> list[Any]:
    """Call a function with each of some jobs, one after the other."""
    with np.errstate(over='ignore', invalid='ignore'):
        return [function(job) for job in jobs]


@contextmanager
def cores(threads: int, samples: int) -> Iterator[Run]:
    """Give a `Run` on some threads, or in turn if there are too few samples for it."""
    if threads <= 1 or samples < _WORTH_THREADS:
        yield in_turn
        return
    with ThreadPoolExecutor(threads) as pool:
        # the error state of numpy belongs to a thread, so each call sets it
        yield lambda function, jobs: list(pool.map(lambda job: in_turn(function, [job])[0], jobs))


def default_threads() -> int:
    """Return the number of cores this process may use, at most 4."""
    if hasattr(os, 'sched_getaffinity'):
        return min(4, len(os.sched_getaffinity(0)))
    return min(4, os.cpu_count() or 1)


class WorkArrays:
    """Work arrays of one size: as many as there are threads that use one at the same time."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._free: SimpleQueue[Floats] = SimpleQueue()

    @contextmanager
    def taken(self) -> Iterator[Floats]:
        """Give an array whose content does not matter."""
        try:
            work = self._free.get_nowait()
        except Empty:
            work = np.empty(self._size)
        yield work
        self._free.put(work)


def square_sum(values: Floats) -> float:
    """
    Return the sum of squares of a contiguous array, shape (n,).

    A stack of dot products reads the data once and leaves the lock of the interpreter alone;
    each is too short for the linear algebra library to start threads of its own.
    """
    whole = values.size // _DOT * _DOT
    rows = values[:whole].reshape(-1, 1, _DOT)
    rest = values[whole:]
    return float(np.matmul(rows, rows.transpose(0, 2, 1)).sum()) + float(rest @ rest)
