# SPDX-License-Identifier: Apache-2.0
"""
Several records of one sensor: one deviation curve, and how far the records differ.

Records that follow one another with breaks between them are one record with holes: the variances
of each averaging time are averaged by their degrees of freedom, which add up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

from imu_bench.errors import DataError
from imu_bench.metrology.combining import sample_statistics
from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.deviations import confidence as trust
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
import numpy as np
import scipy

SAME_RATE = 0.01
"""Relative difference of sample periods up to which averaging times are the same: the drift of
an RC oscillator over the temperature of a room (MPU-9250: ±1 %)."""


@dataclass(frozen=True)
class Scatter:
    """How a number differs from record to record."""

    # mean, std: of the records: Student's t and chi-squared intervals
    mean: Estimate
    std: Estimate
    # standard deviation over the one that the intervals within the records explain; the records
    # differ by more than chance where its interval lies above one
    excess: Estimate
    records: int  # those in which the number is observable


def pooled(curves: Sequence[DeviationCurve]) -> DeviationCurve:
    """
    Return one curve of several records of one sensor.

    Parameters
    ----------
    curves : sequence of DeviationCurve
        Of one kind, unit and confidence, and of sample rates within `SAME_RATE`.

    Raises
    ------
    DataError
        If the curves are of different kinds, units, levels or rates, or there are none.

    Examples
    --------
    >>> from imu_bench.metrology import allan
    >>> rng = np.random.default_rng(1)
    >>> curves = [allan.deviation(rng.normal(size=5000), 1.0) for _ in range(4)]
    >>> both = pooled(curves)
    >>> both.samples, round(float(both.edf[0] / curves[0].edf[0]), 2)
    (20000, 4.0)
    """
    if not curves:
        raise DataError('no curves to pool')
    first = curves[0]
    samples = np.array([curve.samples for curve in curves])
    periods = np.array([curve.period for curve in curves])
    for curve in curves[1:]:
        if (curve.kind, curve.unit, curve.confidence) != (
            first.kind,
            first.unit,
            first.confidence,
        ):
            raise DataError(
                f'a {curve.kind} in {curve.unit} is not pooled with a {first.kind} in {first.unit}'
            )
    if np.ptp(periods) > SAME_RATE * periods.min():
        named = ', '.join(f'{1.0 / period:.6g}' for period in periods)
        raise DataError(f'records of {named} Hz are not pooled: their averaging times differ')
    m = np.unique(np.concatenate([curve.m for curve in curves]))
    sums, degrees, terms = np.zeros(m.size), np.zeros(m.size), np.zeros(m.size, np.int64)
    noise = np.zeros(m.size)
    for curve in curves:
        at = np.searchsorted(m, curve.m)
        sums[at] += curve.edf * curve.deviation**2
        noise[at] += curve.edf * curve.alpha
        degrees[at] += curve.edf
        terms[at] += curve.terms
    deviation = np.sqrt(sums / degrees)
    low, high = trust.interval(deviation, degrees, first.confidence)
    period = float(samples @ periods / samples.sum())
    return replace(
        first,
        period=period,
        samples=int(samples.sum()),
        # one place more for every break between two records
        span=int(sum(curve.span for curve in curves)) + len(curves) - 1,
        m=m,
        tau=np.asarray(m * period, np.float64),
        deviation=deviation,
        low=low,
        high=high,
        edf=degrees,
        terms=terms,
        alpha=np.rint(noise / degrees).astype(np.int64),
        omitted=(),
        min_share=min(curve.min_share for curve in curves),
    )


def scatter(estimates: Sequence[Estimate], confidence: float = CONFIDENCE) -> Scatter | None:
    """
    Return how a number differs from record to record; None where fewer than two have it.

    Examples
    --------
    >>> same = [Estimate(v, v - 0.2, v + 0.2, '1') for v in (1.0, 1.1, 0.9, 1.0)]
    >>> found = scatter(same)
    >>> round(found.mean.value, 2), round(found.std.value, 3), found.excess.low < 1.0
    (1.0, 0.082, True)
    """
    known = [e for e in estimates if e.value is not None]
    if len(known) < 2:
        return None
    values = [float(e.value) for e in known if e.value is not None]
    mean, std = sample_statistics(values, known[0].unit, confidence)
    half = [
        0.5 * (e.high - e.low) / -float(scipy.special.ndtri(0.5 * (1.0 - e.confidence)))
        for e in known
        if e.low is not None and e.high is not None
    ]
    within = math.sqrt(float(np.mean(np.square(half)))) if len(half) == len(known) else 0.0
    if within > 0.0 and std.value is not None and std.low is not None and std.high is not None:
        excess = Estimate(
            std.value / within, std.low / within, std.high / within, '1', confidence,
            method='scatter of the records over that within them',
        )  # fmt: skip
    else:
        excess = Estimate.not_observable('1', 'a record tells no uncertainty of its own')
    return Scatter(mean, std, excess, len(known))
