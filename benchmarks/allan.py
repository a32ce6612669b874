# SPDX-License-Identifier: Apache-2.0
"""
How fast is the overlapped Allan deviation, side by side with allantools in one run?

Every round times all of them, one after the other; the claim is the median of the ratios,
not the seconds: run it on an otherwise idle machine.  Ours includes noise types, degrees of
freedom and intervals, theirs has none.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from statistics import median
import sys
import time
import tracemalloc
from typing import Literal

import allantools
from imu_bench.metrology import allan
from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.deviations.averaging import decimation
from imu_bench.metrology.deviations.greenhall import covariance
import numpy as np
import numpy.typing as npt

from benchmarks._frame import Benchmark

FloatArray = npt.NDArray[np.float64]
Overlap = Literal['full', 'auto']

RATE = 200.0
ROUNDS = 5

BASE = f'allantools {allantools.__version__}'
QUARTER = 'a quarter of the samples'

WAYS: tuple[tuple[str, Overlap, int, float], ...] = (
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


def efficiency(m: npt.NDArray[np.int64], samples: int) -> float:
    """Return the least statistical efficiency of decimated starting points, for white noise."""
    overlaps = set((m / decimation(m, samples))[decimation(m, samples) > 1].tolist())
    return 1.0 / max(_scatter(overlap) / _scatter(1000.0) for overlap in overlaps)


def _scatter(overlap: float) -> float:
    """Return the variance of a long average of squares, Greenhall and Riley (2003) eq. (10)."""
    lags = np.arange(int(2 * overlap) + 1) / overlap
    squares = (covariance(lags, np.inf, 0, 2) / covariance(np.zeros(1), np.inf, 0, 2)) ** 2
    return float(squares[0] + 2.0 * squares[1:].sum()) / overlap


def ours(data: FloatArray, tau: FloatArray, overlap: Overlap, threads: int) -> DeviationCurve:
    """Return the deviation as this package computes it."""
    return allan.deviation(data, RATE, tau=tau, overlap=overlap, threads=threads)


def theirs(data: FloatArray, tau: FloatArray) -> FloatArray:
    """Return the deviations that allantools computes."""
    deviations: FloatArray = allantools.oadev(data, rate=RATE, data_type='freq', taus=tau)[1]
    return deviations


def times(data: FloatArray, tau: FloatArray) -> dict[str, list[float]]:
    """Return seconds per round of allantools, of a quarter of the data, and of each of `WAYS`."""
    taken: dict[str, list[float]] = {name: [] for name in (BASE, QUARTER, *(w[0] for w in WAYS))}
    for _ in range(ROUNDS):
        taken[BASE].append(seconds(partial(theirs, data, tau)))
        taken[QUARTER].append(seconds(partial(ours, data[: data.size // 4], tau, 'full', 1)))
        for name, overlap, threads, _ in WAYS:
            taken[name].append(seconds(partial(ours, data, tau, overlap, threads)))
    return taken


def accuracy(data: FloatArray, tau: FloatArray) -> tuple[float, float]:
    """Return the largest differences: full overlap against allantools, default against full."""
    full, default = ours(data, tau, 'full', 1), ours(data, tau, 'auto', 4)
    below = full.m < data.size / 10
    exact = float(np.max(np.abs(full.deviation / theirs(data, tau) - 1.0)))
    return exact, float(np.max(np.abs(default.deviation / full.deviation - 1.0)[below]))


def main() -> int:
    bench = Benchmark(__doc__)
    bench.add_size('--samples', 10_000_000, quick=200_000, help='length of the record')
    samples = bench.start().samples
    data = np.random.default_rng(0).normal(size=samples) + 9.81
    tau = allan.averaging_factors(samples) / RATE
    theirs(data, tau)  # the first call of each pays for what is set up once
    ours(data, tau, 'full', 1)
    taken = times(data, tau)
    bench.head(
        'overlapped Allan deviation', 's', 'times faster (range)',
        title=f'{tau.size} averaging times to a third of the record',
    )  # fmt: skip
    bench.row(BASE, f'{median(taken[BASE]):.3f}', 1)
    for name, _, _, asked in WAYS:
        ratios = [a / b for a, b in zip(taken[BASE], taken[name], strict=True)]
        ratio = median(ratios)
        spread = f'{ratio:.1f} ({min(ratios):.1f} to {max(ratios):.1f})'
        bench.row(name, f'{median(taken[name]):.3f}', spread)
        bench.claim(f'{name}: times faster than allantools', ratio, at_least=asked)

    exact, near = accuracy(data, tau)
    bench.claim('full overlap against allantools, largest difference', exact, at_most=1e-9)
    bench.claim('default against full overlap below N/10, largest difference', near, at_most=0.01)
    lost = 1 - efficiency(allan.averaging_factors(samples), samples)
    bench.claim('efficiency the default gives up, white noise', lost, at_most=0.01)
    held = max(extra_memory(partial(ours, data, tau, overlap, 4)) for overlap in ('full', 'auto'))
    bench.claim('extra memory', held / data.nbytes, at_most=2.0, unit='copies of one axis')
    pairs = zip(taken[WAYS[0][0]], taken[QUARTER], strict=True)
    longer = median(a / b for a, b in pairs)
    bench.claim('time for four times the samples', longer, at_most=6.0, unit='times as long')
    return bench.done()


if __name__ == '__main__':
    sys.exit(main())
