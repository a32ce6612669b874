# SPDX-License-Identifier: Apache-2.0
"""
Mean, standard deviation and RMS of correlated noise, with intervals that know it.

Sensor noise is rarely white, so sigma/sqrt(n) would promise far too much.  The
samples are cut into up to 64 successive blocks; how far the block means (for
the standard deviation: the block variances) scatter says how well the whole is
known.  As long as neighbouring blocks are still correlated they are joined in
pairs, down to 8; what correlation may be left then widens the interval.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

from imu_bench.metrology.estimate import CONFIDENCE, Estimate
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]

BLOCKS = 64
"""Blocks of a record: their scatter is known to 1/√(2 · 63), 9 %."""

FEWEST_BLOCKS = 8
"""Blocks below which their scatter, known to 27 %, is not asked: samples count as independent."""

FEWEST_PER_BLOCK = 4
"""Samples per block at least; a shorter record has fewer blocks."""

FEWEST_FREEDOM = FEWEST_BLOCKS / 2
"""
Degrees of freedom of a variance that the scatter of blocks cannot go below.  Fewer make the upper
end of an interval many times the value and cover no more: for a correlation time of a fifth of
the record 87.5 % instead of 88 % (simulated, 95 % asked).
"""


@dataclass(frozen=True, eq=False)
class Moments:
    """First and second moments of several axes, block by block."""

    count: npt.NDArray[np.int64]  # samples per block
    # mean, square: mean of every block, and mean of the squared deviation from the mean of the
    # whole axis
    mean: Floats
    square: Floats

    @classmethod
    def of(cls, data: Floats) -> Moments:
        """
        Return the moments of data of shape (axes, n), n >= 1.

        Examples
        --------
        >>> m = Moments.of(np.array([[1.0, 2.0, 3.0, 4.0]]))
        >>> float(m.total_mean[0]), float(m.variance[0])
        (2.5, 1.6666666666666667)
        """
        axes, n = data.shape
        blocks = BLOCKS if n >= BLOCKS * FEWEST_PER_BLOCK else max(1, n // FEWEST_PER_BLOCK)
        edges = np.linspace(0, n, blocks + 1).astype(np.int64)
        mean, within = np.empty((axes, blocks)), np.empty((axes, blocks))
        for block in range(blocks):
            part = data[:, edges[block] : edges[block + 1]]
            # around the first sample, so that a constant gives exactly itself
            first = part[:, :1]
            off = part - first
            middle = off.mean(axis=1, keepdims=True)
            mean[:, block] = (first + middle)[:, 0]
            off -= middle
            within[:, block] = np.einsum('ij,ij->i', off, off)
        count = np.diff(edges)
        total = mean[:, :1] + ((mean - mean[:, :1]) @ count / n)[:, None]
        return cls(count, mean, within / count + (mean - total) ** 2)

    @property
    def samples(self) -> int:
        """Samples per axis."""
        return int(self.count.sum())

    @property
    def total_mean(self) -> Floats:
        """Mean of each axis, shape (axes,)."""
        first = self.mean[:, 0]
        offsets = (self.mean - first[:, None]) @ self.count / self.samples
        return np.asarray(first + offsets, np.float64)

    @property
    def variance(self) -> Floats:
        """Variance of each axis with n - 1 in the denominator, shape (axes,); 0 for n = 1."""
        total = self.square @ self.count
        return np.asarray(total / max(self.samples - 1, 1), np.float64)

    def mean_estimate(self, axis: int, unit: str, confidence: float = CONFIDENCE) -> Estimate:
        """
        Return the mean of one axis.

        The interval is that of the long-term mean as far as this record shows
        it: noise slower than an eighth of the record cannot be seen in it.
        """
        value = float(self.total_mean[axis])
        if self.samples < 2:
            return Estimate(value, None, None, unit, confidence, method='single sample')
        if self.count.size < FEWEST_BLOCKS:  # too short to see correlation: independent samples
            error = math.sqrt(float(self.variance[axis]) / self.samples)
            half = error * float(scipy.special.stdtrit(self.samples - 1, 0.5 + confidence / 2))
            return Estimate(
                value, value - half, value + half, unit, confidence,
                method='independent samples',
            )  # fmt: skip
        error, freedom = error_of_mean(self.mean[axis])
        half = error * float(scipy.special.stdtrit(freedom, 0.5 + confidence / 2))
        return Estimate(value, value - half, value + half, unit, confidence, method='block means')

    def freedom(self, axis: int, confidence: float = CONFIDENCE) -> float:
        """
        Return the equivalent degrees of freedom of the variance of one axis.

        The scatter of a few blocks is itself a guess: Student's factor at this confidence takes
        degrees of freedom off.
        """
        most = float(max(self.samples - 1, 1))
        if self.count.size < FEWEST_BLOCKS:
            return most
        error, freedom = error_of_mean(self.square[axis])
        if error == 0.0:
            return most
        tail = 0.5 + confidence / 2.0
        error *= float(scipy.special.stdtrit(freedom, tail) / scipy.special.ndtri(tail))
        return min(max(2.0 * (float(self.variance[axis]) / error) ** 2, FEWEST_FREEDOM), most)

    def std_estimate(self, axis: int, unit: str, confidence: float = CONFIDENCE) -> Estimate:
        """
        Return the standard deviation of one axis.

        Chi-squared interval with the equivalent degrees of freedom that the
        scatter of the block variances shows: right for correlated and for
        heavy-tailed noise, not for noise that grows without limit.  The
        deviation is about the mean of the record, which followed the slow
        part; the variance of that mean is added at the upper end.
        """
        if self.samples < 2:
            reason = 'a single sample has no standard deviation'
            return Estimate.not_observable(unit, reason, confidence=confidence)
        value = math.sqrt(float(self.variance[axis]))
        low, high = _chi_squared(self.freedom(axis, confidence), confidence)
        followed = 0.0
        if self.count.size >= FEWEST_BLOCKS:
            followed = error_of_mean(self.mean[axis])[0]
        low, high = low * value, high * math.hypot(value, followed)
        return Estimate(value, low, high, unit, confidence, method='block variances')

    def rms_estimate(self, axis: int, unit: str, confidence: float = CONFIDENCE) -> Estimate:
        """Return the RMS about the mean: the standard deviation with n in the denominator."""
        factor = math.sqrt((self.samples - 1) / self.samples)
        return self.std_estimate(axis, unit, confidence).scaled(factor, unit)

    def total_rms_estimate(self, axis: int, unit: str, confidence: float = CONFIDENCE) -> Estimate:
        """Return the RMS about zero: mean and noise together."""
        middle = float(self.total_mean[axis])
        square = float(self.square[axis] @ self.count) / self.samples + middle**2
        value = math.sqrt(square)
        if self.count.size < FEWEST_BLOCKS:
            mean = self.mean_estimate(axis, unit, confidence)
            noise = self.rms_estimate(axis, unit, confidence)
            return _root_sum_square(value, mean, noise)
        # mean square of each block about zero
        blocks = self.square[axis] + middle * (2.0 * self.mean[axis] - middle)
        error, freedom = error_of_mean(blocks)
        half = error * float(scipy.special.stdtrit(freedom, 0.5 + confidence / 2))
        if half == 0.0:
            return Estimate(value, value, value, unit, confidence, method='block mean squares')
        z = float(scipy.special.ndtri(0.5 + confidence / 2))
        freedom = max(2.0 * (z * square / half) ** 2, FEWEST_FREEDOM)
        low, high = _chi_squared(freedom, confidence)
        return Estimate(
            value, value * low, value * high, unit, confidence, method='block mean squares'
        )


def _chi_squared(freedom: float, confidence: float) -> tuple[float, float]:
    """Return the ends of the interval of a deviation over its value."""
    # far beyond any record; the ends differ by the last digits, and the quantiles are still exact
    degrees = min(freedom, 1e16) / 2.0
    tail = (1.0 - confidence) / 2.0
    low = math.sqrt(degrees / float(scipy.special.gammainccinv(degrees, tail)))
    return low, math.sqrt(degrees / float(scipy.special.gammaincinv(degrees, tail)))


def _root_sum_square(value: float, mean: Estimate, noise: Estimate) -> Estimate:
    """Return the RMS about zero of a short run from its mean and noise."""
    if noise.low is None or noise.high is None or mean.low is None or mean.high is None:
        return Estimate(value, None, None, mean.unit, mean.confidence, method='single sample')
    nearest = 0.0 if mean.low < 0.0 < mean.high else min(abs(mean.low), abs(mean.high))
    farthest = max(abs(mean.low), abs(mean.high))
    return Estimate(
        value, math.hypot(nearest, noise.low), math.hypot(farthest, noise.high),
        mean.unit, mean.confidence, method=mean.method,
    )  # fmt: skip


def error_of_mean(blocks: Floats) -> tuple[float, float]:
    """
    Return the standard error of the mean of block values, and its degrees of freedom.

    Blocks are joined in pairs while their lag-1 correlation exceeds the one-sided 5 %
    point of independent ones, 1.645/sqrt(K) (G. S. Fishman 1978, "Grouping observations in
    digital simulation", Management Science 24(5):510, with the lag-1 form of his test).

    Correlation below that point is not absent.  What is left is taken for that of a
    first-order autoregressive sequence, whose mean has (1 + r)/(1 - r) =: I times the variance
    of independent values while their scatter about it comes out (K - I)/(K - 1) times too
    small.  Its r is the lag-1 correlation less the bias of its estimate: -(1 + 3r)/K where the
    mean is estimated as well (F. H. C. Marriott and J. A. Pope 1954, "Bias in the estimation of
    autocorrelations", Biometrika 41:390), -r/K more here, for K - 1 products are divided by K
    squares (the tests find the same by simulation).
    """
    values = blocks
    while True:
        off = values - values.mean()
        total = float(off @ off)
        if total == 0.0:
            return 0.0, float(values.size - 1)
        lag1 = float(off[1:] @ off[:-1]) / total
        correlated = lag1 > 1.645 / math.sqrt(values.size)
        if not correlated or values.size // 2 < FEWEST_BLOCKS:
            break
        values = values[: values.size // 2 * 2].reshape(-1, 2).mean(axis=1)
    r = (values.size * lag1 + 1.0) / max(values.size - 4.0, 1.0)
    # what lasts longer than half the blocks cannot be told from them
    most = 0.5 * values.size
    inflation = min((1.0 + r) / (1.0 - r), most) if r < 1.0 else most
    inflation = max(inflation, 1.0)
    variance = total / (values.size - inflation) / values.size * inflation
    return math.sqrt(variance), float(values.size - 1)
