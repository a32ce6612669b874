# SPDX-License-Identifier: Apache-2.0
"""
The averaging times that a noise model can describe.

Low-pass filters bend the short end of a curve in ways no sum of power laws follows, and that end
has by far the smallest scatter: it would bend every coefficient.  A vibration, or a temperature
that cycles, puts a bump on the curve.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

from imu_bench.metrology.curve import Floats
from imu_bench.metrology.fitting.filter_fit import (
    candidates,
    evidence,
    filtered_white,
    joining,
    LOWEST,
    missing,
    POSSIBLE,
    SHOWN,
)
from imu_bench.metrology.fitting.low_pass import LowPass
from imu_bench.metrology.fitting.model_choice import fit_subsets, residuals_of, WIDER
from imu_bench.metrology.fitting.model_fit import PENALTY, Problem, Solutions
from imu_bench.metrology.fitting.scoring import Bools
from imu_bench.metrology.fitting.screening import Glance, glance, HOPELESS, Judged, MISFIT
import numpy as np

START_MISFIT = 3.0
"""
Mean residual of the first octave, in standard deviations, above which its start is wrong: a right
model shows it in 0.3 % of the records at most.
"""

START_FIT = 1.5
"""Mean residual of the first octave below which a shortened curve starts well: half of that."""

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
"""
Mean squared residual up to which a filter is of a kind that is known, as `noise_fit.DOUBTFUL`.
"""

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

FORGOTTEN = 4.0
"""
Start of a curve, in periods of the cutoff, from which on a filter that must be there but cannot be
told takes 3 % of N at most, and half of that an octave later.
"""

FLOOR = 0.5
"""
What white noise that joins behind a filter counts for, in terms: every reading is rounded, so it
is no surprise, and two standard deviations are enough.
"""

ROUNDS = 5
"""Times that points are taken off a bump."""


@dataclass(frozen=True, eq=False)
class Range(Judged):
    """The averaging times kept, and all fits to them."""

    problem: Problem
    solutions: Solutions
    started: float = 0.0  # averaging time in s before which points are left out, 0 if none
    # first and last averaging time in s left out in the middle; empty if none
    bump: tuple[float, ...] = ()
    # fits behind other low-pass filters, or behind none, that describe the curve about as well
    alike: tuple[Range, ...] = ()
    # what else may be part of the curve, although the fit does without
    further: Floats | None = None

    @cached_property
    def residuals(self) -> Floats:
        """Excess over the likeliest subset, in standard deviations."""
        return residuals_of(self.problem, self.solutions[self.solutions.likeliest])

    @property
    def degrees(self) -> Floats:
        """Degrees of freedom of each point under the likeliest subset."""
        return self.solutions[self.solutions.likeliest].degrees

    @property
    def score(self) -> float:
        """−2 ln L of the likeliest subset with its penalties, the cutoff of a filter included."""
        low_pass = self.problem.low_pass
        further = 0.0 if low_pass is None else 1.0 + (FLOOR if low_pass.floor else 0.0)
        return float(self.solutions.score.min()) + PENALTY * further

    @cached_property
    def evidence(self) -> float:
        """`filter_fit.evidence` of the likeliest subset."""
        return evidence(self.problem, self.solutions[self.solutions.likeliest])

    @property
    def has_white_noise(self) -> bool:
        """Whether white noise is part of the likeliest subset."""
        best = self.solutions.masks[self.solutions.likeliest]
        return bool(best[self.problem.terms.index('N')])

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
        return _weak(whole)
    tried: list[Judged] = [whole]
    for count in _starts(problem):
        tried.append(_from(whole, count))
        before, last = tried[-2:]
        if before is not whole and before.described and before.start <= START_FIT:
            # what bends a curve fades as 1/τ: one octave more halves what is left of it
            return _fit(last if last.described else before)
    fits = [whole]
    while fits[-1].start > START_FIT and len(fits) < len(tried):
        fits.append(_fit(tried[len(fits)]))
    sound = fits[-1] if fits[-1].start <= START_FIT else None
    for candidate in (whole, sound):
        flattened = candidate and _without_bump(candidate)
        if flattened and flattened.start <= START_FIT:
            return flattened
    return sound or min(fits, key=lambda candidate: candidate.chi2)


def _from(whole: Range, count: int) -> Judged:
    """Return what is left without the first points, fitted unless a glance rules that out."""
    shorter = whole.problem.only(slice(count, None))
    seen = glance(shorter, whole.degrees[count:])
    return seen if seen.hopeless else _fit(seen)


def _fit(judged: Judged) -> Range:
    """Return the fit to averaging times from a later start on."""
    if isinstance(judged, Range):
        return judged
    return Range(judged.problem, fit_subsets(judged.problem), float(judged.problem.tau[0]))


def _filtered(whole: Range) -> Range | None:
    """Return the fit with white noise behind a low-pass filter, if a filter bends the curve."""
    # The very start may follow a filter of another kind, or show the rounding behind it; after a
    # period of its cutoff every filter looks alike.
    problem = whole.problem
    if problem.low_pass is not None or 'G' in problem.terms:
        return None
    sound = whole.described and whole.start <= START_MISFIT
    if sound and whole.evidence <= SHOWN:
        return None
    last = int(np.searchsorted(problem.m, CYCLES[-1] / LOWEST))
    last = max(min(last, problem.m.size - FEWEST), 0)
    if not sound and _no_filter(whole, 0) and _no_filter(whole, last):
        return None
    filters = candidates(problem)
    found = _needed(whole, filters, KNOWN_FILTER, 0.0, True)
    for cycles in CYCLES if filters else ():
        count = int(np.searchsorted(problem.tau, cycles / filters[0].cutoff))
        if found is not None or not 0 < count <= problem.tau.size - FEWEST:
            break
        if not _no_filter(whole, count):
            plain = _later(whole, count)
            found = _needed(plain, candidates(plain.problem), MISFIT, DOUBT)
    if found is None and filters and not sound:
        found = _beyond(whole, FORGOTTEN / filters[0].cutoff)
    return found


def _later(whole: Range, count: int) -> Range:
    """Return the fit without the first points."""
    rest = whole.problem.only(slice(count, None))
    return Range(rest, fit_subsets(rest), float(rest.tau[0]))


def _beyond(whole: Range, start: float) -> Range | None:
    """Return the fit from an averaging time on where a filter no longer shows, if it is good."""
    count = int(np.searchsorted(whole.problem.tau, start))
    if not 0 < count <= whole.problem.tau.size - FEWEST:
        return None
    plain = _later(whole, count)
    best = plain.solutions[plain.solutions.likeliest]
    present = {t for t, on in zip(plain.problem.terms, best.mask, strict=True) if on}
    if not plain.described or plain.start > START_FIT or 'N' not in present or 'Q' in present:
        return None
    # a filter takes from the first point, to which a vibration adds
    if whole.problem.variance[0] > best.squares @ whole.problem.basis[:, 0]:
        return None
    return _weak(plain)


def _weak(whole: Range) -> Range:
    """Return a fit that knows of a filter which the curve shows but does not need."""
    # Whether it is there nobody knows; N can be as high as behind it.
    if whole.problem.low_pass is not None or 'G' in whole.problem.terms:
        return whole
    if not POSSIBLE < whole.evidence < np.inf:
        return whole
    return replace(whole, further=missing(whole.problem))


def _no_filter(whole: Range, count: int) -> bool:
    """Return whether no filter describes what is left without the first points."""
    rest = whole.problem.only(slice(count, None))
    columns = np.vstack([rest.basis, filtered_white(rest)])
    return glance(rest, whole.degrees[count:], columns).hopeless


def _needed(
    plain: Range, filters: list[LowPass], misfit: float, doubt: float, floor: bool = False
) -> Range | None:
    """Return the fit of the same points behind a filter, if that describes them and is needed."""
    found = _sound(plain, filters, misfit)
    if filters and floor:
        found = _floored(plain, filters[0], misfit, found)
    if found is None or found.score - doubt >= plain.score:
        return None
    return _or(found, plain)


def _sound(plain: Range, filters: list[LowPass], misfit: float) -> Range | None:
    """Return the fit of the same points behind the first of some filters, if it is good."""
    if not filters or glance(plain.problem.behind(filters[0]), plain.degrees).hopeless:
        return None
    found = _behind(plain, filters[0])
    if found.chi2 > misfit or found.start > START_FIT or not found.has_white_noise:
        return None
    return replace(found, alike=tuple(_behind(plain, other) for other in filters[1:2]))


def _floored(plain: Range, low_pass: LowPass, misfit: float, found: Range | None) -> Range | None:
    """
    Return the fit behind a filter, with white noise that joins behind it if the curve needs that.

    Rounding adds such noise: after a slow filter it is a quarter of the first variances and more,
    and a filter alone would follow them with too high a cutoff and too low an N.
    """
    if found is not None and found.evidence <= SHOWN:
        return found
    floored = _sound(plain, candidates(plain.problem, low_pass), misfit)
    if found is None:
        return floored
    if floored is None or floored.score >= found.score:
        return replace(found, further=joining(found.problem))
    return _or(floored, found)


def _or(found: Range, simpler: Range) -> Range:
    """Return a fit that knows of a simpler one, if that is about as good."""
    close = simpler.described and simpler.score - found.score <= WIDER
    return replace(found, alike=(*found.alike, simpler)) if close else found


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
    degrees = candidate.degrees

    def look(rest: Problem, kept: Bools) -> Glance:
        return glance(rest, degrees[kept])

    def fit(rest: Problem, kept: Bools) -> Range:
        bump = candidate.problem.tau[~kept]
        span = (float(bump[0]), float(bump[-1]))
        return Range(rest, fit_subsets(rest), candidate.started, span)

    if _flattened(candidate, look, HOPELESS) is None:
        return None
    flattened = _flattened(candidate, fit, MISFIT)
    return flattened if isinstance(flattened, Range) else None


def _flattened(
    candidate: Range, judge: Callable[[Problem, Bools], Judged], enough: float
) -> Judged | None:
    """Return what is left when the points above a curve are taken off until the rest fits."""
    problem = candidate.problem
    current: Judged = candidate
    kept = np.ones(problem.tau.size, np.bool_)
    for _ in range(ROUNDS):
        high = current.residuals > max(BUMP, 0.3 * float(current.residuals.max()))
        kept[np.flatnonzero(kept)[high]] = False
        left = float(problem.octaves[kept].sum() / problem.octaves.sum())
        if not high.any() or kept.sum() < FEWEST or left < 1.0 - WIDEST_BUMP:
            return None
        current = judge(problem.only(kept), kept)
        if current.chi2 <= enough:
            return current
    return None
