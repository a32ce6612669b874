# SPDX-License-Identifier: Apache-2.0
"""Who does the work of an analysis: processes, arrays in files, what is kept for the next run."""

from __future__ import annotations

import os

_THREADS = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS')


def one_thread_each() -> None:
    """
    Keep the linear algebra library to one thread: its products are small, the axes are many.

    Counts for processes that start afterwards, and for this one if numpy is not imported yet.
    """
    for name in _THREADS:
        os.environ.setdefault(name, '1')
