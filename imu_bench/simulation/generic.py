# SPDX-License-Identifier: Apache-2.0
"""
A simulated sensor without a chip, for sensors that have no driver yet.

It behaves towards the acquisition as a driver does, with a FIFO of one second.
Rate, noise and errors all come from the sensor's file; nothing is quantised
into registers and no bus is between.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING

from imu_bench.bus.interface import Clock
from imu_bench.config import REQUIRED, Setting
from imu_bench.samples import Samples
import numpy as np

if TYPE_CHECKING:
    # who only asks for its settings needs none of what simulation needs
    from imu_bench.simulation.chip import SensorSource

SETTINGS = (
    Setting('rate_hz', REQUIRED, 'Output data rate.', (), (0.1, 50e3), 'Hz', 'float'),
    Setting('title', 'generic source', 'What the sensor is called.'),
)
"""What the file of a generic source may set beside the settings of every sensor."""

FIFO_S = 1.0
POLL_S = 0.02


class GenericSensor:
    """
    A driver in appearance: hands over what the source made since the last look.

    Parameters
    ----------
    clock : Clock
        The clock on which the source samples.
    settings : mapping
        Checked values of `SETTINGS`.
    """

    def __init__(self, source: SensorSource, clock: Clock, settings: Mapping[str, object]) -> None:
        self.title = str(settings['title'])
        self.counters: Counter[str] = Counter(bus_errors=0, fifo_overflows=0)
        self.continuity = 0
        self.dated = True
        self.skipped: dict[int, int] = {}
        self.edge: tuple[int, int] | None = None
        self.latch_ns: int | None = None
        self._source = source
        self._clock = clock
        self._depth = max(1, round(FIFO_S * source.nominal_hz))

    @property
    def rate_hz(self) -> float:
        """Nominal output data rate."""
        return self._source.nominal_hz

    @property
    def rates_hz(self) -> Mapping[str, float]:
        """Every quantity comes at the main rate."""
        return {}

    @property
    def paced(self) -> bool:
        """The source has its own oscillator."""
        return False

    @property
    def poll_period_s(self) -> float:
        """Some samples at a time, and a slow sensor not needlessly often."""
        return max(POLL_S, 0.5 / self.rate_hz)

    def identify(self) -> str:
        """Return the name given in the file."""
        return self.title

    def configure(self) -> None:
        """Nothing is there to be configured."""

    def start(self) -> None:
        """Start sampling now."""
        self._source.restart(self._clock.now_ns())
        self.continuity += 1

    def stop(self) -> None:
        """Nothing runs on by itself."""

    def close(self) -> None:
        """No bus is held."""

    def read(self) -> list[Samples]:
        """Return everything new; of more than a second the oldest is lost, as in a FIFO."""
        now = self._clock.now_ns()
        run = self._source.samples_until(now)
        if len(run) > self._depth:
            run = run[-self._depth :]
            self.counters['fifo_overflows'] += 1
            self.continuity += 1
        return [self._stamped(run, now)]

    def _stamped(self, run: Samples, now: int) -> Samples:
        """Return the run with what a host would know: when it looked, and the nominal rate."""
        ages = np.arange(len(run) - 1, -1, -1) * (1e9 / self.rate_hz)
        guesses = np.asarray(now - np.rint(ages).astype(np.int64))
        columns = {quantity: getattr(run, quantity) for quantity in self._source.quantities}
        return Samples(stamps=guesses, **columns)
