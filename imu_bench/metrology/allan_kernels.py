# SPDX-License-Identifier: Apache-2.0
"""
The sums below a deviation: squared differences of the phase, block by block.

The phase is the cumulative sum of the rate.  All averaging factors are served from one
block of starting points before the next block is touched, so that for most of them the
data are still in the cache; a block is large enough that threads rarely meet at the lock
of the interpreter, and only operations are used that leave that lock alone (dot products,
cumulative sums along one axis and matrix products hold it, or start threads of their own).
Blocks do not depend on the number of threads and their sums are added in one order, so
threads cannot change a result.

A *run* is a stretch without a missing sample, given by its first point and one past its
last point of the phase.  A difference counts if all its points lie in one run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
import os
from queue import Empty, SimpleQueue
from typing import Any, Literal

from imu_bench.errors import DataError
from imu_bench.metrology import workspace
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

BLOCK = 1 << 18
"""Starting points per block."""

_ROW = 1 << 8
"""Samples that are cumulated in one go; a block has enough such rows to release the lock."""

_WORTH_THREADS = 1 << 20
"""Samples below which threads cost more than they gain."""

TOO_LARGE = 'the samples are too large for their squares to be summed; check their unit'

Run = Callable[[Callable[[Any], Any], Sequence[Any]], list[Any]]
"""Calls a function with each of some jobs and returns the answers in their order."""


def in_turn(function: Callable[[Any], Any], jobs: Sequence[Any]) -> list[Any]:
    """Call a function with each of some jobs, one after the other."""
    with np.errstate(over='ignore', invalid='ignore'):
        return [function(job) for job in jobs]


@contextmanager
def cores(threads: int, samples: int) -> Iterator[Run]:
    """Give a `Run` on some threads, or in turn if there are too few samples for it."""
    if threads <= 1 or samples < _WORTH_THREADS:
        yield in_turn
        return
    with ThreadPoolExecutor(threads) as pool:
        # the error state of numpy belongs to a thread, so each call sets it
        yield lambda function, jobs: list(pool.map(lambda job: in_turn(function, [job])[0], jobs))


def default_threads() -> int:
    """Return the number of cores this process may use, at most 4."""
    if hasattr(os, 'sched_getaffinity'):
        return min(4, len(os.sched_getaffinity(0)))
    return min(4, os.cpu_count() or 1)


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


def cumulate(
    rate: npt.NDArray[np.generic], valid: Mask | None = None, run: Run = in_turn
) -> Floats:
    """
    Return the cumulative sum of rate data less its mean, shape (n + 1,), starting at 0.

    The mean goes first because a long sum of, say, gravity would cost digits.  Missing
    samples count as the mean, whatever value they hold.

    Raises
    ------
    DataError
        If a sample that is not declared missing is NaN or infinite.

    Examples
    --------
    >>> cumulate(np.array([1.0, 2.0, 3.0])).tolist()
    [0.0, -1.0, -1.0, 0.0]
    """
    count = rate.size if valid is None else int(np.count_nonzero(valid))
    rows = -(-rate.size // _ROW)
    phase = workspace.zeros(1 + rows * _ROW, np.float64)
    body = phase[1:]
    blocks = [slice(a, min(a + BLOCK, rate.size)) for a in range(0, rate.size, BLOCK)]

    def where(block: slice) -> Mask | Literal[True]:
        return True if valid is None else valid[block]

    def total(block: slice) -> float:
        return float(np.sum(rate[block], dtype=np.float64, where=where(block)))

    def fill(block: slice) -> None:
        np.subtract(rate[block], mean, out=body[block], where=where(block), dtype=np.float64)
        part = body[block.start : block.start + BLOCK].reshape(-1, _ROW)
        np.cumsum(part, axis=1, out=part)

    def lift(block: slice) -> None:
        part = body[block.start : block.start + BLOCK].reshape(-1, _ROW)
        part += before[block.start // _ROW :][: part.shape[0], None]

    grand = float(np.sum(run(total, blocks)))
    if not np.isfinite(grand):
        refuse_unfinite(rate, valid)
        raise DataError(TOO_LARGE)
    mean = grand / max(count, 1) if _varies(rate, valid) else _first(rate, valid)
    run(fill, blocks)
    ends = np.cumsum(body[_ROW - 1 :: _ROW])
    before = np.concatenate(([0.0], ends[:-1]))
    run(lift, blocks)
    return phase[: rate.size + 1]


def _first(rate: npt.NDArray[np.generic], valid: Mask | None) -> float:
    return float(rate[0 if valid is None else int(np.argmax(valid))])


def _varies(rate: npt.NDArray[np.generic], valid: Mask | None) -> bool:
    """Return whether the samples differ; the mean of equal ones may miss them by a rounding."""
    for step in (max(1, rate.size // 64), 1):
        different = rate[::step] != _first(rate, valid)
        if valid is not None:
            different &= valid[::step]
        if different.any():
            return True
    return False


def refuse_unfinite(values: npt.NDArray[np.generic], valid: Mask | None) -> None:
    """Raise DataError if a value that is not declared missing is NaN or infinite."""
    bad = ~np.isfinite(values)
    if valid is not None:
        bad &= valid
    count = int(np.count_nonzero(bad))
    if count:
        raise DataError(
            f'{count} of {values.size} samples are NaN or infinite, the first at index '
            f'{int(np.argmax(bad))}; declare missing samples with valid='
        )


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
        points[start : start + BLOCK] = kept[start : start + BLOCK]

    run(copy, range(0, kept.size, BLOCK))
    first = -(-runs[:, 0] // stride)
    last = (runs[:, 1] - 1) // stride
    return points, np.stack([first, last + 1], axis=1)[last >= first]


def square_sum(values: Floats, work: Floats | None = None) -> float:
    """Return the sum of squares of an array, which is overwritten unless `work` is given."""
    return float(np.square(values, out=values if work is None else work).sum())


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
        size = max(BLOCK, factor)
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
        (start, min(start + BLOCK, last), last)
        for first, last in runs.tolist()
        for start in range(first, last - reach, BLOCK)
    ]
    size = 3 * min(BLOCK, int(lengths.max(initial=0)))
    free: SimpleQueue[Floats] = SimpleQueue()

    def squares(job: tuple[int, int, int]) -> list[float]:
        start, end, last = job
        try:
            work = free.get_nowait()
        except Empty:
            work = np.empty(size)
        row = [
            square_sum(difference(phase, factor, start, stop, work))
            for factor in factors
            if (stop := min(end, last - order * factor)) > start
        ]
        free.put(work)
        return row

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
