# SPDX-License-Identifier: Apache-2.0
"""
How fast is the overlapped Allan deviation, side by side with allantools in one run?

Prints ratios; they, not the seconds, are the claim.  Run as
``python -m benchmarks.allan [samples]`` on an otherwise idle machine.
"""

from __future__ import annotations

from collections.abc import Callable
import os
import sys
import time
import tracemalloc

# one core means one core for the linear algebra library as well; read when numpy is imported
os.environ.setdefault('OMP_NUM_THREADS', '1')
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import allantools
from imu_bench.metrology import allan
import numpy as np

SAMPLES = 10_000_000
RATE = 200.0
REPEATS = 5


def best(work: Callable[[], object], repeats: int = REPEATS) -> float:
    """Return the shortest of some durations in s: what others on the machine disturb least."""
    durations = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        durations.append(time.perf_counter() - start)
    return min(durations)


def extra_memory(work: Callable[[], object]) -> int:
    """Return the bytes a call holds at most beyond what was there before."""
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    tracemalloc.reset_peak()
    work()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak - before


def main(samples: int = SAMPLES) -> int:
    """Print the table; return 1 if a claim does not hold."""
    data = np.random.default_rng(0).normal(size=samples) + 9.81
    tau = allan.averaging_factors(samples) / RATE

    def ours(overlap: str, threads: int, part: np.ndarray = data) -> allan.DeviationCurve:
        return allan.deviation(part, RATE, tau=tau, overlap=overlap, threads=threads)

    def theirs() -> tuple[np.ndarray, ...]:
        return allantools.oadev(data, rate=RATE, data_type='freq', taus=tau)

    base = best(theirs, 3)
    _, expected, _, _ = theirs()
    full = ours('full', 1)
    default = ours('auto', 4)
    below = full.m < samples / 10
    exact = float(np.max(np.abs(full.deviation / expected - 1.0)))
    near = float(np.max(np.abs(default.deviation / full.deviation - 1.0)[below]))

    print(f'{samples:.0e} samples, {tau.size} averaging times to a third of the record;')
    print(f'cores: {len(os.sched_getaffinity(0))}, load before: {os.getloadavg()[0]:.1f}')
    print('ours includes noise types, degrees of freedom and intervals, theirs has none\n')
    print('| overlapped Allan deviation | s | times faster | asked |')
    print('|---|---|---|---|')
    print(f'| allantools {allantools.__version__} | {base:.3f} | 1 | |')
    good = True
    for name, overlap, threads, asked in (
        ('full overlap, one core', 'full', 1, 3.0),
        ('full overlap, four cores', 'full', 4, 8.0),
        ('default, one core', 'auto', 1, None),
        ('default, four cores', 'auto', 4, 12.0),
    ):
        taken = best(lambda o=overlap, t=threads: ours(o, t))
        ratio = base / taken
        good &= asked is None or ratio >= asked
        print(
            f'| {name} | {taken:.3f} | {ratio:.1f} | {"" if asked is None else f"{asked:.0f}"} |'
        )

    memory = max(extra_memory(lambda o=o: ours(o, 4)) for o in ('full', 'auto')) / data.nbytes
    tenth = best(lambda: ours('full', 1, data[: samples // 10]))
    growth = best(lambda: ours('full', 1)) / tenth
    claims = (
        ('full overlap against allantools, largest difference', exact, 1e-9),
        ('default against full overlap, largest difference below N/10', near, 0.01),
        ('extra memory, in copies of one axis', memory, 2.0),
        ('time for ten times the samples, the same averaging times', growth, 15.0),
    )
    print('\n| claim | measured | at most |\n|---|---|---|')
    for name, value, most in claims:
        good &= value <= most
        print(f'| {name} | {value:.2g} | {most:g} |')
    return 0 if good else 1


if __name__ == '__main__':
    sys.exit(main(int(float(sys.argv[1])) if len(sys.argv) > 1 else SAMPLES))
