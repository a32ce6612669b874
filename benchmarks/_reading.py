# SPDX-License-Identifier: Apache-2.0
"""
Bag to columns, timed in a process of its own, as both readers run in real life.

Run as ``python -m benchmarks._reading {ours,script} BAG``; prints seconds and messages, for ours
the median of several turns.
"""

from __future__ import annotations

import os
from pathlib import Path
from statistics import median
import sys
import time

# as `imu-bench` does it: the processes are the threads; read when numpy is imported
os.environ.setdefault('OMP_NUM_THREADS', '1')
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

TURNS = 7
"""Ours is so short that one disturbance would count for much."""


def ours(path: Path) -> tuple[float, int]:
    """Return the seconds that our reader takes, and the number of samples."""
    from imu_bench.offline.recordings import ReadOptions
    from imu_bench.offline.recordings.cache import columns
    from imu_bench.offline.running import keep_freed_memory

    keep_freed_memory()  # as `imu-bench analyze` does
    turns, count = [], 0
    for _ in range(TURNS):
        start = time.perf_counter()
        with columns(path, ReadOptions()) as read:
            count = sum(map(len, read.recordings))
        turns.append(time.perf_counter() - start)
    return median(turns), count


def script(path: Path) -> tuple[float, int]:
    """Return the same for the loop of the script."""
    from benchmarks import _todays_script

    start = time.perf_counter()
    count = sum(map(len, _todays_script.read(path).values()))
    return time.perf_counter() - start, count


if __name__ == '__main__':
    print(*{'ours': ours, 'script': script}[sys.argv[1]](Path(sys.argv[2])))
