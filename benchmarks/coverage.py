# SPDX-License-Identifier: Apache-2.0
"""
Do the intervals of the deviation hold what they say?  Monte Carlo, fixed seeds.

White, flicker and random-walk rate noise of known level is made many times; counted is how
often the intervals of `allan.deviation`, which is told nothing about the noise, cover the
true deviation.  Run as ``python -m benchmarks.coverage [runs]``.
"""

from __future__ import annotations

import sys
from typing import NamedTuple

from imu_bench.metrology import allan
from imu_bench.metrology.deviations.confidence import interval
import numpy as np
from scipy import fft

SAMPLES = 8192
RUNS = 3000
LEVELS = {0.68: 0.03, 0.95: 0.02}
"""Nominal levels and how far the coverage may be from them."""

NOISES = {0: 'white', -1: 'flicker', -2: 'random walk'}


class Coverage(NamedTuple):
    """How often the intervals at one averaging factor held the truth."""

    alpha: int
    m: int
    identified: float
    covered: dict[float, float]
    width: float


def power_law(alpha: int, n: int) -> np.ndarray:
    """
    Return the impulse response, n long, of noise with PSD ~ f^alpha.

    N. J. Kasdin, "Discrete simulation of colored noise and stochastic processes and 1/f^α power
    law noise generation", Proc. IEEE 83(5) (1995) 802.
    """
    k = np.arange(1, n)
    return np.concatenate(([1.0], np.cumprod((k - 1 - alpha / 2) / k)))


def true_variance(response: np.ndarray, n: int, m: int) -> float:
    """Return the expected Allan variance of the last n samples that a response makes."""
    window = np.repeat([-1.0, 1.0], m) / m
    kernel = np.convolve(response, window)[: response.size]
    energy = np.cumsum(kernel**2)
    # the difference that ends at sample j has seen j + 1 steps of the noise
    return float(energy[response.size - n + 2 * m - 1 :].mean()) / 2.0


def factors(n: int) -> np.ndarray:
    """Return averaging factors up to a tenth of the record, the last one included."""
    return np.unique(np.append(2 ** np.arange(int(np.log2(n / 10)) + 1), n // 10))


def measure(alpha: int, runs: int, n: int, seed: int, kind: str = 'oadev') -> list[Coverage]:
    """Return the coverage at each averaging factor from `runs` records of n samples."""
    response = power_law(alpha, 2 * n)
    size = fft.next_fast_len(4 * n, real=True)
    spectrum = fft.rfft(response, size)
    rng = np.random.default_rng(seed)
    m = factors(n)
    truth = np.sqrt([true_variance(response, n, factor) for factor in m.tolist()])
    covered = {level: np.zeros(m.size) for level in LEVELS}
    identified = np.zeros(m.size)
    width = np.zeros(m.size)
    for _ in range(runs):
        noise = fft.irfft(spectrum * fft.rfft(rng.normal(size=2 * n), size), size)[n : 2 * n]
        curve = allan.deviation(noise, 1.0, tau=m.astype(float), kind=kind)
        identified += curve.alpha == alpha
        for level, count in covered.items():
            low, high = interval(curve.deviation, curve.edf, level)
            count += (low <= truth) & (truth <= high)
        width += np.log(high / low)
    return [
        Coverage(
            alpha,
            int(factor),
            float(identified[i] / runs),
            {level: float(count[i] / runs) for level, count in covered.items()},
            float(width[i] / runs),
        )
        for i, factor in enumerate(m)
    ]


def held(result: Coverage) -> bool:
    """Return whether the coverage is what it should be."""
    return all(abs(result.covered[level] - level) <= LEVELS[level] for level in LEVELS)


def main(runs: int = RUNS) -> int:
    """Print the table; return 1 if a line does not hold."""
    print(f'{runs} records of {SAMPLES} samples; asked: 68 +- 3 %, 95 +- 2 %\n')
    print('| noise | tau/T | 68 % | 95 % | noise identified | width of 95 % | |')
    print('|---|---|---|---|---|---|---|')
    good = True
    for seed, (alpha, name) in enumerate(NOISES.items()):
        for line in measure(alpha, runs, SAMPLES, seed):
            good &= held(line)
            print(
                f'| {name} | 1/{SAMPLES / line.m:.0f} | {100 * line.covered[0.68]:.1f} '
                f'| {100 * line.covered[0.95]:.1f} | {100 * line.identified:.0f} % '
                f'| x{np.exp(line.width):.2f} | {"met" if held(line) else "NOT MET"} |'
            )
    return 0 if good else 1


if __name__ == '__main__':
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else RUNS))
