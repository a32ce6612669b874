# SPDX-License-Identifier: Apache-2.0
"""Work on the next parts of a file in threads while the present one is used."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
import os
from typing import TypeVar

Job = TypeVar('Job')
Answer = TypeVar('Answer')

THREADS = 2
"""More do not help: somebody has to use what they bring."""


def ahead(work: Callable[[Job], Answer], jobs: Iterable[Job]) -> Iterator[Answer]:
    """
    Yield the answers to some jobs in their order, a few jobs ahead of who asks.

    Worth it where the work leaves the lock of the interpreter alone: decompression,
    checksums, reading, large copies.

    Examples
    --------
    >>> list(ahead(lambda number: number**2, range(4)))
    [0, 1, 4, 9]
    """
    threads = max(1, min(THREADS, os.cpu_count() or 1))
    coming = iter(jobs)
    pool = ThreadPoolExecutor(threads)
    waiting: deque[Future[Answer]] = deque()
    try:
        waiting.extend(pool.submit(work, job) for job in islice(coming, threads + 1))
        while waiting:
            answer = waiting.popleft().result()
            waiting.extend(pool.submit(work, job) for job in islice(coming, 1))
            yield answer
    finally:
        pool.shutdown(cancel_futures=True)
