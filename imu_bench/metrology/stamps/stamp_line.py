# SPDX-License-Identifier: Apache-2.0
"""The straight line through the stamps of a recording with gaps: sample period and its error."""

from __future__ import annotations

from dataclasses import dataclass

from imu_bench.metrology import workspace
import numpy as np
import numpy.typing as npt

Integers = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]

CELL = 1024
"""Most samples summed into one cell; a cell never holds a gap."""

BLOCKS = 64
"""Blocks whose means show how far the stamps are from a straight line."""

_PIECE = 1 << 18


@dataclass(frozen=True)
class Line:
    """The line through the stamps; times in ns."""

    # period, error: slope per sample, and its standard error
    period: float
    error: float
    freedom: float  # degrees of freedom of the error; below 1 there is none
    wander: float  # largest excursion of a block mean from the line
    samples: int  # stamps the line goes through


@dataclass
class _Cells:
    """Sums over up to `CELL` successive samples each; times in ns after the first stamp."""

    run: Integers
    count: Floats
    middle: Floats  # mean index
    inside: Floats  # sum of (index - mean index)²
    mean: Floats  # mean stamp
    cross: Floats  # sum of (index - mean index) * (stamp - mean stamp)
    square: Floats  # sum of (stamp - mean stamp)²

    def merged(self, segment: Integers, place: Floats, period: float) -> tuple[float, float]:
        """Return the sums Sxx and Sxy of the deviations from `period`, within segments."""
        late = self.mean - period * place
        weight = np.bincount(segment, self.count)
        x = place - (np.bincount(segment, self.count * place) / weight)[segment]
        y = late - (np.bincount(segment, self.count * late) / weight)[segment]
        sxx = float(np.sum(self.inside + self.count * x * x))
        sxy = float(np.sum(self.cross - period * self.inside + self.count * x * y))
        return sxx, sxy


def _cells(stamps: Integers, breaks: Integers, period: float) -> _Cells:
    """Return the cells of the samples that end a group; those before are late."""
    index = None
    runs = np.concatenate([[0], breaks]).astype(np.int64)
    ends = _group_ends(stamps, period)
    if ends is not None:
        index = workspace.chosen(workspace.counted(stamps.size), ends)
        runs = np.searchsorted(index, runs)
        stamps = workspace.chosen(stamps, ends)
    lengths = np.diff(runs, append=stamps.size)
    cell = min(CELL, max(8, stamps.size // BLOCKS))
    per_run = -(-lengths // cell)
    nth = np.arange(int(per_run.sum())) - np.repeat(np.cumsum(per_run) - per_run, per_run)
    start = np.repeat(runs, per_run) + cell * nth
    ends_at = np.append(start[1:], stamps.size)
    pieces = []
    low = 0
    while low < start.size:
        high = max(low + 1, int(np.searchsorted(ends_at, start[low] + _PIECE, side='right')))
        pieces.append(_sums(stamps, index, start[low:high], int(ends_at[high - 1])))
        low = high
    sums = np.concatenate(pieces, axis=1)
    run = np.repeat(np.arange(runs.size), per_run)
    return _Cells(run, (ends_at - start).astype(np.float64), *sums)


def _sums(stamps: Integers, index: Integers | None, start: Integers, end: int) -> Floats:
    """Return middle, inside, mean, cross and square of successive cells, shape (5, cells)."""
    count = np.diff(start, append=end)
    if index is None and start.size > 1 and np.all(count[:-1] == count[0]):
        rest = _sums(stamps, index, start[-1:], end)
        return np.concatenate([_equal_sums(stamps, start[:-1], int(count[0])), rest], axis=1)
    at = start - start[0]
    origin = stamps[start]
    time = (stamps[start[0] : end] - np.repeat(origin, count)).astype(np.float64)
    mean = np.add.reduceat(time, at) / count
    if index is None:
        middle = start + 0.5 * (count - 1)
        inside = count * (count.astype(np.float64) ** 2 - 1) / 12.0
        place = np.arange(start[0], end) - np.repeat(middle, count)
    else:
        own = index[start[0] : end].astype(np.float64)
        middle = np.add.reduceat(own, at) / count
        place = own - np.repeat(middle, count)
        inside = np.add.reduceat(place * place, at)
    cross = np.add.reduceat(place * time, at)
    time -= np.repeat(mean, count)
    square = np.add.reduceat(time * time, at)
    return np.stack([middle, inside, mean + (origin - stamps[0]), cross, square])


def _equal_sums(stamps: Integers, start: Integers, size: int) -> Floats:
    """Return `_sums` of cells of one size; the same sums in fewer steps."""
    rows = stamps[start[0] : start[0] + start.size * size].reshape(-1, size)
    time = (rows - rows[:, :1]).astype(np.float64)
    mean = time.mean(axis=1)
    place = np.arange(size) - 0.5 * (size - 1)
    cross = time @ place
    time -= mean[:, None]
    square = np.einsum('ij,ij->i', time, time)
    middle = start + 0.5 * (size - 1)
    inside = np.full(start.size, size * (float(size) ** 2 - 1) / 12.0)
    return np.stack([middle, inside, mean + (rows[:, 0] - stamps[0]), cross, square])


def _group_ends(stamps: Integers, period: float) -> npt.NDArray[np.bool_] | None:
    """Return which samples are not followed by one of their group; None if all."""
    ends = workspace.empty(stamps.size, np.bool_)
    ends[-1:] = True
    for start in range(0, stamps.size, _PIECE):
        steps = np.diff(stamps[start : start + _PIECE + 1])
        # a step back is the clock set back, and a gap
        ends[start : start + steps.size] = (steps >= 0.25 * period) | (steps < 0)
    return None if ends.all() else ends


def gap_lengths(steps: Floats, period: float) -> Integers:
    """Return the samples missing in steps across gaps: at least 1, as each is a gap."""
    return np.maximum(np.rint(steps / period).astype(np.int64) - 1, 1)


def straight_line(stamps: Integers, breaks: Integers, steps: Floats, guess: float) -> Line:
    """
    Return the least-squares line through stamps against their place on the grid.

    Runs between gaps first get a line each, of common slope.  Two runs are then
    joined where that slope fixes the number of samples missing between them;
    this is repeated until nothing changes.

    Parameters
    ----------
    stamps : ndarray of int64, shape (n,)
        In ns, n >= 1.
    breaks : ndarray of int64, shape (k,)
        Indices before which samples are missing.
    steps : ndarray of float64, shape (k,)
        Time in ns across each of those gaps.
    guess : float
        Period in ns, for the case that no run has two samples.
    """
    inner = stamps.size - 1 - breaks.size
    if inner > 0:  # the mean step within runs: needs no guess, and no two callers differ
        across = int(np.sum(stamps[breaks] - stamps[breaks - 1]))
        guess = max((int(stamps[-1] - stamps[0]) - across) / inner, 0.0) or guess
    cells = _cells(stamps, breaks, guess)
    joined = np.zeros(breaks.size, dtype=np.bool_)
    period = guess
    for _ in range(8):
        lengths = np.where(joined, gap_lengths(steps, period), 0)
        place = cells.middle + np.concatenate([[0], np.cumsum(lengths)])[cells.run]
        segment = np.concatenate([[0], np.cumsum(~joined)])[cells.run]
        sxx, sxy = cells.merged(segment, place, period)
        if sxx <= 0:
            return Line(guess, 0.0, 0.0, 0.0, int(stamps.size))
        period += sxy / sxx
        if period <= 0:  # equal stamps only: no run shows the period
            return Line(guess, 0.0, 0.0, 0.0, int(stamps.size))
        error, freedom, wander = _scatter(cells, segment, place, period, sxx)
        bridged = joined | ((steps > 0) & (3.0 * steps * error < 0.25 * period**2))
        if np.array_equal(bridged, joined):
            break
        joined = bridged
    coarse = _fineness(stamps) / max(stamps.size - 1, 1)
    return Line(period, float(np.hypot(error, coarse)), freedom, wander, int(stamps.size))


def _fineness(stamps: Integers) -> float:
    """Return the step of the stamps in ns as far as a sample of them shows it, at least 1."""
    steps = np.diff(stamps[:4096])
    return float(max(1, np.gcd.reduce(steps))) / np.sqrt(12.0) if steps.size else 1.0


def _scatter(
    cells: _Cells, segment: Integers, place: Floats, period: float, sxx: float
) -> tuple[float, float, float]:
    """Return the standard error of the slope, its degrees of freedom, and the wander."""
    # The scatter of the stamps gives the error for independent jitter.  A clock that
    # wanders as a random walk W of variance D t adds 6 D / (5 T) to the variance of the
    # slope over a time T: the variance of 12/T³ times the integral of (t - T/2) W.  D comes
    # from how much farther block means drift apart over T/8 than over T/64.
    weight = np.bincount(segment, cells.count)
    late = cells.mean - period * place
    late -= (np.bincount(segment, cells.count * late) / weight)[segment]
    total = float(cells.count.sum())
    within = cells.square - 2 * period * cells.cross + period**2 * cells.inside
    freedom = total - weight.size - 1
    if freedom < 1:
        return 0.0, 0.0, 0.0
    white = max(float(np.sum(within + cells.count * late**2)), 0.0) / freedom / sxx
    edges = np.unique(np.linspace(0, cells.count.size, BLOCKS + 1).astype(np.int64))[:-1]
    if edges.size < 16:
        return float(np.sqrt(white)), freedom, float(np.max(np.abs(late)))
    size = np.add.reduceat(cells.count, edges)
    mean = np.add.reduceat(cells.count * late, edges) / size
    far = edges.size // 8
    near_square = float(np.mean(np.diff(mean) ** 2))
    far_square = float(np.mean((mean[far:] - mean[:-far]) ** 2))
    drift = max(far_square - near_square, 0.0) / (far - 1) * edges.size / total
    walk = 1.2 * drift / total
    effective = freedom if walk < white else 8.0
    return float(np.sqrt(white + walk)), effective, float(np.max(np.abs(mean)))
