# SPDX-License-Identifier: Apache-2.0
"""Who does the work of an analysis: processes, arrays in files, what is kept for the next run."""

from __future__ import annotations

import ctypes
import os
import sys

_THREADS = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS')


def one_thread_each() -> None:
    """
    Keep the linear algebra library to one thread: its products are small, the axes are many.

    Counts for processes that start afterwards, and for this one if numpy is not imported yet.
    """
    for name in _THREADS:
        os.environ.setdefault(name, '1')


_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8
"""What mallopt sets: malloc.h of glibc."""

_KEPT = 32 << 20
"""The largest threshold that glibc allows (mallopt(3), DEFAULT_MMAP_THRESHOLD_MAX)."""


def keep_freed_memory() -> None:
    """
    Let the arrays of an analysis take the memory of those before them.

    glibc gives large blocks back at once, and the system clears every page of the next one.  Of
    six sensors at 1 kHz for 10 min it clears 140 000 pages in place of 330 000, a twentieth of the
    processor time (``/usr/bin/time -f %R imu-bench analyze BAG --jobs 1``).  One heap for all
    threads, or each would keep its own.
    """
    mallopt = getattr(ctypes.CDLL(None), 'mallopt', None) if sys.platform == 'linux' else None
    if mallopt is not None:  # others than glibc do not have it
        for parameter, value in (
            (_ARENA_MAX, 1),
            (_MMAP_THRESHOLD, _KEPT),
            (_TRIM_THRESHOLD, _KEPT),
        ):
            mallopt(parameter, value)
