# SPDX-License-Identifier: Apache-2.0
"""
Could any sum of terms describe a curve?  An answer at one glance, before anything is fitted.

A fit tries every subset of its terms and weighs each by its own noise, a hundred times the work
of one non-negative least squares.  That one sees all terms at once, those of which the fit may
take one only as well, so what it cannot describe, no fit can.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

from imu_bench.metrology.curve import Floats
from imu_bench.metrology.fitting.model_fit import Problem, TINY
from imu_bench.metrology.fitting.scoring import granted
import numpy as np
import scipy

MISFIT = 3.0
"""Mean squared residual above which a model does not describe a curve."""

HOPELESS = 9.0
"""
Mean squared residual of a glance from which no fit describes the curve.  A fit does up to 3, and
of 1160 curves that one describes a glance left more than twice that in 2 only, 7.6 at most.
"""

PASSES = 8
"""Times that the weights follow the model; fewer leave up to ten times the residual."""

_LEAST = 0.01


class Judged(ABC):
    """How well a sum of terms describes the averaging times of a problem."""

    problem: Problem

    @property
    @abstractmethod
    def residuals(self) -> Floats:
        """Excess of each variance over the sum, in standard deviations, shape (k,)."""

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
    def start(self) -> float:
        """Size of the mean residual of the first octave, in standard deviations."""
        first = self.problem.tau < 1.99 * self.problem.tau[0]
        weights = self.problem.octaves[first]
        return abs(float(np.average(self.residuals[first], weights=weights)))


class Glance(Judged):
    """The best sum of all columns."""

    def __init__(self, problem: Problem, residuals: Floats) -> None:
        self.problem = problem
        self._residuals = residuals

    @property
    def residuals(self) -> Floats:
        """Excess of each variance over the sum, in standard deviations, shape (k,)."""
        return self._residuals

    @property
    def hopeless(self) -> bool:
        """Whether no fit of such columns describes the curve."""
        return self.chi2 > HOPELESS


def glance(
    problem: Problem, degrees: Floats, columns: Floats | None = None, passes: int = PASSES
) -> Glance:
    """Return what non-negative sums of the terms leave of a curve."""
    columns = problem.basis if columns is None else columns
    data = problem.variance
    exact = np.sqrt(0.5 * granted(degrees))
    weights = exact * np.sqrt(problem.octaves)
    model = data
    for _ in range(passes):
        weighted = columns * (weights / model)
        scale = 1.0 / np.sqrt((weighted**2).sum(axis=1) + TINY)
        squares, _ = scipy.optimize.nnls(
            (weighted * scale[:, None]).T, weights * data / model, maxiter=50 * len(columns)
        )
        model = np.maximum((squares * scale) @ columns, _LEAST * data)
    return Glance(problem, (data / model - 1.0) * exact)
