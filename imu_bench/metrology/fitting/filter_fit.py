# SPDX-License-Identifier: Apache-2.0
"""
Which low-pass filter bends the start of a curve, if one does.

The cutoff is the only parameter of a noise model that does not enter the Allan variance linearly.
It is found together with the squares by Gauss-Newton steps, for every subset of the slower noise
terms at once: a step of the cutoff is one more column of the linear fit.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
import math

from imu_bench.metrology.curve import Floats
from imu_bench.metrology.fitting.low_pass import deficit, KINDS, LowPass, WEAKEST
from imu_bench.metrology.fitting.model_choice import EQUIVALENT
from imu_bench.metrology.fitting.model_fit import Fitted, parameters_of, PENALTY, Problem, TINY
from imu_bench.metrology.fitting.scoring import Bools, granted, minus_two_log_likelihood
from imu_bench.metrology.fitting.uncertainty import respond
import numpy as np

SHOWN = 2.0
"""
Missing variance at the start, in standard deviations, from which a filter is looked for.  It must
gain as much likelihood as any other term to be kept.
"""

POSSIBLE = 0.0
"""
The same from which the interval of N reaches up to what it is behind a filter, although the curve
does not need one: a filter can only take.  Behind a cutoff of 0.625 sample rates 94 % of 95 %
intervals then hold N in records of 6000 samples, from one standard deviation on 82 %.  The price
where there is no filter, or a very weak one: in two records of five they are some 60 % wider, a
fifth on average.
"""

ROUNDED = 1.3
"""
Largest share of the white noise that joins behind a filter, over its cutoff in sample rates: that
of rounding, (step²/12)·τ0/N².  A filter of first order leaves σ² = π f_c N², and σ is 0.45 steps
at least where rounding adds noise (the mean after it follows the one before it with a slope of
1 ± 2 e^(−2π²σ²), σ in steps).  More is slower noise: it once passed for a filter of 1.9 Hz.
"""

LOWEST = 0.002
"""Lowest cutoff that is looked for, in sample rates: sensors filter less than a decade below."""

PLATEAU = 5e-3
"""Longest correlation time of a filter over the record: behind it N must still show."""

FEWEST = 5
"""Points that a filter needs: two for itself and white noise, and some to contradict them."""

_JOINED = KINDS[:1]
"""
Kinds behind which white noise may join: of one order they then look the same, and one of second
order takes the shape of moving averages, with N 1 % wrong.
"""

_SLOWER = 'BKR'

_GRID = 20
_PASSES = 7
_STEP = 1e-3
_LARGEST_STEP = 0.7


def missing(problem: Problem) -> Floats:
    """Return what a filter of a high cutoff does to a curve, to within a factor, shape (k,)."""
    return np.asarray(-1.0 / problem.tau**2, np.float64)


def joining(problem: Problem) -> Floats:
    """Return what white noise does to a curve that joins behind the filter, shape (k,)."""
    return np.zeros_like(problem.tau) if problem.bends is None else problem.bends[1]


def evidence(problem: Problem, best: Fitted) -> float:
    """
    Return how clearly variance is missing at the start of a curve that a model describes.

    Behind a filter: how clearly there is noise that it did not touch.
    """
    present = {t for t, on in zip(problem.terms, best.mask, strict=True) if on}
    if 'N' not in present or 'Q' in present:
        return -math.inf if 'N' in present else math.inf
    column = missing(problem) if problem.low_pass is None else joining(problem)
    answer = respond(problem, best, extra=column).get('T')
    return 0.0 if answer is None else answer.value / max(answer.spread(0.0), TINY)


def candidates(problem: Problem, start: LowPass | None = None) -> list[LowPass]:
    """Return the filters that fit best, with the slower terms they need, likeliest first."""
    low = _lowest(problem)
    if 'N' not in problem.terms or low >= WEAKEST or problem.tau.size < FEWEST:
        return []
    columns = np.array([problem.basis[problem.terms.index(t)] for t in _slower(problem)])
    columns = columns.reshape(-1, problem.tau.size)
    masks = np.array(list(product((False, True), repeat=len(columns))), np.bool_)
    penalty = PENALTY * masks @ parameters_of(_slower(problem))
    if start is not None:
        columns = np.vstack([1.0 / problem.tau, columns])
        masks = np.hstack([np.ones((len(masks), 1), np.bool_), masks])
    degrees = granted(problem.record * problem.share / problem.tau)
    kinds = KINDS if start is None else _JOINED
    search = _Search(problem, columns, masks, penalty, degrees, low, kinds)
    found = search.descend(search.first() if start is None else start.warped, start is not None)
    return [low_pass for score, low_pass in found if score <= found[0][0] + EQUIVALENT]


def filtered_white(problem: Problem) -> Floats:
    """Return the Allan variances of white noise behind filters of every cutoff, shape (q, k)."""
    trials = np.linspace(min(_lowest(problem), WEAKEST), WEAKEST, _GRID)[:, None]
    return np.vstack([(1.0 - deficit(problem.m, trials, k)) / problem.tau for k in KINDS])


def _lowest(problem: Problem) -> float:
    """Return the lowest cutoff that is looked for, as `LowPass.warped`."""
    longest = min(0.5 / (math.pi * LOWEST) * problem.period, PLATEAU * problem.record)
    return math.log(math.tan(min(0.5 * problem.period / longest, 1.5)))


def _slower(problem: Problem) -> str:
    return ''.join(t for t in _SLOWER if t in problem.terms)


@dataclass(frozen=True, eq=False)
class _Search:
    """
    Terms beside filtered white noise, shape (p, k), and what a search of the cutoff needs.

    Their subsets (s, p), each with a penalty (s,); degrees of freedom (k,); the lowest cutoff; the
    kinds of filters.
    """

    problem: Problem
    columns: Floats
    masks: Bools
    penalty: Floats
    degrees: Floats
    low: float
    kinds: tuple[str, ...]

    def first(self) -> float:
        """Return a cutoff to start from: filtered white noise and a constant, least squares."""
        problem, trials = self.problem, np.linspace(self.low, WEAKEST, _GRID)
        white = (1.0 - deficit(problem.m, trials[:, None], KINDS[0])) / problem.tau
        weight = problem.octaves * self.degrees / problem.variance**2
        # rows: trials; the constant stands for whatever is slower than white noise
        nn, n1, one = white**2 @ weight, white @ weight, weight.sum()
        ny, y = white @ (weight * problem.variance), float(weight @ problem.variance)
        # one point that outweighs all others leaves no room for a constant
        determinant = np.maximum(nn * one - n1**2, 1e-12 * nn * one)
        constant = np.maximum((nn * y - n1 * ny) / determinant, 0.0)
        square = (ny - n1 * constant) / nn
        rest = problem.variance - square[:, None] * white - constant[:, None]
        misfit = np.where(square > 0.0, rest**2 @ weight, np.inf)
        return float(trials[int(np.argmin(misfit))])

    def descend(self, start: float, floor: bool) -> list[tuple[float, LowPass]]:
        """Return the filters with which the best subset of each kind fits, each with its score."""
        # With a floor, the first of the further terms is white noise.
        data, masks = self.problem.variance, np.vstack([self.masks] * len(self.kinds))
        warped = np.full(len(masks), start)
        white = self._white(warped)
        model = np.broadcast_to(data, white.shape)
        for _ in range(_PASSES):
            slope = (self._white(warped + _STEP) - white) / _STEP
            raw, move = self._step(masks, white, slope, model)
            warped = np.clip(warped + move, self.low, WEAKEST)
            white = self._white(warped)
            squares = np.maximum(raw, 0.0)
            model = squares[:, :1] * white + squares[:, 1:] @ self.columns
            model = np.maximum(model, 0.01 * data)
        misfit = minus_two_log_likelihood(data, model, self.degrees, self.problem.octaves)
        positive = (raw[:, 0] > 0.0) & np.all((raw[:, 1:] > 0.0) | ~masks, axis=1)
        penalty = np.tile(self.penalty, len(self.kinds))
        score = np.where(positive, misfit + penalty, np.inf)
        untouched = squares[:, 1] if floor else np.zeros(len(masks))
        share = untouched / np.maximum(squares[:, 0] + untouched, TINY)
        found = []
        parts = np.split(np.arange(len(masks)), len(self.kinds))
        for kind, part in zip(self.kinds, parts, strict=True):
            at = part[score[part].argmin()]
            low_pass = LowPass(float(warped[at]), kind, self.problem.period, float(share[at]))
            possible = low_pass.floor <= ROUNDED * low_pass.cutoff * low_pass.period
            if possible and (np.isfinite(score[at]) or not floor):
                found.append((float(score[at]), low_pass))
        return sorted(found, key=lambda each: each[0])

    def _white(self, warped: Floats) -> Floats:
        """Return the Allan variances of filtered white noise, an equal share of each kind."""
        factors = self.problem.m
        taken = [
            deficit(factors, part[:, None], kind)
            for part, kind in zip(np.split(warped, len(self.kinds)), self.kinds, strict=True)
        ]
        return np.asarray((1.0 - np.vstack(taken)) / self.problem.tau, np.float64)

    def _step(
        self, masks: Bools, white: Floats, slope: Floats, model: Floats
    ) -> tuple[Floats, Floats]:
        """Return squares (s, 1 + p) and steps of the cutoff (s,) from a linear fit."""
        problem, count = self.problem, len(masks)
        slower = np.broadcast_to(self.columns, (count, *self.columns.shape))
        basis = np.concatenate([np.stack([white, slope], axis=1), slower], axis=1)
        active = np.hstack([np.ones((count, 2), np.bool_), masks])
        weights = problem.octaves * self.degrees / model**2
        weighted = basis * weights[:, None, :]
        normal = weighted @ basis.transpose(0, 2, 1)
        at = np.arange(active.shape[1])
        scale = 1.0 / np.sqrt(np.maximum(normal[:, at, at], TINY))
        both = active[:, :, None] & active[:, None, :]
        normal = np.where(both, normal * scale[:, :, None] * scale[:, None, :], 0.0)
        # as in `scored`; the derivative of a filter that does nothing looks like nothing
        normal[:, at, at] = 1.0 + 1e-9
        right = np.where(active, (weighted @ problem.variance) * scale, 0.0)
        raw = np.linalg.solve(normal, right[..., None])[..., 0] * scale
        step = raw[:, 1] / np.maximum(np.abs(raw[:, 0]), TINY)
        return np.delete(raw, 1, axis=1), np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)
