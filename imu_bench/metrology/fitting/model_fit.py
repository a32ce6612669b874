# SPDX-License-Identifier: Apache-2.0
"""
Fits of every subset of noise terms to one Allan variance curve, and the choice among them.

The squared coefficients enter the Allan variance linearly, so each subset is a weighted linear
fit.  An estimate s with ν degrees of freedom scatters as σ² χ²_ν/ν about the true variance σ²;
weights ν/2σ⁴ with σ² and ν from the model, iterated, solve the likelihood equations of that
distribution (weights from the data instead would favour points that came out low).  A subset
whose solution has a negative square is dropped: its non-negative optimum is that of a smaller
subset, which is in the list as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

from imu_bench.metrology.curve import Floats, Integers
from imu_bench.metrology.fitting.low_pass import bends, LowPass
from imu_bench.metrology.fitting.noise_model import (
    density_basis,
    gauss_markov_density,
    gauss_markov_variance,
    variance_basis,
)
from imu_bench.metrology.fitting.scoring import Bools, granted, minus_two_log_likelihood, scored
from imu_bench.metrology.fitting.transfer import record_share, transfer
import numpy as np

PENALTY = 8.0
"""
What one more term must gain in −2 ln L.  Neighbouring points are correlated, so the gain of a
needless term exceeds χ²_1, which is above 8 in 0.5 %; candidates are tested against the spectrum
afterwards.
"""

PARAMETERS = {'R': 1.25, 'G': 2.0}
"""
Terms that count as more than one.  A Gauss-Markov process has a second parameter, its correlation
time.  A ramp is what a random walk looks like now and then in the longest averaging times of a
record, so it must explain more than a random walk does to be preferred.
"""

TINY = 1e-300
"""Keeps quotients of nothing finite."""

_ALL = 'QNBKR'


@dataclass(frozen=True, eq=False)
class Problem:
    """One curve, prepared for fitting: k averaging times, p candidate terms, f frequencies."""

    terms: str  # letters of the p candidates; 'G' is a Gauss-Markov process
    m: Integers
    # tau, variance: averaging times in s; Allan variances over `scale` squared
    tau: Floats
    variance: Floats
    scale: float  # highest deviation of the curve, the unit of everything within a problem
    # octaves of τ that each point stands for, at most one: closely spaced points repeat one
    # another and must not count twice
    octaves: Floats
    basis: Floats  # Allan variance of each term with coefficient one
    densities: Floats  # one-sided density of each term with coefficient one; zero for the ramp
    cross: Floats  # ∫ D_a D_b H² df
    record: float  # what was recorded, in s, without its gaps
    share: Floats  # part of the record that each point can use (end effect, gaps, estimator)
    # frequency, width: frequencies in Hz, and the part of the axis in Hz each stands for
    frequency: Floats
    width: Floats
    # weights H of the points, over the root of `share`: they give the scatter in this record
    power: Floats
    correlation_time: float | None = None  # T_c in s of the term 'G'
    # filter of the white noise, the row of 'N' in `basis` and `densities`
    low_pass: LowPass | None = None
    # derivatives of that row of `basis` by `LowPass.warped` and `LowPass.floor`
    bends: Floats | None = None
    usable: Floats | None = None  # what gaps and the estimator alone leave of it

    @property
    def period(self) -> float:
        """Sample period in s."""
        return float(self.tau[0] / self.m[0])

    @cached_property
    def scatter(self) -> Floats:
        """Variance of each point that every pair of terms causes in this record, (p * p, k)."""
        return self.cross / (self.record * self.share)

    @property
    def ramp(self) -> int | None:
        """Index of the ramp among the terms, which is deterministic."""
        return self.terms.index('R') if 'R' in self.terms else None

    def only(self, kept: Bools | slice) -> Problem:
        """Return the problem with some of its points."""
        return replace(
            self,
            m=self.m[kept],
            tau=self.tau[kept],
            variance=self.variance[kept],
            octaves=octaves_of(self.tau[kept]),
            basis=self.basis[:, kept],
            cross=self.cross[:, kept],
            share=self.share[kept],
            power=self.power[kept],
            bends=None if self.bends is None else self.bends[:, kept],
            usable=None if self.usable is None else self.usable[kept],
        )

    def behind(self, low_pass: LowPass) -> Problem:
        """
        Return the problem with white noise behind a low-pass filter, and without quantisation.

        Quantisation raises the start of a curve that the filter bends down: the two cancel, and
        no curve tells how much there is of either.
        """
        rows = [i for i, t in enumerate(self.terms) if t != 'Q']
        terms = ''.join(self.terms[i] for i in rows)
        basis, densities = self.basis[rows], self.densities[rows]
        white = terms.index('N')
        basis[white] = low_pass.variance(self.tau)
        densities[white] = density_basis(self.frequency, self.period, 'N')[0] * low_pass.gain(
            self.frequency
        )
        pairs = densities[:, None, :] * densities[None, :, :] * self.width
        cross = pairs @ (self.power**2 * self.share[:, None]).T
        return replace(
            self,
            terms=terms,
            basis=basis,
            densities=densities,
            cross=cross.reshape(-1, self.tau.size),
            low_pass=low_pass,
            bends=bends(self.tau, low_pass),
        )


@dataclass(frozen=True, eq=False)
class Fitted:
    """One subset, fitted: mask and squared coefficients (p,), degrees of freedom (k,)."""

    mask: Bools
    squares: Floats
    degrees: Floats


@dataclass(frozen=True, eq=False)
class Solutions:
    """Fits of s subsets."""

    # masks, squares: terms of each subset, and their squared coefficients
    masks: Bools
    squares: Floats
    degrees: Floats  # degrees of freedom of each point under each fit
    # misfit, score: −2 ln L, and the same with `PENALTY` per term; inf where the optimum is not
    # positive
    misfit: Floats
    score: Floats

    def __getitem__(self, index: int) -> Fitted:
        return Fitted(self.masks[index], self.squares[index], self.degrees[index])

    @property
    def likeliest(self) -> int:
        """Index of the subset of best score."""
        return int(np.argmin(self.score))

    def find(self, mask: Bools) -> int:
        """Return the index of a subset."""
        return int(np.flatnonzero((self.masks == mask).all(axis=1))[0])


def prepare(
    m: Integers,
    deviation: Floats,
    period: float,
    samples: int,
    terms: str,
    *,
    usable: Floats | None = None,
    correlation_time: float | None = None,
) -> Problem:
    """
    Return the fitting problem of one curve.

    Parameters
    ----------
    m : ndarray of int64, shape (k,)
        Averaging factors, ascending.
    deviation : ndarray, shape (k,)
        Allan deviations, above zero.
    period : float
        Sample period in s.
    samples : int
        Samples of the record, those that are missing not counted.
    terms : str
        Letters of the candidate terms.
    usable : ndarray, shape (k,), optional
        Degrees of freedom over those of an overlapped estimate without gaps.
    correlation_time : float, optional
        T_c in s of the term 'G'.
    """
    seen = transfer(m, period)
    tau = np.asarray(m * period, np.float64)
    rows = [_ALL.index(t) for t in terms if t != 'G']
    basis = variance_basis(tau, terms.replace('G', ''))
    densities = seen.densities[rows]
    if 'G' in terms and correlation_time is not None:
        basis = np.vstack([basis, gauss_markov_variance(tau, correlation_time)])
        extra = gauss_markov_density(seen.frequency, correlation_time)
        densities = np.vstack([densities, extra])
        pairs = densities[:, None, :] * densities[None, :, :] * seen.width
        cross = pairs @ (seen.power**2).T
    else:
        cross = seen.cross[np.ix_(rows, rows)]
    share = record_share(m, samples)
    if usable is not None:
        share = share * usable
    scale = float(deviation.max())
    return Problem(
        terms=terms,
        m=m,
        tau=tau,
        variance=(deviation / scale) ** 2,
        scale=scale,
        octaves=octaves_of(tau),
        basis=basis,
        densities=densities,
        cross=cross.reshape(-1, tau.size),
        record=samples * period,
        share=share,
        frequency=seen.frequency,
        width=seen.width,
        power=seen.power / np.sqrt(share)[:, None],
        correlation_time=correlation_time,
        usable=usable,
    )


def parameters_of(terms: str) -> Floats:
    """Return what each term counts for in a score, in units of `PENALTY`."""
    return np.array([PARAMETERS.get(t, 1.0) for t in terms])


def octaves_of(tau: Floats) -> Floats:
    """Return the octaves that each averaging time stands for, at most one."""
    log_tau = np.log2(tau)
    if log_tau.size < 2:
        return np.ones_like(log_tau)
    middles = 0.5 * (log_tau[1:] + log_tau[:-1])
    first = 2.0 * log_tau[0] - middles[0]
    last = 2.0 * log_tau[-1] - middles[-1]
    edges = np.concatenate([[first], middles, [last]])
    result: Floats = np.minimum(np.diff(edges), 1.0)
    return result


def degrees_of_freedom(problem: Problem, squares: Floats) -> Floats:
    """Return the equivalent degrees of freedom of each point under given noise."""
    pairs = (squares[:, :, None] * squares[:, None, :]).reshape(len(squares), -1)
    scatter = pairs @ problem.scatter
    total = squares @ problem.basis
    if problem.ramp is not None:
        ramp = squares[:, [problem.ramp]] * problem.basis[problem.ramp]
        scatter += ramp * (total - ramp) * (4.0 * ramp_leverage(problem))
    power = total**2
    degrees = 2.0 * power / np.maximum(scatter, 1e-12 * power + TINY)
    return np.maximum(degrees, 0.5, out=degrees)


def ramp_leverage(problem: Problem) -> Floats:
    """
    Return the variance of the mean difference over that of one difference, at most one.

    With a ramp R the variance at τ is mean (Rτ + d_i)²/2, d_i the noise of one difference; its
    cross term Rτ·mean(d_i) has the variance R²τ² Var(mean d).  The sum of the d_i telescopes
    to the two ends of the record, hence Var(mean d) ≈ 1.5 τ/T · Var(d) for a random walk, and
    less for whiter noise.
    """
    result: Floats = np.minimum(1.0, 1.5 * problem.tau / problem.record)
    return result


def solve(problem: Problem, masks: Bools) -> Solutions:
    """Fit every subset of terms."""
    raw = scored(
        problem.variance,
        problem.basis,
        masks,
        lambda squares: problem.octaves * granted(degrees_of_freedom(problem, squares)),
        problem.octaves * problem.record * problem.share / problem.tau,
    )
    squares = np.maximum(raw, 0.0)
    degrees = degrees_of_freedom(problem, squares)
    misfit = minus_two_log_likelihood(
        problem.variance, squares @ problem.basis, granted(degrees), problem.octaves
    )
    parameters = masks @ parameters_of(problem.terms)
    positive = np.all((raw > 0.0) | ~masks, axis=1)
    score = np.where(positive, misfit + PENALTY * parameters, np.inf)
    return Solutions(masks, squares, degrees, misfit, score)
