# SPDX-License-Identifier: Apache-2.0
"""
Straight regression when the noise wanders: white noise plus a random walk.

A bias that drifts makes neighbouring residuals alike; ordinary least squares would then promise
intervals that are far too narrow.  Here the share of the walk is estimated with the coefficients
(restricted maximum likelihood, D. A. Harville 1977, "Maximum likelihood approaches to variance
component estimation and to related problems", JASA 72(358):320), and the coefficients are
those of generalised least squares (A. C. Aitken 1935, Proc. R. Soc. Edinburgh 55:42).
"""

from __future__ import annotations

from dataclasses import dataclass
import math

from imu_bench.errors import DataError
from imu_bench.metrology.combining import symmetric
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
import numpy as np
import numpy.typing as npt
from scipy import linalg, optimize

Floats = npt.NDArray[np.float64]

MOST = 600
"""Points beyond which the matrices get too large; callers average before."""

_SHARES = (-18.0, 12.0)
"""Range of ln(variance of the walk's step / variance of the white noise)."""


@dataclass(frozen=True, eq=False)
class Regression:
    """
    Coefficients of a linear model under white noise plus random walk.

    Attributes
    ----------
    coefficients : ndarray, shape (p,)
    covariance : ndarray, shape (p, p)
    residuals : ndarray, shape (n,)
    noise : ndarray, shape (n, n)
        Covariance of the noise.
    freedom : float
        n - p.
    """

    coefficients: Floats
    covariance: Floats
    residuals: Floats
    noise: Floats
    freedom: float
    design: Floats

    def coefficient(self, index: int, unit: str, confidence: float = CONFIDENCE) -> Estimate:
        """Return one coefficient."""
        error = math.sqrt(float(self.covariance[index, index]))
        return symmetric(
            float(self.coefficients[index]), error, unit, confidence,
            freedom=self.freedom, method='generalised least squares',
        )  # fmt: skip

    def contrast(
        self, weights: Floats, first: int, unit: str, confidence: float = CONFIDENCE
    ) -> Estimate:
        """
        Return a weighted sum of the data less what the first coefficients explain.

        Parameters
        ----------
        weights : ndarray, shape (n,)
        first : int
            Number of coefficients whose part is taken off.
        unit : str
        confidence : float
        """
        rest = self.residuals + self.design[:, first:] @ self.coefficients[first:]
        through = weights @ self.design[:, :first]
        # noise of the data and of the coefficients, as if they had nothing to do with each other
        variance = weights @ self.noise @ weights
        variance += through @ self.covariance[:first, :first] @ through
        value = float(weights @ rest)
        return symmetric(value, math.sqrt(float(variance)), unit, confidence, freedom=self.freedom)


def regress(times: npt.ArrayLike, design: npt.ArrayLike, data: npt.ArrayLike) -> Regression:
    """
    Return the regression of a drifting signal.

    Parameters
    ----------
    times : array_like, shape (n,)
        s, rising; averages of equally long stretches.
    design : array_like, shape (n, p)
        Must hold a constant among its columns: the walk begins anywhere.
    data : array_like, shape (n,)

    Raises
    ------
    DataError
        If there are fewer points than coefficients need, or more than `MOST`, or the columns
        of the design depend on one another.

    Examples
    --------
    >>> rng = np.random.default_rng(5)
    >>> t, x = np.arange(200.0), np.sin(np.arange(200.0) / 30.0)
    >>> y = 2.0 * x + 0.05 * np.cumsum(rng.normal(size=200)) + 0.1 * rng.normal(size=200)
    >>> found = regress(t, np.column_stack([np.ones(200), x]), y).coefficient(1, '1')
    >>> found.low < 2.0 < found.high
    True
    """
    when, columns = np.asarray(times, np.float64), np.asarray(design, np.float64)
    values = np.asarray(data, np.float64)
    count, width = columns.shape
    if count < width + 3:
        raise DataError(f'{count} points are too few for {width} coefficients and the noise')
    if count > MOST:
        raise DataError(f'{count} points are more than {MOST}: average before')
    sizes = np.linalg.norm(columns, axis=0)
    if np.linalg.matrix_rank(columns / np.where(sizes > 0.0, sizes, 1.0)) < width:
        raise DataError('the columns of the design depend on one another')
    # the walk in steps of the mean spacing
    walk = np.minimum.outer(when - when[0], when - when[0])
    walk = walk / ((when[-1] - when[0]) / (count - 1))
    problem = _Problem(columns, values, walk)
    best = problem.most_likely()
    return problem.solved(best)


class _Problem:
    """Restricted likelihood of the share of the walk."""

    def __init__(self, design: Floats, data: Floats, walk: Floats) -> None:
        self._design, self._data, self._walk = design, data, walk
        self._eye = np.eye(data.size)

    def most_likely(self) -> float:
        grid = np.linspace(*_SHARES, 16)
        scores = [self._deviance(share) for share in grid]
        best = int(np.argmin(scores))
        low, high = grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)]
        found = optimize.minimize_scalar(
            self._deviance, bounds=(low, high), method='bounded', options={'xatol': 0.02}
        )
        return float(found.x)

    def solved(self, share: float) -> Regression:
        shape, root, coefficients, residuals, gram = self._fit(share)
        freedom = self._data.size - self._design.shape[1]
        white = linalg.solve_triangular(root, residuals, lower=True)
        # data without noise have none; keep the matrices regular
        scale = float(white @ white) / freedom
        return Regression(
            coefficients, scale * linalg.inv(gram), residuals, scale * shape, freedom,
            self._design,
        )  # fmt: skip

    def _shape(self, share: float) -> Floats:
        ratio = math.exp(share)
        # scaled so that neither part overflows
        return np.asarray((self._eye + ratio * self._walk) / (1.0 + ratio), np.float64)

    def _fit(self, share: float) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        shape = self._shape(share)
        root = np.asarray(linalg.cholesky(shape, lower=True), np.float64)
        columns = linalg.solve_triangular(root, self._design, lower=True)
        values = linalg.solve_triangular(root, self._data, lower=True)
        gram = columns.T @ columns
        coefficients = np.linalg.solve(gram, columns.T @ values)
        return shape, root, coefficients, self._data - self._design @ coefficients, gram

    def _deviance(self, share: float) -> float:
        _, root, _, residuals, gram = self._fit(share)
        white = linalg.solve_triangular(root, residuals, lower=True)
        freedom = self._data.size - self._design.shape[1]
        square = max(float(white @ white), 1e-300)
        halves = 2.0 * float(np.sum(np.log(np.diag(root))))
        determinant = float(np.linalg.slogdet(gram)[1])
        return float(freedom * math.log(square) + halves + determinant)
