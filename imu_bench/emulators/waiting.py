# SPDX-License-Identifier: Apache-2.0
"""Short waits put together: a transfer on an emulated wire need not send its thread to sleep."""

from __future__ import annotations

from imu_bench.bus.interface import Clock

SHORT_NS = 1_000_000
"""
Waits up to this are put off.  A status register on I²C takes 0.1 to 0.2 ms; to sleep and to be
woken costs as much again in CPU time, and takes longer than asked for.
"""


class Waiting(Clock):
    """
    A clock that lets a few transfers pass before it really waits for them.

    Meanwhile it shows the time as it would be if it had waited, so that it runs ahead of the
    other one, by `SHORT_NS` at most; the next longer wait ends when it should.

    Parameters
    ----------
    clock : Clock
        On which waiting takes time.

    Examples
    --------
    >>> from imu_bench.simulation.clock import SimulatedClock
    >>> real = SimulatedClock(start_ns=0)
    >>> clock = Waiting(real)
    >>> clock.sleep(0.0004)
    >>> clock.now_ns(), real.now_ns()
    (400000, 0)
    >>> clock.sleep(0.0008)
    >>> clock.now_ns(), real.now_ns()
    (1200000, 1200000)
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._shown_ns = 0

    def now_ns(self) -> int:
        """Return nanoseconds since the epoch; never steps backwards."""
        return max(self._clock.now_ns(), self._shown_ns)

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at `deadline_ns`, or up to `SHORT_NS` before and show that time."""
        if deadline_ns - self._clock.now_ns() > SHORT_NS:
            self._clock.sleep_until(deadline_ns)
        self._shown_ns = max(self._shown_ns, deadline_ns)
