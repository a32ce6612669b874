# SPDX-License-Identifier: Apache-2.0
"""
What does the rolling analysis cost, and does it drift?

First the cost per sample of six axes and 40 averaging times in blocks of 200, for windows
of different length, beside the cost of computing the same curves anew from the window at
every publication.  Then a long stream with huge transients in it, compared with the batch
functions on the window again and again.  Run as ``python -m benchmarks.rolling [samples]``
on an otherwise idle machine.
"""

from __future__ import annotations

import itertools
import os
import sys
import time
from typing import NamedTuple

# one core means one core for the linear algebra library as well; read when numpy is imported
os.environ.setdefault('OMP_NUM_THREADS', '1')
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

from imu_bench.metrology import allan
from imu_bench.metrology.deviations import noise_type
from imu_bench.metrology.moments import Moments
from imu_bench.metrology.rolling import IMU_UNITS, RollingAnalysis, Window
from imu_bench.metrology.stamps import timing
import numpy as np

RATE = 1000.0
PERIOD_NS = 1_000_000
BLOCK = 200
FACTORS = 40
WINDOWS = (10.0, 60.0, 600.0)
LIMIT_US = 1.5
SAMPLES = 100_000_000
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
        start = time.perf_counter()
        for first in range(0, count, BLOCK):
            at = first % (len(noise) - BLOCK)
            live.append(np.arange(stamp, stamp + BLOCK) * PERIOD_NS, noise[at : at + BLOCK])
            stamp += BLOCK
        if round_:
            per_block.append((time.perf_counter() - start) / count * 1e6)
    snapshots = []
    for _ in range(5):
        start = time.perf_counter()
        live.snapshot()
        snapshots.append((time.perf_counter() - start) * 1e3)
    size = round(window_s * RATE)
    window = np.resize(noise, (size, noise.shape[1]))
    stamps = np.arange(size) * PERIOD_NS
    start = time.perf_counter()
    grid = timing.grid(stamps)
    placed, _ = timing.place(window, grid)
    for axis, unit in enumerate(IMU_UNITS):
        allan.deviation(
            placed[:, axis], 1 / grid.period_s, tau=averaging_times(window_s), unit=unit,
            overlap='full', threads=1,
        )  # fmt: skip
    Moments.of(np.ascontiguousarray(window.T))
    anew = (time.perf_counter() - start) * 1e3
    phase = np.cumsum(window - window.mean(axis=0), axis=0).T.copy()
    types = []
    for _ in range(5):
        start = time.perf_counter()
        stretches = noise_type.Stretches(np.array([[0, phase.shape[1]]]))
        for axis in phase:
            noise_type.identify_within(stretches, axis, live.m)
        types.append((time.perf_counter() - start) * 1e3)
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


def main(samples: int = SAMPLES) -> int:
    """Print the tables; return 1 if a claim does not hold."""
    noise = np.random.default_rng(1).normal([0, 0, 9.81, 0, 0, 0], 1.0, (100_000, 6))
    print(f'six axes, {FACTORS} averaging times, blocks of {BLOCK}, 1 kHz')
    print('| window | µs/sample | snapshot | noise types in it | anew | ratio | memory |')
    print('|---|---|---|---|---|---|---|')
    costs = []
    for window_s in WINDOWS:
        found = cost(window_s, noise)
        costs.append(found)
        # one publication per second: the samples of that second and a snapshot
        ratio = found.anew / (found.per_sample * RATE * 1e-3 + found.snapshot)
        print(
            f'| {window_s:.0f} s | {found.per_sample:.2f} | {found.snapshot:.1f} ms '
            f'| {found.noise_types:.1f} ms | {found.anew:.1f} ms | {ratio:.1f} '
            f'| {found.memory:.1f} MB |'
        )
    print(f'\ndrift over {samples:,} samples with transients of a million sigma')
    worst = drift(samples)
    claims = (
        ('µs per sample, whatever the window', max(c.per_sample for c in costs), LIMIT_US),
        ('longest window over shortest, cost per sample',
         costs[-1].per_sample / costs[0].per_sample, 1.5),
        ('largest relative difference from the batch', worst, TOLERANCE),
    )  # fmt: skip
    print('\n| claim | measured | at most | |\n|---|---|---|---|')
    for name, value, most in claims:
        print(f'| {name} | {value:.2g} | {most:g} | {"met" if value <= most else "NOT MET"} |')
    return int(any(value > most for _, value, most in claims))


if __name__ == '__main__':
    raise SystemExit(main(*(int(argument) for argument in sys.argv[1:2])))
