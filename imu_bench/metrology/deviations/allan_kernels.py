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

_FEW_RUNS = 32
"""Runs in a block up to which each is summed for itself; that costs calls, not memory."""


def number_of_terms(order: int, m: Integers, runs: Integers) -> Integers:
    """Return the number of complete differences of an order at each averaging factor."""
    lengths, counts = np.unique(runs[:, 1] - runs[:, 0], return_counts=True)
    return np.asarray(counts @ np.maximum(lengths[:, None] - order * m, 0), np.int64)


def second_difference_sums(
    phase: Floats, m: Integers, runs: Integers, run: Run = in_turn
) -> tuple[Floats, Integers]:
    """Return sum and number of the squared second differences with full overlap."""
    return _sums(_second, 2, phase, m, runs, run)


def third_difference_sums(
    phase: Floats, m: Integers, runs: Integers, run: Run = in_turn
) -> tuple[Floats, Integers]:
    """Return sum and number of the squared third differences with full overlap."""
    return _sums(_third, 3, phase, m, runs, run)


def thinned(
    phase: Floats, runs: Integers, stride: int, run: Run = in_turn
) -> tuple[Floats, Integers]:
    """Return every stride-th point of the phase, and its runs counted in such points."""
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
    """
    sums = np.zeros(m.size)
    terms = np.zeros(m.size, np.int64)
    for index, factor in enumerate(m.tolist()):
        size = max(blockwise.BLOCK, factor)
        for first, last in runs[runs[:, 1] - runs[:, 0] > 3 * factor].tolist():
            end = last - 3 * factor + 1
            for start in range(first, end, size):
                stop = min(start + size, end)
                steps = np.zeros(stop - start + factor)
                reach = stop + factor - 1
                inner = _second(phase, factor, start, reach, np.empty(3 * (reach - start)))
                np.cumsum(inner, out=steps[1:])
                steps[:-factor] -= steps[factor:]
                sums[index] += square_sum(steps[:-factor]) / factor**2
            terms[index] += end - first
    return sums, terms


Block = Callable[[Floats, int, int, int, Floats], Floats]


def _sums(
    difference: Block, order: int, phase: Floats, m: Integers, runs: Integers, run: Run
) -> tuple[Floats, Integers]:
    terms = number_of_terms(order, m, runs)
    factors = m[terms > 0].tolist()
    end = int(runs[-1, 1]) if factors else 0
    desk = blockwise.WorkArrays(3 * min(blockwise.BLOCK, phase.size))

    def squares(start: int) -> Floats:
        stop = min(start + blockwise.BLOCK, end)
        inside = runs[np.searchsorted(runs[:, 1], start, 'right') :]
        inside = inside[: np.searchsorted(inside[:, 0], stop)]
        within = _one_by_one if len(inside) <= _FEW_RUNS else _together
        with desk.taken() as work:
            return within(difference, order, phase, factors, inside, start, stop, work)

    sums = np.zeros(m.size)
    for part in run(squares, range(0, end, blockwise.BLOCK)):
        sums[: part.size] += part
    return sums, terms


def _one_by_one(
    difference: Block, order: int, phase: Floats, factors: list[int], runs: Integers, start: int,
    end: int, work: Floats,
) -> Floats:  # fmt: skip
    """Return the sums of squares from the points of a block, run by run."""
    sums = np.zeros(len(factors))
    for first, last in runs.tolist():
        begin = max(start, first)
        for index, factor in enumerate(factors):
            stop = min(end, last - order * factor)
            if stop <= begin:
                break
            sums[index] += square_sum(difference(phase, factor, begin, stop, work))
    return sums


def _together(
    difference: Block, order: int, phase: Floats, factors: list[int], runs: Integers, start: int,
    end: int, work: Floats,
) -> Floats:  # fmt: skip
    """Return what `_one_by_one` does: of all points, with those that meet a gap struck out."""
    sums = np.zeros(len(factors))
    bounds = np.clip(runs, start, end)
    # how many points of its run lie ahead of each point, itself included; 0 in a gap
    ahead = np.zeros(end - start, np.int64)
    inner = ahead[: bounds[-1, 1] - start]
    ends = np.stack([np.zeros(len(runs), np.int64), runs[:, 1]], axis=1)
    inner[:] = np.repeat(ends.ravel(), np.diff(bounds.ravel(), prepend=start))
    inner -= np.arange(start, start + inner.size)
    longest = int(ahead.max())
    for index, factor in enumerate(factors):
        reach = order * factor
        stop = min(end, phase.size - reach)
        if longest <= reach or stop <= start:
            break
        block = difference(phase, factor, start, stop, work)
        np.copyto(block, 0.0, where=ahead[: stop - start] <= reach)
        sums[index] = square_sum(block)
    return sums


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
