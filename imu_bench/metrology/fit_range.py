# SPDX-License-Identifier: Apache-2.0
"""
The averaging times that a noise model can describe.

Low-pass filters bend the short end of a curve in ways no sum of power laws follows, and that end
has by far the smallest scatter: it would bend every coefficient.  A vibration, or a temperature
that cycles, puts a bump on the curve.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

from imu_bench.metrology.curve import Floats
from imu_bench.metrology.filter_fit import candidates, shows
from imu_bench.metrology.low_pass import LowPass
from imu_bench.metrology.model_choice import fit_subsets, residuals_of
from imu_bench.metrology.model_fit import PENALTY, Problem, Solutions
import numpy as np

MISFIT = 3.0
"""Mean squared residual above which a model does not describe a curve."""

START_MISFIT = 3.0
"""Mean residual of the first octave, in standard deviations, above which its start is wrong."""

START_FIT = 1.5
"""Mean residual of the first octave below which a shortened curve starts well."""

FEWEST = 8
"""Points that a shortened curve keeps."""

LATEST = 1e-3
"""
Latest start over the length of the record.  No filter of a useful sensor reaches further, and
what bends a curve there is no fault of its start.
"""

BUMP = 3.0
"""Residual, in standard deviations, of points that may belong to a bump."""

WIDEST_BUMP = 0.5
"""Share of the octaves of a curve that a bump may take."""


KNOWN_FILTER = 1.5
"""Mean squared residual up to which a filter is of a kind that is known."""

DOUBT = 6.0
"""
What less a filter must gain in −2 ln L where the very start is left out for its sake: something
did bend it, and a filter that is needless then costs only precision.
"""

CYCLES = (1.0, 2.0)
"""
Start of a curve, in periods of the cutoff, from which on it tells nothing of the kind of filter
but 1 − 3T/2τ: a moving average is over after half a period, and what a filter of second order
still rings is below 2 permille.
"""

ROUNDS = 5
"""Times that points are taken off a bump."""


@dataclass(frozen=True, eq=False)
class Range:
    """
    The averaging times kept, and all fits to them.

    Attributes
    ----------
    problem : Problem
    solutions : Solutions
    started : float
        Averaging time in s before which points are left out, 0 if none.
    bump : tuple of float
        First and last averaging time in s left out in the middle; empty if none.
    alike : Range or None
        The fit behind another kind of low-pass filter, if it describes the curve as well.
    """

    problem: Problem
    solutions: Solutions
    started: float = 0.0
    bump: tuple[float, ...] = ()
    alike: Range | None = None

    @cached_property
    def residuals(self) -> Floats:
        """Excess over the likeliest subset, in standard deviations."""
        return residuals_of(self.problem, self.solutions[self.solutions.likeliest])

    @property
    def chi2(self) -> float:
        """Mean squared residual, each octave counted once."""
        octaves = self.problem.octaves
        return float(self.residuals**2 @ octaves / octaves.sum())

    @property
    def described(self) -> bool:
        """Whether the model describes the curve."""
        return self.chi2 <= MISFIT

    @property
    def score(self) -> float:
        """−2 ln L of the likeliest subset with its penalties, the cutoff of a filter included."""
        filtered = self.problem.low_pass is not None
        return float(self.solutions.score.min()) + (PENALTY if filtered else 0.0)

    @property
    def has_white_noise(self) -> bool:
        """Whether white noise is part of the likeliest subset."""
        best = self.solutions.masks[self.solutions.likeliest]
        return bool(best[self.problem.terms.index('N')])

    @property
    def start(self) -> float:
        """Size of the mean residual of the first octave, in standard deviations."""
        first = self.problem.tau < 1.99 * self.problem.tau[0]
        weights = self.problem.octaves[first]
        return abs(float(np.average(self.residuals[first], weights=weights)))

    @property
    def widening(self) -> float:
        """Factor on standard deviations: above one where the model does not describe the curve."""
        return 1.0 if self.described else float(np.sqrt(self.chi2))


def choose_range(problem: Problem) -> Range:
    """
    Return the averaging times that a sum of the candidate terms can describe.

    The whole curve if it fits.  Otherwise the start moves up, an octave at a time, until it
    does, and one octave more.  If that does not help, without the bump, if there is one; and if
    that does not either, the earliest start that fits by itself.
    """
    whole = Range(problem, fit_subsets(problem))
    filtered = _filtered(whole)
    if filtered is not None:
        return filtered
    if whole.described and whole.start <= START_MISFIT:
        return whole
    tried = [whole]
    for count in _starts(problem):
        shorter = problem.only(slice(count, None))
        tried.append(Range(shorter, fit_subsets(shorter), float(shorter.tau[0])))
        before = tried[-2]
        if before.started and before.described and before.start <= START_FIT:
            # what bends a curve fades as 1/τ: one octave more halves what is left of it
            return tried[-1] if tried[-1].described else before
    sound = [candidate for candidate in tried if candidate.start <= START_FIT]
    for candidate in (whole, *sound[:1]):
        flattened = _without_bump(candidate)
        if flattened is not None and flattened.start <= START_FIT:
            return flattened
    return sound[0] if sound else min(tried, key=lambda candidate: candidate.chi2)


def _filtered(whole: Range) -> Range | None:
    """
    Return the fit with white noise behind a low-pass filter, if a filter bends the curve.

    The very start may follow a filter of another kind, or show the rounding behind it; after a
    period of its cutoff every filter looks alike.
    """
    problem = whole.problem
    if problem.low_pass is not None or 'G' in problem.terms:
        return None
    sound = whole.described and whole.start <= START_MISFIT
    if sound and not shows(problem, whole.solutions[whole.solutions.likeliest]):
        return None
    filters = candidates(problem)
    found = _needed(whole, filters, KNOWN_FILTER, 0.0)
    for cycles in CYCLES if filters else ():
        count = int(np.searchsorted(problem.tau, cycles / filters[0].cutoff))
        if found is not None or not 0 < count <= problem.tau.size - FEWEST:
            break
        rest = problem.only(slice(count, None))
        plain = Range(rest, fit_subsets(rest), float(rest.tau[0]))
        found = _needed(plain, candidates(rest), MISFIT, DOUBT)
    return found


def _needed(plain: Range, filters: list[LowPass], misfit: float, doubt: float) -> Range | None:
    """Return the fit of the same points behind a filter, if that describes them and is needed."""
    if not filters:
        return None
    found, *alike = (_behind(plain, low_pass) for low_pass in filters)
    good = found.chi2 <= misfit and found.start <= START_FIT and found.has_white_noise
    if not good or found.score - doubt >= plain.score:
        return None
    return replace(found, alike=alike[0] if alike else None)


def _behind(plain: Range, low_pass: LowPass) -> Range:
    """Return the fit of the same points with white noise behind a filter."""
    bent = plain.problem.behind(low_pass)
    return Range(bent, fit_subsets(bent), plain.started)


def _starts(problem: Problem) -> list[int]:
    """Return how many points to leave out for each later start, an octave apart."""
    period = float(problem.tau[0] / problem.m[0])
    latest = min(LATEST * problem.record / period, float(problem.m[-1]))
    octaves = int(np.log2(max(latest / problem.m[0], 1.0)))
    counts = np.searchsorted(problem.m, problem.m[0] * 2 ** np.arange(1, octaves + 1))
    return [int(c) for c in np.unique(counts) if problem.m.size - c >= FEWEST]


def _without_bump(candidate: Range) -> Range | None:
    """Return the curve without the points that stand highest above it, if the rest fits."""
    problem, current = candidate.problem, candidate
    kept = np.ones(problem.tau.size, np.bool_)
    for _ in range(ROUNDS):
        high = current.residuals > max(BUMP, 0.3 * float(current.residuals.max()))
        kept[np.flatnonzero(kept)[high]] = False
        left = float(problem.octaves[kept].sum() / problem.octaves.sum())
        if not high.any() or kept.sum() < FEWEST or left < 1.0 - WIDEST_BUMP:
            return None
        rest, bump = problem.only(kept), problem.tau[~kept]
        current = Range(
            rest, fit_subsets(rest), candidate.started, (float(bump[0]), float(bump[-1]))
        )
        if current.described:
            return current
    return None
