# SPDX-License-Identifier: Apache-2.0
"""Which samples of a microcontroller are missing: its counter, its clock, or both."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

COUNTS = 1 << 16
"""Where a counter of 16 bits begins anew; one of 32 bits does, too."""

TICKS = 1 << 32
"""Where micros() and millis() of an Arduino begin anew."""

APART = 0.5
"""Periods by which a sample may be late."""

CLOCK = 0.02
"""Assumed relative error of its clock over a gap: a ceramic resonator is good to 0.5 %."""

_Numbers = npt.NDArray[np.int64]


class Counted(NamedTuple):
    """
    What the numbers of some samples say.

    Attributes
    ----------
    missing : ndarray of int64, shape (n,)
        Samples that are missing before each; of those up to a jump.
    ages_ns : ndarray of int64, shape (n,)
        How much earlier than the last of them each was taken.
    jumped : bool
        The microcontroller began anew behind these.
    """

    missing: _Numbers
    ages_ns: _Numbers
    jumped: bool


class SampleCounter:
    """
    Follows the numbers from sample to sample.

    Parameters
    ----------
    rate_hz : float

    Examples
    --------
    >>> counter = SampleCounter(100.0)
    >>> found = counter.take(3, np.array([65534, 65535, 2]), np.array([100, 10100, 40100]), None)
    >>> found.missing.tolist(), found.ages_ns.tolist()
    ([0, 0, 2], [40000000, 30000000, 0])
    """

    def __init__(self, rate_hz: float) -> None:
        self._period_us = 1e6 / rate_hz
        self.begin()

    def begin(self) -> None:
        """Take the next sample as the first one."""
        self._last: tuple[int, int] | None = None

    def take(
        self, n: int, count: _Numbers | None, us: _Numbers | None, ms: _Numbers | None
    ) -> Counted:
        """
        Return what is missing; without any numbers that is nothing.

        Parameters
        ----------
        n : int
            Samples, one at least.
        count, us, ms : ndarray of int64, shape (n,), or None
            Number of each sample, and its time in µs or ms.
        """
        ticks, tick_us = (us, 1.0) if us is not None else (ms, 1e3)
        period = self._period_us / tick_us
        zeros = np.zeros(n, dtype=np.int64)
        counts, times = (zeros if given is None else given for given in (count, ticks))
        if self._last is None:
            self._last = int(counts[0]) - 1, int(times[0]) - round(period)
        steps = np.diff(counts, prepend=self._last[0]) % COUNTS
        passed = np.diff(times, prepend=self._last[1]) % TICKS
        self._last = int(counts[-1]), int(times[-1])
        elapsed = passed / period
        if count is None:
            steps = np.maximum(np.rint(elapsed) if ticks is not None else 1, zeros + 1).astype(int)
        off = (steps == 0) | (steps > COUNTS // 2)
        if ticks is not None:
            off |= passed > TICKS // 2
            # a loop that was late has left out what it does not count
            late = elapsed - steps > APART + CLOCK * steps
            steps = np.where(late, np.rint(elapsed), steps).astype(np.int64)
        jumps = np.flatnonzero(off)
        good = int(jumps[0]) if jumps.size else n
        in_us = passed if us is not None else steps * self._period_us
        at = np.cumsum(in_us[:good])
        ages = np.rint(1e3 * (at[-1:] - at)).astype(np.int64)
        return Counted(steps[:good] - 1, ages, bool(jumps.size))
