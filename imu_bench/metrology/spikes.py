# SPDX-License-Identifier: Apache-2.0
"""Samples far off their neighbours: where they are, and how many come in a stream."""

from __future__ import annotations

from collections.abc import Iterator

from imu_bench.metrology import workspace
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

_NONE: Integers = np.empty(0, np.int64)

FAR = 10.0
"""
σ of a sample off the line between its neighbours, 8.2 of what this has itself: Gaussian noise gets
there once in 3·10¹⁵ samples.
"""

EQUAL = 0.25
"""Share of neighbours that are equal above which steps tell no noise: half make their median 0."""

_PIECE = 2**18
_MAD = 1.4826  # median absolute deviation to σ of a normal distribution
_BLOCK = 512
_BESIDE = 2  # neighbours on either side that have to agree
_LONGEST = 4  # samples from the first outlier of a burst to its last
_NEAR = np.arange(-6, 7)  # samples whose median a burst leaves alone
_REACH = _LONGEST + _BESIDE + int(_NEAR[-1])
_MANY = 0.1  # share of samples that stand out, above which none stands alone


def pieces(size: int, overlap: int) -> Iterator[tuple[int, int]]:
    """
    Yield [first, after last) of pieces of an array, each sharing `overlap` samples with the next.

    Examples
    --------
    >>> list(pieces(5, 1))
    [(0, 5)]
    """
    for first in range(0, max(size - overlap, 0), _PIECE):
        yield first, min(first + _PIECE + overlap, size)


def bent(values: Floats, threshold: float) -> Integers:
    """
    Return all positions that stand out of the line between their neighbours by a threshold.

    Examples
    --------
    >>> bent(np.array([0.0, 0.1, 9.0, 0.0, 0.1]), 4.0)
    array([1, 2, 3])
    """
    found = []
    for first, last in pieces(values.size, 2):
        found.append(np.flatnonzero(_bend(values[first:last]) > threshold) + first + 1)
    return np.concatenate(found) if found else _NONE


def _bend(part: Floats) -> Floats:
    """Return how far samples are off the line between their neighbours, shape (n - 2,)."""
    return np.asarray(np.abs(part[1:-1] - 0.5 * (part[2:] + part[:-2])))


def standing_out(values: Floats, tried: Integers, limit: float) -> Integers:
    """
    Return which of the `bent` samples stand out of the line between their neighbours by a limit.

    A single outlier also bends the lines of its neighbours by half; only the
    largest of such a group is returned.

    Examples
    --------
    >>> standing_out(np.array([0.0, 0.1, 9.0, 0.0, 0.1]), np.array([1, 2, 3]), 4.0)
    array([2])
    """
    around = values[np.clip(tried[:, None] + np.arange(-2, 3), 0, values.size - 1)]
    before, bend, after = (_bend(around[:, at : at + 3].T)[0] for at in range(3))
    # the first and the last sample of all have no line
    before[tried == 1], after[tried == values.size - 2] = 0.0, 0.0
    top: npt.NDArray[np.bool_] = (bend > limit) & ~(before > bend) & ~(after > bend)
    return tried[top]


def standing_alone(values: Floats, tried: Integers, limit: float) -> Integers:
    """
    Return the positions of samples a limit off their neighbours, alone or in a short burst.

    An outlier bends the lines of its neighbours by half, and of three in a row the middle is
    straight: they are looked for beside what is bent by half the limit.  Outliers within two
    samples of one another are one burst, of four samples at most.  The two samples before and the
    two behind it agree with one another: a shock rings on, and is no fault of single samples.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Samples.
    tried : ndarray of int64, shape (k,)
        `bent` by half of the limit.
    limit : float
        Distance from the median of thirteen samples; neighbours agree within half of it.

    Examples
    --------
    >>> values = np.zeros(200)
    >>> values[[20, 80, 82, 83]] = 9.0, 8.0, -8.0, 9.0
    >>> values[140:152] = 9.0 * np.cos(np.arange(12)) * 0.9 ** np.arange(12)
    >>> standing_alone(values, bent(values, 2.0), 4.0)
    array([20, 80, 82, 83])
    """
    if not 0 < tried.size <= _MANY * values.size + _LONGEST:
        return _NONE
    beside = np.arange(-_BESIDE, _BESIDE + 1)
    tried = np.unique(np.clip(tried[:, None] + beside, 0, values.size - 1))
    level = np.nanmedian(values[np.clip(tried[:, None] + _NEAR, 0, values.size - 1)], axis=1)
    far = tried[np.abs(values[tried] - level) > limit]
    starts = np.flatnonzero(np.diff(far, prepend=-_LONGEST) > _BESIDE)
    first, last = far[starts], far[np.append(starts[1:], far.size) - 1] if far.size else far
    around = np.concatenate([first[:, None] + beside[:2], last[:, None] + beside[3:]], axis=1)
    agree = np.ptp(values[np.clip(around, 0, values.size - 1)], axis=1) <= 0.5 * limit
    short = last - first < _LONGEST
    return np.asarray(far[np.repeat(agree & short, np.diff(starts, append=far.size))])


def neighbour_noise(steps: Floats) -> float:
    """
    Return the robust σ of samples whose steps from one to the next are given; 0 without any.

    Examples
    --------
    >>> round(neighbour_noise(np.diff(np.random.default_rng(1).normal(size=9000))), 2)
    1.0
    """
    known = steps[np.isfinite(steps)]
    return float(_MAD * workspace.median(np.abs(known)) / np.sqrt(2.0)) if known.size else 0.0


class SpikeCount:
    """
    Counts the single spikes of a stream, by their stamps.

    As `imu-bench analyze` finds them, but for the noise: here that of blocks of some 512 samples,
    there that of the recording.  Of an axis with coarse steps nothing is counted.

    Examples
    --------
    >>> rows = np.random.default_rng(1).normal(size=(2000, 2))
    >>> rows[700, 1] = 40.0
    >>> count = SpikeCount()
    >>> count.add(np.arange(2000), rows)
    >>> count.since(500), count.since(800)
    (1, 0)
    """

    def __init__(self) -> None:
        self._held: list[tuple[Integers, Floats]] = []
        self._found = _NONE

    def add(self, stamps: Integers, rows: Floats) -> None:
        """Take the next samples, rows of shape (n, axes) with NaN where there is no number."""
        self._held.append((stamps, rows))
        if sum(held.size for held, _ in self._held) < _BLOCK:
            return
        self._found = np.concatenate([self._found, self._waiting()])
        [(stamps, rows)] = self._held
        # those at the end wait for their neighbours
        self._held = [(stamps[-2 * _REACH :].copy(), rows[-2 * _REACH :].copy())]

    def since(self, stamp: int) -> int:
        """Return how many came at a stamp or later, and forget those before."""
        self._found = self._found[self._found >= stamp]
        return int(self._found.size + np.count_nonzero(self._waiting() >= stamp))

    def _waiting(self) -> Integers:
        """Return the stamps of spikes among the samples that are held."""
        if not self._held:
            return np.empty(0, np.int64)
        stamps = np.concatenate([held for held, _ in self._held])
        rows = np.concatenate([held for _, held in self._held])
        self._held = [(stamps, rows)]
        return np.concatenate([stamps[_judged(column)] for column in rows.T])


def _judged(column: Floats) -> Integers:
    """Return the positions of single spikes, but for the samples at either end."""
    steps = np.diff(column)
    limit = FAR * neighbour_noise(steps)
    if not limit > 0.0 or np.count_nonzero(steps == 0.0) > EQUAL * steps.size:
        return _NONE
    found = standing_alone(column, bent(column, 0.5 * limit), limit)
    return found[(found >= _REACH) & (found < column.size - _REACH)]
