# SPDX-License-Identifier: Apache-2.0
"""
Which frames of an Xsens motion tracker are missing: its packet counter against its clock.

Document: MT Low-Level Communication Protocol, MT0101P 2020.A (LLCP), section 5.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

COUNTS = 1 << 16
"""Where PacketCounter begins anew."""

TICKS_PER_S = 10_000
"""Of SampleTimeFine."""

TICKS_A_DAY = 864_000_000
"""Where SampleTimeFine begins anew."""

TICK_NS = 1_000_000_000 // TICKS_PER_S


class Counted(NamedTuple):
    """What the counters of some frames say."""

    missing: npt.NDArray[np.int64]  # frames that are missing before each; of those up to a jump
    ages_ns: npt.NDArray[np.int64]  # how much earlier than the last of them each was sampled
    jumped: bool  # counter and clock contradict each other after these: the device began anew


class FrameCounter:
    """
    Follows the counters from frame to frame.

    Examples
    --------
    >>> frames = FrameCounter(400.0)
    >>> frames.take(np.array([65534, 65535, 2]), np.array([100, 125, 200])).missing.tolist()
    [0, 0, 2]
    """

    def __init__(self, rate_hz: float) -> None:
        self._period = round(TICKS_PER_S / rate_hz)
        self._last: tuple[int, int] | None = None

    def begin(self) -> None:
        """Take the next frame as the first one."""
        self._last = None

    def take(self, counter: npt.NDArray[np.int64], ticks: npt.NDArray[np.int64]) -> Counted:
        """
        Return what is missing.

        Parameters
        ----------
        counter, ticks : ndarray of int64, shape (n,)
            PacketCounter and SampleTimeFine of frames in their order, one at least.
        """
        if self._last is None:
            self._last = int(counter[0]) - 1, int(ticks[0]) - self._period
        before = np.array(self._last)[:, np.newaxis]
        steps, passed = np.diff(np.hstack([before, np.stack([counter, ticks])]))
        steps, passed = steps % COUNTS, passed % TICKS_A_DAY
        off = np.abs(passed - steps * self._period) > self._period / 2
        jumps = np.flatnonzero(off | (steps == 0))
        n = int(jumps[0]) if jumps.size else counter.size
        self._last = int(counter[-1]), int(ticks[-1])
        ages = (ticks[n - 1] - ticks[:n]) % TICKS_A_DAY * TICK_NS
        return Counted(steps[:n] - 1, ages, bool(jumps.size))
