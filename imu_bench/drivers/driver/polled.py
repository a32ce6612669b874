# SPDX-License-Identifier: Apache-2.0
"""Chips that overwrite their registers and do not say when."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from imu_bench.bus.interface import Clock
from imu_bench.bus.updates import Look, Updates
from imu_bench.drivers.driver.base import Bus, Driver


class PolledDriver(Driver):
    """Base for a chip that overwrites its registers and does not say when: see `Updates`."""

    counter_names: ClassVar[tuple[str, ...]] = ('repeated', 'lost_samples', 'undated')

    def __init__(
        self, bus: Bus | Mapping[str, Bus], clock: Clock, settings: Mapping[str, object]
    ) -> None:
        super().__init__(bus, clock, settings)
        self.updates = Updates(self.rate_hz)

    @property
    def poll_period_s(self) -> float:
        """Return less than a period by what acquisition varies it, so that nothing is missed."""
        return 0.65 / self.rate_hz

    def start(self) -> None:
        """Start the stream."""
        super().start()
        self.updates.begin()

    def look(self, row: Any, before_ns: int, after_ns: int, words: bytes) -> Look:
        """Look for new samples and count; of those that are missing the acquisition learns."""
        look = self.updates.look(row, before_ns, after_ns, words)
        if len(look.rows):
            self.counters['repeated'] += look.repeated
            self.counters['lost_samples'] += look.skipped
            self.counters['undated'] += len(look.rows) * look.undated
            self.dated = not look.undated
        if look.lost_track:
            self.continuity += 1
        elif look.skipped:
            self.skipped[0] = look.skipped
        return look
