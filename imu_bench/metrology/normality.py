# SPDX-License-Identifier: Apache-2.0
"""
Histogram, and how far noise is from normal.

With millions of samples every test of normality rejects: real noise is
quantised, correlated and never quite normal.  What matters is by how much, so
the size of the departure comes first, with its interval, and the verdict
weighs it against a stated tolerance.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Any

from imu_bench.errors import DataError
from imu_bench.metrology import workspace
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
from imu_bench.metrology.moments import BLOCKS, error_of_mean, FEWEST_BLOCKS
from imu_bench.metrology.statistics import resolution
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

TOLERANCE = 0.02
"""
Distance of the distribution functions up to which noise is called practically normal.  For scale:
Student's t is 0.016 away with 10 degrees of freedom and 0.038 with 5, a uniform distribution
0.057.
"""

LILLIEFORS = (0.752, 0.788, 0.835, 0.907, 1.058)
"""
Quantiles of D sqrt(n) at 80, 85, 90, 95 and 99 % for a normal distribution with fitted mean and
sigma: 60 000 records of 10 000 samples, found as H. W. Lilliefors 1967, J. Am. Stat. Assoc.
62:399, found his for up to 30.
"""

MOST_BINS = 400
"""Bins of a histogram: more than a figure can show."""

FEWEST_SAMPLES = 20
"""Samples below which a distance of 0.2 (95 %) would not be seen."""

_FINE = 4096
"""Places between ±6 sigma where distributions are compared; between two lie 0.0006 at most."""


@dataclass(frozen=True, eq=False)
class Histogram:
    """A histogram with the normal distribution of the same mean and standard deviation."""

    edges: Floats  # between the codes of quantised data, never on one
    count: Integers
    expected: Floats  # counts of the normal distribution
    unit: str  # unit of the edges
    # below, above: samples outside the edges
    below: int
    above: int


@dataclass(frozen=True)
class Normality:
    """How far noise is from normal."""

    # 'normal' (no departure seen), 'practically normal' (a departure is certain, but below the
    # tolerance), 'not normal', or 'undecided' (the record is too short to tell)
    verdict: str
    distance: Estimate  # largest difference of the distribution functions (Kolmogorov's D)
    # skewness, kurtosis: third standardised moment, and excess of the fourth; 0 if normal
    skewness: Estimate
    kurtosis: Estimate
    p_value: float  # probability of this skewness and kurtosis in normal noise
    # share of samples beyond three standard deviations; 0.0027 if normal
    beyond_three_sigma: float


def _finite(data: npt.ArrayLike) -> Floats:
    values = np.asarray(data, dtype=np.float64)
    if values.ndim != 1:
        raise DataError(f'data must have shape (n,), got {values.shape}')
    if not workspace.all_finite(values):
        values = values[np.isfinite(values)]
    if values.size < 2:
        raise DataError(f'{values.size} finite samples make no distribution; record longer')
    return values


def histogram(data: npt.ArrayLike, unit: str, bins: int | None = None) -> Histogram:
    """
    Return the histogram of finite samples with the normal distribution beside it.

    Parameters
    ----------
    unit : str
        Unit of the data.
    bins : int, optional
        Number of bins; by default after Freedman and Diaconis (1981, Z.
        Wahrscheinlichkeitstheorie 57:453): width 2 IQR / n^(1/3), at most `MOST_BINS`.

    Notes
    -----
    Bins of quantised data are whole codes wide, or the histogram would show a
    comb that is not in the data.  Beyond ten standard deviations samples are
    counted, not drawn.

    Raises
    ------
    DataError
        If fewer than two samples are finite, or all are equal.

    Examples
    --------
    >>> h = histogram(np.random.default_rng(1).normal(size=1000), 'm/s²')
    >>> int(h.count.sum()), bool(abs(h.expected.sum() - 1000) < 5)
    (1000, True)
    """
    values = _finite(data)
    if bins is not None and bins < 1:
        raise DataError(f'a histogram needs at least one bin, got {bins}')
    mean, std = _mean_and_std(values)
    lowest, highest = workspace.extremes(values)
    if lowest == highest:
        raise DataError(f'all {values.size} samples are equal ({lowest:g}): no histogram')
    low, high = max(lowest, mean - 10 * std), min(highest, mean + 10 * std)
    if bins is None:
        spread = float(np.subtract(*np.quantile(values[: workspace.PART], (0.75, 0.25))))
        width = 2.0 * (spread or std) / values.size ** (1 / 3)
        bins = int(np.clip(math.ceil((high - low) / width), 1, MOST_BINS))
    edges = _edges(low, high, bins, resolution(values), values[0])
    count = np.zeros(edges.size - 1, dtype=np.int64)
    below = above = 0
    bounds: tuple[Any, ...] = (edges,)
    if np.all(edges[1:] > edges[:-1]):
        bounds = (count.size, (edges[0], edges[-1]))  # the same edges, without a search in them
    for piece in workspace.parts(values.size):
        part = values[piece]
        count += np.histogram(part, *bounds)[0]
        below += int(np.count_nonzero(part < edges[0])) if lowest < edges[0] else 0
        above += int(np.count_nonzero(part > edges[-1])) if highest > edges[-1] else 0
    expected = values.size * np.diff(scipy.special.ndtr((edges - mean) / std))
    return Histogram(edges, count, np.asarray(expected, np.float64), unit, below, above)


def _mean_and_std(values: Floats) -> tuple[float, float]:
    """Return mean and standard deviation without a copy of the values."""
    mean = sum(float(values[part].sum()) for part in workspace.parts(values.size)) / values.size
    squares = 0.0
    for part in workspace.parts(values.size):
        off = values[part] - mean
        squares += float(off @ off)
    return mean, math.sqrt(squares / (values.size - 1))


def _edges(low: float, high: float, bins: int, step: float, code: float) -> Floats:
    """Return edges of equal bins; of whole codes, between codes, if the data are quantised."""
    if step == 0.0 or (high - low) / bins > 50 * step:
        margin = 1e-9 * (high - low)
        return np.linspace(low - margin, high + margin, bins + 1)
    width = step * max(1, round((high - low) / bins / step))
    first = code + (math.floor((low - code) / step + 0.5) - 0.5) * step
    return np.asarray(first + width * np.arange(math.ceil((high - first) / width) + 1))


def normality(data: npt.ArrayLike, confidence: float = CONFIDENCE) -> Normality:
    """
    Return how far noise is from normal.

    Parameters
    ----------
    data : array_like, shape (n,)
        Samples that are not finite are left out.
    confidence : float
        Level of the intervals; the verdict takes a departure for certain at this level.

    Notes
    -----
    Intervals come from the scatter of 64 successive blocks, so that correlated
    samples do not count as independent ones.  The p value adds the squares of
    skewness and kurtosis over their standard errors, chi-squared with two
    degrees of freedom (as C. M. Jarque and A. K. Bera 1987, Int. Stat. Rev.
    55:163, whose errors hold for independent samples; they are the lower limit here).
    The distance is taken between the codes of quantised data.

    Raises
    ------
    DataError
        If there are fewer than `FEWEST_SAMPLES` finite samples, or all are equal.

    Examples
    --------
    >>> normality(np.random.default_rng(1).normal(size=20_000)).verdict
    'normal'
    >>> normality(np.random.default_rng(1).uniform(size=20_000)).verdict
    'not normal'
    """
    values = _finite(data)
    if values.size < FEWEST_SAMPLES:
        raise DataError(
            f'{values.size} samples cannot show whether noise is normal; '
            f'{FEWEST_SAMPLES} are the least'
        )
    mean, std = float(values.mean()), float(values.std(ddof=1))
    if std == 0.0:
        raise DataError(f'all {values.size} samples are equal ({mean:g}): no distribution')
    blocks = min(BLOCKS, values.size // 16) or 1
    edges = np.linspace(0, values.size, blocks + 1).astype(np.int64)
    grid = _fine_edges(values, mean, std)
    z = (values - mean) / std
    places, square = _places(grid, z), z * z
    tail = int(np.count_nonzero(square > 9.0))
    powers, counts = np.empty((4, blocks)), np.zeros((blocks, grid.size + 1))
    for block in range(blocks):
        part = slice(edges[block], edges[block + 1])
        first, second = z[part], square[part]
        every = first, second, second * first, second**2
        # what mean() does, at a third of its price for so few numbers
        powers[:, block] = [np.add.reduce(power) / power.size for power in every]
        counts[block] = np.bincount(places[part], minlength=grid.size + 1)
    skewness, kurtosis = _shape(powers, np.diff(edges), confidence)
    distance = _distance(counts, grid, confidence)
    reach = float(scipy.special.ndtri(0.5 + confidence / 2))
    chi2 = sum((0.0 if e.value is None else e.value / _error(e, reach)) ** 2
               for e in (skewness, kurtosis))  # fmt: skip
    p_value = math.exp(-0.5 * chi2)
    return Normality(
        _verdict(distance, p_value, confidence), distance, skewness, kurtosis,
        p_value, tail / values.size,
    )  # fmt: skip


def _error(estimate: Estimate, reach: float) -> float:
    return ((estimate.high or 0.0) - (estimate.low or 0.0)) / 2.0 / reach


def _fine_edges(values: Floats, mean: float, std: float) -> Floats:
    """Return where the distribution functions are compared, in standard deviations."""
    step = resolution(values) / std
    if step == 0.0 or step < 12.0 / _FINE:
        return np.linspace(-6.0, 6.0, _FINE)
    first = (values[0] - mean) / std
    start = first + (math.floor((-6.0 - first) / step) + 0.5) * step
    return np.asarray(np.arange(start, 6.0 + step, step))


def _places(grid: Floats, values: Floats) -> Integers:
    """Return what np.searchsorted does, for a grid of equal steps, and much faster."""
    if grid.size < 2:
        return np.searchsorted(grid, values)
    step = (grid[-1] - grid[0]) / (grid.size - 1)
    guess = np.ceil((values - grid[0]) / step)
    place: Integers = np.clip(guess, 0, grid.size).astype(np.int64)
    # rounding may have put a value on the wrong side of the edge next to it
    place -= (place > 0) & (grid[np.maximum(place - 1, 0)] >= values)
    place += (place < grid.size) & (grid[np.minimum(place, grid.size - 1)] < values)
    return place


def _shape(powers: Floats, sizes: Integers, confidence: float) -> tuple[Estimate, Estimate]:
    """Return skewness and excess kurtosis with errors from the scatter of the blocks."""
    total = int(sizes.sum())
    m1, m2, m3, m4 = powers @ sizes / total
    variance = m2 - m1 * m1
    skewness = float((m3 - 3 * m1 * m2 + 2 * m1**3) / variance**1.5)
    kurtosis = float((m4 - 4 * m1 * m3 + 6 * m1**2 * m2 - 3 * m1**4) / variance**2 - 3.0)
    # what a block adds to each: the influence of its moments (delta method)
    on_skewness = powers[2] - 3 * powers[0] - 1.5 * skewness * (powers[1] - 1)
    on_kurtosis = powers[3] - 4 * m3 * powers[0] - 2 * (kurtosis + 3) * (powers[1] - 1)
    reach = float(scipy.special.ndtri(0.5 + confidence / 2))
    result = []
    for value, influence, floor in (
        (skewness, on_skewness, 6.0),
        (kurtosis, on_kurtosis, 24.0),
    ):
        error = math.sqrt(floor / total)
        if influence.size >= FEWEST_BLOCKS:
            error = max(error, error_of_mean(influence)[0])
        half = reach * error
        result.append(Estimate(value, value - half, value + half, '1', confidence))
    return result[0], result[1]


def _distance(counts: Floats, grid: Floats, confidence: float) -> Estimate:
    """Return Kolmogorov's D; how far the blocks differ says how many samples count."""
    total = counts.sum()
    cumulative = np.cumsum(counts.sum(axis=0))[:-1] / total
    off = np.abs(cumulative - scipy.special.ndtr(grid))
    value = float(off.max())
    sizes = counts.sum(axis=1)
    error = 0.5 / math.sqrt(total)  # of the share of independent samples below the median
    if sizes.size >= FEWEST_BLOCKS:
        own = np.cumsum(counts, axis=1)[:, :-1] / sizes[:, None]
        levels = np.searchsorted(cumulative, np.linspace(0.1, 0.9, 9))
        error = max(error, *(error_of_mean(own[:, level])[0] for level in levels))
    quantile = float(np.interp(confidence, (0.80, 0.85, 0.90, 0.95, 0.99), LILLIEFORS))
    reach = quantile * 2.0 * error
    return Estimate(value, max(value - reach, 0.0), min(value + reach, 1.0), '1', confidence)


def _verdict(distance: Estimate, p_value: float, confidence: float) -> str:
    low, high = distance.low or 0.0, distance.high or 0.0
    if low > TOLERANCE:
        return 'not normal'
    departs = p_value < 1.0 - confidence or low > 0.0
    if high <= TOLERANCE:
        return 'practically normal' if departs else 'normal'
    if departs and (distance.value or 0.0) > TOLERANCE:
        return 'not normal'
    return (
        'practically normal'
        if departs and (distance.value or 0.0) < TOLERANCE / 2
        else 'undecided'
    )
