# SPDX-License-Identifier: Apache-2.0
"""How well the acquisition of one sensor goes, in numbers; also after each scripted fault."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
import math

from imu_bench.acquisition.quantiles import chi_square
from imu_bench.config.faults import Fault
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
import numpy as np
import numpy.typing as npt

WINDOW_S = 10.0
"""Rate and jitter are those of this much of the latest data."""

BLOCK_NS = 1_000_000_000
"""So much is forgotten at once."""


@dataclass(frozen=True)
class AcquisitionStats:
    """A picture of an acquisition at one moment."""

    state: str  # 'stopped', 'starting', 'running' or 'recovering'
    error: str  # what is wrong now; empty when nothing is
    part: str  # what the chip says it is
    nominal_hz: float  # output data rate as configured
    rate: Estimate  # the chip's true output data rate on the host's clock, Hz
    rate_error: Estimate  # of that rate against the nominal one, ppm
    # samples per second that arrived over the last 10 s, Hz: lower than `rate` when samples are
    # lost
    delivered: Estimate
    jitter: Estimate  # standard deviation of the published sample intervals, s
    stamp_uncertainty: Estimate  # bound of how far stamps are off the times of measurement, s
    samples: int  # of the main stream, delivered since the start
    lost: int  # made by the chip, and never arrived or dropped because nobody drained the queue
    dropped: int  # of these, dropped from the queue
    bus_errors: int  # failed transfers on the bus
    failures: int  # readings that failed, for whatever reason
    recoveries: int  # how often the sensor was brought up again
    late: int  # readings that came more than one poll period after they were due
    queued: int  # samples that wait to be drained
    counters: Mapping[str, int]  # the driver's own counters
    # the failures by the name of the error
    errors: Mapping[str, int] = field(default_factory=dict)
    # the latest error with its name, also when it is over; empty when there was none
    last_error: str = ''
    # how the operating system treats the thread: see `imu_bench.acquisition.priority`
    scheduling: str = ''
    over: str = ''  # why it has ended by itself; empty until then
    # tape, tape_problem: what records or plays the wire says; what went wrong with it
    tape: str = ''
    tape_problem: str = ''


def error_of(rate: Estimate, nominal_hz: float) -> Estimate:
    """Return the error of a rate against the nominal one."""
    if not rate.observable or rate.value is None or rate.low is None or rate.high is None:
        return Estimate.not_observable('ppm', rate.reason, confidence=rate.confidence)
    value, low, high = ((hz / nominal_hz - 1) * 1e6 for hz in (rate.value, rate.low, rate.high))
    return Estimate(value, low, high, 'ppm', rate.confidence)


class _Block:
    """Intervals of a second: how many, of them within the rate, their moments."""

    __slots__ = ('count', 'even', 'first', 'last', 'squares', 'total')

    def __init__(self, first: int) -> None:
        self.first = self.last = first
        self.count = self.even = 0
        self.total = self.squares = 0.0

    def add(self, last: int, count: int, even: int, total: float, squares: float) -> None:
        self.last = last
        self.count += count
        self.even += even
        self.total += total
        self.squares += squares


class IntervalMeter:
    """Rate and jitter of a stream of stamps over the last `WINDOW_S`, in bounded memory."""

    def __init__(self, nominal_hz: float) -> None:
        self._nominal_ns = 1e9 / nominal_hz
        self._last: int | None = None
        self._blocks: deque[_Block] = deque()

    def add(self, stamps: npt.NDArray[np.int64]) -> None:
        """Take note of the next stamps, ns."""
        # in Python: most runs have one to ten samples, for which numpy takes longer
        times = stamps.tolist()
        if self._last is None and times:
            self._last = times.pop(0)
        if self._last is None or not times:
            return
        if not self._blocks or times[0] - self._blocks[-1].first > BLOCK_NS:
            self._blocks.append(_Block(self._last))
        last, nominal, even, total, squares = self._last, self._nominal_ns, 0, 0.0, 0.0
        for stamp in times:
            # deviations from nominal: small numbers keep their digits when squared
            off = stamp - last - nominal
            last = stamp
            if off < 0.5 * nominal:
                even += 1
                total += off
                squares += off * off
        self._last = last
        self._blocks[-1].add(last, len(times), even, total, squares)
        while self._blocks and self._blocks[0].first < self._blocks[-1].last - WINDOW_S * 1e9:
            self._blocks.popleft()

    def delivered(self, confidence: float = CONFIDENCE) -> Estimate:
        """Return samples per second; the ends of the interval are one sample more and less."""
        count = sum(block.count for block in self._blocks)
        if count < 2:
            return Estimate.not_observable('Hz', 'no data yet', confidence=confidence)
        span_s = (self._blocks[-1].last - self._blocks[0].first) * 1e-9
        return Estimate(
            count / span_s, (count - 1) / span_s, (count + 1) / span_s, 'Hz', confidence
        )

    def jitter(self, confidence: float = CONFIDENCE) -> Estimate:
        """Return the standard deviation of the intervals, gaps left out, with its χ² interval."""
        count = sum(block.even for block in self._blocks)
        if count < 3:
            return Estimate.not_observable('s', 'no data yet', confidence=confidence)
        mean = sum(block.total for block in self._blocks) / count
        squares = sum(block.squares for block in self._blocks) - count * mean**2
        squares = max(squares, 0.0)
        tail = (1 - confidence) / 2
        value, low, high = (
            1e-9 * math.sqrt(squares / float(divisor))
            for divisor in (
                count - 1,
                chi_square(count - 1, tail),
                chi_square(count - 1, 1 - tail),
            )
        )
        return Estimate(value, low, high, 's', confidence)


WATCHED_S = 3.0
"""What is lost or counted so long after the recovery still belongs to the fault."""

_COUNTS = ('failures', 'recoveries')


@dataclass
class Aftermath:
    """One fault, and what came of it."""

    fault: Fault
    state: str = 'planned'  # 'planned', 'active', 'over' (no data yet) or 'recovered'
    error: str = ''  # the latest error that it led to, with its name; empty when there was none
    errors: Mapping[str, int] = field(default_factory=dict)  # how many there were, by name
    lost: int = 0  # samples that were lost, and counted
    # what the counters of acquisition and driver have grown by
    counted: Mapping[str, int] = field(default_factory=dict)
    # from its end until a sample arrived that was measured after it
    recovery_s: float | None = None


class FaultWatch:
    """
    Holds the statistics of an acquisition against the script of its faults.

    Parameters
    ----------
    faults : iterable of Fault
        In the order in which they begin.
    switched_on_ns : int
        From when on they count.

    Examples
    --------
    >>> from imu_bench.config.faults import script
    >>> watch = FaultWatch(script(['unplugged 10 2']), switched_on_ns=0)
    >>> [aftermath.state for aftermath in watch.aftermaths]
    ['planned']
    """

    def __init__(self, faults: Iterable[Fault], switched_on_ns: int) -> None:
        self.aftermaths = [Aftermath(fault) for fault in faults]
        self._start_ns = switched_on_ns
        self._before: list[AcquisitionStats | None] = [None] * len(self.aftermaths)

    def look(self, now_ns: int, stats: AcquisitionStats, newest_ns: int) -> list[Aftermath]:
        """
        Take note of how it goes; return the faults whose state has changed.

        Parameters
        ----------
        stats : AcquisitionStats
            Of now.
        newest_ns : int
            Stamp of the newest sample that has arrived.
        """
        changed = []
        for place, aftermath in enumerate(self.aftermaths):
            state = aftermath.state
            if now_ns < self._ns(aftermath.fault.at_s):
                self._before[place] = stats
                continue
            self._follow(aftermath, self._before[place], now_ns, stats, newest_ns)
            if aftermath.state != state:
                changed.append(aftermath)
        return changed

    def _ns(self, elapsed_s: float) -> int:
        return self._start_ns + round(elapsed_s * 1e9)

    def _follow(
        self,
        aftermath: Aftermath,
        before: AcquisitionStats | None,
        now_ns: int,
        stats: AcquisitionStats,
        newest_ns: int,
    ) -> None:
        end_ns = self._ns(aftermath.fault.over_s)
        well = stats.state == 'running' and not stats.error and newest_ns > end_ns
        if aftermath.state != 'recovered':
            aftermath.state = 'active' if now_ns < end_ns else 'over'
            if well and now_ns >= end_ns:
                aftermath.state = 'recovered'
                aftermath.recovery_s = (now_ns - end_ns) * 1e-9
        elif now_ns > end_ns + round((aftermath.recovery_s or 0.0) * 1e9 + WATCHED_S * 1e9):
            return
        aftermath.errors = _grown(stats.errors, {} if before is None else before.errors)
        if aftermath.errors:
            aftermath.error = stats.last_error
        aftermath.lost = stats.lost - (0 if before is None else before.lost)
        aftermath.counted = _grown(_counts(stats), {} if before is None else _counts(before))


def _counts(stats: AcquisitionStats) -> dict[str, int]:
    return {**{name: getattr(stats, name) for name in _COUNTS}, **stats.counters}


def _grown(after: Mapping[str, int], before: Mapping[str, int]) -> dict[str, int]:
    """Return by how much counts have grown, of those that have."""
    grown = {name: count - before.get(name, 0) for name, count in after.items()}
    return {name: count for name, count in grown.items() if count > 0}
