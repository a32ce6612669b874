# SPDX-License-Identifier: Apache-2.0
"""
What do gaps do to the Allan deviation?  Three holes of ten minutes in three hours.

White noise and a rate random walk of known level; the deviation over its theory when missing
samples stay missing, when the ends are moved together, and when a line is drawn across.
Run as ``python -m benchmarks.gaps [records]``.
"""

from __future__ import annotations

import sys

from imu_bench.metrology import allan
from imu_bench.metrology.noise_model import variance_of
import numpy as np

RATE_HZ = 100.0
HOURS = 3.0
HOLES_S = ((1800.0, 2400.0), (4500.0, 5100.0), (7800.0, 8400.0))
TRUTH = {'N': 2.5e-3, 'K': 7e-5}
TAU = (1.0, 10.0, 100.0, 300.0)
RECORDS = 1000
AT_MOST = 0.03


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
    return 0 if good else 1


if __name__ == '__main__':
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else RECORDS))
