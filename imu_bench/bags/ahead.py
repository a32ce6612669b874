# SPDX-License-Identifier: Apache-2.0
"""Work on the next parts of a file in threads while the present one is used."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
import os
from typing import TypeVar

Job = TypeVar('Job')
Answer = TypeVar('Answer')

THREADS = 2
"""More do not help: somebody has to use what they bring."""

_ROOM = 1 << 26
"""Bytes of all answers together, that in use included, unless a single one is larger."""


def ahead(work: Callable[[Job], Answer], jobs: Iterable[tuple[Job, int]]) -> Iterator[Answer]:
    """
    Yield the answers to some jobs in their order, a few jobs ahead of who asks.

    Worth it where the work leaves the lock of the interpreter alone: decompression,
    checksums, reading, large copies.
    """
    threads = max(1, min(THREADS, os.cpu_count() or 1))
    coming = iter(jobs)
    following = next(coming, None)
    pool = ThreadPoolExecutor(threads)
    waiting: deque[tuple[Future[Answer], int]] = deque()
    taken = 0

    def submit() -> None:
        nonlocal following, taken
        while following is not None and len(waiting) <= threads:
            job, size = following
            if taken and taken + size > _ROOM:
                break
            waiting.append((pool.submit(work, job), size))
            taken += size
            following = next(coming, None)

    try:
        submit()
        while waiting:
            future, size = waiting.popleft()
            submit()
            yield future.result()
            del future
            taken -= size
            submit()
    finally:
        pool.shutdown(cancel_futures=True)
