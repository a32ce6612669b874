# SPDX-License-Identifier: Apache-2.0
"""Averages over blocks of samples: what the slow methods look at instead of every sample."""

from __future__ import annotations

from dataclasses import dataclass
import math

from imu_bench.metrology import workspace
from imu_bench.metrology.stretches import longest
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

_COMPLETE = 0.95
"""
Share of its samples that a block needs: the mean of those there then has at most 2.6 % more
deviation than a full one.
"""


@dataclass(frozen=True, eq=False)
class Blocks:
    """
    Averages over successive blocks that do not overlap.

    White and quantisation noise keep their coefficients under averaging; flicker and random walk
    do up to a quarter of the new rate (less the square of sin(x)/x, plus what folds back).
    """

    values: Floats  # averages; 0 where there is none
    valid: Bools  # false where too many samples of a block are missing
    rate_hz: float  # blocks per second
    size: int  # samples per block

    @property
    def span_s(self) -> float:
        """Length of time in s."""
        return self.values.size / self.rate_hz

    def coarser(self, size: int) -> Blocks:
        """Return averages over this many of these blocks."""
        if size <= 1:
            return self
        again = averages(self.values, self.rate_hz, size, self.valid)
        return Blocks(again.values, again.valid, again.rate_hz, self.size * size)

    def longest_piece(self) -> Floats:
        """Return the values of the longest stretch without a gap."""
        return self.values[longest(self.valid)]


def averages(
    placed: Floats, rate_hz: float, size: int, valid: npt.NDArray[np.bool_] | None = None
) -> Blocks:
    """Return averages over blocks of samples; a last block that is not full is left out."""
    count = placed.size // size
    rows = placed[: count * size].reshape(count, size)
    length = max(1, workspace.PART // size)
    if valid is None:
        means = [rows[part].mean(axis=1) for part in workspace.parts(count, length)]
        values = np.concatenate(means) if means else np.empty(0)
        return Blocks(values, np.ones(count, np.bool_), rate_hz / size, size)
    there = valid[: count * size].reshape(count, size)
    samples, sums = np.zeros(count, np.int64), np.zeros(count)
    for part in workspace.parts(count, length):
        samples[part] = np.count_nonzero(there[part], axis=1)
        sums[part] = rows[part].sum(axis=1, where=there[part])
    enough = samples >= max(1, math.ceil(_COMPLETE * size))
    values = np.where(enough, sums / np.maximum(samples, 1), 0.0)
    return Blocks(values, enough, rate_hz / size, size)
