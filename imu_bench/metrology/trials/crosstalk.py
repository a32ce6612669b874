# SPDX-License-Identifier: Apache-2.0
"""
What a vibration along one axis does to the others, and whether it left a trace.

Capriglione et al. 2021, Performance analysis of MEMS-based inertial measurement units in
terrestrial vehicles, section IV: rejection ratio RR, spurious response ratio SR, and the
comparison of the quiet zones before and after.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

from imu_bench.errors import DataError
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
from imu_bench.metrology.moments import error_of_mean
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]

COVERAGE = 2.0
"""Coverage factor of the expanded uncertainty of a difference: JCGM 100:2008, 6.3.3."""

BLOCKS = 64
_DECIBEL = 10.0 / math.log(10.0)


def mean_squares(data: npt.ArrayLike, zero: float = 0.0, blocks: int = BLOCKS) -> Floats:
    """
    Return the mean square about `zero` of successive blocks of equal length.

    Parameters
    ----------
    zero : float
        What the sensor shows without vibration.
    blocks : int
        At most so many; samples that fill no block are left out at the end.

    Raises
    ------
    DataError
        If there are fewer than two samples.

    Examples
    --------
    >>> mean_squares([1.0, -1.0, 3.0, -3.0], blocks=2).tolist()
    [1.0, 9.0]
    """
    values = np.asarray(data, dtype=np.float64)
    if values.ndim != 1 or values.size < 2:
        raise DataError(f'mean squares need two samples or more, got {values.shape}')
    count = min(blocks, values.size)
    size = values.size // count
    off = values[: count * size].reshape(count, size) - zero
    return np.asarray(np.einsum('ij,ij->i', off, off) / size, np.float64)


def ratio_db(
    numerator: Floats, denominator: Floats, *, paired: bool, confidence: float = CONFIDENCE
) -> Estimate:
    """
    Return 20 log10 of the ratio of two RMS values in dB, with its sign.

    Parameters
    ----------
    numerator, denominator : ndarray, shape (k,)
        Mean squares of successive blocks, as `mean_squares` returns them.
    paired : bool
        Whether block k of both is the same time; what both have in common then cancels.
    confidence : float
        Level of the interval.

    Returns
    -------
    Estimate
        Not observable if one of them is zero.

    Examples
    --------
    >>> ratio_db(np.full(8, 4.0), np.full(8, 1.0), paired=True).value.__round__(2)
    6.02
    """
    top, bottom = float(numerator.mean()), float(denominator.mean())
    if top <= 0.0 or bottom <= 0.0:
        return Estimate.not_observable(
            'dB', 'an axis shows nothing at all, not even noise', confidence=confidence
        )
    if paired and numerator.size == denominator.size:
        error, freedom = error_of_mean(numerator / top - denominator / bottom)
    else:
        first, freedom = error_of_mean(numerator / top)
        second, others = error_of_mean(denominator / bottom)
        error, freedom = math.hypot(first, second), min(freedom, others)
    value = _DECIBEL * math.log(top / bottom)
    half = _DECIBEL * error * float(scipy.special.stdtrit(max(freedom, 1.0), 0.5 + confidence / 2))
    return Estimate(value, value - half, value + half, 'dB', confidence, method='RMS of blocks')


def magnitude(level: Estimate) -> Estimate:
    """
    Return the magnitude of a level in dB.

    Equations (1) and (2) of Capriglione et al. 2021 take it: RR = |20 log10(RMS_i,TZ /
    RMS_j,TZ)| with i the axis that is not excited and j the excited one, and SR = |20
    log10(RMS_i,TZ / RMS_i,BZ)| of test zone and zone before (printed RZ in the equation).

    Examples
    --------
    >>> magnitude(Estimate(-22.3, -22.5, -22.1, 'dB')).value
    22.3
    """
    if level.value is None or level.low is None or level.high is None:
        return level
    ends = sorted((abs(level.low), abs(level.high)))
    low = 0.0 if level.low < 0.0 < level.high else ends[0]
    return Estimate(
        abs(level.value), low, ends[1], level.unit, level.confidence, method=level.method
    )


@dataclass(frozen=True)
class Repeated:
    """One quantity over the repetitions of a test."""

    count: int  # repetitions with a value
    mean: Estimate  # mean of the repetitions with the interval of Student's t
    spread: Estimate  # standard deviation of a repetition


def repeated(values: Sequence[Estimate], confidence: float = CONFIDENCE) -> Repeated:
    """
    Return mean and spread over repetitions; one repetition keeps its own interval.

    Raises
    ------
    DataError
        If there is no estimate.

    Examples
    --------
    >>> run = [Estimate(v, None, None, 'dB') for v in (22.3, 22.4, 22.2, 22.3, 22.4)]
    >>> found = repeated(run)
    >>> round(found.mean.value, 2), round(found.spread.value, 3)
    (22.32, 0.084)
    """
    if not values:
        raise DataError('no repetition: nothing to average')
    unit = values[0].unit
    known = np.array([value.value for value in values if value.value is not None], np.float64)
    if known.size == 0:
        return Repeated(0, values[0], Estimate.not_observable(unit, values[0].reason))
    if known.size == 1:
        only = next(value for value in values if value.value is not None)
        reason = 'one repetition has no spread; record five'
        return Repeated(1, only, Estimate.not_observable(unit, reason, confidence=confidence))
    mean, spread = float(known.mean()), float(known.std(ddof=1))
    freedom, tail = known.size - 1, 0.5 * (1.0 - confidence)
    half = spread / math.sqrt(known.size) * float(scipy.special.stdtrit(freedom, 1.0 - tail))
    reach = [
        spread * math.sqrt(freedom / float(scipy.special.chdtri(freedom, p)))
        for p in (tail, 1.0 - tail)
    ]
    return Repeated(
        int(known.size),
        Estimate(mean, mean - half, mean + half, unit, confidence, method='repetitions'),
        Estimate(spread, reach[0], reach[1], unit, confidence, method='repetitions'),
    )


@dataclass(frozen=True)
class Compatibility:
    """Two readings of the same thing, before and after."""

    difference: float  # after less before
    uncertainty: float  # expanded uncertainty of the difference
    ratio: float  # size of the difference over it
    compatible: bool  # whether the ratio is at most one


def compatibility(
    before: tuple[float, float], after: tuple[float, float], coverage: float = COVERAGE
) -> Compatibility:
    """
    Return whether two values with their standard uncertainties are compatible.

    Metrological compatibility, JCGM 200:2012 (VIM), 2.47: the difference is smaller than a
    chosen multiple of its standard uncertainty, here the root sum square of both.

    Parameters
    ----------
    before, after : (float, float)
        Value and standard uncertainty.
    coverage : float
        The multiple.

    Raises
    ------
    DataError
        If an uncertainty is negative, or both are zero while the values differ.

    Examples
    --------
    >>> found = compatibility((-0.0002, 0.0144), (-0.0005, 0.0139))
    >>> found.compatible, round(found.ratio, 4)
    (True, 0.0075)
    """
    if before[1] < 0.0 or after[1] < 0.0:
        raise DataError('a standard uncertainty is not negative')
    difference = after[0] - before[0]
    uncertainty = coverage * math.hypot(before[1], after[1])
    if uncertainty == 0.0:
        if difference != 0.0:
            raise DataError('two values without uncertainty cannot be compared')
        return Compatibility(0.0, 0.0, 0.0, True)
    ratio = abs(difference) / uncertainty
    return Compatibility(difference, uncertainty, ratio, ratio <= 1.0)
