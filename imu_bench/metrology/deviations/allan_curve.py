# SPDX-License-Identifier: Apache-2.0
"""From sums of squared differences to a curve with intervals: batch and rolling analysis."""

from __future__ import annotations

import math

from imu_bench.errors import DataError
from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.deviations import confidence as trust
from imu_bench.metrology.deviations.allan_family import MEMBERS
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Omitted = tuple[tuple[float, str], ...]

_INTEGRATED = {'m/s²': 'm/s', 'rad/s': 'rad', '1': 's', 'm/s': 'm'}
"""Unit of a time deviation, the deviation times a time."""


class NoAveragingTime(DataError):
    """The data hold not one complete difference at any averaging time asked for."""


def curve_from_sums(
    m: Integers,
    sum_sq: Floats,
    terms: Integers,
    period: float,
    samples: int,
    span: int,
    unit: str,
    confidence: float,
    alpha: Integers,
    runs: Integers | None = None,
    omitted: Omitted = (),
) -> DeviationCurve:
    """
    Return the curve of the overlapped Allan deviation from sums: the rolling analysis' entry.

    It equals `deviation` with overlap='full' on the same samples.

    Parameters
    ----------
    m, sum_sq, terms, alpha : ndarray, shape (k,)
        Averaging factors in increasing order, each with at least one term; sums of squared
        second differences of the phase in unit times second, and their number; noise type
        (`noise_type.identify` on the same phase).
    period : float
        Sample period in s.
    samples, span : int
        Samples present, and length of the true time grid.
    unit : str
        Unit of the rate.
    confidence : float
        Level of the intervals.
    runs : ndarray of int64, shape (r, 2), optional
        First and one past the last point of the phase of every run without a gap, as
        `stretches` gives for the samples, plus one at the ends.
    omitted : tuple of (float, str)
        Averaging times the data cannot give, each with the reason.
    """
    stretches = np.array([[0, span + 1]], np.int64) if runs is None else runs
    return build_curve(
        'oadev', m, sum_sq, terms, period, samples, span, unit, confidence, alpha, stretches,
        'edf', omitted,
    )  # fmt: skip


def build_curve(
    kind: str, m: Integers, sums: Floats, terms: Integers, period: float, samples: int, span: int,
    unit: str, confidence: float, alpha: Integers, runs: Integers, intervals: str,
    omitted: Omitted,
) -> DeviationCurve:  # fmt: skip
    """Return the curve of any member of the family; see `curve_from_sums`."""
    member = MEMBERS[kind]
    tau = np.asarray(m * period, np.float64)
    values = member.deviation(sums, terms, m, period)
    if kind == 'tdev':
        # NIST SP 1065 (2008), equation (15)
        values = values * tau / math.sqrt(3.0)
        unit = _INTEGRATED.get(unit, f'{unit}·s')
    degrees = trust.edf_of_runs(kind, alpha, m, runs[:, 1] - runs[:, 0] - 1)
    if intervals == 'simple':
        low, high = trust.simple_interval(values, m, samples, confidence)
    else:
        low, high = trust.interval(values, degrees, confidence)
    return DeviationCurve(
        kind, unit, period, samples, span, m, tau, values, low, high, degrees, terms, alpha,
        confidence, omitted,
    )  # fmt: skip


def possible(
    kind: str, wanted: Integers, runs: Integers, period: float
) -> tuple[Integers, Omitted]:
    """Return the averaging factors with at least one term, and why the others have none."""
    longest = int((runs[:, 1] - runs[:, 0]).max(initial=0))
    enough = np.array(
        [trust.DIFFERENCES[kind].terms(m, longest) > 0 for m in wanted.tolist()], bool
    )
    span = MEMBERS[kind].span
    stretch = f'the longest stretch without a gap has {max(longest - 1, 0) * period:g} s'
    omitted = tuple(
        (m * period, f'needs {span} x {m * period:g} s, {stretch}')
        for m in wanted[~enough].tolist()
    )
    if not enough.any():
        first = omitted[0][1] if omitted else f'too few samples, {stretch}'
        raise NoAveragingTime(f'no averaging time is possible: {first}; record longer')
    return wanted[enough], omitted
