# SPDX-License-Identifier: Apache-2.0
"""
Stamps: true rate, jitter, gaps, duplicates, order faults, and the regular time grid.

Every estimator of the bench takes its sample period from `period`, so that a
rolling result and a batch result of the same samples have the same time axis.
"""

from __future__ import annotations

from dataclasses import dataclass
import itertools
import math

from imu_bench.errors import DataError
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
from imu_bench.metrology.stamps.stamp_line import gap_lengths, Line
from imu_bench.metrology.stamps.time_grid import Grid, grid, judge, Judged, period, place
import numpy as np
import numpy.typing as npt
import scipy

__all__ = ['Gap', 'Grid', 'Timing', 'analyse', 'grid', 'period', 'place']

Integers = npt.NDArray[np.int64]

LISTED_GAPS = 1000
"""The longest gaps are listed one by one, up to this many; all are counted."""

_NANO = 1e-9


@dataclass(frozen=True)
class Gap:
    """A place where samples are missing."""

    index: int  # index, among the stamps handed in, of the first sample after the gap
    start_ns: int  # stamp of the last sample before it
    duration_s: float  # from that sample to the next one
    missing: int  # samples that should have been in between


@dataclass(frozen=True)
class Timing:
    """What the stamps of a recording say about its sampling."""

    samples: int  # stamps handed in
    duration_s: float  # from the first to the last stamp kept
    rate: Estimate  # true rate in Hz; samples missing in gaps do not lower it
    period_s: float  # sample period; the time axis of every estimator (`period`)
    # standard deviation of the interval between successive stamps in s (period jitter, JEDEC
    # JESD65B), outside gaps
    jitter: Estimate
    gaps: tuple[Gap, ...]  # the longest `LISTED_GAPS`, in order of time
    # gap_count, missing: all gaps, and all samples missing in them
    gap_count: int
    missing: int
    # duplicates, order_faults: samples that repeat a stamp, or whose stamp is out of order
    duplicates: int
    order_faults: int
    nominal_hz: float | None  # rate the sensor was asked for
    rate_error: Estimate | None  # true rate against the nominal one in ppm
    # step to which the stamps were rounded; 0 where it is much finer than the period
    resolution_s: float
    burst: float  # mean number of samples stamped together; 1 for samples stamped one by one
    # largest excursion of the stamps from a straight line, averaged over 1/64 of the recording:
    # slow variation of the sensor's clock
    wander_s: float


def analyse(
    stamps_ns: npt.ArrayLike, nominal_hz: float | None = None, confidence: float = CONFIDENCE
) -> Timing:
    """
    Return what the stamps of a recording say about its sampling.

    Parameters
    ----------
    stamps_ns : array_like of int64, shape (n,)
        Stamps in ns.
    nominal_hz : float, optional
        Rate the sensor was asked for.
    confidence : float
        Level of the intervals.

    Raises
    ------
    DataError
        If there are fewer than two stamps, or they do not advance.

    Notes
    -----
    The interval of the rate comes from the scatter of up to 64 block means about
    the straight line, with the correlation from block to block taken into
    account, so that a wandering clock widens it; it is never narrower than the
    step of the stamps over the duration.  Where jitter is so large that single
    missing samples escape or are invented, their expected number widens it too.

    Examples
    --------
    500 Hz asked, 12.5 Hz delivered (thesis on Murata SCL3300 and TDK IIM-42652, section 4.3):

    >>> found = analyse(np.arange(1000) * 80_000_000, nominal_hz=500.0)
    >>> round(found.rate.value, 6), round(found.rate_error.value)
    (12.5, -975000)
    """
    if nominal_hz is not None and not (nominal_hz > 0 and math.isfinite(nominal_hz)):
        raise DataError(f'the nominal rate must be a positive number of Hz, got {nominal_hz}')
    judged, line = judge(stamps_ns)
    lengths = gap_lengths(judged.steps, line.period)
    rate = _rate(line, _slips(judged, line.period), confidence)
    duration = int(judged.kept[-1] - judged.kept[0])
    error = None
    if nominal_hz is not None:
        error = _relative(rate, nominal_hz)
    grouped, jitter = _intervals(judged, line.period, confidence)
    return Timing(
        samples=int(judged.keep.size),
        duration_s=duration * _NANO,
        rate=rate,
        period_s=line.period * _NANO,
        jitter=jitter,
        gaps=_gaps(judged, lengths),
        gap_count=int(lengths.size),
        missing=int(lengths.sum()),
        duplicates=judged.duplicates,
        order_faults=judged.order_faults,
        nominal_hz=nominal_hz,
        rate_error=error,
        resolution_s=judged.rule.resolution * _NANO,
        burst=judged.kept.size / max(1, judged.kept.size - grouped),
        wander_s=line.wander * _NANO,
    )


def _slips(judged: Judged, period: float) -> float:
    """Return how many samples the count may be off because jitter hides or feigns gaps."""
    steps = np.diff(judged.kept[: 1 << 16]) / period
    if steps.size < 2 or judged.rule.resolution:
        return 0.0
    if np.mean(steps < 0.25) > 0.05:
        return 0.0  # stamped in bursts: whole groups are judged
    # a gap hides behind a step shortened by half a period, and as many steps show it
    hidden = float(np.mean(steps < 0.5))
    off = np.abs(steps - 1.0)
    spread = 1.4826 * float(np.median(off[off < 0.5])) if np.any(off < 0.5) else 0.5
    # of 360 000 samples none was feigned at a jitter of 0.2 periods, 4 at 0.25, 64 at 0.3
    feigned = 4.0 * float(scipy.special.ndtr(-1.6 / max(spread, 1e-3)))
    return judged.breaks.size * hidden + judged.kept.size * feigned


def _rate(line: Line, slips: float, confidence: float) -> Estimate:
    value = 1.0 / (line.period * _NANO)
    if line.freedom < 1:
        return Estimate.not_observable(
            'Hz', f'{line.samples} samples give a rate but not its uncertainty; record longer',
            confidence=confidence, method='stamps',
        )  # fmt: skip
    reach = float(scipy.special.stdtrit(line.freedom, 0.5 * (1 + confidence)))
    half = value * min(reach * line.error / line.period + slips / line.samples, 1.0)
    return Estimate(value, value - half, value + half, 'Hz', confidence, method='stamps')


def _relative(rate: Estimate, nominal_hz: float) -> Estimate:
    if rate.value is None or rate.low is None or rate.high is None:
        return Estimate.not_observable('ppm', rate.reason, confidence=rate.confidence)
    value, low, high = (
        1e6 * (r - nominal_hz) / nominal_hz for r in (rate.value, rate.low, rate.high)
    )
    return Estimate(value, low, high, 'ppm', rate.confidence, method=rate.method)


def _intervals(judged: Judged, period: float, confidence: float) -> tuple[int, Estimate]:
    """Return how many samples share the stamp of the one before, and the jitter."""
    kept = judged.kept
    steps = kept.size - 1 - judged.breaks.size
    if steps < 2:
        reason = 'fewer than two intervals between samples; record longer'
        return 0, Estimate.not_observable('s', reason, confidence=confidence)
    edges = np.linspace(0, kept.size - 1, min(64, max(1, steps // 4)) + 1).astype(np.int64)
    counts, squares = np.zeros(edges.size - 1), np.zeros(edges.size - 1)
    grouped = 0
    for block, (start, end) in enumerate(itertools.pairwise(edges)):
        step = np.diff(kept[start : end + 1])
        low, high = np.searchsorted(judged.breaks - 1, (start, end))
        step = np.delete(step, judged.breaks[low:high] - 1 - start)
        grouped += int(np.count_nonzero(step < 0.25 * period))
        off = step - period
        counts[block], squares[block] = off.size, float(off @ off)
    variance = squares.sum() / (steps - 1)
    value = math.sqrt(variance) * _NANO
    if edges.size < 9:
        freedom = (steps - 1) / 1.5
    else:  # freedom from the scatter of the blocks: no assumption on the kind of jitter
        scatter = float(np.sum((squares - variance * counts) ** 2)) / steps**2
        freedom = min(2.0 * variance**2 / scatter, steps - 1.0) if scatter > 0 else steps - 1.0
    low_q, high_q = scipy.special.chdtri(
        max(freedom, 1.0), (0.5 + confidence / 2, 0.5 - confidence / 2)
    )
    factor = math.sqrt(max(freedom, 1.0))
    return grouped, Estimate(
        value, value * factor / math.sqrt(high_q), value * factor / math.sqrt(low_q),
        's', confidence, method='interval between stamps',
    )  # fmt: skip


def _gaps(judged: Judged, lengths: Integers) -> tuple[Gap, ...]:
    chosen = np.arange(lengths.size)
    if lengths.size > LISTED_GAPS:
        chosen = np.sort(np.argsort(-lengths, kind='stable')[:LISTED_GAPS])
    after = judged.breaks[chosen]
    where = after if judged.keep.size == judged.kept.size else np.flatnonzero(judged.keep)[after]
    start, end = judged.kept[after - 1], judged.kept[after]
    return tuple(
        Gap(int(i), int(t), int(u - t) * _NANO, int(m))
        for i, t, u, m in zip(where, start, end, lengths[chosen], strict=True)
    )
