# SPDX-License-Identifier: Apache-2.0
"""How well the acquisition of one sensor goes, in numbers."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
import math

from imu_bench.metrology.estimate import CONFIDENCE, Estimate
import numpy as np
import numpy.typing as npt
from scipy.special import chdtri

WINDOW_S = 10.0
"""Rate and jitter are those of this much of the latest data."""

RATE_TOLERANCE = 0.01
"""Share of its rate that a sensor may miss and still be said to keep it."""


@dataclass(frozen=True)
class AcquisitionStats:
    """
    A picture of an acquisition at one moment.

    Attributes
    ----------
    state : str
        'stopped', 'starting', 'running' or 'recovering'.
    error : str
        What is wrong now; empty when nothing is.
    part : str
        What the chip says it is.
    nominal_hz : float
        Output data rate as configured.
    rate : Estimate
        The chip's true output data rate on the host's clock, Hz.
    rate_error : Estimate
        Of that rate against the nominal one, ppm.
    delivered : Estimate
        Samples per second that arrived over the last 10 s, Hz: lower than
        `rate` when samples are lost.
    jitter : Estimate
        Standard deviation of the published sample intervals, s.
    samples : int
        Of the main stream, delivered since the start.
    lost : int
        Made by the chip, and never arrived or dropped because nobody drained the queue.
    dropped : int
        Of these, dropped from the queue.
    bus_errors : int
        Failed transfers on the bus.
    failures : int
        Readings that failed, for whatever reason.
    recoveries : int
        How often the sensor was brought up again.
    late : int
        Readings that came more than one poll period after they were due.
    queued : int
        Samples that wait to be drained.
    counters : mapping of str to int
        The driver's own counters.
    errors : mapping of str to int
        The failures by the name of the error.
    last_error : str
        The latest error with its name, also when it is over; empty when there was none.
    scheduling : str
        How the operating system treats the thread: see `imu_bench.acquisition.priority`.
    over : str
        Why it has ended by itself; empty until then.
    tape, tape_problem : str
        What records or plays the wire says; what went wrong with it.
    """

    state: str
    error: str
    part: str
    nominal_hz: float
    rate: Estimate
    rate_error: Estimate
    delivered: Estimate
    jitter: Estimate
    samples: int
    lost: int
    dropped: int
    bus_errors: int
    failures: int
    recoveries: int
    late: int
    queued: int
    counters: Mapping[str, int]
    errors: Mapping[str, int] = field(default_factory=dict)
    last_error: str = ''
    scheduling: str = ''
    over: str = ''
    tape: str = ''
    tape_problem: str = ''


def error_of(rate: Estimate, nominal_hz: float) -> Estimate:
    """
    Return the error of a rate against the nominal one.

    Examples
    --------
    >>> error_of(Estimate(1010.0, 1009.0, 1011.0, 'Hz'), 1000.0).value.__round__(6)
    10000.0
    """
    if not rate.observable or rate.value is None or rate.low is None or rate.high is None:
        return Estimate.not_observable('ppm', rate.reason, confidence=rate.confidence)
    value, low, high = ((hz / nominal_hz - 1) * 1e6 for hz in (rate.value, rate.low, rate.high))
    return Estimate(value, low, high, 'ppm', rate.confidence)


class IntervalMeter:
    """
    Rate and jitter of a stream of stamps over the last `WINDOW_S`, in bounded memory.

    Examples
    --------
    >>> meter = IntervalMeter(100.0)
    >>> meter.add(np.arange(101) * 10_000_000)
    >>> meter.delivered().value, meter.jitter().value
    (100.0, 0.0)
    """

    def __init__(self, nominal_hz: float) -> None:
        self._nominal_ns = 1e9 / nominal_hz
        self._last: int | None = None
        # per block: first and last stamp, intervals, of them within the rate, their moments
        self._blocks: deque[tuple[int, int, int, int, float, float]] = deque()

    def add(self, stamps: npt.NDArray[np.int64]) -> None:
        """Take note of the next stamps, ns."""
        if stamps.size == 0:
            return
        if self._last is not None:
            stamps = np.concatenate(((self._last,), stamps))
        first, intervals = int(stamps[0]), stamps[1:] - stamps[:-1]
        # deviations from nominal: small numbers keep their digits when squared
        even = intervals[intervals < 1.5 * self._nominal_ns] - self._nominal_ns
        self._last = int(stamps[-1])
        if intervals.size:
            self._blocks.append(
                (
                    first,
                    self._last,
                    intervals.size,
                    even.size,
                    float(even.sum()),
                    float(even @ even),
                )
            )
        while self._blocks and self._blocks[0][0] < self._last - WINDOW_S * 1e9:
            self._blocks.popleft()

    def delivered(self, confidence: float = CONFIDENCE) -> Estimate:
        """Return samples per second; the ends of the interval are one sample more and less."""
        count = sum(block[2] for block in self._blocks)
        if count < 2:
            return Estimate.not_observable('Hz', 'no data yet', confidence=confidence)
        span_s = (self._blocks[-1][1] - self._blocks[0][0]) * 1e-9
        return Estimate(
            count / span_s, (count - 1) / span_s, (count + 1) / span_s, 'Hz', confidence
        )

    def jitter(self, confidence: float = CONFIDENCE) -> Estimate:
        """Return the standard deviation of the intervals, gaps left out, with its χ² interval."""
        count = sum(block[3] for block in self._blocks)
        if count < 3:
            return Estimate.not_observable('s', 'no data yet', confidence=confidence)
        mean = sum(block[4] for block in self._blocks) / count
        squares = sum(b[5] - 2 * mean * b[4] + b[3] * mean**2 for b in self._blocks)
        squares = max(squares, 0.0)
        tail = (1 - confidence) / 2
        value, low, high = (
            1e-9 * math.sqrt(squares / float(divisor))
            for divisor in (count - 1, chdtri(count - 1, tail), chdtri(count - 1, 1 - tail))
        )
        return Estimate(value, low, high, 's', confidence)
