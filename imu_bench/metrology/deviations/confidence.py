# SPDX-License-Identifier: Apache-2.0
"""How far a deviation can be trusted: equivalent degrees of freedom, and intervals."""

from __future__ import annotations

import math
from typing import NamedTuple

from imu_bench.errors import DataError
from imu_bench.metrology.deviations.greenhall import inverse_edf
from imu_bench.metrology.estimate import check_confidence
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

_TOTAL = {0: (1.50, 0.0), -1: (1.17, 0.22), -2: (0.93, 0.36)}
"""(b, c) of edf = b T/tau - c for the total variance: NIST SP 1065 (2008), table 7."""

_RUN_LENGTHS = 32
"""Different run lengths that are told apart; more are put into groups of equal number."""


class Differences(NamedTuple):
    """What the degrees of freedom depend on: differences taken, overlap, phase averaging."""

    d: int
    overlapping: bool = True
    modified: bool = False
    total: bool = False

    def terms(self, m: int, points: int) -> int:
        """Return how many differences `points` of the phase hold; below 1 if none."""
        if self.total:
            return points - 2 if points > m + 1 else 0
        if self.modified:
            return points - (self.d + 1) * m + 1
        if self.overlapping:
            return points - self.d * m
        return (points - 1) // m - self.d + 1


DIFFERENCES = {
    'adev': Differences(2, overlapping=False),
    'oadev': Differences(2),
    'mdev': Differences(2, modified=True),
    'tdev': Differences(2, modified=True),
    'hdev': Differences(3, overlapping=False),
    'ohdev': Differences(3),
    'totdev': Differences(2, total=True),
}


def edf(kind: str, alpha: npt.ArrayLike, m: npt.ArrayLike, n: npt.ArrayLike) -> Floats:
    """
    Return the equivalent degrees of freedom of a variance of the Allan family.

    Parameters
    ----------
    kind : str
        'adev', 'oadev', 'mdev', 'tdev', 'hdev', 'ohdev' or 'totdev'.
    alpha : array_like of float
        Power-law exponent of the rate PSD, 2 to -4; the members with two differences know
        nothing below -2 and take lower values for -2.  Between integers the logarithm of
        the edf is interpolated.
    m, n : array_like of int
        Averaging factor, and samples of the rate without a gap (phase points less one).
        All three broadcast.

    Notes
    -----
    Greenhall and Riley (2003), see `imu_bench.metrology.deviations.greenhall`.  The total
    deviation takes table 7 of NIST SP 1065 (2008), and its row for white noise, which is on
    the safe side, for alpha above 0.
    """
    differences = _known(kind)
    exponents, factors, samples = np.broadcast_arrays(
        np.asarray(alpha, np.float64), np.asarray(m, np.int64), np.asarray(n, np.int64)
    )
    exponents = np.clip(exponents, -2.0 if differences.d == 2 else -4.0, 2.0)
    lower = np.floor(exponents).astype(np.int64)
    values = [
        _between(kind, a, e - a, factor, count)
        for a, e, factor, count in zip(
            lower.flat, exponents.flat, factors.flat, samples.flat, strict=True
        )
    ]
    return np.array(values).reshape(factors.shape)


def edf_of_runs(kind: str, alpha: npt.ArrayLike, m: Integers, lengths: Integers) -> Floats:
    """
    Return the degrees of freedom of estimates pooled over runs between gaps.

    Runs count as independent: the variance of a mean of M_r terms each with edf_r is that
    of a chi-squared variable with (sum M_r)^2 / sum(M_r^2 / edf_r) degrees of freedom.
    """
    differences = _known(kind)
    exponents = np.broadcast_to(np.asarray(alpha), m.shape)
    if lengths.size == 1:
        return edf(kind, exponents, m, lengths)
    result = np.empty(m.size)
    ordered = np.sort(lengths)
    every = np.unique(ordered)
    for index, (exponent, factor) in enumerate(zip(exponents.tolist(), m.tolist(), strict=True)):
        least = next(n for n in every.tolist() if differences.terms(factor, n + 1) > 0)
        groups, counts = _grouped(ordered[np.searchsorted(ordered, least) :])
        terms = np.array([differences.terms(factor, n + 1) for n in groups.tolist()], np.float64)
        each = edf(kind, exponent, factor, groups)
        result[index] = (counts @ terms) ** 2 / (counts @ (terms**2 / each))
    return result


def interval(
    deviation: npt.ArrayLike, degrees: npt.ArrayLike, confidence: float
) -> tuple[Floats, Floats]:
    """
    Return the two-sided chi-squared interval of a deviation.

    NIST SP 1065 (2008), equation (45).
    """
    check_confidence(confidence)
    value = np.asarray(deviation, np.float64)
    half = np.asarray(degrees, np.float64) / 2.0
    tail = (1.0 - confidence) / 2.0
    # a chi-squared quantile is twice the inverse of the incomplete gamma function
    low = value * np.sqrt(half / scipy.special.gammainccinv(half, tail))
    high = value * np.sqrt(half / scipy.special.gammaincinv(half, tail))
    return low, high


def simple_interval(
    deviation: npt.ArrayLike, m: npt.ArrayLike, samples: int, confidence: float
) -> tuple[Floats, Floats]:
    """
    Return the interval from the relative error 1/sqrt(2 (N/K - 1)): N samples, K averaged.

    It knows neither overlap nor noise type and exists for comparison.  The error is one
    standard deviation; other confidence levels scale it as in a normal distribution.

    IEEE Std 952-1997 annex C; used in both theses the bench grew from.
    """
    check_confidence(confidence)
    value = np.asarray(deviation, np.float64)
    clusters = samples / np.asarray(m, np.float64)
    if np.any(clusters <= 1.0):
        raise DataError('the simple interval needs more samples than one average takes')
    error = scipy.special.ndtri(0.5 + confidence / 2.0) / np.sqrt(2.0 * (clusters - 1.0))
    return value * np.maximum(1.0 - error, 0.0), value * (1.0 + error)


def _known(kind: str) -> Differences:
    if kind not in DIFFERENCES:
        raise DataError(f'unknown deviation {kind!r}; known are {", ".join(DIFFERENCES)}')
    return DIFFERENCES[kind]


def _between(kind: str, lower: int, part: float, m: int, n: int) -> float:
    below = _edf(kind, int(lower), int(m), int(n))
    if part == 0.0:
        return below
    above = _edf(kind, int(lower) + 1, int(m), int(n))
    return math.exp((1.0 - part) * math.log(below) + part * math.log(above))


def _edf(kind: str, alpha: int, m: int, n: int) -> float:
    differences = DIFFERENCES[kind]
    terms = differences.terms(m, n + 1)
    if terms < 1:
        raise DataError(f'{n} samples hold no {kind} difference at averaging factor {m}')
    if differences.total:
        b, c = _TOTAL[min(alpha, 0)]
        return min(max((b * n / m - c) * _short(min(alpha, 0), m), 1.0), float(terms))
    stride = m if differences.overlapping else 1
    inverse = inverse_edf(alpha, differences.d, m, terms, stride, differences.modified)
    return max(1.0 / inverse, 1.0)


def _short(alpha: int, m: int) -> float:
    """Return by how much short averages lower the degrees of freedom of the total variance."""
    # Its table holds for long averages; the factor is that of the overlapped Allan variance.
    periods = 16
    return _edf('oadev', alpha, m, periods * m) / _edf('oadev', alpha, 100, periods * 100)


def _grouped(lengths: Integers) -> tuple[Integers, Floats]:
    """Return ascending run lengths and how many runs have each; many go into few groups."""
    values, counts = np.unique(lengths, return_counts=True)
    if values.size > _RUN_LENGTHS:
        parts = np.array_split(lengths, _RUN_LENGTHS)
        values = np.array([part.mean() for part in parts]).astype(np.int64)
        counts = np.array([part.size for part in parts])
    return values.astype(np.int64), counts.astype(np.float64)
