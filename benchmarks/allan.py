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

BASE = f'allantools {allantools.__version__}'
QUARTER = 'a quarter of the samples'

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


def ours(data: np.ndarray, tau: np.ndarray, overlap: str, threads: int) -> allan.DeviationCurve:
    """Return the deviation as this package computes it."""
    return allan.deviation(data, RATE, tau=tau, overlap=overlap, threads=threads)


def theirs(data: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return what allantools computes: averaging times, deviations, errors, counts."""
    return allantools.oadev(data, rate=RATE, data_type='freq', taus=tau)


def times(data: np.ndarray, tau: np.ndarray) -> dict[str, list[float]]:
    """Return seconds per round of allantools, of a quarter of the data, and of each of `WAYS`."""
    taken: dict[str, list[float]] = {name: [] for name in (BASE, QUARTER, *(w[0] for w in WAYS))}
    for _ in range(ROUNDS):
        taken[BASE].append(seconds(lambda: theirs(data, tau)))
        taken[QUARTER].append(seconds(lambda: ours(data[: data.size // 4], tau, 'full', 1)))
        for name, overlap, threads, _ in WAYS:
            taken[name].append(seconds(lambda o=overlap, t=threads: ours(data, tau, o, t)))
    return taken


def show_times(taken: dict[str, list[float]]) -> bool:
    """Print how much faster each way is; return whether all are as fast as asked."""
    print('| overlapped Allan deviation | s | times faster, median (range) | asked | |')
    print('|---|---|---|---|---|')
    print(f'| {BASE} | {statistics.median(taken[BASE]):.3f} | 1 | | |')
    good = True
    for name, _, _, asked in WAYS:
        ratios = [a / b for a, b in zip(taken[BASE], taken[name], strict=True)]
        ratio = statistics.median(ratios)
        good &= ratio >= asked
        print(
            f'| {name} | {statistics.median(taken[name]):.3f} '
            f'| {ratio:.1f} ({min(ratios):.1f} to {max(ratios):.1f}) | {asked:.0f} '
            f'| {met(ratio >= asked)} |'
        )
    return good


def accuracy(data: np.ndarray, tau: np.ndarray) -> tuple[float, float]:
    """Return the largest differences: full overlap against allantools, default against full."""
    expected = theirs(data, tau)[1]
    full, default = ours(data, tau, 'full', 1), ours(data, tau, 'auto', 4)
    below = full.m < data.size / 10
    exact = float(np.max(np.abs(full.deviation / expected - 1.0)))
    return exact, float(np.max(np.abs(default.deviation / full.deviation - 1.0)[below]))


def show_claims(data: np.ndarray, tau: np.ndarray, taken: dict[str, list[float]]) -> bool:
    """Print what else is claimed; return whether it holds."""
    exact, near = accuracy(data, tau)
    lost = 1 - efficiency(allan.averaging_factors(data.size), data.size)
    held = max(extra_memory(lambda o=o: ours(data, tau, o, 4)) for o in ('full', 'auto'))
    pairs = zip(taken[WAYS[0][0]], taken[QUARTER], strict=True)
    claims = (
        ('full overlap against allantools, largest difference', exact, 1e-9),
        ('default against full overlap, largest difference below N/10', near, 0.01),
        ('statistical efficiency the default gives up, white noise', lost, 0.01),
        ('extra memory, in copies of one axis', held / data.nbytes, 2.0),
        (
            'time for four times the samples, the same averaging times',
            statistics.median(a / b for a, b in pairs),
            6.0,
        ),
    )
    print('\n| claim | measured | at most | |\n|---|---|---|---|')
    for name, value, most in claims:
        print(f'| {name} | {value:.2g} | {most:g} | {met(value <= most)} |')
    return all(value <= most for _, value, most in claims)


def main(samples: int = SAMPLES) -> int:
    """Print the tables; return 1 if a claim does not hold."""
    data = np.random.default_rng(0).normal(size=samples) + 9.81
    tau = allan.averaging_factors(samples) / RATE
    print(f'{samples:.0e} samples, {tau.size} averaging times to a third of the record;')
    print(f'cores: {len(os.sched_getaffinity(0))}, load before: {os.getloadavg()[0]:.1f}')
    print('ours includes noise types, degrees of freedom and intervals, theirs has none\n')
    theirs(data, tau)  # the first call of each pays for what is set up once
    ours(data, tau, 'full', 1)
    taken = times(data, tau)
    fast = show_times(taken)
    return 0 if show_claims(data, tau, taken) and fast else 1


if __name__ == '__main__':
    sys.exit(main(int(float(sys.argv[1])) if len(sys.argv) > 1 else SAMPLES))
