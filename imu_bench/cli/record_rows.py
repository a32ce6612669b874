# SPDX-License-Identifier: Apache-2.0
"""What is shown of each sensor or topic while it is recorded, and the verdict on it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
import math
from statistics import median
import time
from typing import NamedTuple, TYPE_CHECKING

from imu_bench.acquisition.stats import RATE_TOLERANCE
from imu_bench.cli.live import digits
from imu_bench.offline.notation import count, duration, grouped

if TYPE_CHECKING:
    from imu_bench.nodes.bench_monitor import RecorderView, SensorView

SILENT_S = 5.0
"""A node says something every second; after so long without a word something is wrong."""

UNEVEN_S = 0.25
"""Samples come in bursts, and are counted once a second: so much is no lack of them."""

WINDOW = 10
"""Counts over which the rate of a topic is taken, one a second."""


STARTED_S = 1.0
"""What a sensor publishes so soon, before the recorder has found it, is not in the bag."""


class Verdict(NamedTuple):
    """What came of one row: a line for the user, and what is wrong, empty if nothing is."""

    line: str
    fault: str


class Row(ABC):
    """
    A sensor or a topic that is recorded.

    Attributes
    ----------
    name, topic : str
        What the user calls it, and the topic whose messages count.
    died : str
        Why its node has ended; empty while it runs.
    plays : bool
        Its node plays a wire recording, and ends by itself when that is over.
    over : bool
        Whether its node has ended so.
    """

    def __init__(self, name: str, recorder: RecorderView, topic: str) -> None:
        self.name, self.topic = name, topic
        self.plays = False
        self.died, self.over = '', False
        self._recorder = recorder

    @property
    @abstractmethod
    def publishing(self) -> bool:
        """Whether anything has come."""

    @property
    @abstractmethod
    def silent_s(self) -> float:
        """Seconds since anything was heard of it."""

    @abstractmethod
    def begin(self) -> None:
        """Count from now on."""

    @abstractmethod
    def cells(self) -> tuple[str, str, str]:
        """Return rate, the rate there should be, and what was lost."""

    @abstractmethod
    def verdict(self, stored: int | None, ended_s: float) -> Verdict:
        """
        Judge what is in the bag.

        Parameters
        ----------
        stored : int or None
            Messages of the topic; None if the bag was not finished.
        ended_s : float
            End of the recording on the clock of `time.monotonic`.
        """

    def _messages(self, stored: int | None) -> str:
        if stored is not None:
            return count(stored, 'message')
        return f'{count(self._recorder.stored(self.topic), "message")} at the last count'

    def shown(self) -> tuple[str, str, str]:
        """Return the cells, and in place of a rate that is none why it is none."""
        rate, nominal, lost = self.cells()
        if self.died or self.over:
            rate = 'ENDED' if self.died else 'over'
        elif SILENT_S < self.silent_s < math.inf:
            rate = f'silent {self.silent_s:.0f} s'
        return rate, nominal, lost


class SensorRow(Row):
    """
    A sensor of the bench, by what its node says of itself.

    Parameters
    ----------
    view : SensorView
    recorder : RecorderView
    topic : str
    plays : bool
        As in `Row`.
    """

    def __init__(
        self, view: SensorView, recorder: RecorderView, topic: str, *, plays: bool = False
    ) -> None:
        super().__init__(view.name, recorder, topic)
        self._view, self.plays = view, plays
        self._first, self._first_s = 0.0, -math.inf

    @property
    def publishing(self) -> bool:
        """Whether samples have come, and are recorded."""
        return self._view.publishing and self._recorder.stored(self.topic) > 0

    @property
    def silent_s(self) -> float:
        """Seconds since its node was heard."""
        return time.monotonic() - self._view.heard_s

    @property
    def trouble(self) -> str:
        """What its node says is wrong with the sensor now; empty if nothing is."""
        return self._view.message if self._view.level >= 2 and self.publishing else ''

    def begin(self) -> None:
        """Count from now on."""
        self._first, self._first_s = self._view.number('samples'), self._view.heard_s

    def cells(self) -> tuple[str, str, str]:
        """Return rate, nominal rate and samples lost, as the node says."""
        view = self._view
        delivered, nominal = view.number('delivered_hz'), view.number('nominal_hz')
        lost = view.number('lost')
        lost_text = '' if math.isnan(lost) else grouped(int(lost))
        return digits(delivered, '.1f'), digits(nominal, '.0f'), lost_text

    def verdict(self, stored: int | None, ended_s: float) -> Verdict:
        """Judge from the samples that came since the beginning, and those that were lost."""
        view = self._view
        published, nominal = self._published(), view.number('nominal_hz')
        missed = 0 if stored is None else max(0, int(published) - stored)
        lost = max(0, int(view.values.get('lost', '0')))
        rate, least = self._rate(ended_s)
        slow = rate < least or missed > STARTED_S * nominal + RATE_TOLERANCE * published
        fault = self._fault(slow, ended_s)
        # the latest is the finer one, but may have in it what was lost before the beginning
        seen = rate if fault else max(rate, view.number('delivered_hz'))
        kept = f'{"did NOT keep" if fault else "kept"} its rate ({seen:.1f} of {nominal:.0f} Hz)'
        gone = f'{grouped(lost)} lost' if lost or fault else 'nothing lost'
        if missed > STARTED_S * nominal:
            gone += f', {grouped(missed)} more did not reach the recorder'
        why = f'; {fault}' if fault and fault != _SLOW else ''
        line = f'{self.name}: {self._messages(stored)}, {kept}, {gone}{why}'
        return Verdict(line, fault and f'{self.name} {fault}')

    def _published(self) -> float:
        published = self._view.number('published.imu/data_raw')
        return 0.0 if math.isnan(published) else published

    def _rate(self, ended_s: float) -> tuple[float, float]:
        """Return the mean rate since the beginning, and the least that counts as kept."""
        view = self._view
        heard = self.over or (ended_s - view.heard_s < SILENT_S and not self.died)
        span_s = (view.heard_s if heard else ended_s) - self._first_s
        nominal, true = view.number('nominal_hz'), view.number('rate_hz')
        least = (1.0 - RATE_TOLERANCE) * (nominal if math.isnan(true) else true)
        if span_s <= 1.0:  # one count, no rate of its own
            return view.number('delivered_hz'), least
        rate = (view.number('samples') - self._first) / span_s
        return rate, least * max(0.0, 1.0 - UNEVEN_S / span_s)

    def _fault(self, slow: bool, ended_s: float) -> str:
        if self.died:
            return self.died
        silent_s = ended_s - self._view.heard_s
        if silent_s > SILENT_S and not self.over:
            return f'had said nothing for {duration(silent_s)}'
        if self.trouble:
            return f'gave nothing in the end: {self.trouble}'
        return _SLOW if slow else ''


_SLOW = 'did not keep its rate'


class TopicRow(Row):
    """
    A topic that somebody publishes, by what the recorder says it has stored.

    What its rate should be is not known: it is measured by the typical second with messages.

    Parameters
    ----------
    recorder : RecorderView
    topic : str
    """

    def __init__(self, recorder: RecorderView, topic: str) -> None:
        super().__init__(topic, recorder, topic)
        self._counts: deque[tuple[float, int]] = deque(maxlen=WINDOW + 1)
        self._rates: list[float] = []
        self._first = (-math.inf, 0)
        self._grown_s = -math.inf

    def hear(self) -> None:
        """Take note of what is stored now, if the recorder has said something new."""
        heard_s, stored = self._recorder.heard_s, self._recorder.stored(self.topic)
        if self._counts and heard_s <= self._counts[-1][0]:
            return
        if self._counts:
            before_s, before = self._counts[-1]
            if stored > before:
                self._grown_s = heard_s
                if before:  # the first second of a topic is not a whole one
                    self._rates.append((stored - before) / (heard_s - before_s))
        self._counts.append((heard_s, stored))

    @property
    def publishing(self) -> bool:
        """Whether messages are stored."""
        return self._recorder.stored(self.topic) > 0

    @property
    def silent_s(self) -> float:
        """Seconds since a message was stored."""
        return time.monotonic() - self._grown_s

    def begin(self) -> None:
        """Count from now on."""
        self.hear()
        self._first = self._counts[-1]
        self._grown_s = self._first[0]

    def cells(self) -> tuple[str, str, str]:
        """Return the rate of the last seconds and of a typical one; losses are not known."""
        (first_s, first), (last_s, last) = self._counts[0], self._counts[-1]
        rate = (last - first) / (last_s - first_s) if last_s > first_s else math.nan
        return digits(rate, '.1f'), digits(self._typical(), '.1f'), ''

    def _typical(self) -> float:
        return median(self._rates) if self._rates else math.nan

    def verdict(self, stored: int | None, ended_s: float) -> Verdict:
        """Judge by whether it came to the end as it came in a typical second."""
        (first_s, first), (last_s, last) = self._first, self._counts[-1]
        typical, span_s = self._typical(), last_s - first_s
        text = f'{self.name}: {self._messages(stored)}'
        if math.isnan(typical) or span_s < 1.0:
            return Verdict(f'{text}, too short to tell a rate', '')
        rate, least = (last - first) / span_s, (1.0 - RATE_TOLERANCE) * typical
        silent_s = ended_s - self._grown_s
        fault = ''
        if silent_s > SILENT_S:
            fault = f'nothing came in the last {duration(silent_s)}'
        elif rate < least * (1.0 - UNEVEN_S / span_s):
            fault = _SLOW
        kept = 'did NOT keep its rate' if fault else 'kept its rate'
        why = f'; {fault}' if fault and fault != _SLOW else ''
        line = f'{text}, {kept} ({rate:.1f} Hz, typically {typical:.1f}){why}'
        return Verdict(line, fault and f'{self.name}: {fault}')
