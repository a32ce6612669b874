# SPDX-License-Identifier: Apache-2.0
"""
Sums of squared second differences over a sliding window, without running sums.

Adding what enters and subtracting what leaves would keep the rounding of every
large value for ever.  Here the squares are summed into bins of `BIN` starting
points; the sum over a window is the sum of its whole bins and of the part of
the first one that is still inside, which is computed anew.
"""

from __future__ import annotations

from imu_bench.metrology.sliding.sample_ring import SampleRing
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

BIN = 2048
"""Starting points of differences summed together."""


class WindowSums:
    """
    Sums of squared second differences of the integral, per averaging factor and axis.

    A difference starts at sample i and ends at i + 2m; it counts if these samples lie
    in one run.
    """

    def __init__(self, ring: SampleRing, m: Integers) -> None:
        self._ring = ring
        self._m = m.tolist()
        axes = ring.values.shape[0]
        self._bins = np.zeros((ring.capacity // BIN + 3, m.size, axes))
        self._newest = -1
        self._work = np.empty((2, axes, 2 * BIN))

    @property
    def nbytes(self) -> int:
        """Memory in bytes; it never changes."""
        return self._bins.nbytes + self._work.nbytes

    def clear(self) -> None:
        """Forget everything."""
        self._newest = -1

    def add(self, begin: int) -> None:
        """Count the differences that end after sample `begin`, the first of the new ones."""
        ring, bins = self._ring, self._bins
        while self._newest < (ring.end - 1) // BIN:
            self._newest += 1
            bins[self._newest % len(bins)] = 0.0
        for a, b in ring.runs(ring.first, begin, ring.end):
            for k, m in enumerate(self._m):
                low, high = max(a, begin + 1 - 2 * m), b - 2 * m + 1
                if high <= a:
                    break
                while low < high:
                    stop = min(high, low + BIN)
                    off = self._differences(m, low, stop)
                    edge = min((low // BIN + 1) * BIN, stop)
                    bins[low // BIN % len(bins), k] += _squares(off[:, : edge - low])
                    if edge < stop:
                        bins[edge // BIN % len(bins), k] += _squares(off[:, edge - low :])
                    low = stop

    def total(self, start: int, end: int) -> Floats:
        """Return the sums over the differences that start at `start` or later, shape (k, axes)."""
        ring = self._ring
        last = max(end - 1, 0) // BIN + 1
        whole = min(-(-start // BIN), last)
        slots = np.arange(whole, last) % len(self._bins)
        sums = np.asarray(self._bins[slots].sum(axis=0), np.float64)
        edge = whole * BIN
        if edge > start:  # the part of the first bin that is in the window
            for a, b in ring.runs(start, start, edge):
                self._count(sums, a, min(b, end), a, edge)
        if ring.end > end:  # what ends beyond `end`
            for a, b in ring.runs(start, end, ring.end):
                self._count(sums, a, b, end + 1, b + 1, ends=True)
        return sums

    def _count(
        self, sums: Floats, a: int, b: int, low: int, high: int, ends: bool = False
    ) -> None:
        """Add the differences of one run that start (or end) from `low` to `high`."""
        for k, m in enumerate(self._m):
            if b - 2 * m < a:
                break
            shift = 2 * m if ends else 0
            sums[k] += self._range(m, max(a, low - shift), min(b - 2 * m + 1, high - shift))

    def _range(self, m: int, low: int, high: int) -> Floats:
        total = np.zeros(self._work.shape[1])
        while low < high:
            stop = min(high, low + BIN)
            total += _squares(self._differences(m, low, stop))
            low = stop
        return total

    def _differences(self, m: int, low: int, high: int) -> Floats:
        """Return the differences that start between two samples, at most `BIN` apart."""
        phase, low, count = self._ring.phase, low - self._ring.first, high - low
        first, second = self._work
        if m < count:
            # the first differences of these points and of the points m later are the same
            step = np.subtract(
                phase[:, low + m : low + count + 2 * m],
                phase[:, low : low + count + m],
                out=first[:, : count + m],
            )
            return np.subtract(step[:, m:], step[:, :count], out=second[:, :count])
        middle = phase[:, low + m : low + m + count]
        off = np.subtract(
            phase[:, low + 2 * m : low + 2 * m + count], middle, out=first[:, :count]
        )
        off -= np.subtract(middle, phase[:, low : low + count], out=second[:, :count])
        return off


def _squares(values: Floats) -> Floats:
    """Return the sum of squares of each row."""
    return np.asarray(np.einsum('ij,ij->i', values, values), np.float64)
