# SPDX-License-Identifier: Apache-2.0
"""
The phase of a rate: its cumulative sum.

A cumulative sum takes one addition after the other, ten times slower than the memory.
Stacks of small matrix products do the same work abreast; each is too small for the linear
algebra library to start threads of its own.
"""

from __future__ import annotations

from imu_bench.errors import DataError
from imu_bench.metrology import blockwise, workspace
from imu_bench.metrology.blockwise import in_turn, Run
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

TOO_LARGE = 'the samples are too large for their squares to be summed; check their unit'

_ROW = 1 << 4
"""Samples that one row of a matrix product sums."""

_STACK = 1 << 13
"""Samples of one matrix product."""

_ONES = np.ones(_ROW)
_UP_TO = np.triu(np.ones((_ROW, _ROW)))
"""A row of samples times this is the row of their cumulative sums."""


def cumulate(
    rate: npt.NDArray[np.generic], valid: Mask | None = None, run: Run = in_turn
) -> Floats:
    """
    Return the cumulative sum of rate data less its mean, shape (n + 1,), starting at 0.

    The mean goes first because a long sum of, say, gravity would cost digits.  Missing
    samples count as the mean, whatever value they hold.
    """
    size = blockwise.BLOCK
    blocks = [slice(a, min(a + size, rate.size)) for a in range(0, rate.size, size)]
    summation = _Summation(rate, valid)
    totals, counts = np.array(run(summation.total, blocks)).T
    if not np.isfinite(totals.sum()):
        refuse_unfinite(rate, valid)
        raise DataError(TOO_LARGE)
    # relative to a sample, or the mean of equal ones would miss them by a rounding
    mean = summation.first + float(totals.sum() / max(counts.sum(), 1.0))
    ends = np.cumsum(totals - counts * (mean - summation.first)).tolist()
    starts = zip(blocks, [0.0, *ends[:-1]], strict=True)
    run(lambda job: summation.fill(job[0], job[1], mean), list(starts))
    return summation.phase[: rate.size + 1]


class _Summation:
    """Sums blocks of a rate into its phase, each block for itself."""

    def __init__(self, rate: npt.NDArray[np.generic], valid: Mask | None) -> None:
        self._rate = rate
        self._valid = valid
        self._stack = min(_STACK, blockwise.BLOCK)
        self.first = float(rate[0 if valid is None else int(np.argmax(valid))])
        self.phase = workspace.empty(1 + self._whole(rate.size), np.float64)
        self.phase[0] = 0.0
        self._desk = blockwise.WorkArrays(min(blockwise.BLOCK, self.phase.size - 1))

    def total(self, block: slice) -> tuple[float, int]:
        """Return the sum of the samples of a block less the first sample, and their number."""
        present = None if self._valid is None else int(np.count_nonzero(self._valid[block]))
        with self._desk.taken() as work:
            total = float(self._less(self.first, block, work).sum())
        return total, block.stop - block.start if present is None else present

    def fill(self, block: slice, start: float, mean: float) -> None:
        """Write the phase after each sample of a block; it is `start` before the first one."""
        with self._desk.taken() as work:
            part = self._less(mean, block, work)
            rows = part.reshape(-1, self._stack // _ROW, _ROW)
            # the phase before each row goes with its first sample
            part[::_ROW] += np.cumsum(np.append(start, rows @ _ONES))[:-1]
            body = self.phase[1 + block.start : 1 + block.start + part.size]
            np.matmul(rows, _UP_TO, out=body.reshape(rows.shape))

    def _less(self, level: float, block: slice, work: Floats) -> Floats:
        """Return the samples of a block less a level, 0 where missing, in whole stacks."""
        size = block.stop - block.start
        part = work[: self._whole(size)]
        np.subtract(self._rate[block], level, out=part[:size], dtype=np.float64)
        part[size:] = 0.0
        if self._valid is not None:
            part[:size][~self._valid[block]] = 0.0
        return part

    def _whole(self, size: int) -> int:
        return -(-size // self._stack) * self._stack


def refuse_unfinite(values: npt.NDArray[np.generic], valid: Mask | None) -> None:
    """Refuse values that are NaN or infinite without being declared missing."""
    bad = ~np.isfinite(values)
    if valid is not None:
        bad &= valid
    count = int(np.count_nonzero(bad))
    if count:
        raise DataError(
            f'{count} of {values.size} samples are NaN or infinite, the first at index '
            f'{int(np.argmax(bad))}; declare missing samples with valid='
        )
