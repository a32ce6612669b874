# SPDX-License-Identifier: Apache-2.0
"""
How far fitted noise coefficients can be trusted.

A fitted square θ_j = Σ g_i s_i weighs the spectrum with G = Σ g_i H_i, so its mean, variance and
third cumulant under any noise follow from `transfer`; correlations between averaging times are
in them.  The distribution is taken as Pearson type III (a shifted χ²) with these three, which is
exact for one dominant noise and tends to a normal one where terms are differences of others.
Intervals collect the values θ that the data do not contradict: both the estimate and its scatter
are those that θ would give, so a term is significant when zero is contradicted.
"""

from __future__ import annotations

from dataclasses import dataclass

from imu_bench.metrology.curve import Floats
from imu_bench.metrology.fitting.model_fit import Fitted, Problem, ramp_leverage, TINY
from imu_bench.metrology.fitting.scoring import granted
import numpy as np
from numpy.polynomial import polynomial
import scipy

_STEPS = np.sinh(np.linspace(-5.0, 9.0, 180))
"""Trial values around an estimate, in standard deviations: fine near it, far out at the ends."""


@dataclass(frozen=True, eq=False)
class Response:
    """How the estimate of one squared coefficient answers to noise."""

    value: float  # the estimate, which may be negative
    # second, third: variance and third cumulant, as polynomials in the true square
    second: Floats
    third: Floats

    def moments(self, square: Floats) -> tuple[Floats, Floats]:
        """Return standard deviation and skewness of the estimate if the truth is `square`."""
        floor = 1e-20 * (self.value**2 + square**2) + TINY
        variance = np.maximum(polynomial.polyval(square, self.second), floor)
        deviation = np.sqrt(variance)
        return deviation, polynomial.polyval(square, self.third) / (variance * deviation)

    def spread(self, square: float) -> float:
        """Return the standard deviation of the estimate if the truth is `square`."""
        return float(self.moments(np.array([square]))[0][0])

    def below(self, value: float, square: Floats) -> Floats:
        """Return the probability of an estimate up to `value` if the truth is `square`."""
        deviation, skewness = self.moments(square)
        return pearson3_below(np.clip((value - square) / deviation, -1e6, 1e6), skewness)

    def significance(self) -> float:
        """Return the probability of an estimate this high if the term were absent."""
        return float(1.0 - self.below(self.value, np.zeros(1))[0])

    def interval(self, confidence: float) -> tuple[float, float]:
        """Return the two-sided interval of the square."""
        tail = 0.5 * (1.0 - confidence)
        falling = self._falling(self.value)
        return _crossing(*falling, 1.0 - tail), _crossing(*falling, tail)

    def upper_bound(self, confidence: float) -> float:
        """
        Return the upper bound of the square, the upper end of a two-sided interval.

        An estimate below zero counts as zero: a fluctuation downwards must not promise more
        than the record could have shown.
        """
        return _crossing(*self._falling(max(self.value, 0.0)), 0.5 * (1.0 - confidence))

    def _falling(self, value: float) -> tuple[Floats, Floats]:
        """Return trial truths, ascending, and the probability of an estimate up to `value`."""
        trials = value + self.spread(max(value, 0.0)) * _STEPS
        trials = np.concatenate([[0.0], trials[trials > 0.0]])
        return trials, np.minimum.accumulate(self.below(value, trials))


def _crossing(trials: Floats, falling: Floats, level: float) -> float:
    """Return the trial where a falling probability passes `level`; the end if it never does."""
    return float(np.interp(-level, -falling, trials))


def pearson3_below(z: Floats, skewness: Floats) -> Floats:
    """Return the distribution function of a standardised Pearson type III variable."""
    flat = np.abs(skewness) < 1e-3
    shape = 4.0 / np.where(flat, 1.0, skewness) ** 2
    # z in units of a gamma variable of this shape, mirrored for negative skewness
    gamma = np.maximum(shape + 2.0 * z / np.where(flat, 1.0, skewness), 0.0)
    right = np.where(
        skewness > 0, scipy.special.gammainc(shape, gamma), scipy.special.gammaincc(shape, gamma)
    )
    result: Floats = np.where(flat, scipy.special.ndtr(z), right)
    return result


def respond(
    problem: Problem,
    fitted: Fitted,
    *,
    truth: Floats | None = None,
    extra: Floats | None = None,
    widening: float = 1.0,
) -> dict[str, Response]:
    """
    Return the response of every term of a fit.

    Parameters
    ----------
    fitted : Fitted
        Its squares and degrees set the weights.
    truth : ndarray, shape (p,), optional
        The noise that scatters the estimates; the fit itself if not given.
    extra : ndarray, shape (k,), optional
        A further column of the fit, for a parameter without a density of its own: 'T' in the
        result.
    widening : float
        Factor on every standard deviation, for a model that fits badly.
    """
    noise = fitted.squares if truth is None else truth
    letters = [t for t, on in zip(problem.terms, fitted.mask, strict=True) if on]
    columns, own = problem.basis[fitted.mask], problem.densities[fitted.mask]
    present = noise[fitted.mask]
    further = [] if extra is None else [('T', extra)]
    if problem.bends is not None and problem.low_pass is not None:
        # the cutoff was fitted as well, and the floor if there is one
        count = 2 if problem.low_pass.floor else 1
        moved = fitted.squares[problem.terms.index('N')] * problem.bends[:count]
        further += list(zip('FW'[:count], moved, strict=True))
    # a parameter of a term that is absent changes nothing
    further = [(letter, column) for letter, column in further if column.any()]
    for letter, column in further:
        letters = [*letters, letter]
        columns, own = np.vstack([columns, column]), np.vstack([own, 0.0 * own[0]])
        present = np.append(present, 0.0)
    rows = _rows(problem, fitted, columns)
    gains = rows @ problem.power
    others = (noise @ problem.densities - present[:, None] * own) * gains
    per_record = problem.width / problem.record
    second = variance_in(others, own * gains, per_record)
    if problem.usable is not None:
        # `power` carries the share that gaps leave as a variance does, its root; a third
        # cumulant, of the square of the record, wants the third root of the square
        gains = rows @ (problem.power * problem.usable[:, None] ** (-1.0 / 6.0))
        others = (noise @ problem.densities - present[:, None] * own) * gains
    third = third_cumulant_in(others, own * gains, 2.0 * per_record / problem.record)
    if problem.ramp is not None:
        ramp = _ramp_responses(problem, noise, rows)
        is_ramp = np.array([letter == 'R' for letter in letters])
        second[:, 1] += np.where(is_ramp, ramp, 0.0)
        second[:, 0] += np.where(is_ramp, 0.0, noise[problem.ramp] * ramp)
    values = rows @ problem.variance
    return {
        letter: Response(float(values[i]), second[i] * widening**2, third[i] * widening**3)
        for i, letter in enumerate(letters)
    }


def _rows(problem: Problem, fitted: Fitted, columns: Floats) -> Floats:
    """Return the weights g of every point in every estimate, shape (p, k)."""
    model = fitted.squares @ problem.basis
    weights = problem.octaves * granted(fitted.degrees) / model**2
    scale = 1.0 / np.sqrt(columns**2 @ weights)
    columns = columns * scale[:, None]
    normal = (columns * weights) @ columns.T + 1e-12 * np.eye(len(columns))
    return np.asarray(np.linalg.solve(normal, columns * weights) * scale[:, None], np.float64)


def variance_in(others: Floats, own: Floats, of_one: Floats) -> Floats:
    """Return the variance of estimates as polynomials in their own truth, shape (p, 3)."""
    parts = [others**2 @ of_one, 2.0 * ((others * own) @ of_one), own**2 @ of_one]
    return np.stack(parts, axis=1)


def third_cumulant_in(others: Floats, own: Floats, of_one: Floats) -> Floats:
    """Return the third cumulant, shape (p, 4), as `variance_in` does the variance."""
    a2, b2 = others**2 * of_one, own**2 * of_one
    parts = [(a2 * others).sum(axis=1), 3.0 * (a2 * own).sum(axis=1),
             3.0 * (b2 * others).sum(axis=1), (b2 * own).sum(axis=1)]  # fmt: skip
    return np.stack(parts, axis=1)


def _ramp_responses(problem: Problem, noise: Floats, rows: Floats) -> Floats:
    """Return the variance that a unit ramp gives each estimate through its cross term."""
    random = noise @ problem.basis
    if problem.ramp is not None:
        random = random - noise[problem.ramp] * problem.basis[problem.ramp]
    # one slope of the noise over the record moves all averaging times together
    spread = problem.tau * np.sqrt(2.0 * np.maximum(random, 0.0) * ramp_leverage(problem))
    return np.asarray((rows @ spread) ** 2, np.float64)
