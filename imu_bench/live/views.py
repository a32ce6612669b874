# SPDX-License-Identifier: Apache-2.0
"""What sensors and recorder of a running bench say of themselves, as those see it who watch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
import math
import time

from imu_bench.account import (
    BESIDE,
    counts,
    flooded,
    LEFT_OUT,
    RATE_TOLERANCE,
    RECORDERS,
    SECOND,
    SEVERAL,
    several,
    several_record,
    Tally,
    TURNED_AWAY,
)


@dataclass
class SensorView:
    """The latest that one sensor's node and the analysis node said of it."""

    name: str
    level: int = 3
    message: str = 'has not been heard of'
    values: dict[str, str] = field(default_factory=dict)
    noise: dict[str, float] = field(default_factory=dict)
    """Mean one-sided noise density of the axes there are, SI, by quantity."""
    faults: dict[int, dict[str, str]] = field(default_factory=dict)
    """What is known of each scripted fault, as `imu_bench.nodes.fault_report` has it."""
    recovered_s: float = -math.inf
    """When the latest recovery from a fault was heard of, on the clock of `time.monotonic`."""
    heard_s: float = -math.inf
    """When the values were heard, on the same clock."""
    unanalysed: int = 0
    """Messages that the analysis node has missed."""
    tally: Tally = field(default_factory=Tally)
    """What it has counted, over all of its lives."""

    def hear(self, level: int, message: str, values: Mapping[str, str]) -> None:
        """Take note of what is said of its acquisition, with the level of a DiagnosticStatus."""
        self.level, self.message, self.values = level, message, dict(values)
        self.tally.hear(counts(self.values))
        self.heard_s = time.monotonic()

    def number(self, key: str) -> float:
        """Return a diagnostic value as a number; NaN when there is none."""
        try:
            return float(self.values[key].split()[0])
        except (KeyError, ValueError, IndexError):
            return math.nan

    def hear_of_faults(self, values: Mapping[str, str]) -> None:
        """Take note of what the sensor's node says of its faults, by '<number>.<key>'."""
        for path, value in values.items():
            number, _, key = path.partition('.')
            if not number.isdecimal():  # somebody else says this
                continue
            fault = self.faults.setdefault(int(number), {})
            if key == 'state' and value == 'recovered' != fault.get(key):
                self.recovered_s = time.monotonic()
            fault[key] = value

    @property
    def played(self) -> bool:
        """Whether it has nothing more to give, because what it plays is over."""
        return self.level == 0 and self.values.get('state') == 'stopped'

    @property
    def publishing(self) -> bool:
        """Whether samples have arrived."""
        return self.number('samples') > 0

    @property
    def expected_hz(self) -> float:
        """
        The least of the rates that it can be held to: as set, and as its chip makes them.

        A chip that is faster than it was set gives what was asked for even if some is lost.
        """
        nominal, true = self.number('nominal_hz'), self.number('rate_hz')
        return nominal if math.isnan(true) else min(nominal, true)

    @property
    def at_full_rate(self) -> bool:
        """Whether samples arrive now at the rate at which they should."""
        return self.number('delivered_hz') >= (1 - RATE_TOLERANCE) * self.expected_hz

    @property
    def begun_faults(self) -> list[dict[str, str]]:
        """The scripted faults that have begun."""
        return [fault for fault in self.faults.values() if fault.get('state') != 'planned']

    @property
    def lost_by_faults(self) -> int:
        """Samples that the scripted faults have cost."""
        return sum(counts(fault).get('lost', 0) for fault in self.begun_faults)


@dataclass
class RecorderView:
    """The latest that the recorder of one bag said."""

    bag: str = ''
    message: str = ''
    failed: bool = False
    values: dict[str, str] = field(default_factory=dict)
    heard_s: float = -math.inf
    """When it was heard, on the clock of `time.monotonic`."""

    def hear(self, failed: bool, message: str, values: Mapping[str, str]) -> None:
        """Take note of what the recorder says."""
        self.failed, self.message, self.values = failed, message, dict(values)
        self.heard_s = time.monotonic()

    def stored(self, topic: str) -> int:
        """Return how many messages of a topic are on the disk."""
        return self.counts.get(f'stored.{topic}', 0)

    @property
    def counts(self) -> dict[str, int]:
        """Everything that it counts."""
        return counts(self.values)

    @property
    def several(self) -> list[str]:
        """A line for each topic of one sensor that several publish, with their names."""
        return [
            several(key.removeprefix(SEVERAL), names)
            for key, names in self.values.items()
            if key.startswith(SEVERAL)
        ]

    @property
    def others(self) -> str:
        """A line for those who record the same; empty if nobody does."""
        names = self.values.get(RECORDERS)
        return several_record(names, self.values.get(SECOND, '')) if names else ''

    @property
    def two_of_ours(self) -> bool:
        """Whether one of those is a recorder like this one: a bench has one."""
        return bool(self.others and self.values.get(SECOND))

    @property
    def flooded(self) -> str:
        """A line for what was said on /diagnostics and is too much; empty if nothing is."""
        left_out = self.counts.get(LEFT_OUT, 0)
        return flooded(left_out) if left_out else ''

    @property
    def beside(self) -> dict[str, int]:
        """Messages left out, by topic of others that is recorded beside a bench."""
        found = self.counts.items()
        return {key.removeprefix(BESIDE): n for key, n in found if key.startswith(BESIDE)}

    @property
    def turned_away(self) -> int:
        """Topics of others that are not recorded, because they are too many."""
        return self.counts.get(TURNED_AWAY, 0)

    @property
    def dropped(self) -> int:
        """Messages that came faster than the disk took them."""
        return self.counts.get('dropped', 0)
