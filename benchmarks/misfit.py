# SPDX-License-Identifier: Apache-2.0
"""
What does the analysis say of noise that is no sum of its terms?  Monte Carlo, fixed seeds.

Records of 10 min, 1 h and 5 h at 100 Hz with a Gauss-Markov bias, spectra of 1/f^0.8 and 1/f^1.3,
a step, a slow cycle, an aliased tone, a resonant filter, outliers, lost samples, a hole and
jittered stamps go the way that `imu-bench analyze` goes (`_misfit.py` makes them, without a line
of the simulation).  Counted is how often a coefficient or a filter is claimed that is not there,
how often the interval of N holds the truth, and how often the result says that something is no
noise.  A K that the result says to be none as well as one is counted beside: open.

All of it takes an hour of one core; ``--keep FILE --stop-after 200`` does a part, again and again.
"""

from __future__ import annotations

from collections import Counter
import sys

from imu_bench.metrology.likelihood.choice import not_told
from imu_bench.offline.analysis.axis_result import AxisResult
from imu_bench.offline.analysis.settings import Settings
import numpy as np

from benchmarks._analyzed import analyzed, AXIS
from benchmarks._frame import Benchmark
from benchmarks._misfit import RATE_HZ, SCENARIOS
from benchmarks._parts import Parts

FALSE = 2.0
"""Most records in 100 that may claim what is not there."""

SAYING = ('bias_moves', 'no_model', 'methods_disagree', 'unsteady_noise')
"""Findings that say that the noise is not what the model is made for."""


def count(name: str, seconds: float, seed: int) -> Counter[str]:
    """Return what one record of a scenario adds to its counts."""
    scenario, n = SCENARIOS[name], int(seconds * RATE_HZ)
    rng = np.random.default_rng([seed, int(seconds)])
    values, stamps = scenario.make(n, rng), None
    if scenario.places is not None:
        places = scenario.places(n, rng)
        stamps = np.rint(places * (1e9 / RATE_HZ)).astype(np.int64)
        # what is lost or in between is white: any of the samples will do in any place
        values = values[: places.size]
    whole = analyzed(values, RATE_HZ, Settings(min_share=scenario.min_share), stamps)
    result, codes = whole.axes[AXIS], {finding.code for finding in whole.health.findings}
    found = Counter[str]()
    for term in 'NQBK':
        estimate = result.coefficient(term)
        found[term] += estimate.observable
        low, high = estimate.low, estimate.high
        truth = scenario.truth.get(term, 0.0)
        found[f'{term} held'] += low is not None and high is not None and low <= truth <= high
    # a walk that may be another noise as far as the record shows, and is said to be
    if result.coefficient('K').observable and result.choice and not_told(result.choice):
        found['K open'] += 1
    rate = whole.health.rate
    found['rate held'] += (rate.low or 0.0) <= RATE_HZ <= (rate.high or 0.0)
    found['lost'] += whole.health.missing > 0
    found['filter'] += result.model.low_pass is not None
    found['moves'] += 'bias_moves' in codes
    found['said'] += bool(codes & set(SAYING)) or 'F' in _taken(result) or 'G' in _taken(result)
    return found


def _taken(result: AxisResult) -> str:
    return result.choice.best.terms if result.choice else ''


def judge(bench: Benchmark, name: str, length: str, found: Counter[str], runs: int) -> None:
    """Claim what a scenario is held to."""
    scenario = SCENARIOS[name]

    def share(key: str) -> float:
        return 100.0 * found[key] / runs

    for term in 'QBK':
        if term not in scenario.truth and term not in scenario.vague:
            false = share(term) - (share('K open') if term == 'K' else 0.0)
            bench.claim(f'{name}, {length}: false {term}', false, at_most=FALSE, unit='%')
    if not scenario.filtered:
        bench.claim(f'{name}, {length}: false filter', share('filter'), at_most=FALSE, unit='%')
    bench.claim(f'{name}, {length}: N held', share('N held'), at_least=90.0, unit='%')
    if scenario.odd:
        bench.claim(f'{name}, {length}: finding', share('moves'), at_least=95.0, unit='%')
    if scenario.jittered:
        bench.claim(f'{name}, {length}: invented loss', share('lost'), at_most=FALSE, unit='%')
        bench.claim(f'{name}, {length}: rate held', share('rate held'), at_least=90.0, unit='%')


def main() -> int:
    bench = Benchmark(__doc__)
    bench.add_size('--runs', 100, quick=1, help='records of each kind and length')
    bench.add_size('--shortest', 600.0, quick=60.0, help='seconds of the shortest records')
    bench.add_size('--lengths', 3, quick=1, help='lengths: once, 6 times and 30 times that')
    bench.add_argument(
        '--only', default='', metavar='TEXT', help='scenarios whose name holds this'
    )
    parts = Parts(bench)
    options = bench.start()
    lengths = [options.shortest * factor for factor in (1, 6, 30)[: options.lengths]]
    names = [name for name in SCENARIOS if options.only in name]
    if not names:
        bench.error(f'--only {options.only!r}: there are {"; ".join(SCENARIOS)}')
    keys = [
        (name, seconds, seed)
        for seed in range(options.runs)
        for seconds in lengths
        for name in names
    ]
    counted = parts.run(options, count, keys)
    shown = ('N held', 'Q', 'B', 'B held', 'K', 'K open', 'K held', 'filter', 'moves', 'said')
    for seconds in lengths:
        length = f'{seconds / 60.0:g} min'
        title = f'records of {length}: how many of {options.runs}'
        bench.head(f'{length:30}', *shown, title=title)
        for name in names:
            found = sum(
                (Counter(counted[name, seconds, seed]) for seed in range(options.runs)),
                Counter[str](),
            )
            bench.row(f'{name:30}', *(found[key] for key in shown))
            judge(bench, name, length, found, options.runs)
    return bench.done()


if __name__ == '__main__':
    sys.exit(main())
