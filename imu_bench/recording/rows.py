# SPDX-License-Identifier: Apache-2.0
"""What is shown of each sensor or topic while it is recorded, and the verdict on it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
import math
from statistics import median
import time
from typing import NamedTuple, TYPE_CHECKING

from imu_bench.account import (
    Account,
    MISSED,
    NOTHING,
    of_sensor,
    PUBLISHED,
    RATE_TOLERANCE,
    topic,
    UNTIL,
)
from imu_bench.acquisition.stats import WINDOW_S
from imu_bench.counting import count, grouped
from imu_bench.nodes.topic_names import SUFFIXES
from imu_bench.offline.notation import duration
from imu_bench.units import convert
from msg_conversions.quantities import ANGULAR_VELOCITY, LINEAR_ACCELERATION

if TYPE_CHECKING:
    from collections.abc import Mapping

    from imu_bench.live.views import RecorderView, SensorView

SILENT_S = 5.0
"""A node says something every second; after so long without a word something is wrong."""

UNEVEN_S = 0.25
"""Samples come in bursts, and are counted once a second: so much is no lack of them."""

WINDOW = 10
"""Counts over which the rate of a topic is taken, one a second."""

LATE_S = 1.0
"""So much later than a recovery its samples may have left the rate's window."""

_NOISE = {
    LINEAR_ACCELERATION.name: ('m/s²/√Hz', 'µg/√Hz', '.0f'),
    ANGULAR_VELOCITY.name: ('rad/s/√Hz', 'm°/s/√Hz', '.1f'),
}
"""Unit of a noise density, the one it is shown in, and its format."""

_SLOW = 'did not keep its rate'


class Cells(NamedTuple):
    """What the table shows of a row; an empty text where there is nothing to show."""

    rate: str
    nominal: str
    lost: str = ''
    noise: tuple[str, ...] = ('', '')


class Verdict(NamedTuple):
    """What came of one row: a line for the user, what is wrong, and where its samples are."""

    line: str
    faults: list[str]
    account: Account


class Row(ABC):
    """A sensor or a topic that is recorded."""

    def __init__(self, name: str, recorder: RecorderView, topic: str) -> None:
        # name, topic: what the user calls it, and the topic whose messages count
        self.name, self.topic = name, topic
        self.plays = False  # its node plays a wire recording, and ends by itself when that is over
        self.died = ''  # why its node has ended; empty while it runs
        self.over = False  # whether it has ended with its wire recording
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

    @property
    def missing(self) -> str:
        """What is known of it while it gives no data."""
        return self.name

    @property
    def played(self) -> str:
        """What is said of a recording that has been played to its end; empty before."""
        return ''

    @abstractmethod
    def cells(self) -> Cells:
        """Return what there is to show."""

    @abstractmethod
    def account(self, stored: Mapping[str, int] | None = None) -> Account:
        """Return where its samples are; `stored` are the messages of a finished bag by topic."""

    @abstractmethod
    def verdict(
        self, stored: Mapping[str, int] | None, account: Account, ended_s: float
    ) -> Verdict:
        """
        Judge what is in the bag.

        Parameters
        ----------
        stored : mapping of str to int, or None
            Messages of the bag by topic; None if it was not finished.
        account : Account
            Where they are, and where others are.
        ended_s : float
            End of the recording on the clock of `time.monotonic`.
        """

    def _messages(self, stored: Mapping[str, int] | None) -> str:
        if stored is not None:
            return count(stored.get(self.topic, 0), 'message')
        return f'{count(self._recorder.stored(self.topic), "message")} at the last count'

    def shown(self) -> Cells:
        """Return the cells, and in place of a rate that is none why it is none."""
        cells = self.cells()
        if self.died or self.over:
            return cells._replace(rate='ENDED' if self.died else 'over')
        if SILENT_S < self.silent_s < math.inf:
            return cells._replace(rate=f'silent {self.silent_s:.0f} s')
        return cells


class SensorRow(Row):
    """A sensor of the bench, by what its node says of itself."""

    def __init__(
        self, view: SensorView, recorder: RecorderView, space: str, *, plays: bool = False
    ) -> None:
        super().__init__(view.name, recorder, f'{space}/{SUFFIXES[0]}')
        self._view, self._space, self.plays = view, space, plays
        self._first, self._lost_first = 0, 0
        self._begun: tuple[int, float] = (0, -math.inf)

    @property
    def publishing(self) -> bool:
        """Whether samples have come, and are recorded."""
        return self._view.publishing and self._recorder.stored(self.topic) > 0

    @property
    def missing(self) -> str:
        """Its name, and what its node says."""
        return f'{self.name} {self._view.message}'

    @property
    def silent_s(self) -> float:
        """Seconds since its node was heard."""
        return time.monotonic() - self._view.heard_s

    @property
    def played(self) -> str:
        """What its node says of a recording that it has played to its end; empty before."""
        return self._view.message if self.plays and self._view.played else ''

    @property
    def trouble(self) -> str:
        """What its node says is wrong with the sensor now; empty if nothing is."""
        return self._view.message if self._view.level >= 2 and self.publishing else ''

    def begin(self) -> None:
        """Count from now on."""
        self._first, self._begun = self._view.tally['samples'], self._progress
        self._lost_first = self.account().chip

    def cells(self) -> Cells:
        """Return rate, nominal rate, samples lost and where, and noise so far."""
        view = self._view
        return Cells(
            digits(view.number('delivered_hz'), '.1f'),
            digits(view.number('nominal_hz'), '.0f'),
            lost_cell(self.account()) if view.publishing else '',
            tuple(
                digits(convert(view.noise.get(quantity, math.nan), unit, shown), form)
                for quantity, (unit, shown, form) in _NOISE.items()
            ),
        )

    def account(self, stored: Mapping[str, int] | None = None) -> Account:
        """Return where its samples are, as its node and the recorder count them."""
        view = self._view
        return of_sensor(
            self.name,
            view.tally,
            self._space,
            self._recorder.counts,
            stored,
            SUFFIXES,
            scripted=view.lost_by_faults,
            unanalysed=view.unanalysed,
        )

    def verdict(
        self, stored: Mapping[str, int] | None, account: Account, ended_s: float
    ) -> Verdict:
        """Judge from the samples that came since the beginning, and those that were lost."""
        view = self._view
        trouble, slow = self._trouble(ended_s), ''
        if view.begun_faults:
            kept, slow = self._since_faults()
        else:
            rate, least = self._rate(ended_s)
            slow = _SLOW if rate < least else ''
            # the latest is the finer one, but may have in it what was lost before the beginning
            seen = rate if trouble or slow else max(rate, view.number('delivered_hz'))
            nominal = view.number('nominal_hz')
            word = (
                'did NOT keep' if rate < least
                else 'came until then at' if trouble
                else 'is faster than' if seen > (1.0 + RATE_TOLERANCE) * nominal
                else 'kept'
            )  # fmt: skip
            kept = f'{word} its rate ({seen:.1f} of {nominal:.0f} Hz)'
        faults = [*filter(None, [trouble or slow or self._too_many(account)]), *account.faults]
        why = f'; {trouble}' if trouble else ''
        words = account.words
        if trouble or slow:  # what was never read, nobody could count
            words = words.replace(NOTHING, 'no loss counted')
        line = f'{self.name}: {self._messages(stored)}, {kept}, {words}{why}'
        return Verdict(line, [f'{self.name} {fault}' for fault in faults], account)

    def _too_many(self, account: Account) -> str:
        """Say what a sensor loses that is fast enough to give its nominal rate all the same."""
        lost = account.chip - self._lost_first
        read = self._view.tally['samples'] - self._first
        return f'lost {grouped(lost)} in the sensor' if lost > RATE_TOLERANCE * read else ''

    @property
    def _progress(self) -> tuple[int, float]:
        """Return how many samples there are by now, and by when, s."""
        # By the sensor's own stamps where it says them: its word may come late, and comes once
        # more when it has long been stopped.
        view = self._view
        until_ns = view.number(f'{UNTIL}{SUFFIXES[0]}')
        if math.isnan(until_ns):
            return view.tally['samples'], view.heard_s
        return view.tally[f'{PUBLISHED}{SUFFIXES[0]}'], until_ns * 1e-9

    def _rate(self, ended_s: float) -> tuple[float, float]:
        """Return the mean rate since the beginning, and the least that counts as kept."""
        view = self._view
        (first, first_s), (last, last_s) = self._begun, self._progress
        span_s, uneven_s = last_s - first_s, 0.0
        if view.heard_s == last_s:
            uneven_s = UNEVEN_S
            heard = self.over or (ended_s - view.heard_s < SILENT_S and not self.died)
            span_s = (last_s if heard else ended_s) - first_s
        least = (1.0 - RATE_TOLERANCE) * view.expected_hz
        if span_s <= 1.0:  # one count, no rate of its own
            return view.number('delivered_hz'), least
        return (last - first) / span_s, least * max(0.0, 1.0 - uneven_s / span_s)

    def _since_faults(self) -> tuple[str, str]:
        """Say how it goes since the last scripted fault, and what is wrong with that."""
        view = self._view
        seen = f'{view.number("delivered_hz"):.1f} of {view.number("nominal_hz"):.0f} Hz'
        if any(fault.get('state') != 'recovered' for fault in view.begun_faults):
            return f'has NOT recovered ({seen})', 'has not recovered'
        if view.at_full_rate:
            return f'keeps its rate since its last fault ({seen})', ''
        if view.heard_s - view.recovered_s < WINDOW_S + LATE_S:
            return f'its rate of the last {WINDOW_S:g} s has its last fault in it ({seen})', ''
        return f'does NOT keep its rate since its last fault ({seen})', _SLOW

    def _trouble(self, ended_s: float) -> str:
        if self.died:
            return self.died
        if not self._view.publishing:
            return f'gave no data: {self._view.message}'
        silent_s = ended_s - self._view.heard_s
        if silent_s > SILENT_S and not self.over:
            return f'had said nothing for {duration(silent_s)}'
        if self.trouble:
            return f'gave nothing in the end: {self.trouble}'
        return ''


class TopicRow(Row):
    """
    A topic that somebody publishes, by what the recorder says it has stored.

    What its rate should be is not known: it is measured by the typical second with messages.
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

    def cells(self) -> Cells:
        """Return the rate of the last seconds and of a typical one, and what was missed."""
        (first_s, first), (last_s, last) = self._counts[0], self._counts[-1]
        rate = (last - first) / (last_s - first_s) if last_s > first_s else math.nan
        known = MISSED + self.name in self._recorder.counts
        lost = lost_cell(self.account()) if known else ''
        return Cells(digits(rate, '.1f'), digits(self._typical(), '.1f'), lost)

    def account(self, stored: Mapping[str, int] | None = None) -> Account:
        """Return what the recorder has missed of it, told by the numbers of its messages."""
        return Account(self.name, topics=(topic(self.name, self._recorder.counts, stored),))

    def _typical(self) -> float:
        return median(self._rates) if self._rates else math.nan

    def verdict(
        self, stored: Mapping[str, int] | None, account: Account, ended_s: float
    ) -> Verdict:
        """Judge by whether it came to the end as it came in a typical second."""
        (first_s, first), (last_s, last) = self._first, self._counts[-1]
        typical, span_s = self._typical(), last_s - first_s
        text = f'{self.name}: {self._messages(stored)}'
        faults = [f'{self.name}: {fault}' for fault in account.faults]
        lost = f', {account.words}' if account.lost else ''
        if math.isnan(typical) or span_s < 1.0:
            return Verdict(f'{text}, too short to tell a rate{lost}', faults, account)
        rate, least = (last - first) / span_s, (1.0 - RATE_TOLERANCE) * typical
        silent_s = ended_s - self._grown_s
        fault = ''
        if silent_s > SILENT_S:
            fault = f'nothing came in the last {duration(silent_s)}'
        elif rate < least * (1.0 - UNEVEN_S / span_s):
            fault = _SLOW
        kept = 'did NOT keep its rate' if fault else 'kept its rate'
        why = f'; {fault}' if fault and fault != _SLOW else ''
        line = f'{text}, {kept} ({rate:.1f} Hz, typically {typical:.1f}){lost}{why}'
        return Verdict(line, [*([f'{self.name}: {fault}'] if fault else []), *faults], account)


def lost_cell(account: Account) -> str:
    """Return how many were lost so far, with the borders in the order in which they are passed."""
    parts = [f'{grouped(number)} {border.short}' for border, number in account.lost.items()]
    if account.scripted:
        parts.insert(0, f'{grouped(account.scripted)} faults')
    return ', '.join(parts) or '0'


def digits(value: float, form: str) -> str:
    """Return a number in a format, nothing where there is none."""
    return '' if math.isnan(value) else format(value, form)
