# SPDX-License-Identifier: Apache-2.0
"""
The models a record is tried against, and the penalised likelihood of each.

White noise N, flicker B, random walk K, one Gauss-Markov process G of any correlation time, and in
the place of flicker a power law F of any exponent.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
import math

from imu_bench.metrology.curve import Floats
from imu_bench.metrology.fitting.model_fit import PENALTY
from imu_bench.metrology.fitting.noise_model import density_basis, gauss_markov_density
from imu_bench.metrology.fitting.scoring import granted
from imu_bench.metrology.likelihood.cosines import Bins
import numpy as np

POWERS = ('N', 'NB', 'NK', 'NBK', 'B', 'K', 'BK')
"""Sums of power laws."""

PROCESSES = ('NG', 'NBG', 'NKG', 'G')
"""Sums with a Gauss-Markov process."""

EXPONENTS = ('NF', 'NFK')
"""Sums with a power law of free exponent."""

LONGEST = 0.15
"""Longest correlation time over the record; a longer one is a random walk in it."""

SHORTEST = 0.5
"""Shortest correlation time times the highest frequency: a shorter one is white there."""

DEVIANT = 4.5
"""
Deviations of a group of bins from the model, from which it does not describe them: 7·10⁻⁶ each,
of some 25 groups.
"""

_TIME_STEP = 0.5
_SLOW = 100.0  # correlation time over that of a value from which on no averaging matters
_SLOPES = (0.5, 0.6, 0.7, 0.8, 0.9, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6)
_SLOPE_STEP = 0.1
STEEPEST = _SLOPES[-1]
"""Steepest exponent that is tried; what is steeper is a random walk."""

_PASSES = 12
_VERTICES = 2
_WIDTH = 0.7  # of a first look at the density, in ln f
_GROUP = 4
_SURE_BIN = 8
_TINY = 1e-300


@dataclass(frozen=True, eq=False)
class Candidate:
    """One model, fitted."""

    terms: str  # of 'NBKGF'
    shape: float  # correlation time in s of G, or exponent of F; 0 without either
    squares: Floats  # squared coefficients
    # misfit, score: −2 ln L; the same with `PENALTY` per parameter, inf where no sum of all terms
    # is best
    misfit: float
    score: float
    # rate_hz, size: values per second, and samples of which each is the average
    rate_hz: float = math.inf
    size: int = 1

    def density(self, frequency: Floats) -> Floats:
        """Return the one-sided density."""
        return np.asarray(self.squares @ self.rows(frequency, self.terms, self.shape))

    def rows(self, frequency: Floats, terms: str, shape: float) -> Floats:
        """Return the densities of terms, as `rows` of values like those this was fitted to."""
        return rows(frequency, terms, shape, self.rate_hz, self.size)

    def describes(self, bins: Bins) -> bool:
        """Return whether groups of bins scatter about the model as they should."""
        kept = bins.degrees >= _SURE_BIN
        degrees = granted(bins.degrees[kept])
        ratio = bins.density[kept] / self.density(bins.frequency[kept]) - 1.0
        starts = np.arange(0, ratio.size, _GROUP)
        if not starts.size:
            return True
        sums = np.add.reduceat(degrees, starts)
        groups = np.add.reduceat(degrees * ratio, starts) / sums * np.sqrt(0.5 * sums)
        return bool(np.abs(groups).max() < DEVIANT)

    @cached_property
    def values(self) -> dict[str, float]:
        """The coefficients by letter."""
        return {t: math.sqrt(s) for t, s in zip(self.terms, self.squares, strict=True)}


def rows(
    frequency: Floats, terms: str, shape: float, rate_hz: float = math.inf, size: int = 1
) -> Floats:
    """
    Return the one-sided density of each term with coefficient one, shape (p, k).

    That of F is 2/(2πf)^a: for a = 1 the one of flicker noise.
    """
    made = {
        'G': lambda: _averaged_process(frequency, shape, rate_hz, size),
        'F': lambda: 2.0 / (2.0 * np.pi * frequency) ** shape,
    }
    # a period matters to quantisation only
    return np.array(
        [made[t]() if t in made else density_basis(frequency, 1.0, t)[0] for t in terms]
    )


def _averaged_process(frequency: Floats, time: float, rate_hz: float, size: int) -> Floats:
    """Return the density of averages over samples of a Gauss-Markov process with q_c = 1."""
    # Samples τ0 apart correlate by p^k, p = e^(−τ0/T), and have the variance T/2: their density is
    # τ0 T (1 − p²)/(1 − 2p cos(2πfτ0) + p²).  An average of m of them takes the share
    # sin²(πfmτ0)/(m sin(πfτ0))², and what is above half its rate folds back.
    period = 1.0 / (rate_hz * size)
    if time > _SLOW * period * size:
        return gauss_markov_density(frequency, time)
    pole, density = math.exp(-period / time), np.zeros_like(frequency)
    for fold in range(size):
        angle = np.pi * (frequency + fold * rate_hz) * period
        sampled = (
            period * time * (1.0 - pole**2) / (1.0 - 2.0 * pole * np.cos(2.0 * angle) + pole**2)
        )
        density += sampled * np.sin(size * angle) ** 2 / (size * np.sin(angle)) ** 2
    return density


def likelihoods(bins: Bins) -> list[Candidate]:
    """Return the best fit of every sum of terms, the likeliest model first."""
    low, high = SHORTEST / bins.frequency[-1], LONGEST * bins.span
    times = np.exp(np.arange(math.log(low), math.log(max(high, low)) + 1e-9, _TIME_STEP)).tolist()
    trials = [(terms, 0.0) for terms in POWERS]
    trials += [(terms, time) for terms in PROCESSES for time in times]
    trials += [(terms, slope) for terms in EXPONENTS for slope in _SLOPES]
    found = _solved(bins, trials)
    finer = []
    for one in _best_of_each(found):
        step = _SLOPE_STEP if 'F' in one.terms else _TIME_STEP
        if one.shape:
            finer += [(one.terms, _moved(one, step * s)) for s in (-0.4, -0.2, 0.2, 0.4)]
    found += _solved(bins, finer)
    for _ in range(_VERTICES):
        found += _solved(bins, _vertices(found))
    return _best_of_each(found)


def _moved(one: Candidate, by: float) -> float:
    """Return an exponent that is so much higher, or a time whose logarithm is."""
    return one.shape + by if 'F' in one.terms else one.shape * math.exp(by)


def _vertices(found: list[Candidate]) -> list[tuple[str, float]]:
    """Return the lowest points of parabolas through the best shapes and the two beside each."""
    trials = []
    for best in _best_of_each(found):
        if not best.shape or not math.isfinite(best.score):
            continue
        alike = [c for c in found if c.terms == best.terms and math.isfinite(c.score)]
        below = max((c for c in alike if c.shape < best.shape), key=_shape, default=None)
        above = min((c for c in alike if c.shape > best.shape), key=_shape, default=None)
        if below is None or above is None:
            continue
        left, right = (
            c.shape - best.shape if 'F' in best.terms else math.log(c.shape / best.shape)
            for c in (below, above)
        )
        down, up = below.score - best.score, above.score - best.score
        bend = left * right * (left - right)
        curvature, slope = (
            (right * down - left * up) / bend,
            (left**2 * up - right**2 * down) / bend,
        )
        if curvature > 0.0:
            trials.append((best.terms, _moved(best, -0.5 * slope / curvature)))
    return trials


def _shape(one: Candidate) -> float:
    return one.shape


def again(bins: Bins, like: list[Candidate]) -> list[Candidate]:
    """Return the same models fitted to other bins."""
    return sorted(
        _solved(bins, [(one.terms, one.shape) for one in like]), key=lambda one: one.score
    )


def _best_of_each(found: list[Candidate]) -> list[Candidate]:
    best: dict[str, Candidate] = {}
    for one in sorted(found, key=lambda one: one.score):
        best.setdefault(one.terms, one)
    return sorted(best.values(), key=lambda one: one.score)


def _solved(bins: Bins, trials: list[tuple[str, float]]) -> list[Candidate]:
    """Return every trial by Fisher scoring, all at once."""
    if not trials:
        return []
    widest = max(len(terms) for terms, _ in trials)
    basis = np.zeros((len(trials), widest, bins.frequency.size))
    plain = dict(zip('NBK', rows(bins.frequency, 'NBK', 0.0), strict=True))
    sampling = bins.rate_hz, bins.size
    shaped: dict[tuple[str, float], Floats] = {}
    for at, (terms, shape) in enumerate(trials):
        for row, term in enumerate(terms):
            if term in plain:
                basis[at, row] = plain[term]
                continue
            if (term, shape) not in shaped:
                shaped[term, shape] = rows(bins.frequency, term, shape, *sampling)[0]
            basis[at, row] = shaped[term, shape]
    raw, misfit = scored(bins, basis)
    found = []
    for at, (terms, shape) in enumerate(trials):
        part = raw[at, : len(terms)]
        count = len(terms) + (shape != 0.0)
        score = float(misfit[at]) + PENALTY * count if np.all(part > 0.0) else math.inf
        squares = np.maximum(part, 0.0)
        found.append(Candidate(terms, shape, squares, float(misfit[at]), score, *sampling))
    return found


def scored(bins: Bins, basis: Floats) -> tuple[Floats, Floats]:
    """
    Return the squares of many sums of densities by Fisher scoring, and −2 ln L of each.

    Parameters
    ----------
    bins : Bins
        The spectrum.
    basis : ndarray, shape (s, p, k)
        The densities of p terms in each of s sums; a row of zeros is no term.

    Returns
    -------
    squares : ndarray, shape (s, p)
        Those below zero would make the sum fit better and are taken as zero in what follows.
    misfit : ndarray, shape (s,)
        −2 ln L.
    """
    degrees = granted(bins.degrees)
    smooth = _smooth(bins)
    scale = np.sqrt(basis**2 @ (degrees / smooth**2)) + _TINY
    basis = basis / scale[:, :, None]
    absent = scale[:, :, None] <= 2 * _TINY
    ridge = 1e-9 * np.eye(basis.shape[1]) + np.where(absent, np.eye(basis.shape[1]), 0.0)
    model = np.broadcast_to(smooth, (len(basis), bins.frequency.size))
    for _ in range(_PASSES):
        weighted = basis * (degrees / model**2)[:, None, :]
        raw = np.linalg.solve(
            weighted @ basis.transpose(0, 2, 1) + ridge, weighted @ bins.density[:, None]
        )
        squares = np.maximum(raw, 0.0)
        new = np.maximum((basis * squares).sum(axis=1), 0.02 * smooth)
        # a step of the weights beyond a factor of three comes back
        model = np.clip(new, model / 3.0, 3.0 * model)
    # of the normal terms themselves: what is known may be taken off them and still be compared
    misfit = (degrees * (np.log(new) + bins.density / new)).sum(axis=1)
    return raw[..., 0] / scale, misfit


def _smooth(bins: Bins) -> Floats:
    """Return a density that no single term pulls down, to weigh by at first."""
    log_f = np.log(bins.frequency)
    near = (np.abs(log_f[:, None] - log_f) < _WIDTH) * bins.degrees
    return np.asarray(near @ bins.density / near.sum(axis=1))
