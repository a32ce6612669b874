# SPDX-License-Identifier: Apache-2.0
"""
How fast is the overlapped Allan deviation, side by side with allantools in one run?

Every round times all of them, one after the other; the claim is the median of the ratios,
not the seconds.  Run as ``python -m benchmarks.allan [samples]`` on an otherwise idle machine.
"""

from __future__ import annotations

from collections.abc import Callable
import os
import statistics
import sys
import time
import tracemalloc

# one core means one core for the linear algebra library as well; read when numpy is imported
os.environ.setdefault('OMP_NUM_THREADS', '1')
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import allantools
from imu_bench.metrology import allan
from imu_bench.metrology.deviations.averaging import decimation
from imu_bench.metrology.deviations.greenhall import covariance
import numpy as np

SAMPLES = 10_000_000
RATE = 200.0
ROUNDS = 5

WAYS = (
    ('full overlap, one core', 'full', 1, 3.0),
    ('full overlap, four cores', 'full', 4, 8.0),
    ('default, one core', 'auto', 1, 12.0),
    ('default, four cores', 'auto', 4, 12.0),
)
"""Name, overlap, threads, and how many times faster than allantools it is asked to be."""


def seconds(work: Callable[[], object]) -> float:
    """Return how long a call takes."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def extra_memory(work: Callable[[], object]) -> int:
    """Return the bytes a call holds at most beyond what was there before."""
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    tracemalloc.reset_peak()
    work()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak - before


def efficiency(m: np.ndarray, samples: int) -> float:
    """Return the least statistical efficiency of decimated starting points, for white noise."""
    overlaps = set((m / decimation(m, samples))[decimation(m, samples) > 1].tolist())
    return 1.0 / max(_scatter(overlap) / _scatter(1000.0) for overlap in overlaps)


def _scatter(overlap: float) -> float:
    """Return the variance of a long average of squares, Greenhall and Riley (2003) eq. (10)."""
    lags = np.arange(int(2 * overlap) + 1) / overlap
    squares = (covariance(lags, np.inf, 0, 2) / covariance(np.zeros(1), np.inf, 0, 2)) ** 2
    return float(squares[0] + 2.0 * squares[1:].sum()) / overlap


def met(good: bool) -> str:
    """Return what stands behind a line."""
    return 'met' if good else 'NOT MET'


def main(samples: int = SAMPLES) -> int:
    """Print the table; return 1 if a claim does not hold."""
    data = np.random.default_rng(0).normal(size=samples) + 9.81
    m = allan.averaging_factors(samples)
    tau = m / RATE

    def ours(overlap: str, threads: int, part: np.ndarray = data) -> allan.DeviationCurve:
        return allan.deviation(part, RATE, tau=tau, overlap=overlap, threads=threads)

    def theirs() -> tuple[np.ndarray, ...]:
        return allantools.oadev(data, rate=RATE, data_type='freq', taus=tau)

    _, expected, _, _ = theirs()
    full = ours('full', 1)
    default = ours('auto', 4)
    below = full.m < samples / 10
    exact = float(np.max(np.abs(full.deviation / expected - 1.0)))
    near = float(np.max(np.abs(default.deviation / full.deviation - 1.0)[below]))

    print(f'{samples:.0e} samples, {tau.size} averaging times to a third of the record;')
    print(f'cores: {len(os.sched_getaffinity(0))}, load before: {os.getloadavg()[0]:.1f}')
    print('ours includes noise types, degrees of freedom and intervals, theirs has none\n')
    base: list[float] = []
    taken: dict[str, list[float]] = {name: [] for name, *_ in WAYS}
    quarter: list[float] = []
    for _ in range(ROUNDS):
        base.append(seconds(theirs))
        quarter.append(seconds(lambda: ours('full', 1, data[: samples // 4])))
        for name, overlap, threads, _ in WAYS:
            taken[name].append(seconds(lambda o=overlap, t=threads: ours(o, t)))
    print('| overlapped Allan deviation | s | times faster, median (range) | asked | |')
    print('|---|---|---|---|---|')
    print(f'| allantools {allantools.__version__} | {statistics.median(base):.3f} | 1 | | |')
    good = True
    for name, _, _, asked in WAYS:
        ratios = [a / b for a, b in zip(base, taken[name], strict=True)]
        ratio = statistics.median(ratios)
        good &= ratio >= asked
        print(
            f'| {name} | {statistics.median(taken[name]):.3f} '
            f'| {ratio:.1f} ({min(ratios):.1f} to {max(ratios):.1f}) | {asked:.0f} '
            f'| {met(ratio >= asked)} |'
        )

    memory = max(extra_memory(lambda o=o: ours(o, 4)) for o in ('full', 'auto')) / data.nbytes
    growth = statistics.median(a / b for a, b in zip(taken[WAYS[0][0]], quarter, strict=True))
    claims = (
        ('full overlap against allantools, largest difference', exact, 1e-9),
        ('default against full overlap, largest difference below N/10', near, 0.01),
        ('statistical efficiency the default gives up, white noise', 1 - efficiency(m, samples),
         0.01),
        ('extra memory, in copies of one axis', memory, 2.0),
        ('time for four times the samples, the same averaging times', growth, 6.0),
    )  # fmt: skip
    print('\n| claim | measured | at most | |\n|---|---|---|---|')
    for name, value, most in claims:
        good &= value <= most
        print(f'| {name} | {value:.2g} | {most:g} | {met(value <= most)} |')
    return 0 if good else 1


if __name__ == '__main__':
    sys.exit(main(int(float(sys.argv[1])) if len(sys.argv) > 1 else SAMPLES))
