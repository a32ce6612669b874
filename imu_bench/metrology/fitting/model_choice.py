# SPDX-License-Identifier: Apache-2.0
"""Which noise terms a curve supports: the best subset, and those it cannot be told from."""

from __future__ import annotations

from dataclasses import dataclass

from imu_bench.metrology.curve import Floats
from imu_bench.metrology.fitting.model_fit import Fitted, Problem, Solutions, solve
from imu_bench.metrology.fitting.scoring import granted, subsets
from imu_bench.metrology.fitting.uncertainty import respond
import numpy as np

SIGNIFICANCE = 1e-4
"""Largest probability that a term of the best subset is a chance of the other noise."""

DECISIVE = 50.0
"""
Gain in −2 ln L beyond which a term needs no test (χ²_1 exceeds it in 2 of 10¹²): without it the
model is so far off that its scatter means nothing.
"""

EQUIVALENT = 4.0
"""Subsets whose score comes this close, 0.14 in likelihood, to the best cannot be told from it."""

WIDER = 7.0
"""The same for supersets of the best, which widen its intervals only."""


@dataclass(frozen=True, eq=False)
class Choice:
    """The best subset and its rivals."""

    best: Fitted  # the likeliest subset; it gives the values
    # subsets that the data cannot tell from it: a term that one of them does without is not
    # observable
    rivals: tuple[Fitted, ...]
    # subsets that contain the best and fit a little better than chance would
    supersets: tuple[Fitted, ...]
    # for each term, of all subsets that fit about as well as the best, however many terms they
    # need, the one with most of it; None if no subset holds the term
    largest: tuple[Fitted | None, ...]

    def certain(self, index: int) -> bool:
        """Return whether a term belongs to the best subset and all its rivals."""
        return all(bool(fitted.mask[index]) for fitted in (self.best, *self.rivals))


def fit_subsets(problem: Problem) -> Solutions:
    """Return the fits of all subsets of the candidate terms, of fewer terms than points."""
    count = len(problem.terms)
    return solve(problem, subsets(count, min(count, problem.tau.size - 1)))


def residuals_of(problem: Problem, fitted: Fitted) -> Floats:
    """Return the excess of each variance over a fit, in standard deviations, shape (k,)."""
    excess = problem.variance / (fitted.squares @ problem.basis) - 1.0
    return np.asarray(excess * np.sqrt(0.5 * granted(fitted.degrees)), np.float64)


def choose(problem: Problem, solutions: Solutions) -> Choice:
    """Return the likeliest of the fitted subsets and its rivals."""
    score = solutions.score.copy()
    best = sound = solutions.likeliest
    while solutions.masks[sound].sum() > 1 and not _significant(problem, solutions, sound):
        score[sound] = np.inf
        sound = int(np.argmin(score))
    near = solutions.score - solutions.score[best]
    contains = np.all(solutions.masks | ~solutions.masks[best], axis=1)
    others = np.arange(near.size) != best
    # the likeliest subset gives the values, but what its terms may be a chance of rivals it
    rivals = (near <= EQUIVALENT) & ~contains | (np.arange(near.size) == sound)
    supersets = (near <= WIDER) & contains
    return Choice(
        best=solutions[best],
        rivals=tuple(solutions[int(i)] for i in np.flatnonzero(others & rivals)),
        supersets=tuple(solutions[int(i)] for i in np.flatnonzero(others & supersets)),
        largest=tuple(_largest(solutions, best, at) for at in range(len(problem.terms))),
    )


def _largest(solutions: Solutions, best: int, at: int) -> Fitted | None:
    """Return the subset with most of a term among those that fit about as well as the best."""
    fits = solutions.misfit <= solutions.misfit[best] + EQUIVALENT
    candidates = np.flatnonzero(fits & np.isfinite(solutions.score) & solutions.masks[:, at])
    if not candidates.size:
        return None
    return solutions[int(candidates[np.argmax(solutions.squares[candidates, at])])]


def _significant(problem: Problem, solutions: Solutions, index: int) -> bool:
    """Return whether no term of a subset is likely to be a chance of the others."""
    mask = solutions.masks[index]
    for at in np.flatnonzero(mask):
        without = mask.copy()
        without[at] = False
        null = solutions.find(without)
        if solutions.misfit[null] - solutions.misfit[index] > DECISIVE:
            continue
        answer = respond(problem, solutions[index], truth=solutions.squares[null])
        if answer[problem.terms[at]].significance() > SIGNIFICANCE:
            return False
    return True
