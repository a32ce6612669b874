# SPDX-License-Identifier: Apache-2.0
"""Time that passes when somebody waits: an hour of bench data in seconds."""

from __future__ import annotations

import threading

from imu_bench.errors import ConfigError

START_NS = 1_700_000_000_000_000_000
"""Default start, 2023-11-14 22:13:20 UTC: far from zero, as real stamps are."""


class SimulatedClock:
    """
    A clock that stands still until it is told to move.

    Who sleeps moves the time; nobody waits in reality.  It never steps
    backwards, and may be used from several threads.

    Examples
    --------
    >>> clock = SimulatedClock(start_ns=0)
    >>> clock.sleep(1.5)
    >>> clock.sleep_until(1_000_000_000)
    >>> clock.now_ns()
    1500000000
    """

    def __init__(self, start_ns: int = START_NS) -> None:
        self._now_ns = int(start_ns)
        self._lock = threading.Lock()

    def now_ns(self) -> int:
        """Return nanoseconds since the epoch."""
        return self._now_ns

    def sleep_until(self, deadline_ns: int) -> None:
        """Let time pass up to `deadline_ns`; nothing happens when that has passed."""
        with self._lock:
            self._now_ns = max(self._now_ns, int(deadline_ns))

    def sleep(self, seconds: float) -> None:
        """Let `seconds` pass, beside what others sleep meanwhile."""
        if seconds < 0:
            raise ConfigError(f'cannot sleep for {seconds} s')
        with self._lock:
            self._now_ns += round(seconds * 1e9)
