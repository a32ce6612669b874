# SPDX-License-Identifier: Apache-2.0
"""
How well do the methods find N, B and K?  Monte Carlo with known truth, fixed seeds.

Every record is 2.9 h at 100 Hz of white noise, rate random walk and, in the second half of the
table, flicker noise.  Each method gets the same records.  Run as
``python -m benchmarks.coefficients [runs]``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
import sys
import time

from imu_bench.metrology import allan, coefficients, whittle
from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.fitting.noise_model import NoiseModel, variance_basis
import numpy as np
from scipy import fft, optimize

SAMPLES = 2**20
RATE_HZ = 100.0
TRUTHS = ({'N': 2.5e-3, 'B': 0.0, 'K': 7e-5}, {'N': 2.5e-3, 'B': 6e-4, 'K': 7e-5})
RUNS = 200

FIT = 'this package: weighted fit'
REFERENCE = 'non-negative LS, weights from the model, terms given'
PLAIN = 'non-negative LS, weights 1/variance'
WHITTLE = 'this package: Whittle likelihood'
TANGENT = 'slope tangent (MATLAB example)'
METHODS = (FIT, REFERENCE, PLAIN, WHITTLE, TANGENT)


@dataclass
class Outcome:
    """What one method found: values by term, one per run, and what its intervals held."""

    values: dict[str, list[float]] = field(default_factory=lambda: {t: [] for t in 'NBK'})
    covered: dict[str, list[bool]] = field(default_factory=lambda: {t: [] for t in 'NBK'})
    observed: dict[str, list[bool]] = field(default_factory=lambda: {t: [] for t in 'NBK'})
    seconds: list[float] = field(default_factory=list)

    def add(self, values: dict[str, float], seconds: float) -> None:
        """Add the values of one run."""
        for term in 'NBK':
            self.values[term].append(values.get(term, 0.0))
        self.seconds.append(seconds)

    def add_model(self, model: NoiseModel, truth: dict[str, float]) -> None:
        """Add what intervals and bounds say about the truth."""
        for term in 'NBK':
            estimate = model.coefficients[term]
            self.observed[term].append(estimate.observable)
            inside = estimate.low <= truth[term] <= estimate.high
            self.covered[term].append(bool(inside))

    def errors(self, term: str, truth: float, runs: list[bool] | None = None) -> np.ndarray:
        """Return the relative errors in percent, of all runs that report the term or of some."""
        runs = runs or self.observed[term] or [True] * len(self.values[term])
        return 100.0 * np.array(self.values[term])[runs] / truth - 100.0

    def bias(self, term: str, truth: float) -> float:
        """Return the mean relative error in percent."""
        return float(np.mean(self.errors(term, truth)))

    def rmse(self, term: str, truth: float, runs: list[bool] | None = None) -> float:
        """Return the root mean square relative error in percent."""
        return float(np.sqrt(np.mean(self.errors(term, truth, runs) ** 2)))


@lru_cache(maxsize=2)
def flicker_response(n: int, size: int) -> np.ndarray:
    """Return the spectrum, over `size` samples, of the first n of flicker noise's response."""
    k = np.arange(1, n)
    return fft.rfft(np.concatenate([[1.0], np.cumprod((k - 0.5) / k)]), size)


def simulated(truth: dict[str, float], n: int, rate_hz: float, rng: np.random.Generator):
    """
    Return rate noise of known coefficients, shape (n,).

    Flicker: N. J. Kasdin, "Discrete simulation of colored noise", Proc. IEEE 83(5) (1995); its
    two-sided density is B²/(2πf) for a driving noise of standard deviation B.
    """
    x = truth.get('N', 0.0) * np.sqrt(rate_hz) * rng.standard_normal(n)
    if truth.get('K'):
        x += np.cumsum(truth['K'] / np.sqrt(rate_hz) * rng.standard_normal(n))
    if truth.get('B'):
        size = fft.next_fast_len(2 * n, real=True)
        drive = fft.rfft(truth['B'] * rng.standard_normal(n), size)
        x += fft.irfft(flicker_response(n, size) * drive, size)[:n]
    if truth.get('Q'):
        x += truth['Q'] * rate_hz * np.diff(rng.standard_normal(n + 1))
    if truth.get('R'):
        x += truth['R'] * np.arange(n) / rate_hz
    return x


def tangent_tau(n: int, rate_hz: float) -> np.ndarray:
    """Return the averaging times of the MATLAB example: 100, logarithmic, to half the record."""
    largest = 2.0 ** np.floor(np.log2(n / 2))
    return np.unique(np.ceil(np.geomspace(1.0, largest, 100))) / rate_hz


def least_squares(curve: DeviationCurve, terms: str, *, from_model: bool) -> dict[str, float]:
    """
    Return coefficients by non-negative least squares, the terms being known beforehand.

    With weights from the model (five passes, degrees of freedom of white noise after Stein
    1985) the best method known; with weights 1/variance the usual one.
    """
    n, m = curve.samples, curve.m.astype(float)
    degrees = (1.5 * (n - 1) / m - 2.0 * (n - 2) / n) * 4.0 * m**2 / (4.0 * m**2 + 5.0)
    variance = curve.deviation**2
    basis = variance_basis(curve.tau, terms)
    model, squares = variance, np.zeros(len(terms))
    for _ in range(5 if from_model else 1):
        weight = np.sqrt(degrees / 2.0) / model if from_model else 1.0 / variance
        scale = np.sqrt(np.sum((basis * weight) ** 2, axis=1))
        found, _ = optimize.nnls((basis * weight).T / scale, variance * weight)
        squares = found / scale
        model = squares @ basis
    return dict(zip(terms, np.sqrt(squares).tolist(), strict=True))


def measure(
    truth: dict[str, float],
    runs: int,
    n: int = SAMPLES,
    rate_hz: float = RATE_HZ,
    seed: int = 1,
    methods: tuple[str, ...] = METHODS,
) -> dict[str, Outcome]:
    """Return what every method finds in `runs` records; all but Whittle's go together."""
    outcomes = {name: Outcome() for name in methods}
    for run in range(runs):
        x = simulated(truth, n, rate_hz, np.random.default_rng([seed, run]))
        curve = allan.deviation(x, rate_hz, unit='m/s²')
        wide = allan.deviation(x, rate_hz, unit='m/s²', tau=tangent_tau(n, rate_hz))
        terms = 'NBK' if truth['B'] else 'NK'
        model = _timed(outcomes[FIT], lambda c=curve: coefficients.fit(c))
        outcomes[FIT].add_model(model, truth)
        if WHITTLE in methods:
            spectral = _timed(
                outcomes[WHITTLE],
                lambda x=x, t=terms: whittle.fit(x, rate_hz, unit='m/s²', terms=t),
            )
            for term in 'NBK':
                outcomes[WHITTLE].observed[term].append(spectral.coefficients[term].observable)
        _timed(outcomes[TANGENT], lambda c=wide: coefficients.tangent_fit(c))
        outcomes[REFERENCE].add(least_squares(curve, terms, from_model=True), 0.0)
        outcomes[PLAIN].add(least_squares(curve, terms, from_model=False), 0.0)
    return outcomes


def _timed(outcome: Outcome, work: Callable[[], NoiseModel]) -> NoiseModel:
    start = time.perf_counter()
    model = work()
    outcome.add(dict(model.fitted), time.perf_counter() - start)
    return model


def verdicts(truth: dict[str, float], outcomes: dict[str, Outcome]) -> list[tuple[str, bool]]:
    """Return each claim with whether it held."""
    ours, tangent = outcomes[FIT], outcomes[TANGENT]
    claims = []
    for term in 'NBK':
        if truth[term]:
            bias = ours.bias(term, truth[term])
            claims.append((f'{term}: bias {bias:+.1f} %, at most 1 %', abs(bias) <= 1.0))
    for term in 'BK' if truth['B'] else 'K':
        # every method in the runs in which we report the term: the same data for all
        runs, true = ours.observed[term], truth[term]
        rmse = ours.rmse(term, true, runs)
        others = [outcomes[name].rmse(term, true, runs) for name in METHODS if name != FIT]
        claim = (
            f'{term}: RMSE {rmse:.1f} %, at most 1.1 x the best other method, {min(others):.1f} %'
        )
        claims.append((claim, rmse <= 1.1 * min(others)))
        twice = tangent.rmse(term, true, runs)
        claim = f'{term}: at least twice better than the slope tangent, {twice:.1f} %'
        claims.append((claim, 2.0 * rmse <= twice))
    if not truth['B']:
        claims.append(('no bias instability reported', not any(ours.observed['B'])))
    for term in 'NBK':
        share = float(np.mean(ours.covered[term]))
        # 200 runs scatter by 1.5 % about 95 %
        claims.append(
            (f'{term}: intervals and bounds hold the truth ({share:.0%})', share >= 0.88)
        )
    return claims


def main(runs: int = RUNS) -> int:
    """Print the tables; return 1 if a claim does not hold."""
    good = True
    for truth in TRUTHS:
        outcomes = measure(truth, runs)
        print(
            f'\n{runs} records of {SAMPLES / RATE_HZ / 3600:.1f} h at {RATE_HZ:g} Hz, '
            f'N = {truth["N"]:g}, B = {truth["B"]:g}, K = {truth["K"]:g}; bias / RMSE in % '
            'of the runs that report a term\n'
        )
        print('| method | N | B | K | B reported | K reported |')
        print('|---|---|---|---|---|---|')
        for name, outcome in outcomes.items():
            cells = [
                f'{outcome.bias(t, truth[t]):+.1f} / {outcome.rmse(t, truth[t]):.1f}'
                if truth[t]
                else f'median {np.median(outcome.values[t]):.1e}'
                for t in 'NBK'
            ]
            for term in 'BK':
                observed = outcome.observed[term]
                cells.append(f'{sum(observed)} of {runs}' if observed else 'always')
            print(f'| {name} | ' + ' | '.join(cells) + ' |')
        print()
        for claim, held in verdicts(truth, outcomes):
            good &= held
            print(f'{"met    " if held else "NOT MET"}  {claim}')
        fit_ms = 1e3 * float(np.median(outcomes[FIT].seconds))
        print(f'         a fit took {fit_ms:.1f} ms')
    return 0 if good else 1


if __name__ == '__main__':
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else RUNS))
