# SPDX-License-Identifier: Apache-2.0
"""
What do gaps do to the Allan deviation?  Three holes of ten minutes in three hours.

White noise and a rate random walk of known level; the deviation over its theory when missing
samples stay missing, when the ends are moved together, and when a line is drawn across.  Then
single samples lost at random, with averages that may lack a twentieth of theirs.
"""

from __future__ import annotations

import sys

from imu_bench.metrology import allan
from imu_bench.metrology.fitting.noise_model import variance_of
import numpy as np
import numpy.typing as npt

from benchmarks._frame import Benchmark
from benchmarks.coefficients import simulated

FloatArray = npt.NDArray[np.float64]

RATE_HZ = 100.0
HOURS = 3.0
SIZE = round(HOURS * 3600 * RATE_HZ)
HOLES_S = ((1800.0, 2400.0), (4500.0, 5100.0), (7800.0, 8400.0))
TRUTH = {'N': 2.5e-3, 'K': 7e-5}
TAU = (1.0, 10.0, 100.0, 300.0)
WAYS = ('missing', 'moved together', 'interpolated')
AT_MOST = 0.03
LOST = (0.001, 0.01)
MIN_SHARE = 0.95


def measure(records: int) -> dict[str, FloatArray]:
    """Return the mean deviation over its theory for each way, shape (k,)."""
    valid = np.ones(SIZE, bool)
    for first, last in HOLES_S:
        valid[round(first * RATE_HZ) : round(last * RATE_HZ)] = False
    index = np.arange(SIZE)
    squares = {name: np.zeros(len(TAU)) for name in WAYS}
    for seed in range(records):
        x = simulated(TRUTH, SIZE, RATE_HZ, np.random.default_rng([7, seed]))
        ways = (x, valid), (x[valid], None), (np.interp(index, index[valid], x[valid]), None)
        for name, (data, mask) in zip(WAYS, ways, strict=True):
            curve = allan.deviation(data, RATE_HZ, tau=TAU, valid=mask, overlap='decimated')
            squares[name] += curve.deviation**2 / records
    theory = variance_of(TRUTH, TAU)
    return {name: np.sqrt(square / theory) for name, square in squares.items()}


def scattered(records: int, lost: float) -> tuple[FloatArray, float]:
    """Return the deviation over that of the whole records, and the longest strict time in s."""
    square, whole, longest = np.zeros(len(TAU)), np.zeros(len(TAU)), 0.0
    for seed in range(records):
        rng = np.random.default_rng([8, seed])
        x, valid = simulated(TRUTH, SIZE, RATE_HZ, rng), rng.random(SIZE) >= lost
        curve = allan.deviation(
            x, RATE_HZ, tau=TAU, valid=valid, min_share=MIN_SHARE, overlap='decimated'
        )
        square += curve.deviation**2
        whole += allan.deviation(x, RATE_HZ, tau=TAU, overlap='decimated').deviation ** 2
        if seed == 0:
            longest = float(allan.deviation(x, RATE_HZ, valid=valid).tau[-1])
    return np.sqrt(square / whole), longest


def furthest(ratio: FloatArray) -> float:
    """Return the largest relative difference from one."""
    return float(np.max(np.abs(ratio - 1.0)))


def main() -> int:
    bench = Benchmark(__doc__)
    bench.add_size('--records', 1000, quick=2, help='records with holes; a twentieth of it lossy')
    records = bench.start().records
    columns = [f'{tau:g} s' for tau in TAU]
    bench.head('samples of the holes', *columns, title='deviation over theory, three holes')
    ratios = measure(records)
    for name, ratio in ratios.items():
        bench.row(name, *(f'{value:.3f}' for value in ratio))
    bench.claim('holes left out: from the theory', furthest(ratios['missing']), at_most=AT_MOST)
    bench.head(
        'lost', *columns, 'strict ends at',
        title='deviation of records that lose single samples, over the same ones whole; averages '
        f'count from {100 * MIN_SHARE:g} % of their samples on',
    )  # fmt: skip
    for lost in LOST:
        ratio, longest = scattered(-(-records // 20), lost)
        bench.row(f'{lost:.1%}', *(f'{value:.3f}' for value in ratio), f'{longest:g} s')
        name = f'{lost:.1%} lost at random: from the whole record'
        bench.claim(name, furthest(ratio), at_most=AT_MOST)
    return bench.done()


if __name__ == '__main__':
    sys.exit(main())
