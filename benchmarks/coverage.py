# SPDX-License-Identifier: Apache-2.0
"""
Do the intervals of the deviation hold what they say?  Monte Carlo, fixed seeds.

White, flicker and random-walk rate noise of known level is made many times; counted is how
often the intervals that `imu-bench analyze` gives, which is told nothing about the noise, cover
the true deviation, and how often it claims each coefficient.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
import sys
from typing import NamedTuple

from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.deviations.confidence import interval
from imu_bench.offline.analysis.settings import Settings
import numpy as np
from scipy import fft

from benchmarks._analyzed import analyzed, AXIS
from benchmarks._frame import Benchmark
from benchmarks._parts import Parts

SAMPLES = 8192
RATE_HZ = 1.0
QUIET = 1e-6
"""rad/s; a random walk of so many samples is no motion then."""

LEVELS = {0.68: 0.03, 0.95: 0.02}
"""Nominal levels and how far the coverage may be from them."""

TERMS = 'QNBKR'

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


def analyzed_curve(noise: np.ndarray, m: np.ndarray) -> tuple[DeviationCurve, str]:
    """Return the deviation that `imu-bench analyze` finds, and the coefficients it claims."""
    settings = Settings(taus=tuple(m.astype(float).tolist()))
    result = analyzed(noise, RATE_HZ, settings).axes[AXIS]
    if result.allan is None:
        raise ValueError('noise that is none')
    return result.allan, ''.join(t for t in TERMS if result.coefficient(t).observable)


@lru_cache
def known(alpha: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the spectrum of the impulse response, and the true deviation at `factors(n)`."""
    response = power_law(alpha, 2 * n)
    size = fft.next_fast_len(4 * n, real=True)
    truth = np.sqrt([true_variance(response, n, factor) for factor in factors(n).tolist()])
    return QUIET * fft.rfft(response, size), QUIET * truth


def made(alpha: int, n: int, seed: int) -> np.ndarray:
    """Return n samples of noise."""
    spectrum, _ = known(alpha, n)
    size = 2 * (spectrum.size - 1)
    drive = np.random.default_rng([seed, -alpha]).normal(size=2 * n)
    noise: np.ndarray = fft.irfft(spectrum * fft.rfft(drive, size), size)[n : 2 * n]
    return noise


def held(
    alpha: int,
    n: int,
    seed: int,
    curve_of: Callable[[np.ndarray, np.ndarray], tuple[DeviationCurve, str]] = analyzed_curve,
) -> dict[str, list[float]]:
    """Return what the intervals of one record held at each averaging factor, and the claims."""
    _, truth = known(alpha, n)
    curve, claimed = curve_of(made(alpha, n, seed), factors(n))
    found = {'identified': (curve.alpha == alpha).astype(float).tolist()}
    for level in LEVELS:
        low, high = interval(curve.deviation, curve.edf, level)
        found[f'{level}'] = ((low <= truth) & (truth <= high)).astype(float).tolist()
    found['width'] = np.log(high / low).tolist()
    found['claimed'] = [float(term in claimed) for term in TERMS]
    return found


def summary(alpha: int, n: int, records: Sequence[Mapping[str, list[float]]]) -> list[Coverage]:
    """Return the coverage at each averaging factor."""
    mean = {name: np.mean([one[name] for one in records], axis=0) for name in records[0]}
    return [
        Coverage(
            alpha,
            int(factor),
            float(mean['identified'][i]),
            {level: float(mean[f'{level}'][i]) for level in LEVELS},
            float(mean['width'][i]),
        )
        for i, factor in enumerate(factors(n))
    ]


def main() -> int:
    bench = Benchmark(__doc__)
    bench.add_size('--runs', 3000, quick=5, help=f'records of {SAMPLES} samples of each noise')
    parts = Parts(bench)
    options = bench.start()
    keys = [(alpha, SAMPLES, run) for run in range(options.runs) for alpha in NOISES]
    records = parts.run(options, held, keys)
    levels = {f'{100 * level:.0f} %': level for level in LEVELS}
    bench.head('noise', 'tau/T', *levels, 'noise identified', 'width of 95 %')
    for alpha, name in NOISES.items():
        of_noise = [records[alpha, SAMPLES, run] for run in range(options.runs)]
        lines = summary(alpha, SAMPLES, of_noise)
        for line in lines:
            covered = (f'{100 * line.covered[level]:.1f}' for level in LEVELS)
            identified, width = f'{100 * line.identified:.0f} %', f'x{np.exp(line.width):.2f}'
            bench.row(name, f'1/{SAMPLES / line.m:.0f}', *covered, identified, width)
        for text, level in levels.items():
            furthest = max(abs(line.covered[level] - level) for line in lines)
            bench.claim(
                f'{name}: coverage from {text} at any averaging time',
                100 * furthest, at_most=100 * LEVELS[level], unit='%',
            )  # fmt: skip
    bench.head('noise      ', *TERMS, title=f'records of {options.runs} that claim a coefficient')
    for alpha, name in NOISES.items():
        claims = np.sum([records[k]['claimed'] for k in keys if k[0] == alpha], axis=0)
        bench.row(name, *(f'{count:.0f}' for count in claims))
    return bench.done()


if __name__ == '__main__':
    sys.exit(main())
