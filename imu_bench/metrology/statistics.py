# SPDX-License-Identifier: Apache-2.0
"""Statistics of a still sensor: bias, noise, extremes, outliers, and how two sensors compare."""

from __future__ import annotations

from dataclasses import dataclass
import math

from imu_bench.errors import DataError
from imu_bench.metrology import workspace
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
from imu_bench.metrology.moments import Moments
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

MAD_TO_SIGMA = 1.482602218505602
"""
Standard deviation of a normal distribution over its median absolute deviation: 1 / ndtri(3/4).
"""

LISTED_OUTLIERS = 1000
"""Indices of the largest outliers are kept, up to this many; all are counted."""

_PART = 1 << 20
_ROBUST = 1 << 18
"""Samples that median and scale of long data come from: good to 0.3 % of the scale."""

_SAMPLE = 1 << 14


@dataclass(frozen=True, eq=False)
class Outliers:
    """Samples too far out to belong to the noise."""

    count: int
    indices: npt.NDArray[np.int64]  # where the `LISTED_OUTLIERS` largest are, in order
    threshold: float  # distance from `centre` beyond which a sample is an outlier
    # centre, scale: median, and standard deviation from the median absolute deviation
    centre: float
    scale: float


@dataclass(frozen=True, eq=False)
class Statistics:
    """Statistics of one axis at rest."""

    # samples, left_out: samples that went in; samples left out as not finite, or as outliers if
    # asked
    samples: int
    left_out: int
    # mean, std: bias, and standard deviation (n - 1)
    mean: Estimate
    std: Estimate
    # rms, rms_total: RMS about the mean, and about zero
    rms: Estimate
    rms_total: Estimate
    # minimum, maximum, peak, peak_to_peak: extremes of this record; `peak` is the largest distance
    # from the mean. They grow with the length of a record and carry no interval
    minimum: Estimate
    maximum: Estimate
    peak: Estimate
    peak_to_peak: Estimate
    three_sigma: Estimate  # three standard deviations
    freedom: float  # equivalent degrees of freedom of the variance
    outliers: Outliers


def describe(
    data: npt.ArrayLike,
    unit: str,
    confidence: float = CONFIDENCE,
    *,
    valid: npt.ArrayLike | None = None,
    drop_outliers: bool = False,
) -> Statistics:
    """
    Return the statistics of one axis.

    Parameters
    ----------
    unit : str
        Unit of the data.
    confidence : float
        Level of the intervals.
    valid : array_like of bool, shape (n,), optional
        False where the regular grid holds no sample.
    drop_outliers : bool
        Leave outliers out; they are counted and kept otherwise.

    Raises
    ------
    DataError
        If no finite sample is left, or the shapes disagree.

    Notes
    -----
    Intervals of mean, standard deviation and RMS hold for correlated noise, see
    `imu_bench.metrology.moments`; with fewer than 32 samples they assume
    independent ones.

    Examples
    --------
    >>> s = describe([9.7, 9.8, 9.9, 9.8], 'm/s²')
    >>> round(s.mean.value, 3), round(s.std.value, 4), round(s.peak_to_peak.value, 3)
    (9.8, 0.0816, 0.2)
    """
    values = _usable(data, valid)
    given = int(np.size(data)) if valid is None else int(np.count_nonzero(valid))
    found = outliers(values)
    if drop_outliers and found.count:
        values = values[np.abs(values - found.centre) <= found.threshold]
    moments = Moments.of(values[None, :])
    mean = moments.mean_estimate(0, unit, confidence)
    std = moments.std_estimate(0, unit, confidence)
    low, high = workspace.extremes(values)
    middle = float(moments.total_mean[0])

    def observed(value: float) -> Estimate:
        return Estimate(value, None, None, unit, confidence, method='observed')

    return Statistics(
        samples=int(values.size),
        left_out=given - int(values.size),
        mean=mean,
        std=std,
        rms=moments.rms_estimate(0, unit, confidence),
        rms_total=moments.total_rms_estimate(0, unit, confidence),
        minimum=observed(low),
        maximum=observed(high),
        peak=observed(max(high - middle, middle - low)),
        peak_to_peak=observed(high - low),
        three_sigma=std.scaled(3.0, unit),
        freedom=moments.freedom(0),
        outliers=found,
    )


def _usable(data: npt.ArrayLike, valid: npt.ArrayLike | None) -> Floats:
    values = np.asarray(data, dtype=np.float64)
    if values.ndim != 1:
        raise DataError(f'data must have shape (n,), got {values.shape}')
    if valid is not None:
        mask = np.asarray(valid, dtype=np.bool_)
        if mask.shape != values.shape:
            raise DataError(f'valid has shape {mask.shape}, the data {values.shape}')
        values = values if mask.all() else values[mask]
    if not workspace.all_finite(values):
        values = values[np.isfinite(values)]
    if values.size == 0:
        raise DataError('no finite samples: nothing to describe')
    return values


def resolution(data: npt.ArrayLike) -> float:
    """
    Return the step of quantised data; 0 if the data show none.

    Data are quantised where the values seen are a quarter of the samples or fewer, and 95 of
    100 distances of neighbouring values are multiples of the step to a tenth of it.

    Examples
    --------
    >>> resolution(np.round(np.sin(np.arange(1000.0)), 2)).__round__(6)
    0.01
    """
    values = np.asarray(data, dtype=np.float64)
    part = values[: 1 << 16]
    most = part.size // 4
    # a third of the samples shows as a rule that there are too many
    codes = np.unique(part[: most + most // 4])
    if codes.size <= most:
        codes = np.unique(part)
    if codes.size < 2 or codes.size > most:
        return 0.0
    steps = np.diff(codes)
    step = float(np.median(steps[steps < 1.5 * steps.min()]))
    if float(steps.max()) > 2.0**53 * step:
        return 0.0  # rounding, or a number that is almost zero
    # a float that went through text or another unit is off by rounding
    off = np.abs(steps / step - np.rint(steps / step))
    return step if float(np.mean(off < 0.1)) > 0.95 else 0.0


def _robust(values: Floats) -> tuple[float, float]:
    """Return centre and scale from the median, of a part of very long data."""
    part = values
    if values.size > _ROBUST:
        starts = np.linspace(0, values.size - _SAMPLE, _ROBUST // _SAMPLE).astype(np.int64)
        part = np.concatenate([values[start : start + _SAMPLE] for start in starts])
    centre = workspace.median(part)
    off = np.abs(part - centre)
    scale = MAD_TO_SIGMA * workspace.median(off)
    if scale == 0.0:  # more than half of the samples are equal
        scale = math.sqrt(math.pi / 2.0) * float(np.mean(off))
        step = resolution(part)
        scale = max(min(scale, step), step / math.sqrt(12.0)) if step else scale
    return centre, scale


def outliers(data: npt.ArrayLike) -> Outliers:
    """
    Return the samples too far from the median to belong to the noise.

    The distance is measured in standard deviations from the median absolute
    deviation (B. Iglewicz and D. C. Hoaglin 1993, "How to Detect and Handle Outliers",
    ASQC Basic References in Quality Control 16).  Their fixed limit of 3.5 would call
    five in ten thousand good samples outliers; here the limit grows with the number of
    samples, so that normal noise has one outlier in twenty records, whatever their length.
    """
    values = np.asarray(data, dtype=np.float64)
    if values.size == 0:
        raise DataError('no samples: no outliers to look for')
    centre, scale = _robust(values)
    limit = max(3.5, -float(scipy.special.ndtri(0.05 / 2.0 / values.size)))
    threshold = limit * scale
    chosen: list[npt.NDArray[np.int64]] = []
    for start in range(0, values.size, _PART):
        off = np.abs(values[start : start + _PART] - centre)
        chosen.append(np.flatnonzero(off > threshold) + start)
    found = np.concatenate(chosen)
    listed = found
    if found.size > LISTED_OUTLIERS:
        largest = np.argsort(-np.abs(values[found] - centre), kind='stable')[:LISTED_OUTLIERS]
        listed = np.sort(found[largest])
    return Outliers(int(found.size), listed, threshold, centre, scale)


def without_spikes(
    values: Floats, positions: npt.NDArray[np.int64], neighbours: int = 4
) -> Floats:
    """
    Return data with single samples in the place of which the median of their neighbours stands.

    That is what a Hampel filter does (R. K. Pearson, "Outliers in process modeling and
    identification", IEEE Trans. Control Syst. Technol. 10(1) (2002)).  Replacing a share p takes
    or adds at most p of the variance of white noise, p/2 of N, and leaves slow noise alone; a
    missing sample would break every long average that holds it.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Samples; NaN are no neighbours.
    positions : ndarray of int64, shape (k,)
        Where the spikes are.
    neighbours : int
        Samples on either side that the median is taken of.

    Examples
    --------
    >>> without_spikes(np.array([1.0, 2.0, 90.0, 2.0, 3.0]), np.array([2])).tolist()
    [1.0, 2.0, 2.0, 2.0, 3.0]
    """
    settled = workspace.empty(values.size, np.float64)
    settled[:] = values
    settled[positions] = np.nan
    reach = np.concatenate([np.arange(-neighbours, 0), np.arange(1, neighbours + 1)])
    near = np.clip(positions[:, None] + reach, 0, values.size - 1)
    beside = np.where(np.isnan(settled[near]).all(axis=1)[:, None], 0.0, settled[near])
    settled[positions] = np.nanmedian(beside, axis=1) if positions.size else settled[positions]
    return settled


def variance_ratio(
    numerator: Statistics, denominator: Statistics, confidence: float = CONFIDENCE
) -> Estimate:
    """
    Return the ratio of the variances of two sensors.

    The interval is that of the F distribution with the equivalent degrees of
    freedom of both; it assumes that the two records are independent.
    """
    if numerator.std.unit != denominator.std.unit:
        raise DataError(
            f'cannot compare a sensor in {numerator.std.unit} with one in {denominator.std.unit}'
        )
    if numerator.std.value is None or not denominator.std.value:
        raise DataError('a ratio needs two standard deviations, the second not zero')
    value = (numerator.std.value / denominator.std.value) ** 2
    tail = (1.0 - confidence) / 2.0
    first, second = numerator.freedom, denominator.freedom
    low = value / float(scipy.special.fdtri(first, second, 1.0 - tail))
    high = value * float(scipy.special.fdtri(second, first, 1.0 - tail))
    return Estimate(value, low, high, '1', confidence, method='F distribution')
