# SPDX-License-Identifier: Apache-2.0
"""When a sensor is read."""

from __future__ import annotations

from imu_bench.acquisition.device import Device

GOLDEN = 0.6180339887498949
"""Fractional part of the golden ratio: its multiples fill an interval evenly (Weyl)."""

SILENCE_S = 0.5
"""A sensor that answers and delivers nothing for this long has lost its configuration."""


class Schedule:
    """
    Deadlines that are regular, but for a shift within one sample period.

    Reading in step with the chip would show the clock model the same phase
    over and over; shifts by multiples of the golden ratio show it every
    phase, so that some reading soon comes right after a sample.  Where the
    reading is the sample there is no shift.

    Deadlines that have passed are left out.  A chip that overwrites its only sample is read at
    once instead: where reading takes longer than a deadline allows, a pause would cost samples.
    """

    def __init__(self, device: Device, begun_ns: int) -> None:
        period_s = device.poll_period_s
        self.begun_ns = begun_ns  # when it was started
        self.due_ns = begun_ns  # deadline that is kept now; with a shift, see above, without it
        self.poll_ns = period_s * 1e9  # time between two deadlines
        # a device that answers and delivers nothing for so long is not well
        self.patience_s = max(SILENCE_S, 10 / device.rate_hz, 5 * period_s)
        self.late = 0  # readings that came more than one poll period after they were due
        self._reach_ns = 0.0 if device.paced else min(1e9 / device.rate_hz, 0.5 * self.poll_ns)
        self._overwrites = not device.paced and period_s * device.rate_hz < 1.0
        self._turn = 0

    def next_ns(self, now_ns: int) -> int:
        """Return the next deadline; now, if it has passed and nothing may be missed."""
        poll = self.poll_ns
        self._turn += 1
        passed = int((now_ns - self.begun_ns) // poll)
        self.late += self._turn + 1 <= passed
        if self._overwrites and passed >= self._turn:
            self._turn = passed
            return now_ns
        if self._turn + 1 <= passed:
            self._turn = passed + 1
        self.due_ns = self.begun_ns + round(self._turn * poll)
        return self.begun_ns + round(
            self._turn * poll + self._turn * GOLDEN % 1.0 * self._reach_ns
        )
