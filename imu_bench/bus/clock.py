# SPDX-License-Identifier: Apache-2.0
"""The time of this computer."""

from __future__ import annotations

import time

from imu_bench.bus.interface import Clock


class SystemClock(Clock):
    """
    Time since the epoch that never steps.

    It is read once at the start and runs on the monotonic clock from there, so that a
    correction by NTP does not tear a recording apart.

    Examples
    --------
    >>> clock = SystemClock()
    >>> before = clock.now_ns()
    >>> clock.sleep_until(before + 1_000_000)
    >>> clock.now_ns() - before >= 1_000_000
    True
    """

    def __init__(self) -> None:
        self._epoch_ns = time.time_ns() - time.monotonic_ns()

    def now_ns(self) -> int:
        """Return nanoseconds since the epoch; never steps backwards."""
        return self._epoch_ns + time.monotonic_ns()

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at `deadline_ns`, or at once when that has passed."""
        while (left := deadline_ns - self.now_ns()) > 0:
            time.sleep(left * 1e-9)
