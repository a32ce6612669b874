# SPDX-License-Identifier: Apache-2.0
"""Facts about the stored numbers of one axis, in one pass over pieces that fit the cache."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from imu_bench.metrology import workspace
from imu_bench.metrology.spikes import neighbour_noise, pieces
from imu_bench.metrology.statistics import resolution
from imu_bench.metrology.stretches import stretches
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_LONG = 16  # samples; shorter runs of equal values are not kept
_DISTINCT = 2**16  # samples looked at for the resolution
_SHORT = 256  # samples; longer than the memory of a filter, shorter than a drift


@dataclass(frozen=True)
class AxisFacts:
    """What the values of an axis look like, without regard to time."""

    # lowest, highest: extremes
    lowest: float
    highest: float
    # at_lowest, at_highest: how often they occur
    at_lowest: int
    at_highest: int
    repeated: float  # share of samples equal to the one before, between 0 and 1
    longest: tuple[int, int]  # position and length of the longest run of equal values
    # position and length of every run that is too long to be chance
    frozen: tuple[tuple[int, int], ...]
    # smallest step between values, if all values are multiples of one step
    resolution: float | None
    # robust σ of the difference of neighbours over √2: scatter without drift and outliers
    noise: float
    # median of σ within short pieces: scatter of noise that a filter makes alike in neighbours
    scatter: float


def examine(values: Floats) -> AxisFacts:
    """Return the facts about one axis."""
    lowest, highest = workspace.extremes(values)
    equal, runs, longest = _equal_runs(values)
    repeated = equal / max(values.size - 1, 1)
    limit = _chance(values.size, repeated)
    return AxisFacts(
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


def levels_inside(values: Floats, extreme: float, *, top: bool, levels: int = 3) -> int:
    """
    Return how often the commonest of the values next to an extreme occurs.

    One value alone is no measure: in the tail of a coarse signal it may be missing by chance.
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


def repeated_rows(columns: Sequence[Floats]) -> int:
    """Return how many rows equal the row before in every column."""
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
        starts, ends = (first + stretches(same)).T
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
    """Return a length of runs of equal values that chance does not reach."""
    # For independent repeats of probability p the longest of n has about
    # ln(n (1 − p)) / −ln p samples (Schilling 1990, College Math. J. 21:196); three times that
    # allows for noise that is not white.
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
    return neighbour_noise(steps)
