# SPDX-License-Identifier: Apache-2.0
"""
Which power law S_y(f) ~ f^alpha dominates at an averaging time.

Four ways, each where it is the surest, from many averages to few:

1. With 256 averages and more, the lag-1 autocorrelation of the d-th differences of the
   phase taken at the averaging time (W. J. Riley and C. A. Greenhall, "Power law noise
   identification using the lag 1 autocorrelation", 18th EFTF, 2004).  Their conversion of
   the autocorrelation to alpha holds for noise sampled at its own rate; averages of flicker
   noise come out near alpha = -1.44 with it.  Here the boundaries between integers move
   with the averaging factor from their formula to the autocorrelation of averages in
   continuous time (Greenhall and Riley 2003, equation (9)).  Differences are taken from
   all offsets, not only from every m-th point.
2. With fewer, the slope of the variance over the two octaves that end at the averaging
   time, which hold four times more averages.  In a sum of power laws the noise gets redder
   with tau, so a slope that says whiter than what way 1 found at the longest averages it
   has is taken for chance: those are the points that came out low, and fewer degrees of
   freedom are the safe side for them.
3. With fewer and no room for two octaves (m < 4), the ratio B1 of the standard variance to
   the Allan variance (NIST SP 1065, 2008, section 5.5.2).
4. With fewer than ten averages, the noise at the longest averages of which there are ten.

White and flicker phase noise share a slope; R(n), the ratio of modified and plain variance
(NIST SP 1065, section 5.5.2), tells them apart.  No drift is removed: a ramp of the rate
looks like alpha = -3, which has its slope.

What is found at one averaging time does not depend on which others are asked for.
"""

from __future__ import annotations

from bisect import bisect_right
from functools import lru_cache
from itertools import pairwise
import math

from imu_bench.metrology import workspace
from imu_bench.metrology.deviations.allan_kernels import modified_sums, second_difference_sums
from imu_bench.metrology.deviations.greenhall import covariance
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

MANY = 256
"""Averages from which the lag-1 autocorrelation decides."""

FEW = 10
"""Averages below which the noise at fewer, longer ones is taken over."""

_STARTS = 2048
"""
Differences looked at per averaging time: r1 scatters by (1 - r1²)/√2048, and alpha by 0.13 for
white noise, 0.09 for flicker noise.
"""

_BOUND = 10.0
"""Median sizes of a difference beyond which it is cut off: 6.7 σ, one normal one in 10¹¹."""

_PHASE_SLOPE = -1.5
"""Exponent of the variance between those of phase noise, -2, and of white noise, -1."""

_STRETCH = 1 << 16
"""Points of the phase that R(n) looks at, if m allows."""


def identify(
    phase: Floats, m: Integers, runs: Integers | None = None, differences: int = 2
) -> Integers:
    """
    Return the power-law exponent alpha of the rate at each averaging factor.

    Parameters
    ----------
    phase : ndarray of float64, shape (n + 1,)
        Cumulative sum of the rate; its origin and a linear part change nothing.
    m : ndarray of int64, shape (k,)
        Averaging factors in increasing order.
    runs : ndarray of int64, shape (r, 2), optional
        First and one past the last point of `phase` of every run without a gap.
    differences : int
        2 for the Allan members (alpha from 2 to -3), 3 for the Hadamard members (to -4).
    """
    if runs is None or (len(runs) == 1 and runs[0, 1] - runs[0, 0] == phase.size):
        return identify_within(_whole(phase.size), phase, m, differences)
    return identify_within(Stretches(runs), phase, m, differences)


def identify_within(
    stretches: Stretches, phase: Floats, m: Integers, differences: int = 2
) -> Integers:
    """Return what `identify` does; axes that share their gaps share the stretches."""
    search = _Search(phase, stretches, differences)
    return np.array([search.at(factor) or 0 for factor in m.tolist()], np.int64)


class Stretches:
    """The runs of a phase, and from which of their points differences are taken."""

    def __init__(self, runs: Integers) -> None:
        self._runs = runs
        self._lengths = runs[:, 1] - runs[:, 0]
        self._averages: dict[int, int] = {}
        self._starts: dict[int, Integers] = {}
        self._longest_with: dict[int, int] = {}

    def averages(self, m: int) -> int:
        """Return the number of complete averages over m samples."""
        if m not in self._averages:
            self._averages[m] = int(((self._lengths - 1) // m).sum())
        return self._averages[m]

    def longest_with(self, least: int) -> int:
        """Return the largest averaging factor with at least so many averages, 0 if none."""
        if least not in self._longest_with:
            factors = range(1, int(self._lengths.max()) + 1)
            found = bisect_right(factors, -least, key=lambda m: -self.averages(m))
            self._longest_with[least] = found
        return self._longest_with[least]

    def starts(self, reach: int) -> Integers:
        """Return up to `_STARTS` points, evenly spread, from which a run goes on for `reach`."""
        if reach not in self._starts:
            room = np.maximum(self._lengths - reach, 0)
            ends = np.cumsum(room)
            total = int(ends[-1])
            count = min(total, _STARTS)
            position = np.arange(count) * total // max(count, 1)
            run = np.searchsorted(ends, position, side='right')
            found = self._runs[run, 0] + position - (ends - room)[run]
            self._starts[reach] = np.asarray(found, np.int64)
        return self._starts[reach]

    def longest(self) -> tuple[int, int]:
        """Return first and one past the last point of the longest run."""
        first, last = self._runs[np.argmax(self._lengths)].tolist()
        return first, last


@lru_cache(maxsize=2)
def _whole(size: int) -> Stretches:
    """Return the one run of a phase without gaps: axes and windows are often equally long."""
    return Stretches(np.array([[0, size]], np.int64))


class _Search:
    """Identifies the noise at one averaging factor after the other, looking at surer ones."""

    def __init__(self, phase: Floats, stretches: Stretches, differences: int) -> None:
        self._phase = phase
        self._stretches = stretches
        self._differences = differences
        self._anchors: dict[int, int | None] = {}
        self._variances: dict[int, float | None] = {}

    def at(self, factor: int) -> int | None:
        """Return the noise at an averaging factor; None if there is none at all."""
        phase, stretches = self._phase, self._stretches
        averages = stretches.averages(factor)
        if averages < FEW:
            found = self._anchor(FEW)
            return 0 if found is not None and found > 0 and self._too_flat(factor) else found
        if averages >= MANY:
            found = _by_autocorrelation(phase, factor, stretches, self._differences)
        else:
            if factor >= 4:
                found = self._by_slope(factor)
            else:
                found = _by_b1(phase, factor, stretches, self._differences)
            surer = self._anchor(MANY)
            if found is not None and surer is not None:
                found = min(found, surer)
        if found == 2 and self._too_flat(factor):
            return 0
        return _phase_noise(phase, factor, stretches) if found == 2 else found

    def _too_flat(self, factor: int) -> bool:
        """Return whether the deviation falls too slowly here for phase noise."""
        # Shorter averages may still show it; its interval, of as many degrees of freedom as
        # samples, would be far too narrow.
        if factor < 4:
            return False
        slopes = (self._slope(factor // part, factor) for part in (2, 4))
        return any(slope is not None and slope > _PHASE_SLOPE for slope in slopes)

    def _anchor(self, least: int) -> int | None:
        """Return the noise at the longest averages of which there are at least so many."""
        if least not in self._anchors:
            longest = self._stretches.longest_with(least)
            self._anchors[least] = self.at(longest) if longest else None
        return self._anchors[least]

    def _by_slope(self, m: int) -> int | None:
        slope = self._slope(m // 4, m)
        if slope is None:
            return None
        # the variance goes with tau^mu, mu = -alpha - 1 down to mu = -2 for phase noise
        return 2 if slope < _PHASE_SLOPE else max(-round(slope) - 1, -1 - self._differences)

    def _slope(self, short: int, long: int) -> float | None:
        """Return the exponent of the variance between two averaging factors; None if too few."""
        first, last = self._variance(short), self._variance(long)
        if not first or not last:
            return None
        return math.log(last / first) / math.log(long / short)

    def _variance(self, m: int) -> float | None:
        """Return the mean square of some differences over m; None if there are too few."""
        if m not in self._variances:
            starts = self._stretches.starts(self._differences * m)
            self._variances[m] = None
            if starts.size >= FEW:
                (steps,) = _bounded(_steps(self._phase, m, self._differences, starts, 1))
                self._variances[m] = float(steps @ steps) / starts.size / m**2
        return self._variances[m]


def _steps(phase: Floats, m: int, d: int, starts: Integers, count: int) -> list[Floats]:
    """Return the d-th differences from some points, and from the points m, 2m, ... later."""
    points = [phase[k * m :].take(starts) for k in range(d + count)]
    for _ in range(d):
        points = [after - before for before, after in pairwise(points)]
    return points


def _bounded(differences: list[Floats]) -> list[Floats]:
    """Return differences cut off where no noise gets: one bad sample must not decide."""
    sizes = np.abs(differences[0])
    largest = max(float(np.abs(steps).max()) for steps in differences)
    # where most are larger than that their median is, too, and nothing is cut off
    if 2 * np.count_nonzero(sizes >= 1.01 / _BOUND * largest) > sizes.size:
        return differences
    most = _BOUND * workspace.median(sizes)
    if most == 0.0:
        return differences
    return [np.minimum(np.maximum(steps, -most), most) for steps in differences]


def _by_autocorrelation(phase: Floats, m: int, stretches: Stretches, d: int) -> int | None:
    starts = stretches.starts((d + 1) * m)
    if starts.size < FEW:
        return None
    first, second = _bounded(_steps(phase, m, d, starts, 2))
    square = float(first @ first + second @ second) / 2.0
    if square == 0.0:
        return None
    r1 = float(first @ second) / square
    sampled, averaged = _autocorrelations(d)
    bounds = averaged + (sampled - averaged) / m**2
    # one step down in alpha for every boundary passed; 2 stands for both kinds of phase noise
    passed = int(np.searchsorted(bounds, r1))
    return 2 if passed == 0 else 1 - passed


def _by_b1(phase: Floats, m: int, stretches: Stretches, d: int) -> int | None:
    """Compare the variance of the averages of the longest run with their Allan variance."""
    first, last = stretches.longest()
    averages = np.diff(phase[first:last:m])
    n = averages.size
    if n < FEW:
        return None
    allan = float(np.mean(np.diff(averages) ** 2)) / 2.0
    if allan == 0.0:
        return None
    expected = [_b1(n, mu) for mu in range(-2, 3)]
    bounds = [math.sqrt(a * b) for a, b in pairwise(expected)]
    passed = int(np.searchsorted(bounds, float(np.var(averages, ddof=1)) / allan))
    return 2 if passed == 0 else 1 - passed


def _b1(n: int, mu: int) -> float:
    """Return the expected ratio B1 of n averages: NIST SP 1065 (2008), section 5.5.2."""
    if mu == 0:
        return n * math.log(n) / (2.0 * (n - 1) * math.log(2.0))
    return n * (1.0 - float(n) ** mu) / (2.0 * (n - 1) * (1.0 - 2.0**mu))


def _phase_noise(phase: Floats, m: int, stretches: Stretches) -> int:
    """Return 2 for white and 1 for flicker phase noise."""
    first, last = stretches.longest()
    stretch = phase[first : min(last, first + max(_STRETCH, 16 * m))]
    if m == 1:
        rate = np.diff(stretch)
        rate -= rate.mean()
        # fractional noise with alpha = 1.5 has r1 = -3/7 (Riley and Greenhall 2004)
        return 2 if float(rate[1:] @ rate[:-1]) < -3.0 / 7.0 * float(rate @ rate) else 1
    factor = np.array([m])
    whole = np.array([[0, stretch.size]])
    modified, modified_terms = modified_sums(stretch, factor, whole)
    plain, terms = second_difference_sums(stretch, factor, whole)
    if not modified_terms[0]:
        return 2
    ratio = float(modified[0] / modified_terms[0] / (plain[0] / terms[0]))
    origin = np.zeros(1)
    flicker = covariance(origin, 1.0, 1, 2) / covariance(origin, float(m), 1, 2)
    return 2 if ratio < math.sqrt(float(flicker[0]) / m) else 1


@lru_cache
def _autocorrelations(d: int) -> tuple[Floats, Floats]:
    """Return the lag-1 autocorrelation of d-th differences for alpha = 1/2, -1/2, ..."""
    # First for noise at its own rate, r1 = delta / (1 - delta) with delta = -alpha/2 - (d - 1)
    # (Riley and Greenhall 2004), then for long averages of it, from the covariance of
    # integrated noise |t|^(1 - alpha).
    alphas = 0.5 - np.arange(d + 2)
    delta = -alphas / 2.0 - (d - 1)
    orders = np.arange(-d, d + 1)
    signs = np.array([(-1.0) ** k * math.comb(2 * d, d + k) for k in orders.tolist()])
    powers = 1.0 - alphas[:, None]
    averaged = (np.abs(1 + orders) ** powers @ signs) / (np.abs(orders) ** powers @ signs)
    return delta / (1.0 - delta), averaged
