# SPDX-License-Identifier: Apache-2.0
"""
The samples of a sliding window and their integral in memory of fixed size, and their sums.

Squared second differences are summed without running sums: adding what enters and subtracting
what leaves would keep the rounding of every large value for ever.  Here the squares are summed
into bins of `BIN` starting points; the sum over a window is the sum of its whole bins and of the
part of the first one that is still inside, which is computed anew.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator

from imu_bench.metrology.sliding.rolling_intake import Piece
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

QUIET = 64
"""Samples over which the noise is looked at to see whether the integral ran away."""

RUNAWAY = 2.0**20
"""Integral over noise of one step from which it is taken anew: ten digits are left."""


class SampleRing:
    """
    A window of samples that moves along a stream.

    Samples are numbered from the start of the stream.  Missing samples take no
    place: a break marks where an uninterrupted run ends and the next begins.

    The integral (the phase of the Allan variance) loses digits where it grows
    large against the noise.  It is therefore summed up again from the samples,
    backwards from the newest, with the latest mean taken out, whenever the
    memory is full and whenever a step or a transient made it run away; no
    rounding of the past survives in it.
    """

    def __init__(self, axes: int, window: int, slack: int) -> None:
        self.window = window
        self.capacity = window + slack
        # number of the first sample after the clock was last set back
        self.first = self.end = self.floor = 0
        # numbers of the samples before which some are missing, in order
        self.breaks: list[int] = []
        self.steps: list[float] = []  # time in ns across each of these gaps
        self.stamps = np.zeros(self.capacity, dtype=np.int64)
        self.values = np.zeros((axes, self.capacity))
        # ``phase[:, k - first]`` is the sum of what comes before sample k
        self.phase = np.zeros((axes, self.capacity + 1))
        self._slope = np.zeros((axes, 1))

    @property
    def nbytes(self) -> int:
        """Memory in bytes; it never changes."""
        return self.stamps.nbytes + self.values.nbytes + self.phase.nbytes

    @property
    def room(self) -> int:
        """Samples that fit before older ones have to go."""
        return self.capacity - (self.end - self.first)

    def write(self, piece: Piece) -> None:
        """Append samples, at most `room`."""
        stamps, values = piece.stamps, piece.values
        n = stamps.size
        place = self.end - self.first
        if self.end == 0:
            self._slope = values[:, :1].copy()
        self.stamps[place : place + n] = stamps
        self.values[:, place : place + n] = values
        step = self.phase[:, place + 1 : place + 1 + n]
        np.subtract(values, self._slope, out=step)
        np.cumsum(step, axis=1, out=step)
        step += self.phase[:, place : place + 1]
        for index, gap in zip(piece.breaks, piece.steps, strict=True):
            self.breaks.append(self.end + index)
            self.steps.append(gap)
            if gap < 0:
                self.floor = self.end + index
        self.end += n

    def mark(self) -> tuple[int, int, int]:
        """Return where the ring ends, for `rollback`."""
        return self.end, len(self.breaks), self.floor

    def rollback(self, mark: tuple[int, int, int]) -> None:
        """Take back the samples written since `mark`."""
        self.end, count, self.floor = mark
        del self.breaks[count:], self.steps[count:]

    def clear(self) -> None:
        """Forget everything."""
        self.first = self.end = self.floor = 0
        self.breaks.clear()
        self.steps.clear()

    def since(self, window_ns: int) -> int:
        """
        Return the number of the first sample less than `window_ns` before the newest.

        Samples before the clock was set back do not count.
        """
        low, high = max(self.floor - self.first, 0), self.end - self.first
        if low >= high:
            return self.end
        stamps = self.stamps[low:high]
        oldest = int(np.searchsorted(stamps, stamps[-1] - window_ns, side='right'))
        return self.first + low + max(oldest, high - low - self.window)

    def overrun(self, window_ns: int) -> bool:
        """Return whether samples that belong to the window had to go."""
        oldest = self.since(window_ns)
        full = self.end - oldest >= self.window or oldest == self.first > 0
        return full and bool(
            self.stamps[self.end - self.first - 1] - self.stamps[oldest - self.first]
            < 0.99 * window_ns
        )

    def stamps_from(self, start: int) -> Integers:
        """Return the stamps from one sample on."""
        return self.stamps[start - self.first : self.end - self.first]

    def breaks_from(self, start: int) -> tuple[Integers, Floats]:
        """Return the breaks after one sample, as indices counted from it, and their steps."""
        after = bisect_right(self.breaks, start)
        breaks = np.array(self.breaks[after:], dtype=np.int64) - start
        return breaks, np.array(self.steps[after:], dtype=np.float64)

    def make_room(self, oldest: int) -> None:
        """Drop the samples before `oldest`, or more if the window does not hold the rest."""
        oldest = max(oldest, self.end - self.window)
        drop, size = oldest - self.first, self.end - oldest
        for row in (self.stamps, *self.values):
            row[:size] = row[drop : drop + size]
        self.first = oldest
        gone = bisect_right(self.breaks, oldest)
        del self.breaks[:gone], self.steps[:gone]
        if size:
            self._integrate(self.values[:, :size].mean(axis=1, keepdims=True))

    def check(self, count: int) -> None:
        """Take the integral anew if it ran away in the newest `count` samples."""
        size = self.end - self.first
        blocks = count // QUIET
        if blocks == 0:
            return
        newest = self.values[:, size - blocks * QUIET : size].reshape(-1, blocks, QUIET)
        steps = np.diff(newest, axis=2)
        power = np.einsum('ijk,ijk->ij', steps, steps) / (QUIET - 1)
        still = np.where(power > 0.0, power, np.inf)
        quietest = np.argmin(still, axis=1)
        noise = np.sqrt(np.min(still, axis=1))
        if np.any(np.abs(self.phase[:, size]) > RUNAWAY * noise):
            level = newest[np.arange(newest.shape[0]), quietest].mean(axis=1)
            self._integrate(level[:, None])

    def _integrate(self, slope: Floats) -> None:
        size = self.end - self.first
        self._slope = slope
        backwards = self.phase[:, size - 1 :: -1][:, :size]
        np.subtract(slope, self.values[:, size - 1 :: -1][:, :size], out=backwards)
        np.cumsum(backwards, axis=1, out=backwards)
        self.phase[:, size] = 0.0

    def runs(self, start: int, low: int, high: int) -> Iterator[tuple[int, int]]:
        """
        Give first and one past the last sample of the runs with a sample from low to high.

        Samples before `start` do not count.
        """
        after = bisect_right(self.breaks, max(low, start))
        first = max(start, self.breaks[after - 1]) if after else start
        for place in self.breaks[after : bisect_right(self.breaks, high - 1)]:
            yield first, place
            first, after = place, after + 1
        yield first, self.breaks[after] if after < len(self.breaks) else self.end


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
