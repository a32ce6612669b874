# SPDX-License-Identifier: Apache-2.0
"""
When was a sample measured?  From the count of samples, not from the moment of reading.

A chip samples at its own, very even pace; the host reads when it gets round to
it.  What the host knows is this: at the time t_i at which it learnt that k_i
samples existed, sample k_i had been measured.  So every reading is *late*, by
up to one period and by all the delays of bus and operating system, and none is
early.  Averages over such readings are biased and jump with the load of the
machine; the lower envelope does not.  The model is the straight line below all
readings that has the smallest sum of distances to them, the linear programme
of S. Moon, P. Skelly, D. Towsley, "Estimation and removal of clock skew from
network delay measurements", IEEE INFOCOM 1999, pp. 227-234; its solution is the
edge of the lower convex hull above the mean count.

An edge of a data-ready line is late by microseconds in place of a period.  While there are such,
readings count samples and tell no time.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
import math

from imu_bench.acquisition.quantiles import student
from imu_bench.errors import NotReady
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
import numpy as np
import numpy.typing as npt

WINDOW_S = 30.0
"""Readings older than this are forgotten, so that the line follows the chip's temperature."""

BUCKET_S = 0.25
"""Of the readings in a bucket only the one nearest to the line is kept."""

SETTLE_S = 0.3
SETTLE_READINGS = 30
SETTLE_MOST_S = 1.0
"""
Samples are held back at the start and after a loss until so much is known: of 30 readings that are
late by anything up to a period, the least late one is late by a thirtieth of it.
"""

TRUST_S = 10.0
"""
A period found over this long is kept through a loss: at 100 Hz that thirtieth is 33 ppm of it.
"""

RATE_ERROR, DRIFT = 0.2, 0.005
"""
By more no chip's rate is off its nominal one, and while some losses are uncertain by no more off
the one that is known: assumed, well above the 3 % and the changes with temperature of all tests.
A line that is steeper was made of losses that were told too large, and would count more of them,
for ever.
"""

STALL_S = 0.05
STALL_BUCKETS = 2
"""
Readings this late over whole buckets mean that the chip stopped and nobody said so: a busy host
may delay single readings by as much, not all of half a second.
"""

SAME_PHASE = 0.25
"""
Part of a period within which the phase after a loss counts as unchanged: well above that
thirtieth, and one new phase of two is farther off.
"""

SLEW = 1e-3
"""
Corrections of the line reach the stamps at this relative speed at most, 1 ms per second: no
interval is off by more, and a line that settled on a wrong thirtieth of 10 ms is right after a
third of a second.
"""

EDGE_S = 1.0
"""A line that has been silent for so long is not waited for any more."""

Point = tuple[float, float]


def lower_edge(points: Sequence[Point]) -> tuple[Point, Point]:
    """Return the ends of the lower convex hull's edge below the mean of the abscissae."""
    hull: list[Point] = []
    for k, t in points:
        while len(hull) > 1:
            (k0, t0), (k1, t1) = hull[-2], hull[-1]
            if (k1 - k0) * (t - t0) > (t1 - t0) * (k - k0):
                break
            hull.pop()
        hull.append((k, t))
    middle = sum(k for k, _ in points) / len(points)
    after = next(i for i, (k, _) in enumerate(hull) if k >= middle and i > 0)
    return hull[after - 1], hull[after]


class ClockModel:
    """Turn counts and readings into stamps."""

    def __init__(self, nominal_hz: float, missing: int = 0, after_ns: int | None = None) -> None:
        # output data rate as configured; the true one may be off by several percent
        self.nominal_hz = nominal_hz
        self.missing = missing  # what was missing before
        self._after_ns = after_ns
        self.settling = True  # true while too little is known to give stamps
        self._origin_ns: int | None = None
        self._count = 0
        self._readings: list[Point] = []
        self._points: deque[tuple[int, float, float]] = deque()
        self._anchor: Point | None = None
        self._period = self._known = 1e9 / nominal_hz
        self._trusted = False
        # from this count on nothing was lost
        self._whole_from = 0.0
        self._stalled = 0
        self._given = 0
        self._last = -math.inf
        self._after_gap = True
        self._told = 0
        self._edge_t = -math.inf
        self._edge_late = 0.0
        self._within = math.inf

    @property
    def period_ns(self) -> float:
        """The chip's sample period on the host's clock."""
        return self._period

    def observe(
        self,
        n: int,
        host_ns: int,
        edge: tuple[int, int] | None = None,
        latch_ns: int | None = None,
    ) -> None:
        """Take note that `n` more samples existed when the host's clock showed `host_ns`."""
        if n == 0:
            return
        if self._origin_ns is None:
            self._origin_ns = host_ns
            if self._after_ns is not None:
                self._last = float(self._after_ns - host_ns)
        self._count += n
        reading = (float(self._count), float(host_ns - self._origin_ns))
        if edge is not None:
            reading = float(self._count - edge[0]), float(edge[1] - self._origin_ns)
            self._note_edge(reading)
        elif reading[1] - self._edge_t < EDGE_S * 1e9:
            return
        elif latch_ns is not None:
            self._within = min(self._within, latch_ns / 2)
        if not self.settling:
            self._add(reading)
            return
        if self._readings and reading[0] <= self._readings[-1][0]:
            return  # an edge that was told apart wrongly
        self._readings.append(reading)
        span_s = (reading[1] - self._readings[0][1]) * 1e-9
        enough = span_s >= SETTLE_S and len(self._readings) >= SETTLE_READINGS
        if enough or span_s >= SETTLE_MOST_S:
            self.settle()
            self._told = 0

    def _note_edge(self, edge: Point) -> None:
        """Let edges alone tell the time from the first one on."""
        if edge[1] - self._edge_t > EDGE_S * 1e9:
            self._edge_late = 0.0
            self._readings = []
        elif self._anchor is not None and not self.settling:
            # what the handler usually takes: how much of it there always is nobody can see
            self._edge_late += 0.01 * (abs(self._late(edge)) - self._edge_late)
        self._edge_t = edge[1]

    def successor(self, missing: int, after_ns: int) -> ClockModel:
        """Return a model that begins anew, with the period that is known."""
        model = ClockModel(self.nominal_hz, missing, after_ns)
        model._period = model._known = self._known
        model._trusted = self._trusted
        return model

    def uncertainty(self) -> Estimate:
        """
        Return by how much stamps may be off, s: an interval from zero to a bound.

        It is what the line leaves of the least late readings, and what no reading can show:
        without a data-ready line half of the fastest transfer, with one what the interrupt
        takes more than it takes at least.
        """
        by_edges = bool(self._points) and self._points[-1][2] - self._edge_t < EDGE_S * 1e9
        hidden = self._edge_late if by_edges else self._within
        if self.settling or len(self._points) < 4 or math.isinf(hidden):
            return Estimate.not_observable('s', 'nobody knows how long samples wait to be read')
        late = sorted(abs(self._late(point[1:])) for point in self._points)
        bound = 1e-9 * (late[int(CONFIDENCE * (len(late) - 1))] + hidden)
        return Estimate(bound, 0.0, bound, 's', CONFIDENCE)

    def skip(self, n: int) -> None:
        """Take note that the chip counted `n` samples that never arrived; the next one did."""
        self._count += n
        self.missing += n

    def interrupt(self) -> None:
        """Take note that samples were lost since the last reading; how many is found out."""
        self.settle()
        self.settling = True

    def settle(self) -> None:
        """Decide with what is known: stamps can be given for everything observed."""
        if not self.settling or not self._readings:
            return
        if self._anchor is not None:
            self._bridge()
        readings, self._readings = self._readings, []
        self.settling = False
        self._points.extend((self._bucket(t), k, t) for k, t in readings)
        self._fit()
        # from here on one point per bucket will do
        kept: dict[int, tuple[int, float, float]] = {}
        for point in self._points:
            held = kept.get(point[0])
            if held is None or self._late(point[1:]) < self._late(held[1:]):
                kept[point[0]] = point
        self._points = deque(kept.values())

    def stamps(self, n: int, skipped: int = 0) -> npt.NDArray[np.int64]:
        """
        Return the times of the next `n` samples in ns, later than all given before.

        The stamps run from the last one given straight to where the line now
        puts the newest, as far as `SLEW` lets them: a correction never makes a step.
        Before them is the gap of those that were `skipped`.
        """
        if self.settling or self._origin_ns is None:
            raise NotReady('the clock model is settling; call settle() to give stamps already')
        self._given += skipped
        target, start = self._line(self._given + n), self._last
        if self._after_gap or skipped:
            start, self._after_gap = max(start, self._line(self._given)), False
        self._given += n
        slew = SLEW * self._period
        step = min(max((target - start) / n, self._period - slew), self._period + slew)
        run = start + step * np.arange(1, n + 1)
        self._last = float(run[-1])
        return np.asarray(self._origin_ns + np.rint(run).astype(np.int64))

    def rate(self, confidence: float = CONFIDENCE) -> Estimate:
        """
        Return the chip's true rate in Hz.

        The interval is that of a least-squares slope through the points, which
        are the least late readings of each bucket; the envelope does better.
        """
        points = [point[1:] for point in self._points]
        if self.settling or len(points) < 4:
            return Estimate.not_observable(
                'Hz', f'wait about {SETTLE_MOST_S + 4 * BUCKET_S:g} s', confidence=confidence
            )
        k = np.array([point[0] for point in points])
        late = np.array([self._late(point) for point in points])
        k -= k.mean()
        slope = k @ late / (k @ k)
        residual = late - late.mean() - slope * k
        deviation = math.sqrt(residual @ residual / (k.size - 2) / (k @ k))
        half = student(k.size - 2, 0.5 + confidence / 2) * deviation / self._period
        hz = 1e9 / self._period
        return Estimate(hz, hz * (1 - half), hz * (1 + half), 'Hz', confidence)

    def _line(self, k: float) -> float:
        """Return the time of sample number k, ns since the first reading."""
        anchor_k, anchor_t = self._anchor or (0.0, 0.0)
        return anchor_t + (k - anchor_k) * self._period

    def _late(self, reading: Point) -> float:
        return reading[1] - self._line(reading[0])

    def _bucket(self, t: float) -> int:
        return int(t // (BUCKET_S * 1e9))

    def _add(self, reading: Point) -> None:
        """Keep a reading if it is the least late of its bucket."""
        bucket = self._bucket(reading[1])
        newest = self._points[-1]
        if bucket < newest[0] or (bucket > newest[0] and reading[0] <= newest[1]):
            return  # an edge that was told apart wrongly
        if bucket == newest[0]:
            if self._late(reading) >= self._late(newest[1:]):
                return
            self._points.pop()
        elif self._has_stalled():
            self.settling = True
            self._readings.append(reading)
            return
        self._points.append((bucket, *reading))
        window = max(WINDOW_S / BUCKET_S, 50 * self._period / (BUCKET_S * 1e9))
        while self._points[0][0] < bucket - window:
            self._points.popleft()
        self._fit()

    def _has_stalled(self) -> bool:
        """Return whether the buckets that end now show that the chip had stopped."""
        limit = max(STALL_S * 1e9, 3 * self._period)
        late = self._late(self._points[-1][1:]) > limit
        self._stalled = self._stalled + 1 if late else 0
        if self._stalled < STALL_BUCKETS or len(self._points) <= STALL_BUCKETS:
            return False
        for _ in range(STALL_BUCKETS):
            self._points.pop()
        self._stalled = 0
        return True

    def _fit(self) -> None:
        points = [(k, t) for _, k, t in self._points]
        span_s = (points[-1][1] - points[0][1]) * 1e-9
        if len(points) > 1 and not (self._trusted and span_s < TRUST_S):
            (k0, t0), (k1, t1) = lower_edge(points)
            period = (t1 - t0) / (k1 - k0)
            off = abs(period / self._known - 1.0)
            whole = points[0][0] >= self._whole_from
            if whole and span_s >= TRUST_S:
                self._period = self._known = period
                self._trusted = True
            elif off <= (DRIFT if self._trusted else RATE_ERROR):
                self._period = period
            else:
                # some losses were told wrong: only what came after them tells the time
                self._period = self._known
                after = [point for point in self._points if point[1] >= self._whole_from]
                self._points = deque(after or [self._points[-1]])
                points = [(k, t) for _, k, t in self._points]
        # the supporting line of this slope
        self._anchor = min(points, key=lambda point: point[1] - point[0] * self._period)

    def _bridge(self) -> None:
        """Count what was lost: the line before the loss against the readings after it."""
        # Both are lower envelopes, so that their difference is free of the
        # lateness of reading.  An oscillator that ran on, as it does through an
        # overflow, comes back with its old phase.  After a reset the phase is
        # another: the old points are moved onto it, which keeps what they know
        # of the period.
        jump = min(self._late(reading) for reading in self._readings)
        number = round(jump / self._period)
        lost = max(0, number)
        # losses since the line was last settled were told from few readings, all of them late:
        # what was told too large shows as soon as one comes that is less late
        taken_back = min(max(0, -number), self._told)
        self.missing -= taken_back
        self._told += lost - taken_back
        phase = jump - lost * self._period
        if abs(phase) < SAME_PHASE * self._period:
            phase = 0.0
        self.missing += lost
        self._count += lost
        self._given += lost
        self._after_gap = lost > 0
        self._readings = [(k + lost, t) for k, t in self._readings]
        if lost or taken_back:
            self._whole_from = self._readings[0][0]
        self._points = deque((bucket, k, t + phase) for bucket, k, t in self._points)
