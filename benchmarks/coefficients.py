# SPDX-License-Identifier: Apache-2.0
"""
How well do the methods find N, B and K?  Monte Carlo with known truth, fixed seeds.

Every record is 2.9 h at 100 Hz of white noise, rate random walk and, in the second half of the
table, flicker noise.  Each method gets the same records; ours is all that
`imu-bench analyze` does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
import json
import sys
from typing import Any

from imu_bench.metrology import allan, coefficients, whittle
from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.fitting.noise_model import NoiseModel, variance_basis
import numpy as np
import numpy.typing as npt
from scipy import fft, optimize

from benchmarks._analyzed import analyzed, AXIS
from benchmarks._frame import Benchmark
from benchmarks._parts import Parts
from benchmarks.coverage import power_law

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]

Found = dict[str, dict[str, Any]]
"""Value, whether reported, and whether its interval held the truth, each by term."""

TERMS = 'QNBK'
RATE_HZ = 100.0
TRUTHS = ({'N': 2.5e-3, 'B': 0.0, 'K': 7e-5}, {'N': 2.5e-3, 'B': 6e-4, 'K': 7e-5})

OURS = 'imu-bench analyze'
REFERENCE = 'non-negative LS, weights from the model, terms given'
PLAIN = 'non-negative LS, weights 1/variance'
WHITTLE = 'Whittle likelihood, terms given'
TANGENT = 'slope tangent (MATLAB example)'
METHODS = (OURS, REFERENCE, PLAIN, WHITTLE, TANGENT)


@dataclass
class Outcome:
    """What one method found: values by term, one per run, and what its intervals held."""

    values: dict[str, list[float]] = field(default_factory=lambda: {t: [] for t in TERMS})
    covered: dict[str, list[bool]] = field(default_factory=lambda: {t: [] for t in TERMS})
    observed: dict[str, list[bool]] = field(default_factory=lambda: {t: [] for t in TERMS})

    def add(self, found: Found) -> None:
        """Add one run."""
        for mine, its in (
            (self.values, found['values']), (self.covered, found['covered']),
            (self.observed, found['observed']),
        ):  # fmt: skip
            for term, one in its.items():
                mine[term].append(one)

    def errors(self, term: str, truth: float, runs: list[bool] | None = None) -> FloatArray:
        """Return the relative errors in percent, of runs that report the term; NaN of none."""
        runs = runs or self.observed[term] or [True] * len(self.values[term])
        if not any(runs):
            return np.array([np.nan])
        return 100.0 * np.array(self.values[term])[runs] / truth - 100.0

    def bias(self, term: str, truth: float) -> float:
        """Return the mean relative error in percent."""
        return float(np.mean(self.errors(term, truth)))

    def rmse(self, term: str, truth: float, runs: list[bool] | None = None) -> float:
        """Return the root mean square relative error in percent."""
        return float(np.sqrt(np.mean(self.errors(term, truth, runs) ** 2)))


@lru_cache(maxsize=2)
def flicker_response(n: int, size: int) -> ComplexArray:
    """Return the spectrum, over `size` samples, of the first n of flicker noise's response."""
    response: ComplexArray = fft.rfft(power_law(-1, n), size)
    return response


def simulated(
    truth: dict[str, float], n: int, rate_hz: float, rng: np.random.Generator
) -> FloatArray:
    """
    Return rate noise of known coefficients, shape (n,).

    Flicker: N. J. Kasdin, "Discrete simulation of colored noise", Proc. IEEE 83(5) (1995); its
    two-sided density is B²/(2πf) for a driving noise of standard deviation B.
    """
    x: FloatArray = truth.get('N', 0.0) * np.sqrt(rate_hz) * rng.standard_normal(n)
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


def tangent_tau(n: int, rate_hz: float) -> FloatArray:
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


def record(
    told: str,
    run: int,
    n: int,
    rate_hz: float = RATE_HZ,
    seed: int = 1,
    methods: Sequence[str] = METHODS,
) -> dict[str, Found]:
    """Return what every method of `methods` finds in one record; the truth is JSON."""
    truth: dict[str, float] = json.loads(told)
    x = simulated(truth, n, rate_hz, np.random.default_rng([seed, run]))
    terms = 'NBK' if truth['B'] else 'NK'
    result = analyzed(x, rate_hz).axes[AXIS]
    if result.allan is None:
        raise ValueError('noise that is none')
    curve, wide = result.allan, allan.deviation(x, rate_hz, tau=tangent_tau(n, rate_hz))
    ways: dict[str, Callable[[], Found]] = {
        OURS: lambda: _of_model(result.model, truth),
        REFERENCE: lambda: _of_values(least_squares(curve, terms, from_model=True)),
        PLAIN: lambda: _of_values(least_squares(curve, terms, from_model=False)),
        WHITTLE: lambda: _of_model(whittle.fit(x, rate_hz, terms=terms), truth),
        TANGENT: lambda: _of_values(coefficients.tangent_fit(wide).fitted),
    }
    return {name: way() for name, way in ways.items() if name in methods}


def _of_model(model: NoiseModel, truth: Mapping[str, float]) -> Found:
    """Return what a model says, and what its intervals and bounds say about the truth."""
    estimates = {term: model.coefficients[term] for term in TERMS}
    return {
        'values': {term: model.fitted.get(term, 0.0) for term in TERMS},
        'observed': {term: one.observable for term, one in estimates.items()},
        'covered': {
            term: one.low is not None
            and one.high is not None
            and one.low <= truth.get(term, 0.0) <= one.high
            for term, one in estimates.items()
        },
    }


def _of_values(values: Mapping[str, float]) -> Found:
    """Return what a method says that has no intervals and reports everything."""
    return {'values': {t: values.get(t, 0.0) for t in TERMS}, 'observed': {}, 'covered': {}}


def measure(
    truth: dict[str, float],
    runs: int,
    n: int,
    rate_hz: float = RATE_HZ,
    seed: int = 1,
    methods: tuple[str, ...] = METHODS,
) -> dict[str, Outcome]:
    """Return what every method finds in `runs` records."""
    told = json.dumps(truth)
    return gathered(record(told, run, n, rate_hz, seed, methods) for run in range(runs))


def gathered(records: Iterable[dict[str, Found]]) -> dict[str, Outcome]:
    """Return the outcome of every method over many records."""
    outcomes: dict[str, Outcome] = {}
    for one in records:
        for name, found in one.items():
            outcomes.setdefault(name, Outcome()).add(found)
    return outcomes


def judge(bench: Benchmark, truth: dict[str, float], outcomes: dict[str, Outcome]) -> None:
    """Claim what the method of this package is held to."""
    ours, tangent = outcomes[OURS], outcomes[TANGENT]
    kind = 'with B' if truth['B'] else 'no B'
    for term in 'NBK':
        if truth[term]:
            bias = abs(ours.bias(term, truth[term]))
            bench.claim(f'{kind}, {term}: bias', bias, at_most=1.0, unit='%')
    for term in 'BK' if truth['B'] else 'K':
        # every method in the runs in which we report the term: the same data for all
        runs, true = ours.observed[term], truth[term]
        rmse = ours.rmse(term, true, runs)
        best = min(outcomes[name].rmse(term, true, runs) for name in METHODS if name != OURS)
        name = f'{kind}, {term}: RMSE over that of the best other method'
        bench.claim(name, rmse / best, at_most=1.1)
        better = tangent.rmse(term, true, runs) / rmse
        name = f'{kind}, {term}: RMSE of the slope tangent over ours'
        bench.claim(name, better, at_least=2.0)
    for term in 'Q' if truth['B'] else 'QB':
        bench.claim(f'{kind}: records with {term} reported', sum(ours.observed[term]), at_most=0)
    for term in TERMS:
        share = 100.0 * float(np.mean(ours.covered[term]))
        name = f'{kind}, {term}: intervals and bounds hold the truth'
        bench.claim(name, share, at_least=93.0, unit='%')


def main() -> int:
    bench = Benchmark(__doc__)
    bench.add_size('--runs', 200, quick=3, help='records of each kind')
    bench.add_size('--samples', 2**20, quick=2**15, help='of each record')
    parts = Parts(bench)
    options = bench.start()
    told = [json.dumps(truth) for truth in TRUTHS]
    keys = [(one, run, options.samples) for run in range(options.runs) for one in told]
    records = parts.run(options, record, keys)
    for truth, one in zip(TRUTHS, told, strict=True):
        outcomes = gathered(records[one, run, options.samples] for run in range(options.runs))
        words = ', '.join(f'{term} = {value:g}' for term, value in truth.items())
        bench.head(
            'method', *'NBK', *(f'{term} reported' for term in TERMS),
            title=f'{words}: bias / RMSE in % of the runs that report a term',
        )  # fmt: skip
        for name, outcome in outcomes.items():
            cells = [
                f'{outcome.bias(t, truth[t]):+.1f} / {outcome.rmse(t, truth[t]):.1f}'
                if truth[t]
                else f'median {np.median(outcome.values[t]):.1e}'
                for t in 'NBK'
            ]
            for term in TERMS:
                observed = outcome.observed[term]
                cells.append(f'{sum(observed)} of {options.runs}' if observed else 'always')
            bench.row(name, *cells)
        judge(bench, truth, outcomes)
    return bench.done()


if __name__ == '__main__':
    sys.exit(main())
