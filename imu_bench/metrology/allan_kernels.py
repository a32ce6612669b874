# SPDX-License-Identifier: Apache-2.0
"""
The sums below a deviation: squared differences of the phase, block by block.

All averaging factors are served from one block of starting points before the next block is
touched, so that for most of them the data are still in the cache.  The sums of blocks are
added in one order, so threads cannot change a result.

A *run* is a stretch without a missing sample, given by its first point and one past its
last point of the phase.  A difference counts if all its points lie in one run.
"""

from __future__ import annotations

from collections.abc import Callable

from imu_bench.metrology import blockwise, workspace
from imu_bench.metrology.blockwise import in_turn, Run, square_sum
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]


def complete_runs(valid: Mask) -> Integers:
    """
    Return first and one past the last sample of every run without a missing sample.

    Examples
    --------
    >>> complete_runs(np.array([True, True, False, True])).tolist()
    [[0, 2], [3, 4]]
    """
    padded = np.concatenate(([False], valid, [False]))
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    return edges.reshape(-1, 2).astype(np.int64)


def second_difference_sums(
    phase: Floats, m: Integers, runs: Integers, run: Run = in_turn
) -> tuple[Floats, Integers]:
    """
    Return sum and number of the squared second differences with full overlap.

    Parameters
    ----------
    phase : ndarray of float64, shape (n + 1,)
    m : ndarray of int64, shape (k,)
        Averaging factors in increasing order.
    runs : ndarray of int64, shape (r, 2)
        Runs of the phase.
    run : callable
        From `cores`; the result does not depend on it.

    Examples
    --------
    >>> phase = np.array([0.0, 1.0, 4.0, 9.0, 16.0])
    >>> sums, terms = second_difference_sums(phase, np.array([1, 2]), np.array([[0, 5]]))
    >>> sums.tolist(), terms.tolist()
    ([12.0, 64.0], [3, 1])
    """
    return _sums(_second, 2, phase, m, runs, run)


def third_difference_sums(
    phase: Floats, m: Integers, runs: Integers, run: Run = in_turn
) -> tuple[Floats, Integers]:
    """Return sum and number of the squared third differences with full overlap."""
    return _sums(_third, 3, phase, m, runs, run)


def thinned(
    phase: Floats, runs: Integers, stride: int, run: Run = in_turn
) -> tuple[Floats, Integers]:
    """
    Return every stride-th point of the phase, and its runs counted in such points.

    Examples
    --------
    >>> thinned(np.arange(8.0), np.array([[0, 5], [6, 8]]), 3)
    (array([0., 3., 6.]), array([[0, 2],
           [2, 3]]))
    """
    kept = phase[::stride]
    points = workspace.empty(kept.size, np.float64)

    def copy(start: int) -> None:
        points[start : start + blockwise.BLOCK] = kept[start : start + blockwise.BLOCK]

    run(copy, range(0, kept.size, blockwise.BLOCK))
    first = -(-runs[:, 0] // stride)
    last = (runs[:, 1] - 1) // stride
    return points, np.stack([first, last + 1], axis=1)[last >= first]


def modified_sums(phase: Floats, m: Integers, runs: Integers) -> tuple[Floats, Integers]:
    """
    Return sum and number of the squared moving averages, over m, of the second differences.

    The moving average comes from a cumulative sum of the differences themselves, block by
    block; third differences of a twice summed phase would lose digits on long records.

    Examples
    --------
    >>> phase = np.array([0.0, 1.0, 4.0, 9.0, 16.0])
    >>> modified_sums(phase, np.array([1]), np.array([[0, 5]]))
    (array([12.]), array([3]))
    """
    sums = np.zeros(m.size)
    terms = np.zeros(m.size, np.int64)
    for index, factor in enumerate(m.tolist()):
        size = max(blockwise.BLOCK, factor)
        for first, last in runs.tolist():
            end = last - 3 * factor + 1
            for start in range(first, end, size):
                stop = min(start + size, end)
                steps = np.zeros(stop - start + factor)
                reach = stop + factor - 1
                inner = _second(phase, factor, start, reach, np.empty(3 * (reach - start)))
                np.cumsum(inner, out=steps[1:])
                steps[:-factor] -= steps[factor:]
                sums[index] += square_sum(steps[:-factor]) / factor**2
            terms[index] += max(end - first, 0)
    return sums, terms


Block = Callable[[Floats, int, int, int, Floats], Floats]


def _sums(
    difference: Block, order: int, phase: Floats, m: Integers, runs: Integers, run: Run
) -> tuple[Floats, Integers]:
    lengths = runs[:, 1] - runs[:, 0]
    terms = np.maximum(lengths[:, None] - order * m[None, :], 0).sum(axis=0)
    factors = m[terms > 0].tolist()
    reach = order * factors[0] if factors else 0
    jobs = [
        (start, min(start + blockwise.BLOCK, last), last)
        for first, last in runs.tolist()
        for start in range(first, last - reach, blockwise.BLOCK)
    ]
    desk = blockwise.Desk(3 * min(blockwise.BLOCK, int(lengths.max(initial=0))))

    def squares(job: tuple[int, int, int]) -> list[float]:
        start, end, last = job
        with desk.taken() as work:
            return [
                square_sum(difference(phase, factor, start, stop, work))
                for factor in factors
                if (stop := min(end, last - order * factor)) > start
            ]

    sums = np.zeros(m.size)
    for row in run(squares, jobs):
        sums[: len(row)] += row
    return sums, terms


def _second(phase: Floats, m: int, start: int, stop: int, work: Floats) -> Floats:
    """Return the second differences from every point of a block, in `work`."""
    count = stop - start
    if m < count:
        # the first differences of a block and of the points m later are the same ones
        first = np.subtract(
            phase[start + m : stop + 2 * m], phase[start : stop + m], out=work[: count + m]
        )
        return np.subtract(first[m:], first[:count], out=work[2 * count : 3 * count])
    middle = phase[start + m : stop + m]
    block = np.subtract(phase[start + 2 * m : stop + 2 * m], middle, out=work[:count])
    block -= middle
    block += phase[start:stop]
    return block


def _third(phase: Floats, m: int, start: int, stop: int, work: Floats) -> Floats:
    """Return the third differences from every point of a block, in `work`."""
    count = stop - start
    block = np.subtract(
        phase[start + 2 * m : stop + 2 * m], phase[start + m : stop + m], out=work[:count]
    )
    block *= -3.0
    block += phase[start + 3 * m : stop + 3 * m]
    block -= phase[start:stop]
    return block
