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

POSSIBLE = 1.0
"""
The same from which the interval of N reaches up to what it is behind a filter, although the curve
does not need one.  Behind a cutoff of 0.625 sample rates one of 6000 samples is not needed three
times of four; 86 % of 95 % intervals then hold N, without this 71 %.
"""

LOWEST = 0.002
"""Lowest cutoff that is looked for, in sample rates: sensors filter less than a decade below."""

PLATEAU = 5e-3
"""Longest correlation time of a filter over the record: behind it N must still show."""

FEWEST = 5
"""Points that a filter needs: two for itself and white noise, and some to contradict them."""

_SLOWER = 'BKR'

_GRID = 20
_PASSES = 7
_STEP = 1e-3
_LARGEST_STEP = 0.7


def shows(problem: Problem, best: Fitted, deviations: float = SHOWN) -> bool:
    """
    Return whether variance is missing at the start of a curve that a model describes.

    Parameters
    ----------
    problem : Problem
    best : Fitted
    deviations : float
        How much at least, in standard deviations.
    """
    present = {t for t, on in zip(problem.terms, best.mask, strict=True) if on}
    if 'N' not in present or 'Q' in present:
        return 'N' not in present
    missing = -1.0 / problem.tau**2
    answer = respond(problem, best, extra=missing)['T']
    return answer.value > deviations * answer.spread(0.0)


def candidates(problem: Problem) -> list[LowPass]:
    """Return the filters that fit best, with the slower terms they need, likeliest first."""
    low = _lowest(problem)
    if 'N' not in problem.terms or low >= WEAKEST or problem.tau.size < FEWEST:
        return []
    columns = np.array([problem.basis[problem.terms.index(t)] for t in _slower(problem)])
    columns = columns.reshape(-1, problem.tau.size)
    masks = np.array(list(product((False, True), repeat=len(columns))), np.bool_)
    degrees = granted(problem.record * problem.share / problem.tau)
    search = _Search(problem, columns, masks, degrees, low)
    found = search.descend(search.first())
    return [
        LowPass(warped, kind, problem.period)
        for score, warped, kind in found
        if score <= found[0][0] + EQUIVALENT
    ]


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
    """Slower terms (p, k), their subsets (s, p), degrees of freedom (k,) and lowest cutoff."""

    problem: Problem
    columns: Floats
    masks: Bools
    degrees: Floats
    low: float

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

    def descend(self, start: float) -> list[tuple[float, float, str]]:
        """Return score, cutoff and order of the best subset behind a filter of each kind."""
        data, masks = self.problem.variance, np.vstack([self.masks] * len(KINDS))
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
        penalty = PENALTY * masks @ parameters_of(_slower(self.problem))
        score = np.where(positive, misfit + penalty, np.inf).reshape(len(KINDS), -1)
        best = score.argmin(axis=1)
        at = np.arange(len(KINDS))
        cutoffs = warped.reshape(score.shape)[at, best]
        return sorted(zip(score[at, best].tolist(), cutoffs.tolist(), KINDS, strict=True))

    def _white(self, warped: Floats) -> Floats:
        """Return the Allan variances of filtered white noise, an equal share of each kind."""
        factors = self.problem.m
        taken = [
            deficit(factors, part[:, None], kind)
            for part, kind in zip(np.split(warped, len(KINDS)), KINDS, strict=True)
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
