# SPDX-License-Identifier: Apache-2.0
"""
What do gaps do to the Allan deviation?  Three holes of ten minutes in three hours.

White noise and a rate random walk of known level; the deviation over its theory when missing
samples stay missing, when the ends are moved together, and when a line is drawn across.  Then
single samples lost at random, with averages that may lack a twentieth of theirs.
Run as ``python -m benchmarks.gaps [records]``.
"""

from __future__ import annotations

import sys

from imu_bench.metrology import allan
from imu_bench.metrology.fitting.noise_model import variance_of
import numpy as np

RATE_HZ = 100.0
HOURS = 3.0
HOLES_S = ((1800.0, 2400.0), (4500.0, 5100.0), (7800.0, 8400.0))
TRUTH = {'N': 2.5e-3, 'K': 7e-5}
TAU = (1.0, 10.0, 100.0, 300.0)
RECORDS = 1000
AT_MOST = 0.03
LOST = (0.001, 0.01)
MIN_SHARE = 0.95


def record(rng: np.random.Generator) -> np.ndarray:
    """Return the rate of a sensor at rest, shape (n,)."""
    size = round(HOURS * 3600 * RATE_HZ)
    x = TRUTH['N'] * np.sqrt(RATE_HZ) * rng.standard_normal(size)
    x += np.cumsum(TRUTH['K'] / np.sqrt(RATE_HZ) * rng.standard_normal(size))
    return x


def measure(records: int) -> dict[str, np.ndarray]:
    """Return the mean deviation over its theory for each way, shape (k,)."""
    size = round(HOURS * 3600 * RATE_HZ)
    valid = np.ones(size, bool)
    for first, last in HOLES_S:
        valid[round(first * RATE_HZ) : round(last * RATE_HZ)] = False
    index = np.arange(size)
    squares = {'missing': 0.0, 'moved together': 0.0, 'interpolated': 0.0}
    for seed in range(records):
        x = record(np.random.default_rng([7, seed]))
        ways = {
            'missing': (x, valid),
            'moved together': (x[valid], None),
            'interpolated': (np.interp(index, index[valid], x[valid]), None),
        }
        for name, (data, mask) in ways.items():
            curve = allan.deviation(data, RATE_HZ, tau=TAU, valid=mask, overlap='decimated')
            squares[name] = squares[name] + curve.deviation**2 / records
    theory = variance_of(TRUTH, TAU)
    return {name: np.sqrt(square / theory) for name, square in squares.items()}


def scattered(records: int, lost: float) -> tuple[np.ndarray, float]:
    """Return the deviation over that of the whole records, and the longest strict time in s."""
    size = round(HOURS * 3600 * RATE_HZ)
    square, whole, longest = np.zeros(len(TAU)), np.zeros(len(TAU)), 0.0
    for seed in range(records):
        rng = np.random.default_rng([8, seed])
        x, valid = record(rng), rng.random(size) >= lost
        options = {'tau': TAU, 'overlap': 'decimated'}
        curve = allan.deviation(x, RATE_HZ, valid=valid, min_share=MIN_SHARE, **options)
        square += curve.deviation**2
        whole += allan.deviation(x, RATE_HZ, **options).deviation ** 2
        if seed == 0:
            longest = float(allan.deviation(x, RATE_HZ, valid=valid).tau[-1])
    return np.sqrt(square / whole), longest


def main(records: int = RECORDS) -> int:
    """Print the table; return 1 if the claim does not hold."""
    print(f'{records} records of {HOURS:g} h with three holes of 10 min, deviation over theory\n')
    print('| samples of the holes | ' + ' | '.join(f'{tau:g} s' for tau in TAU) + ' | |')
    print('|---|' + '---|' * (len(TAU) + 1))
    good = True
    for name, ratio in measure(records).items():
        verdict = ''
        if name == 'missing':
            good = bool(np.all(np.abs(ratio - 1.0) <= AT_MOST))
            verdict = f'within {100 * AT_MOST:.0f} %: {"met" if good else "NOT MET"}'
        print(f'| {name} | ' + ' | '.join(f'{value:.3f}' for value in ratio) + f' | {verdict} |')
    some = -(-records // 20)
    print(f'\n{some} records that lose single samples, over the same ones whole;')
    print(f'averages count from {100 * MIN_SHARE:g} % of their samples on\n')
    print('| lost | ' + ' | '.join(f'{tau:g} s' for tau in TAU) + ' | strict ends at | |')
    print('|---|' + '---|' * (len(TAU) + 2))
    for lost in LOST:
        ratio, longest = scattered(some, lost)
        close = bool(np.all(np.abs(ratio - 1.0) <= AT_MOST))
        good &= close
        print(
            f'| {100 * lost:g} % | ' + ' | '.join(f'{value:.3f}' for value in ratio)
            + f' | {longest:g} s | within {100 * AT_MOST:.0f} %: {"met" if close else "NOT MET"} |'
        )  # fmt: skip
    return 0 if good else 1


if __name__ == '__main__':
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else RECORDS))
