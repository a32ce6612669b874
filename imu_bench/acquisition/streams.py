# SPDX-License-Identifier: Apache-2.0
"""The streams of one sensor: each with its own rate and its own way to its stamps."""

from __future__ import annotations

from dataclasses import fields, replace

from imu_bench.acquisition.clock_model import ClockModel
from imu_bench.acquisition.stats import IntervalMeter
from imu_bench.samples import Samples
import numpy as np

QUANTITIES = tuple(field.name for field in fields(Samples) if field.name != 'stamps')


def quantities(run: Samples) -> tuple[str, ...]:
    """
    Return which quantities a run carries; it tells the streams of a sensor apart.

    Examples
    --------
    >>> quantities(Samples(stamps=[0], temperature=[21.0]))
    ('temperature',)
    """
    return tuple(name for name in QUANTITIES if getattr(run, name) is not None)


class CountedStream:
    """A stream whose samples all pass through the chip's counter or FIFO: the clock model's."""

    def __init__(self, nominal_hz: float) -> None:
        self.model = ClockModel(nominal_hz)
        self.meter = IntervalMeter(nominal_hz)
        self._held: list[Samples] = []

    def push(self, run: Samples) -> list[Samples]:
        """Take a run that was just read; return the runs whose stamps are settled."""
        if len(run):
            self._held.append(run)
            self.model.observe(len(run), int(run.stamps[-1]))
        return [] if self.model.settling else self._release()

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
        stamped = [replace(run, stamps=self.model.stamps(len(run))) for run in held]
        for run in stamped:
            self.meter.add(run.stamps)
        return stamped


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
        steps = np.arange(len(run) + 1)
        guesses = np.concatenate([[self._last], run.stamps])
        stamps = (np.maximum.accumulate(guesses - steps) + steps)[1:]
        self._last = int(stamps[-1])
        return [replace(run, stamps=stamps)]

    def interrupt(self) -> list[Samples]:
        """Nothing is held back."""
        return []

    def flush(self) -> list[Samples]:
        """Nothing is held back."""
        return []
