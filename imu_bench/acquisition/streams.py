# SPDX-License-Identifier: Apache-2.0
"""The streams of one sensor, each with its own rate and way to its stamps, and when it is read."""

from __future__ import annotations

from imu_bench.acquisition.clock_model import ClockModel
from imu_bench.acquisition.device import Device
from imu_bench.acquisition.stats import IntervalMeter
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
from imu_bench.samples import Samples
import numpy as np
import numpy.typing as npt


class CountedStream:
    """A stream whose samples all pass through the chip's counter or FIFO: the clock model's."""

    def __init__(self, nominal_hz: float) -> None:
        self.model = ClockModel(nominal_hz)
        self.meter = IntervalMeter(nominal_hz)
        # runs that wait, each with how many samples are missing before it
        self._held: list[tuple[int, Samples]] = []
        self._skipped = 0
        self._last_ns: int | None = None
        self._anew = False
        self._arrivals: Arrivals | None = None

    def skip(self, n: int) -> None:
        """Take note of samples that the chip counted and that never arrived."""
        self.model.skip(n)
        self._skipped += n

    def push(
        self, run: Samples, edge: tuple[int, int] | None = None, latch_ns: int | None = None
    ) -> list[Samples]:
        """Take a run that was just read; return the runs whose stamps are settled."""
        if len(run):
            self._held.append((self._skipped, run))
            self._skipped, self._arrivals = 0, None
            self.model.observe(len(run), int(run.stamps[-1]), edge, latch_ns)
        return [] if self.model.settling else self._release()

    def push_undated(self, run: Samples) -> list[Samples]:
        """
        Take a run of which nobody knows which samples they are; return it, and what was held back.

        Its stamps stand, time tells how many are missing, and the model begins anew after it.
        """
        if not len(run):
            return []
        held, nominal_hz = self.flush(), self.model.nominal_hz
        stamps = run.stamps
        if self._last_ns is not None and stamps[0] <= self._last_ns:
            stamps = np.maximum(stamps, self._last_ns + 1 + np.arange(len(run)))
        if self._arrivals is None:
            self._arrivals = Arrivals(nominal_hz)
            if self._last_ns is not None:
                self._arrivals.observe(np.array([self._last_ns]))
        before = self._arrivals.missing
        self._arrivals.observe(stamps)
        self._last_ns = int(stamps[-1])
        missing = self.model.missing + self._arrivals.missing - before
        self.model, self._anew = self.model.successor(missing, self._last_ns), True
        self.meter.add(stamps)
        return [*held, run.restamped(stamps)]

    def interrupt(self) -> list[Samples]:
        """Take note of a loss; return what was held back before it."""
        held = self.flush()
        self.model.interrupt()
        return held

    def flush(self) -> list[Samples]:
        """Return what is held back, with the stamps that are known so far."""
        self.model.settle()
        return self._release() if self._held else []

    def _release(self) -> list[Samples]:
        held, self._held = self._held, []
        stamped = [run.restamped(self.model.stamps(len(run), gap)) for gap, run in held]
        if self._anew and self._last_ns is not None:
            # of the pause before it the model knows nothing
            pause = (int(stamped[0].stamps[0]) - self._last_ns) / self.model.period_ns
            self.model.missing += max(0, round(pause) - 1)
            self._anew = False
        for run in stamped:
            self.meter.add(run.stamps)
            self._last_ns = int(run.stamps[-1])
        return stamped


class Arrivals:
    """How many are missing by the times of samples alone, where nobody knows which they are."""

    NEARLY = 0.05
    """Part of a period that a sample may come earlier than the earliest one so far."""

    def __init__(self, nominal_hz: float) -> None:
        self.missing = 0
        self._period_ns = 1e9 / nominal_hz
        self._due_ns: float | None = None

    def observe(self, stamps: npt.NDArray[np.int64]) -> None:
        """Take note of the times at which samples came; a late one is not a loss."""
        for t in stamps.tolist():
            due = t if self._due_ns is None else self._due_ns
            lost = max(0, int((t - due) / self._period_ns + self.NEARLY))
            self.missing += lost
            # what is due follows the earliest ones
            self._due_ns = min(due + lost * self._period_ns, t) + self._period_ns


class Pace:
    """The computer's own pace: in the place of a clock model where nothing counts the samples."""

    def __init__(self, nominal_hz: float) -> None:
        self.nominal_hz = nominal_hz
        self.missing = 0  # deadlines at which no sample was taken
        self._period_ns = 1e9 / nominal_hz
        self._last_ns: int | None = None
        self._last_due_ns = 0
        self._anew = False

    def observe(self, stamps: npt.NDArray[np.int64], due_ns: int) -> None:
        """
        Take note of the times of samples, and of the deadline at which they were taken.

        A late sample is no loss: only a deadline without one is.  After a restart the deadlines
        begin anew, and what was lost is the time that has passed.
        """
        if self._last_ns is not None:
            passed = stamps[0] - self._last_ns if self._anew else due_ns - self._last_due_ns
            self.missing += max(0, round(float(passed) / self._period_ns) - 1)
        self._last_ns, self._last_due_ns, self._anew = int(stamps[-1]), due_ns, False

    def interrupt(self) -> None:
        """Take note that the deadlines begin anew."""
        self._anew = True

    def rate(self, confidence: float = CONFIDENCE) -> Estimate:
        """Return that there is none to be found out."""
        return Estimate.not_observable(
            'Hz', 'this computer sets the pace; see the delivered rate', confidence=confidence
        )

    def uncertainty(self) -> Estimate:
        """Return that nobody knows."""
        return Estimate.not_observable('s', 'this computer asks for each sample')


class PacedStream:
    """A stream whose samples are taken when the driver reads: their stamps stand."""

    def __init__(self, nominal_hz: float) -> None:
        self.model = Pace(nominal_hz)
        self.meter = IntervalMeter(nominal_hz)

    def skip(self, n: int) -> None:
        """Take note of samples that the driver knows to be lost."""
        self.model.missing += n

    def push(self, run: Samples, due_ns: int) -> list[Samples]:
        """Take a run that was just read, and the deadline at which; return it."""
        if not len(run):
            return []
        self.model.observe(run.stamps, due_ns)
        self.meter.add(run.stamps)
        return [run]

    def interrupt(self) -> list[Samples]:
        """Take note of a loss."""
        self.model.interrupt()
        return []

    def flush(self) -> list[Samples]:
        """Nothing is held back."""
        return []


def main_stream(nominal_hz: float, paced: bool) -> CountedStream | PacedStream:
    """Return the main stream of a sensor: paced by the host, or by the chip."""
    return PacedStream(nominal_hz) if paced else CountedStream(nominal_hz)


class PolledStream:
    """
    A stream beside the main one that is looked at now and then, such as a slow magnetometer.

    Nothing counts its samples, so the driver's stamps stand; they are only kept in order.
    """

    def __init__(self) -> None:
        self._last = -1

    def push(self, run: Samples) -> list[Samples]:
        """Take a run that was just read; return it in order."""
        if not len(run):
            return []
        if len(run) == 1 and run.stamps[0] > self._last:
            self._last = int(run.stamps[0])
            return [run]
        steps = np.arange(len(run) + 1)
        guesses = np.concatenate([[self._last], run.stamps])
        stamps = (np.maximum.accumulate(guesses - steps) + steps)[1:]
        self._last = int(stamps[-1])
        return [run.restamped(stamps)]

    def interrupt(self) -> list[Samples]:
        """Nothing is held back."""
        return []

    def flush(self) -> list[Samples]:
        """Nothing is held back."""
        return []


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
