# SPDX-License-Identifier: Apache-2.0
"""
Linear regression when the noise wanders: white noise, flicker noise and a random walk together.

A bias that drifts makes neighbouring residuals alike; ordinary least squares would then promise
intervals that are far too narrow.  For given shares of the three noises the coefficients are
those of generalised least squares (A. C. Aitken 1935, Proc. R. Soc. Edinburgh 55:42).  How much
there is of each is not known; every mixture counts as much as the data make it likely
(restricted likelihood, D. A. Harville 1977, "Maximum likelihood approaches to variance component
estimation and to related problems", JASA 72(358):320), so that not knowing it is in the interval.

Averages over equal stretches are taken into the cosine transform (DCT-II).  There white noise
and a random walk are independent from line to line, and flicker noise nearly so: no matrix of
the size of the recording is ever solved.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

from imu_bench.errors import DataError
from imu_bench.metrology.combining import symmetric
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

METHOD = 'generalised least squares'

_NOTHING = -5.0
"""ln of the share, at the lowest frequency, at which a noise is lost in the white noise."""

_ALL = math.log(30.0)
"""ln of the share at the highest frequency at which white noise is lost in another."""

_STEP = 1.0
"""Step of ln share; the likelihood is smooth on the scale of a factor of ten."""

_UNLIKELY = 1e-5
"""Mixtures less likely than this are left out."""


@dataclass(frozen=True, eq=False)
class Regression:
    """Coefficients of a linear model under noise that wanders, for every likely mixture of it."""

    weights: Floats  # probabilities of the mixtures
    coefficients: Floats  # of the columns after the constant
    covariance: Floats
    noise: Floats  # variance of the lines of the cosine transform
    freedom: float
    _design: Floats
    _data: Floats
    _index: Integers

    def coefficient(self, index: int, unit: str, confidence: float = CONFIDENCE) -> Estimate:
        """Return the coefficient of one column, the constant being column 0."""
        if index == 0:
            return self._level(unit, confidence)
        values = self.coefficients[:, index - 1]
        return self._estimate(values, self.covariance[:, index - 1, index - 1], unit, confidence)

    def contrast(
        self, weights: Floats, first: int, unit: str, confidence: float = CONFIDENCE
    ) -> Estimate:
        """Return a weighted sum of the data less what the first coefficients explain."""
        along = weights @ self._design
        taken = np.where(np.arange(along.size) < first - 1, along, 0.0)
        values = weights @ self._data - self.coefficients @ taken
        # the same noise is in the sum and in the coefficients
        variance = self.noise @ _lines(self._index, weights) ** 2
        variance += (self.covariance @ taken) @ (taken - 2.0 * along)
        return self._estimate(values, np.maximum(variance, 0.0), unit, confidence)

    def _level(self, unit: str, confidence: float) -> Estimate:
        """Return the constant: the mean of this record where the other columns are 0."""
        middle = self._design.mean(axis=0)
        values = self._data.mean() - self.coefficients @ middle
        variance = (self.covariance @ middle) @ middle + self.noise[:, -1] / self._data.size
        return self._estimate(values, variance, unit, confidence)

    def _estimate(
        self, values: Floats, variances: Floats, unit: str, confidence: float
    ) -> Estimate:
        mean = float(self.weights @ values)
        errors = np.sqrt(variances)
        spread = math.sqrt(float(self.weights @ (variances + (values - mean) ** 2)))
        tail = (1.0 - confidence) / 2.0
        low, high = (self._quantile(values, errors, part) for part in (tail, 1.0 - tail))
        if low is None or high is None:  # no noise at all
            return symmetric(mean, spread, unit, confidence, freedom=self.freedom, method=METHOD)
        return Estimate(mean, min(low, mean), max(high, mean), unit, confidence, method=METHOD)

    def _quantile(self, values: Floats, errors: Floats, part: float) -> float | None:
        """Return where Student's distributions of all mixtures together reach a probability."""
        ends = values + errors * float(scipy.special.stdtrit(self.freedom, part))
        low, high = float(ends.min()), float(ends.max())
        if errors.min() <= 0.0:
            return None

        def beyond(at: float) -> float:
            reached = scipy.special.stdtr(self.freedom, (at - values) / errors)
            return float(self.weights @ reached) - part

        # all mixtures agree, or nearly: rounding decides about the signs
        if high - low <= 1e-9 * float(errors.max()) or beyond(low) * beyond(high) >= 0.0:
            return 0.5 * (low + high)
        return float(scipy.optimize.brentq(beyond, low, high, xtol=1e-4 * float(errors.min())))


def regress(index: npt.ArrayLike, design: npt.ArrayLike, data: npt.ArrayLike) -> Regression:
    """Return the regression of a drifting signal."""
    places, columns = np.asarray(index, np.int64), np.asarray(design, np.float64)
    values = np.asarray(data, np.float64)
    count, width = columns.shape
    if count < width + 3:
        raise DataError(f'{count} points are too few for {width} coefficients and the noise')
    if np.ptp(columns[:, 0]) > 0.0:
        raise DataError('the first column of the design is not constant')
    sizes = np.linalg.norm(columns, axis=0)
    if np.linalg.matrix_rank(columns / np.where(sizes > 0.0, sizes, 1.0)) < width:
        raise DataError('the columns of the design depend on one another')
    # what least squares explain is taken off and added again: the rest keeps its digits
    explained = np.linalg.lstsq(columns / sizes, values - values[0], rcond=None)[0] / sizes
    rest = values - values[0] - columns @ explained
    lines = _lines(places, columns[:, 1:])
    scale = np.sqrt(np.mean(lines**2, axis=0))
    found = _Mixtures(lines / scale, _lines(places, rest), _missing(places))
    return Regression(
        found.weights,
        explained[1:] + found.coefficients / scale,
        found.covariance / np.outer(scale, scale),
        found.noise,
        found.freedom,
        columns[:, 1:],
        values,
        places,
    )


class _Mixtures:
    """Coefficients and probability of every mixture of the three noises."""

    def __init__(self, design: Floats, data: Floats, missing: Floats) -> None:
        width, (count, gone) = design.shape[1], missing.shape
        # a value that is missing may be anything: a coefficient of its own
        columns = np.column_stack([design, missing, data])
        size = width + gone
        self.freedom = float(count - size)
        shapes = _shapes(count + 1)
        grams = _grams(columns, 1.0 / shapes)
        normal, toward = grams[:, :size, :size], grams[:, :size, size]
        inverse = np.linalg.inv(normal)
        solved = np.einsum('mij,mj->mi', inverse, toward)
        squares = grams[:, size, size] - np.einsum('mi,mi->m', toward, solved)
        squares = np.maximum(squares, 1e-300)
        deviance = self.freedom * np.log(squares) + np.log(shapes).sum(axis=1)
        deviance += np.linalg.slogdet(normal)[1]
        likely = np.exp(-0.5 * (deviance - deviance.min()))
        kept = likely > _UNLIKELY
        self.weights = np.asarray(likely[kept] / likely[kept].sum(), np.float64)
        level = squares[kept] / self.freedom
        self.coefficients = np.asarray(solved[kept, :width], np.float64)
        self.covariance = np.asarray(
            inverse[kept, :width, :width] * level[:, None, None], np.float64
        )
        self.noise = np.asarray(shapes[kept] * level[:, None], np.float64)


def _grams(columns: Floats, weights: Floats) -> Floats:
    """Return the products of columns, shape (m, q, q), for every row of weights, (m, k)."""
    rows, across = np.triu_indices(columns.shape[1])
    # not by BLAS, whose threads cost more than such a product when the machine is busy
    halves = np.einsum('mk,kq->mq', weights, columns[:, rows] * columns[:, across])
    full = np.empty((weights.shape[0], columns.shape[1], columns.shape[1]))
    full[:, rows, across] = halves
    full[:, across, rows] = halves
    return full


def _shapes(count: int) -> Floats:
    """Return the spectra of all mixtures, shape (m, count - 1), at the lines but the first."""
    # A density ∝ f^-p, averaged over each stretch and read once per stretch, is at angular
    # frequency ω per stretch proportional to (2 - 2 cos ω) Σ |ω + 2πi|^-(p + 2) over all integers
    # i: the sinc² of the average, and what it lets alias.
    turns = np.arange(1, count) / (2.0 * count)
    step = 2.0 - 2.0 * np.cos(2.0 * np.pi * turns)
    parts = np.array(
        [
            step * (scipy.special.zeta(power, turns) + scipy.special.zeta(power, 1.0 - turns))
            for power in (2.0, 3.0, 4.0)
        ]
    )
    parts /= parts[:, :1]
    flicker = np.arange(_NOTHING, _ALL + math.log(count), _STEP)
    walk = np.arange(_NOTHING, _ALL + 2.0 * math.log(count), _STEP)
    shares = np.exp([[0.0, a, b] for a in flicker for b in walk])
    shares /= shares.sum(axis=1, keepdims=True)
    return np.asarray(np.einsum('mi,ik->mk', shares, parts), np.float64)


def _whole(index: Integers, values: Floats) -> Floats:
    span = int(index[-1] - index[0]) + 1
    whole = np.zeros((span, *values.shape[1:]))
    whole[index - index[0]] = values
    return whole


def _lines(index: Integers, values: Floats) -> Floats:
    """Return the cosine transform but for its first line, which a constant fills alone."""
    return np.asarray(scipy.fft.dct(_whole(index, values), axis=0, norm='ortho')[1:], np.float64)


def _missing(index: Integers) -> Floats:
    """Return the transforms of unit values where values are missing, shape (k, gone)."""
    there = _whole(index, np.ones(index.size)) > 0.0
    return np.asarray(
        scipy.fft.dct(np.eye(there.size)[:, ~there], axis=0, norm='ortho')[1:], np.float64
    )
