# SPDX-License-Identifier: Apache-2.0
"""
What does the rolling analysis cost, and does it drift?

First the cost per sample of six axes and 40 averaging times in blocks of 200, for windows
of different length, beside the cost of computing the same curves anew from the window at
every publication.  Then a long stream with huge transients in it, compared with the batch
functions on the window again and again.  Run it on an otherwise idle machine.
"""

from __future__ import annotations

import itertools
import sys
import time
from typing import NamedTuple

from imu_bench.metrology import allan
from imu_bench.metrology.deviations import noise_type
from imu_bench.metrology.moments import Moments
from imu_bench.metrology.rolling import IMU_UNITS, RollingAnalysis, Window
from imu_bench.metrology.stamps import timing
import numpy as np

from benchmarks._frame import Benchmark

RATE = 1000.0
PERIOD_NS = 1_000_000
BLOCK = 200
FACTORS = 40
SHORTER_WINDOWS = (60, 10)
"""Parts of the longest."""
LIMIT_US = 1.5
TOLERANCE = 1e-9
CHECKS = 20


def averaging_times(window_s: float) -> list[float]:
    """Return 40 averaging times from one sample to a third of the window."""
    top = window_s * RATE / 3
    factors = np.unique(np.rint(np.geomspace(1, top, FACTORS)).astype(int)).tolist()
    extra = (m for m in range(1, int(top)) if m not in factors)
    while len(factors) < FACTORS:
        factors.append(next(extra))
    return [m / RATE for m in sorted(factors)]


class Cost(NamedTuple):
    """µs per sample; ms per snapshot, in it for noise types, to compute the window anew; MB."""

    per_sample: float
    snapshot: float
    noise_types: float
    anew: float
    memory: float


def cost(window_s: float, noise: np.ndarray) -> Cost:
    """Measure the rolling analysis, and the batch analysis of one window."""
    live = RollingAnalysis(window_s, RATE, taus=averaging_times(window_s))
    per_block = []
    fill = int(1.3 * window_s * RATE)
    stamp = 0
    for round_ in range(4):
        count = fill if round_ == 0 else 100_000
        start = time.process_time()
        for first in range(0, count, BLOCK):
            at = first % (len(noise) - BLOCK)
            live.append(np.arange(stamp, stamp + BLOCK) * PERIOD_NS, noise[at : at + BLOCK])
            stamp += BLOCK
        if round_:
            per_block.append((time.process_time() - start) / count * 1e6)
    snapshots = []
    for _ in range(5):
        start = time.process_time()
        live.snapshot()
        snapshots.append((time.process_time() - start) * 1e3)
    size = round(window_s * RATE)
    window = np.resize(noise, (size, noise.shape[1]))
    stamps = np.arange(size) * PERIOD_NS
    start = time.process_time()
    grid = timing.grid(stamps)
    placed, _ = timing.place(window, grid)
    for axis, unit in enumerate(IMU_UNITS):
        allan.deviation(
            placed[:, axis], 1 / grid.period_s, tau=averaging_times(window_s), unit=unit,
            overlap='full', threads=1,
        )  # fmt: skip
    Moments.of(np.ascontiguousarray(window.T))
    anew = (time.process_time() - start) * 1e3
    phase = np.cumsum(window - window.mean(axis=0), axis=0).T.copy()
    types = []
    for _ in range(5):
        start = time.process_time()
        stretches = noise_type.Stretches(np.array([[0, phase.shape[1]]]))
        for axis in phase:
            noise_type.identify_within(stretches, axis, live.m)
        types.append((time.process_time() - start) * 1e3)
    return Cost(min(per_block), min(snapshots), min(types), anew, live.nbytes / 1e6)


def difference(window: Window, stamps: np.ndarray, values: np.ndarray) -> float:
    """Return the largest relative difference from the batch functions on the same samples."""
    inside = (stamps >= window.start_ns) & (stamps <= window.end_ns)
    grid = timing.grid(stamps[inside])
    curve = window.curves[0]
    if curve is None:
        raise SystemExit('the window has no curve')
    batch = allan.deviation(
        values[inside], 1 / grid.period_s, tau=curve.tau, unit=curve.unit, overlap='full'
    )
    pairs = [(curve.deviation, batch.deviation), (curve.low, batch.low), (curve.high, batch.high)]
    moments = Moments.of(values[inside][None, :])
    for ours, theirs in (
        (window.rms[0], moments.rms_estimate(0, curve.unit)),
        (window.std[0], moments.std_estimate(0, curve.unit)),
        (window.mean[0], moments.mean_estimate(0, curve.unit)),
    ):
        pairs.append((np.array([ours.value, ours.high]), np.array([theirs.value, theirs.high])))
    pairs.append((np.array([window.period_s]), np.array([grid.period_s])))
    return max(float(np.max(np.abs(ours / theirs - 1))) for ours, theirs in pairs)


def drift(samples: int) -> float:
    """Stream samples with transients of a million sigma; return the largest difference."""
    window_s, kept = 20.0, 22_000
    live = RollingAnalysis(window_s, RATE, axes=1, units=['rad/s'])
    rng = np.random.default_rng(0)
    worst, done, chunk = 0.0, 0, 1_000_000
    checks = set(np.linspace(1, -(-samples // chunk), CHECKS).astype(int).tolist())
    for part in range(1, -(-samples // chunk) + 1):
        values = rng.normal(9.81, 0.01, chunk)
        # it enters and leaves the window before the check, and once is still inside
        at = chunk - (10_000 if part % 4 == 0 else 30_000)
        values[at : at + 300] += 1e4
        late = rng.integers(-20_000, 20_000, chunk)
        stamps = np.arange(done, done + chunk) * PERIOD_NS + late
        sizes = rng.integers(1, 4000, 1000).cumsum()
        edges = [0, *sizes[sizes < chunk].tolist(), chunk]
        for a, b in itertools.pairwise(edges):
            live.append(stamps[a:b], values[a:b, None])
        done += chunk
        if part in checks:
            off = difference(live.snapshot(), stamps[-kept:], values[-kept:])
            worst = max(worst, off)
            print(f'  {done:>11,} samples: largest relative difference {off:.1e}', flush=True)
    return worst


def main() -> int:
    bench = Benchmark(__doc__)
    bench.add_size('--samples', 100_000_000, quick=200_000, help='of the long stream')
    bench.add_size('--window', 600.0, quick=60.0, help='seconds of the longest window')
    options = bench.start()
    noise = np.random.default_rng(1).normal([0, 0, 9.81, 0, 0, 0], 1.0, (100_000, 6))
    bench.head(
        'window', 'µs/sample', 'snapshot', 'noise types in it', 'anew', 'ratio', 'memory',
        title=f'six axes, {FACTORS} averaging times, blocks of {BLOCK}, 1 kHz',
    )  # fmt: skip
    costs = []
    for window_s in (*(options.window / part for part in SHORTER_WINDOWS), options.window):
        found = cost(window_s, noise)
        costs.append(found)
        # one publication per second: the samples of that second and a snapshot
        ratio = found.anew / (found.per_sample * RATE * 1e-3 + found.snapshot)
        times = (f'{ms:.1f} ms' for ms in (found.snapshot, found.noise_types, found.anew))
        cells = f'{found.per_sample:.2f}', *times, f'{ratio:.1f}', f'{found.memory:.1f} MB'
        bench.row(f'{window_s:.0f} s', *cells)
    print(f'\ndrift over {options.samples:,} samples with transients of a million sigma')
    worst = drift(options.samples)
    dearest = max(found.per_sample for found in costs)
    bench.claim('sample, whatever the window', dearest, at_most=LIMIT_US, unit='µs')
    longest = costs[-1].per_sample / costs[0].per_sample
    bench.claim('sample, longest window over shortest', longest, at_most=1.5)
    bench.claim('largest relative difference from the batch', worst, at_most=TOLERANCE)
    return bench.done()


if __name__ == '__main__':
    sys.exit(main())
