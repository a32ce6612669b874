# SPDX-License-Identifier: Apache-2.0
"""
The same numbers as the batch analysis, over a window that slides along a live stream.

A snapshot equals, to rounding, what `timing.grid`, `allan.deviation` and
`moments.Moments` give for the samples of the window: it holds the samples
themselves, judges their stamps by the same rule and sums nothing that it would
have to subtract again.  The cost per sample does not depend on the window.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math

from imu_bench.errors import DataError, NotReady
from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.deviations import noise_type
from imu_bench.metrology.deviations.allan_curve import curve_from_sums, NoAveragingTime, possible
from imu_bench.metrology.deviations.averaging import averaging_factors
from imu_bench.metrology.estimate import check_confidence, CONFIDENCE, Estimate
from imu_bench.metrology.moments import Moments
from imu_bench.metrology.sliding.rolling_intake import Intake, PENDING, Piece
from imu_bench.metrology.sliding.sample_ring import BIN, SampleRing, WindowSums
from imu_bench.metrology.stamps.stamp_line import gap_lengths
from imu_bench.metrology.stamps.time_grid import period
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

MARGIN = 1.1
"""A sensor may be faster than announced by a tenth and still fill the whole window."""

SLACK = 16
"""
The window is moved to the front of its memory after a 16th of it has passed: a quarter takes 17 %
more memory and is no faster (3.4 to 3.9 µs per sample of six axes either way).
"""

IMU_UNITS = ('m/s²',) * 3 + ('rad/s',) * 3

_LEAST = 3
_ABSENT = 'this axis is not measured'
_NANO = 1e-9


@dataclass(frozen=True, eq=False)
class Window:
    """The state of a sliding window."""

    # start_ns, end_ns: stamps of its first and last sample; cut a recording there to get the same
    # samples
    start_ns: int
    end_ns: int
    # samples, missing: samples in it, and samples missing in its gaps
    samples: int
    missing: int
    period_s: float  # measured sample period
    # overlapped Allan deviation; None where an axis is not measured or the window is still too
    # short
    curves: tuple[DeviationCurve | None, ...]
    # rms, mean, std: RMS about the mean, mean, and standard deviation; not observable where an
    # axis is not measured
    rms: tuple[Estimate, ...]
    mean: tuple[Estimate, ...]
    std: tuple[Estimate, ...]
    # whether samples came so much faster than announced that the memory does not hold the whole
    # window
    truncated: bool
    # left_out, duplicates, order_faults: samples dropped since the start: not finite, repeated,
    # out of order
    left_out: int
    duplicates: int
    order_faults: int


class RollingAnalysis:
    """
    Overlapped Allan deviation, RMS, mean and standard deviation over a sliding window.

    The window holds the samples whose stamp is in (end - window_s, end], where end is
    the last stamp.  A clock that is set back, and an axis that begins to be
    measured, start a new window.

    Parameters
    ----------
    window_s : float
        Length of the window.
    rate_hz : float
        Nominal or first measured rate; fixes the memory and the averaging factors.
    axes : int
        Columns of the values.
    units : sequence of str, optional
        Unit of each; those of acceleration and angular velocity for six axes.
    taus : sequence of float, optional
        Averaging times in s at that rate; evenly spaced logarithms by default.
    confidence : float
        Level of the intervals.

    Raises
    ------
    DataError
        If an argument makes no sense.

    Examples
    --------
    >>> live = RollingAnalysis(10.0, 100.0, axes=1, units=['rad/s'], taus=[0.1, 1.0])
    >>> noise = np.random.default_rng(1).normal(scale=0.01, size=(3000, 1))
    >>> for start in range(0, 3000, 200):
    ...     stamps = np.arange(start, start + 200) * 10_000_000
    ...     live.append(stamps, noise[start : start + 200])
    >>> window = live.snapshot()
    >>> window.samples, window.curves[0].tau.round(3).tolist()
    (1000, [0.1, 1.0])
    """

    def __init__(
        self,
        window_s: float,
        rate_hz: float,
        axes: int = 6,
        units: Sequence[str] | None = None,
        taus: Sequence[float] | None = None,
        confidence: float = CONFIDENCE,
    ) -> None:
        for name, number in (('window_s', window_s), ('rate_hz', rate_hz)):
            if not (number > 0 and math.isfinite(number)):
                raise DataError(f'{name} must be a positive number, got {number}')
        if units is None and axes == len(IMU_UNITS):
            units = IMU_UNITS
        if units is None or axes < 1 or len(units) != axes:
            raise DataError(f'{axes} axes need a unit each, got {units}')
        check_confidence(confidence)
        samples = round(window_s * rate_hz)
        if samples < _LEAST:
            raise DataError(f'{window_s:g} s at {rate_hz:g} Hz hold fewer than {_LEAST} samples')
        # the true rate may be above the nominal one: its window holds longer averages
        most = math.ceil(samples * MARGIN) + BIN
        self._grid = taus is None
        # averaging factors
        self.m = averaging_factors(
            most if self._grid else samples, 'log' if taus is None else list(taus), rate_hz
        )
        self._units = tuple(units)
        self._confidence = confidence
        self._window_ns = round(window_s / _NANO)
        self._nominal_s = 1.0 / rate_hz
        self._ring = SampleRing(axes, most, max(most // SLACK, 8 * BIN) + PENDING)
        self._sums = WindowSums(self._ring, self.m)
        self._intake = Intake(axes, self._nominal_s / _NANO, most)
        self._staged: list[tuple[Integers, Floats]] = []
        self._clear()

    @property
    def nbytes(self) -> int:
        """Memory in bytes, fixed at construction but for a block of samples in transit."""
        return self._ring.nbytes + self._sums.nbytes

    @property
    def span_s(self) -> float:
        """Time from the first to the last sample of the window."""
        stamps = self._ring.stamps_from(self._ring.since(self._window_ns))
        return float(stamps[-1] - stamps[0]) * _NANO if stamps.size else 0.0

    def _clear(self) -> None:
        """Begin an empty window."""
        self._ring.clear()
        self._sums.clear()
        self._epoch = self._intake.epoch
        self._next_review = BIN

    def append(self, stamps_ns: npt.ArrayLike, values: npt.ArrayLike) -> None:
        """
        Take more samples, any number of them.

        Parameters
        ----------
        values : array_like, shape (n, axes)
            A column of NaN is an axis that is not measured; other rows that are
            not finite are left out and counted.

        Raises
        ------
        DataError
            If the shapes disagree or the stamps are not whole nanoseconds.
        """
        stamps, rows = np.asarray(stamps_ns), np.asarray(values, dtype=np.float64)
        if stamps.ndim != 1 or rows.shape != (stamps.size, len(self._units)):
            raise DataError(
                f'stamps of shape {stamps.shape} and values of {rows.shape}: expected (n,) '
                f'and (n, {len(self._units)})'
            )
        if stamps.size == 0:
            return
        if stamps.dtype.kind not in 'iu':
            raise DataError(f'stamps are whole nanoseconds (int64), got {stamps.dtype}')
        # copies: the caller may use its arrays again
        self._staged.append((stamps.astype(np.int64), rows.copy()))
        if sum(block.size for block, _ in self._staged) >= BIN:
            self._commit()

    def _commit(self) -> None:
        """Move what was staged into the window, in pieces of at most `BIN` samples."""
        if not self._staged:
            return
        stamps = np.concatenate([block for block, _ in self._staged])
        rows = np.concatenate([block for _, block in self._staged])
        self._staged.clear()
        for start in range(0, stamps.size, BIN):
            part = slice(start, start + BIN)
            piece = self._intake.feed(stamps[part], rows[part])
            if self._intake.epoch != self._epoch:
                self._clear()
            self._enter(piece)

    def _enter(self, piece: Piece) -> None:
        """Enter settled samples into the window."""
        ring, count = self._ring, piece.stamps.size
        if count == 0:
            return
        begin = ring.end
        if ring.room < count:
            ring.make_room(ring.since(self._window_ns))
            self._review()
        ring.write(piece)
        ring.check(count)
        self._sums.add(begin)
        if ring.end - ring.first >= self._next_review:
            self._next_review *= 8
            self._review()

    def _review(self) -> None:
        """Measure the sample period of the stamps anew."""
        ring = self._ring
        start = ring.since(self._window_ns)
        self._intake.review(ring.stamps_from(start), *ring.breaks_from(start))

    def snapshot(self) -> Window:
        """
        Return the state of the window, up to the last sample handed in.

        Raises
        ------
        NotReady
            If the window holds fewer than three samples, or all stamps are equal.
        """
        self._commit()
        ring = self._ring
        counted, mark = ring.end, ring.mark()
        tail = self._intake.tail()
        if ring.room < tail.stamps.size:
            ring.make_room(ring.since(self._window_ns))
            mark = ring.mark()
        ring.write(tail)  # as if nothing followed; taken back below
        try:
            if ring.end - ring.first < _LEAST:
                raise NotReady(f'the window holds {ring.end - ring.first} samples; wait for more')
            return self._window(ring.since(self._window_ns), counted)
        finally:
            ring.rollback(mark)

    def _window(self, start: int, counted: int) -> Window:
        ring = self._ring
        stamps, (breaks, steps) = ring.stamps_from(start), ring.breaks_from(start)
        if stamps[0] == stamps[-1]:
            raise NotReady(f'all {stamps.size} stamps of the window are equal; wait for more')
        period_s = period(stamps, breaks, steps, self._nominal_s)
        missing = int(gap_lengths(steps, period_s / _NANO).sum())
        edges = np.concatenate([[0], breaks, [stamps.size]])
        runs = np.stack([edges[:-1], edges[1:] + 1], axis=1)
        values = ring.values[:, start - ring.first : ring.end - ring.first]
        moments = Moments.of(values)
        curves = self._curves(start, counted, period_s, runs, stamps.size + missing)
        duplicates, order_faults = self._intake.faults
        return Window(
            start_ns=int(stamps[0]),
            end_ns=int(stamps[-1]),
            samples=int(stamps.size),
            missing=missing,
            period_s=period_s,
            curves=curves,
            rms=self._estimates(moments.rms_estimate),
            mean=self._estimates(moments.mean_estimate),
            std=self._estimates(moments.std_estimate),
            truncated=ring.overrun(self._window_ns),
            left_out=self._intake.left_out,
            duplicates=duplicates,
            order_faults=order_faults,
        )

    def _estimates(self, estimate: Callable[[int, str, float], Estimate]) -> tuple[Estimate, ...]:
        return tuple(
            estimate(axis, unit, self._confidence)
            if self._intake.measured[axis]
            else Estimate.not_observable(unit, _ABSENT, confidence=self._confidence)
            for axis, unit in enumerate(self._units)
        )

    def _curves(
        self, start: int, counted: int, period_s: float, runs: Integers, span: int
    ) -> tuple[DeviationCurve | None, ...]:
        ring = self._ring
        # the named grid ends at a third of the data, also while the window fills
        wanted = self.m[np.isin(self.m, averaging_factors(span))] if self._grid else self.m
        try:
            m, omitted = possible('oadev', wanted, runs, period_s)
        except NoAveragingTime:
            return (None,) * len(self._units)
        some = np.isin(self.m, m)
        sums = self._sums.total(start, counted)[some] * period_s**2
        lengths = runs[:, 1] - runs[:, 0]
        terms = np.maximum(lengths[:, None] - 2 * m, 0).sum(axis=0)
        stretches = noise_type.Stretches(runs)
        curves: list[DeviationCurve | None] = []
        for axis, unit in enumerate(self._units):
            if not self._intake.measured[axis]:
                curves.append(None)
                continue
            phase = ring.phase[axis, start - ring.first : ring.end - ring.first + 1]
            alpha = noise_type.identify_within(stretches, phase, m)
            curves.append(
                curve_from_sums(
                    m, sums[:, axis], terms, period_s, ring.end - start, span, unit,
                    self._confidence, alpha, runs, omitted,
                )
            )  # fmt: skip
        return tuple(curves)
