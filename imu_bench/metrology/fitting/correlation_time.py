# SPDX-License-Identifier: Apache-2.0
"""The correlation time of a Gauss-Markov process within a noise model."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
import math

from imu_bench.metrology.curve import Floats
from imu_bench.metrology.fitting.model_fit import Problem, solve
from imu_bench.metrology.fitting.noise_model import gauss_markov_variance, GM_PEAK_TAU
from imu_bench.metrology.fitting.scoring import subsets
from imu_bench.metrology.fitting.screening import glance
import numpy as np

_COARSE = 0.5
"""Step of ln T_c of the search; the likelihood is smooth on the scale of an octave of τ."""

_STEP = 1e-3

_PASSES = 4
"""Passes of a glance that only has to tell correlation times apart."""

MOST_TERMS = 3
"""Terms of a model, the process among them, by which correlation times are compared."""


def likeliest(prepared: Callable[[float], Problem], tau: Floats) -> Problem:
    """Return the problem whose correlation time fits best."""
    grid = _grid(tau)

    @cache
    def score(index: int) -> float:
        return _score(prepared(math.exp(grid[index]))) if 0 <= index < grid.size else math.inf

    best = _first(prepared(math.exp(grid[0])))
    while (better := min((best, best - 1, best + 1), key=score)) != best:
        best = better
    coarse = prepared(math.exp(grid[best]))
    left, middle, right = score(best - 1), score(best), score(best + 1)
    if not all(map(math.isfinite, (left, middle, right))):
        return coarse
    shift = 0.5 * (left - right) / max(left - 2.0 * middle + right, 1e-9)
    refined = prepared(math.exp(grid[best] + _COARSE * float(np.clip(shift, -0.5, 0.5))))
    return min((refined, coarse), key=_score)


def processes(tau: Floats) -> Floats:
    """Return the Allan variances of processes of every correlation time, shape (t, k)."""
    return np.array([gauss_markov_variance(tau, math.exp(x)) for x in _grid(tau)])


def _grid(tau: Floats) -> Floats:
    """Return the logarithms of the correlation times that are compared."""
    low = math.log(tau[min(2, tau.size - 1)] / GM_PEAK_TAU)
    high = max(math.log(0.5 * tau[-1] / GM_PEAK_TAU), low + _COARSE)
    return np.arange(low, high + _COARSE, _COARSE)


def _first(problem: Problem) -> int:
    """Return the index of the correlation time that looks best at a glance, one of every two."""
    degrees = problem.record * problem.share / problem.tau
    others = problem.basis[[t != 'G' for t in problem.terms]]
    left = [
        glance(problem, degrees, np.vstack([others, process]), passes=_PASSES).chi2
        for process in processes(problem.tau)[::2]
    ]
    return 2 * int(np.argmin(left))


def slope(problem: Problem, correlation_time: float, square: float) -> Floats:
    """Return the derivative of the Allan variance by ln T_c, for a square of q_c."""
    above = gauss_markov_variance(problem.tau, correlation_time * math.exp(_STEP))
    below = gauss_markov_variance(problem.tau, correlation_time * math.exp(-_STEP))
    result: Floats = square * (above - below) / (2.0 * _STEP)
    return result


def _score(problem: Problem) -> float:
    """Return the best score of any subset that holds the Gauss-Markov process."""
    count = len(problem.terms)
    masks = subsets(count, min(count, MOST_TERMS, problem.tau.size - 1))
    return float(solve(problem, masks[masks[:, problem.terms.index('G')]]).score.min())
