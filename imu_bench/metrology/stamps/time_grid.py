# SPDX-License-Identifier: Apache-2.0
"""The regular time grid of a recording: one sample period, one position for every sample."""

from __future__ import annotations

from dataclasses import dataclass

from imu_bench.errors import DataError
from imu_bench.metrology import workspace
from imu_bench.metrology.stamps.continuity import Continuity
from imu_bench.metrology.stamps.stamp_line import gap_lengths, Line, straight_line
from imu_bench.metrology.stamps.stamp_rule import Rule
import numpy as np
import numpy.typing as npt

Integers = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

LONGEST_HOLE = 1 << 20
"""A gap takes at most this many empty positions of a grid: no estimator looks across one."""

_BLOCK = 1 << 18
_NANO = 1e-9


@dataclass(frozen=True, eq=False)
class Grid:
    """The position of every sample on the regular time grid."""

    index: Integers  # position on the grid; -1 for a sample that was dropped
    keep: Mask  # false for duplicates and order faults
    period_s: float  # measured sample period
    span: int  # length of the grid, gaps included

    @property
    def regular(self) -> bool:
        """Whether every sample was kept and none is missing."""
        return self.span == self.index.size


@dataclass(frozen=True)
class Judged:
    """Stamps with the judgement of the continuity rule."""

    keep: Mask  # false for duplicates and order faults
    kept: Integers  # the stamps that were kept
    breaks: Integers  # indices among them before which samples are missing
    steps: Floats  # time across those gaps in ns, -1 where the clock was set back
    rule: Rule
    duplicates: int
    order_faults: int


def _checked(stamps_ns: npt.ArrayLike) -> Integers:
    stamps = np.asarray(stamps_ns)
    if stamps.ndim != 1:
        raise DataError(f'stamps must have shape (n,), got {stamps.shape}')
    if stamps.size and stamps.dtype.kind not in 'iu':
        raise DataError(f'stamps are whole nanoseconds (int64), got {stamps.dtype}')
    if stamps.size == 0:
        raise DataError('no stamps: the recording is empty')
    return stamps.astype(np.int64, copy=False)


def _judged(stamps: Integers, rule: Rule) -> Judged:
    stream = Continuity(rule)
    keep = workspace.empty(stamps.size, np.bool_)
    found, steps = [], []
    done = 0
    for start in range(0, stamps.size, _BLOCK):
        end = min(start + _BLOCK, stamps.size)
        kept, gaps = stream.settle(stamps[start:end], final=end == stamps.size)
        keep[done : done + kept.size] = kept
        found.append(np.flatnonzero(gaps) + done)
        steps.append(gaps[gaps != 0])
        done += kept.size
    holes = np.concatenate(found)
    if stream.order_faults + stream.duplicates == 0:
        kept_stamps, breaks = stamps, holes
    else:
        kept_stamps = workspace.chosen(stamps, keep)
        breaks = np.searchsorted(np.flatnonzero(keep), holes)
    return Judged(
        keep,
        kept_stamps,
        breaks,
        np.concatenate(steps),
        rule,
        stream.duplicates,
        stream.order_faults,
    )


def judge(stamps_ns: npt.ArrayLike, period_s: float | None = None) -> tuple[Judged, Line]:
    """Return the judgement of stamps and the line through those kept."""
    stamps = _checked(stamps_ns)
    if stamps.size < 2 and period_s is None:
        raise DataError('a single sample has no sample rate; give the rate')
    rule = Rule.of(stamps, None if period_s is None else period_s / _NANO)
    judged = _judged(stamps, rule)
    line = straight_line(judged.kept, judged.breaks, judged.steps, rule.period)
    off = abs(line.period - rule.period) / rule.period
    if period_s is None and 1e-3 < off < 0.5:
        judged = _judged(stamps, Rule.of(stamps, line.period))
        line = straight_line(judged.kept, judged.breaks, judged.steps, line.period)
    return judged, line


def period(stamps_ns: Integers, breaks: Integers, steps_ns: Floats, guess_s: float) -> float:
    """
    Return the sample period in s: least squares over uninterrupted runs.

    Parameters
    ----------
    stamps_ns : ndarray of int64, shape (n,)
        Stamps without duplicates and order faults.
    breaks : ndarray of int64, shape (k,)
        Indices of the samples before which samples are missing.
    steps_ns : ndarray of float64, shape (k,)
        Time across each of those gaps, as `Continuity.settle` gives it.
    guess_s : float
        Returned where no run has two samples.

    Notes
    -----
    The length of a gap is used only where the period found so far fixes the
    number of samples missing in it.  The result therefore depends on where the
    gaps are, not on how long somebody took them to be.
    """
    return straight_line(stamps_ns, breaks, steps_ns, guess_s / _NANO).period * _NANO


def grid(stamps_ns: npt.ArrayLike, period_s: float | None = None) -> Grid:
    """
    Return the position of every sample on the regular time grid.

    Successive differences of stamps are rounded to whole periods by the rule of
    `imu_bench.metrology.stamps.continuity`, so that an error of the period or a drift
    of the sensor's clock never accumulates.

    Parameters
    ----------
    stamps_ns : array_like of int64, shape (n,)
        Stamps in ns.
    period_s : float, optional
        Sample period if it is known; found from the stamps otherwise.  The
        `period_s` of the result is measured in either case.

    Raises
    ------
    DataError
        If there are no stamps, or they do not advance.

    Examples
    --------
    >>> g = grid([0, 10_000_000, 20_000_000, 50_000_000])
    >>> g.index.tolist(), g.span, round(g.period_s, 6)
    ([0, 1, 2, 5], 6, 0.01)
    """
    judged, line = judge(stamps_ns, period_s)
    lengths = np.minimum(gap_lengths(judged.steps, line.period), LONGEST_HOLE)
    index = workspace.empty(judged.keep.size, np.int64)
    place = -1  # of the sample before
    kept = 0
    for start in range(0, index.size, _BLOCK):
        part = slice(start, min(start + _BLOCK, index.size))
        chosen = judged.keep[part]
        steps = np.ones(int(np.count_nonzero(chosen)), np.int64)
        first, last = np.searchsorted(judged.breaks, (kept, kept + steps.size))
        steps[judged.breaks[first:last] - kept] += lengths[first:last]
        index[part] = -1
        index[part][chosen] = place + np.cumsum(steps)
        place += int(steps.sum())
        kept += steps.size
    return Grid(index, judged.keep, line.period * _NANO, place + 1)


def place(values: npt.ArrayLike, grid: Grid) -> tuple[Floats, Mask]:
    """
    Return values on the regular grid, and which positions hold a sample.

    Parameters
    ----------
    values : array_like, shape (n,) or (n, axes)
        One row per stamp.
    grid : Grid
        Of those stamps.

    Returns
    -------
    placed : ndarray of float64, shape (span,) or (span, axes)
        Zero where no sample is; the array itself where none is missing.

    Raises
    ------
    DataError
        If there are not as many rows as stamps.

    Examples
    --------
    >>> placed, valid = place([1.0, 2.0, 3.0], grid([0, 10, 40]))
    >>> placed.tolist(), valid.tolist()
    ([1.0, 2.0, 0.0, 0.0, 3.0], [True, True, False, False, True])
    """
    rows = np.asarray(values, dtype=np.float64)
    if rows.shape[:1] != grid.index.shape:
        raise DataError(f'{rows.shape[:1]} rows of values for {grid.index.size} stamps')
    if grid.regular:
        return rows, np.ones(grid.span, dtype=np.bool_)
    width = int(np.prod(rows.shape[1:]))
    placed = workspace.zeros(grid.span * width, np.float64).reshape(grid.span, *rows.shape[1:])
    valid = workspace.zeros(grid.span, np.bool_)
    for start in range(0, grid.index.size, _BLOCK):
        part = slice(start, start + _BLOCK)
        index = grid.index[part][grid.keep[part]]
        placed[index] = rows[part][grid.keep[part]]
        valid[index] = True
    return placed, valid
