# SPDX-License-Identifier: Apache-2.0
"""Facts about the stored numbers of one axis, in one pass over pieces that fit the cache."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from imu_bench.metrology import workspace
from imu_bench.metrology.statistics import resolution
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_PIECE = 2**18
_LONG = 16  # samples; shorter runs of equal values are not kept
_DISTINCT = 2**16  # samples looked at for the resolution
_SHORT = 256  # samples; longer than the memory of a filter, shorter than a drift
_MAD = 1.4826


@dataclass(frozen=True)
class Numbers:
    """
    What the values of an axis look like, without regard to time.

    Attributes
    ----------
    lowest, highest : float
        Extremes.
    at_lowest, at_highest : int
        How often they occur.
    repeated : float
        Share of samples equal to the one before, between 0 and 1.
    longest : tuple of (int, int)
        Position and length of the longest run of equal values.
    frozen : tuple of (int, int)
        Position and length of every run that is too long to be chance.
    resolution : float or None
        Smallest step between values, if all values are multiples of one step.
    noise : float
        Robust σ of the difference of neighbours over √2: scatter without drift and outliers.
    scatter : float
        Median of σ within short pieces: scatter of noise that a filter makes alike in neighbours.
    """

    lowest: float
    highest: float
    at_lowest: int
    at_highest: int
    repeated: float
    longest: tuple[int, int]
    frozen: tuple[tuple[int, int], ...]
    resolution: float | None
    noise: float
    scatter: float


def examine(values: Floats) -> Numbers:
    """
    Return the facts about one axis.

    Parameters
    ----------
    values : ndarray, shape (n,), n >= 1
        The samples; NaN never equals anything and is never an extreme.

    Examples
    --------
    >>> facts = examine(np.array([1.0, 2.0, 2.0, 2.0, 1.0, 3.0]))
    >>> facts.longest, facts.repeated, facts.highest
    ((1, 3), 0.4, 3.0)
    """
    lowest, highest = workspace.extremes(values)
    equal, runs, longest = _equal_runs(values)
    repeated = equal / max(values.size - 1, 1)
    limit = _chance(values.size, repeated)
    return Numbers(
        lowest,
        highest,
        _occurrences(values, lowest),
        _occurrences(values, highest),
        repeated,
        longest,
        tuple(run for run in runs if run[1] > limit),
        _resolution(values),
        _noise(values),
        _scatter(values),
    )


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


def levels_inside(values: Floats, extreme: float, *, top: bool, levels: int = 3) -> int:
    """
    Return how often the commonest of the values next to an extreme occurs.

    One value alone is no measure: in the tail of a coarse signal it may be missing by chance.

    Examples
    --------
    >>> levels_inside(np.array([1.0, 2.0, 2.0, 3.0, 3.0, 3.0]), 3.0, top=True)
    2
    """
    most = 0
    for _ in range(levels):
        inside = -np.inf if top else np.inf
        for first, last in pieces(values.size, 0):
            part = values[first:last]
            if top:
                inside = np.max(part, initial=inside, where=part < extreme)
            else:
                inside = np.min(part, initial=inside, where=part > extreme)
        extreme = float(inside)
        most = max(most, _occurrences(values, extreme))
    return most


def _occurrences(values: Floats, value: float) -> int:
    return sum(
        int(np.count_nonzero(values[first:last] == value))
        for first, last in pieces(values.size, 0)
    )


def spikes(values: Floats, threshold: float) -> npt.NDArray[np.int64]:
    """
    Return the positions that stand out of the line between their neighbours by a threshold.

    A single outlier also bends the lines of its neighbours by half; only the
    largest of such a group is returned.

    Examples
    --------
    >>> spikes(np.array([0.0, 0.1, 9.0, 0.0, 0.1]), 4.0)
    array([2])
    """
    found = []
    for first, last in pieces(values.size, 2):
        part = values[first:last]
        bend = np.abs(part[1:-1] - 0.5 * (part[2:] + part[:-2]))
        hits = np.flatnonzero(bend > threshold)
        padded = np.concatenate(([0.0], bend, [0.0]))
        top = (bend[hits] >= padded[hits]) & (bend[hits] >= padded[hits + 2])
        found.append(hits[top] + first + 1)
    return np.concatenate(found) if found else np.empty(0, dtype=np.int64)


def repeated_rows(columns: Sequence[Floats]) -> int:
    """
    Return how many rows equal the row before in every column.

    Examples
    --------
    >>> repeated_rows([np.array([1.0, 1.0, 1.0]), np.array([2.0, 2.0, 3.0])])
    1
    """
    count = 0
    for first, last in pieces(columns[0].size, 1):
        parts = [column[first:last] for column in columns]
        same = np.logical_and.reduce([part[1:] == part[:-1] for part in parts])
        count += int(np.count_nonzero(same))
    return count


def _equal_runs(values: Floats) -> tuple[int, list[tuple[int, int]], tuple[int, int]]:
    """Return the number of repeats, the long runs of equal values, and the longest run."""
    equal, longest = 0, (0, 1)
    runs: list[tuple[int, int]] = []
    open_from: int | None = None  # a run that reaches the end of a piece goes on in the next
    for first, last in pieces(values.size, 1):
        part = values[first:last]
        same = part[1:] == part[:-1]
        equal += int(np.count_nonzero(same))
        edges = np.flatnonzero(np.diff(np.concatenate(([False], same, [False])).view(np.int8)))
        starts, ends = first + edges[::2], first + edges[1::2]
        if starts.size and starts[0] == first and open_from is not None:
            starts[0] = open_from
        open_from = int(starts[-1]) if ends.size and ends[-1] == last - 1 else None
        lengths = ends - starts + 1
        if lengths.size:
            best = int(np.argmax(lengths))
            longest = max(longest, (int(starts[best]), int(lengths[best])), key=lambda r: r[1])
        for index in np.flatnonzero(lengths >= _LONG):
            run = (int(starts[index]), int(lengths[index]))
            if runs and runs[-1][0] == run[0]:
                runs[-1] = run
            else:
                runs.append(run)
    return equal, runs, longest


def _chance(size: int, repeated: float) -> float:
    """
    Return a length of runs of equal values that chance does not reach.

    For independent repeats of probability p the longest of n has about
    ln(n (1 − p)) / −ln p samples (Schilling 1990, College Math. J. 21:196); three times that
    allows for noise that is not white.
    """
    if repeated >= 1.0:
        return 0.0
    if repeated <= 0.0:
        return _LONG
    expected = np.log(max(size * (1.0 - repeated), 2.0)) / -np.log(repeated)
    return max(float(_LONG), 3.0 * float(expected) + 10.0)


def _resolution(values: Floats) -> float | None:
    part = values[:_DISTINCT]
    return resolution(part[np.isfinite(part)]) or None


def _spread(values: Floats, width: int) -> list[Floats]:
    """Return up to 64 pieces spread over the recording."""
    width = min(width, values.size)
    count = min(64, max(1, values.size // 4096))
    starts = np.linspace(0, values.size - width, count).astype(np.int64)
    return [values[s : s + width] for s in starts.tolist()]


def _scatter(values: Floats) -> float:
    """Return the median of the scatter within pieces."""
    pieces_ = [part[np.isfinite(part)] for part in _spread(values, _SHORT)]
    return float(np.median([part.std() if part.size else 0.0 for part in pieces_]))


def _noise(values: Floats) -> float:
    """Return the robust scatter of neighbours, from pieces spread over the recording."""
    steps = np.concatenate([np.diff(part) for part in _spread(values, 4096)])
    steps = steps[np.isfinite(steps)]
    if not steps.size:
        return 0.0
    return float(_MAD * np.median(np.abs(steps)) / np.sqrt(2.0))
