# SPDX-License-Identifier: Apache-2.0
"""
The Allan family: deviation of averages against averaging time, with intervals.

Definitions follow W. J. Riley, "Handbook of Frequency Stability Analysis", NIST SP 1065
(2008), section 5.2, with a rate (of rotation, or specific force) in the place of fractional
frequency and its integral in the place of phase.

The total, Thêo and time interval errors of one stretch are in `deviations.total`.

Samples lie on their true time grid.  Where some are missing, only differences whose
averages are complete count, unless `min_share` allows for less; nothing is interpolated.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Any, Literal

from imu_bench.errors import DataError
from imu_bench.metrology import blockwise
from imu_bench.metrology.blockwise import Run
from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.deviations import allan_kernels, noise_type, partial
from imu_bench.metrology.deviations.allan_curve import (
    build_curve,
    curve_from_sums,
    NoAveragingTime,
    possible,
)
from imu_bench.metrology.deviations.allan_family import MEMBERS
from imu_bench.metrology.deviations.averaging import averaging_factors, BASE, decimation, Taus
from imu_bench.metrology.deviations.integral import cumulate, refuse_unfinite, TOO_LARGE
from imu_bench.metrology.estimate import check_confidence, CONFIDENCE
from imu_bench.metrology.stretches import stretches
from imu_bench.units import canonical
import numpy as np
import numpy.typing as npt

__all__ = [
    'DynamicDeviation',
    'NoAveragingTime',
    'averaging_factors',
    'curve_from_sums',
    'deviation',
    'deviations',
    'dynamic_deviation',
]

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

DECIMATE_ABOVE = 1 << 20
"""Samples up to which overlap='auto' is full overlap."""

KEPT = 0.99
"""
Least share of the record that decimated differences must cover: a share s less makes intervals
s/2 wider.  Short runs between gaps lose more at their ends; their differences are then taken in
full.
"""


def deviation(
    data: npt.ArrayLike,
    rate_hz: float,
    *,
    kind: str = 'oadev',
    tau: Taus = 'log',
    data_type: Literal['rate', 'phase'] = 'rate',
    valid: npt.ArrayLike | None = None,
    unit: str = '1',
    confidence: float = CONFIDENCE,
    overlap: Literal['auto', 'full', 'decimated'] = 'auto',
    intervals: Literal['edf', 'simple'] = 'edf',
    threads: int | None = None,
    min_share: float = 1.0,
) -> DeviationCurve:
    """
    Return one deviation of the Allan family of one axis.

    Parameters
    ----------
    data : array_like, shape (n,)
        Rate samples, or points of its integral, on a regular time grid.
    rate_hz : float
        Sample rate in Hz.
    kind : str
        'adev', 'oadev' (overlapped), 'mdev' (modified), 'tdev' (time), 'hdev' (Hadamard),
        'ohdev' (overlapped Hadamard) or 'totdev' (total; NIST SP 1065 equation (25), both
        ends reflected, not corrected for bias).
    tau : str or sequence of float
        'log', 'octave', 'decade', 'all', or averaging times in s; see `averaging_factors`.
    data_type : str
        'rate', or 'phase' for the integral of the rate.
    valid : array_like of bool, shape (n,), optional
        False where a sample of the grid is missing; what `data` holds there does not matter.
    unit : str
        Unit of the rate, and so of the deviation (the time deviation is in its integral).
    confidence : float
        Level of the intervals.
    overlap : str
        For 'oadev': 'full' starts a difference at every sample.  'decimated' starts them at
        every 3rd, 9th, 27th... sample where tau is a multiple of it and at least 12 starts
        per tau remain; this costs below 1 % of statistical efficiency and stays within 1 %
        of full overlap.  Points where phase noise dominates, whose differences only full
        overlap uses up, are then done in full, and so are those whose runs between gaps are
        so short that more than 1 % of the record would be lost.  'auto' is full up to 2**20
        samples and decimated above.  The other members always use all their differences.
    intervals : str
        'edf': chi-squared with the equivalent degrees of freedom for the noise identified at
        each tau; 'simple': the relative error 1/sqrt(2 (N/K - 1)).
    threads : int, optional
        Cores to use; up to four by default.  The result does not depend on it.
    min_share : float
        Least share of its samples that an average needs, from 0.5 to 1; for 'oadev' of rates.
        Below 1 the mean is taken over those present; what that costs is said in
        `imu_bench.metrology.deviations.partial`.

    Raises
    ------
    DataError
        If not one averaging time can be had from the data, a sample that is not declared
        missing is NaN or infinite, tau is below the sample period, or an option is unknown.
    UnitError
        If the unit is unknown.

    Examples
    --------
    >>> white = np.random.default_rng(7).normal(scale=0.01, size=200_000)
    >>> curve = deviation(white, 100.0, tau=[1.0, 100.0], unit='rad/s')
    >>> curve.deviation.round(6).tolist()  # 0.01 rad/s over the root of 100 and 10 000
    [0.001005, 9.2e-05]
    >>> curve.noise, curve.low.round(6).tolist(), curve.high.round(6).tolist()
    (['white', 'white'], [0.00098, 7.3e-05], [0.001031, 0.000125])
    """
    values = _series(data)
    _check(kind, data_type, overlap, intervals, rate_hz, confidence)
    partial.check_share(min_share, kind, data_type)
    mask = _mask(valid, values.size)
    samples = values.size if mask is None else int(np.count_nonzero(mask))
    threads = blockwise.default_threads() if threads is None else threads
    thin = kind == 'oadev' and (
        overlap == 'decimated' or (overlap == 'auto' and values.size > DECIMATE_ABOVE)
    )
    period = 1.0 / rate_hz
    quiet = np.errstate(over='ignore', invalid='ignore')
    with quiet, blockwise.cores(threads, values.size) as run:
        if min_share < 1.0 and mask is not None and 0 < samples < values.size:
            return partial.deviation_of_most(
                values, mask, rate_hz, tau, min_share, canonical(unit), confidence, thin,
                intervals, run,
            )  # fmt: skip
        if data_type == 'rate':
            phase = cumulate(values, mask, run)
        else:
            phase = np.asarray(values, np.float64)
            refuse_unfinite(phase, mask)
        runs = _runs(mask, phase.size)
        wanted = averaging_factors(phase.size - 1, tau, rate_hz, kind)
        m, omitted = possible(kind, wanted, runs, period)
        member = MEMBERS[kind]
        sums, terms = _decimated(phase, m, runs, run) if thin else member.sums(phase, m, runs, run)
        if not np.all(np.isfinite(sums)):
            raise DataError(TOO_LARGE)
        alpha = noise_type.identify(phase, m, runs, member.differences)
        again = (alpha > 0) & thin
        if again.any():
            sums[again], terms[again] = member.sums(phase, m[again], runs, run)
    if data_type == 'rate':
        sums *= period**2
    return build_curve(
        kind, m, sums, terms, period, samples, values.size, canonical(unit), confidence,
        alpha, runs, intervals, omitted,
    )  # fmt: skip


def deviations(data: npt.ArrayLike, rate_hz: float, **options: Any) -> tuple[DeviationCurve, ...]:
    """Return one curve for each axis of data of shape (n, axes); see `deviation`."""
    columns = np.asarray(data)
    if columns.ndim != 2:
        raise DataError(f'data must have shape (n, axes), got {columns.shape}; see deviation()')
    return tuple(deviation(column, rate_hz, **options) for column in columns.T)


@dataclass(frozen=True, eq=False)
class DynamicDeviation:
    """Deviation curves of a window that moves along a record."""

    start: Floats  # start of each window in s after the first sample
    window: float  # length of the window in s
    curves: tuple[DeviationCurve | None, ...]  # None where gaps leave not one averaging time


def dynamic_deviation(
    data: npt.ArrayLike,
    rate_hz: float,
    window_s: float,
    step_s: float,
    *,
    valid: npt.ArrayLike | None = None,
    **options: Any,
) -> DynamicDeviation:
    """
    Return deviation curves of a window of fixed length that moves along the record.

    Parameters
    ----------
    rate_hz : float
        Sample rate in Hz.
    window_s, step_s : float
        Length of the window, and distance between the starts of two windows, in s.
    valid, **options
        As for `deviation`.

    Raises
    ------
    DataError
        If the window is longer than the record, the window or the step is shorter than a
        sample, or as for `deviation`.

    Notes
    -----
    L. Galleani and P. Tavella, "The dynamic Allan variance", IEEE Trans. UFFC 56(3) (2009).

    Examples
    --------
    >>> noise = np.random.default_rng(7).normal(size=6000)
    >>> noise[3000:] *= 10.0
    >>> moving = dynamic_deviation(noise, 100.0, window_s=10.0, step_s=25.0, tau=[0.1])
    >>> moving.start.tolist(), [float(curve.deviation[0].round(1)) for curve in moving.curves]
    ([0.0, 25.0, 50.0], [0.3, 2.0, 3.4])
    """
    values = _series(data)
    mask = _mask(valid, values.size)
    _check_rate(rate_hz)
    window, step = round(window_s * rate_hz), round(step_s * rate_hz)
    if step < 1 or window < 1:
        raise DataError(
            f'window ({window_s} s) and step ({step_s} s) must be at least one sample, '
            f'{1.0 / rate_hz:g} s'
        )
    if window > values.size:
        raise DataError(
            f'a window of {window_s:g} s does not fit a record of {values.size / rate_hz:g} s'
        )
    starts = np.arange(0, values.size - window + 1, step)
    curves: list[DeviationCurve | None] = []
    for start in starts.tolist():
        part = slice(start, start + window)
        there = None if mask is None else mask[part]
        if there is not None and not there.any():
            curves.append(None)
            continue
        try:
            curves.append(deviation(values[part], rate_hz, valid=there, **options))
        except NoAveragingTime:
            curves.append(None)
    return DynamicDeviation(starts / rate_hz, window / rate_hz, tuple(curves))


def _decimated(phase: Floats, m: Integers, runs: Integers, run: Run) -> tuple[Floats, Integers]:
    """Return the sums of the overlapped Allan variance from fewer and fewer points."""
    full = allan_kernels.number_of_terms(2, m, runs)
    # a record without gaps that has as many differences as this one
    strides = decimation(m, full + 2 * m - 1)
    sums = np.zeros(m.size)
    terms = np.zeros(m.size, np.int64)
    thin, its_runs, stride = phase, runs, 1
    while True:
        here = strides == stride
        if here.any():
            sums[here], terms[here] = allan_kernels.second_difference_sums(
                thin, m[here] // stride, its_runs, run
            )
        if stride >= strides.max():
            break
        thin, its_runs = allan_kernels.thinned(thin, its_runs, BASE, run)
        stride *= BASE
    # the ends of every run fall between the points that are kept
    cut = terms * strides < KEPT * full
    if cut.any():
        sums[cut], terms[cut] = allan_kernels.second_difference_sums(phase, m[cut], runs, run)
    return sums, terms


def _series(data: npt.ArrayLike) -> npt.NDArray[np.generic]:
    values = np.asarray(data)
    if values.ndim != 1:
        raise DataError(f'data must have shape (n,), got {values.shape}; see deviations()')
    if values.size == 0:
        raise DataError('there are no samples')
    if values.dtype.kind not in 'iuf':
        raise DataError(f'data must be numbers, got an array of {values.dtype}')
    return values


def _mask(valid: npt.ArrayLike | None, size: int) -> Mask | None:
    if valid is None:
        return None
    mask = np.asarray(valid)
    if mask.shape != (size,) or mask.dtype != bool:
        raise DataError(
            f'valid must be a bool array of shape ({size},) like the data, '
            f'got {mask.dtype} of shape {mask.shape}'
        )
    return mask


def _runs(mask: Mask | None, points: int) -> Integers:
    """Return the runs of a phase with one point more than the mask, or as many."""
    if mask is None:
        return np.array([[0, points]], np.int64)
    runs = stretches(mask)
    runs[:, 1] += points - mask.size
    return runs


def _check_rate(rate_hz: float) -> None:
    if not (math.isfinite(rate_hz) and rate_hz > 0.0):
        raise DataError(f'rate_hz must be positive and finite, got {rate_hz}')


def _check(
    kind: str, data_type: str, overlap: str, intervals: str, rate_hz: float, confidence: float
) -> None:
    for name, value, known in (
        ('kind', kind, tuple(MEMBERS)),
        ('data_type', data_type, ('rate', 'phase')),
        ('overlap', overlap, ('auto', 'full', 'decimated')),
        ('intervals', intervals, ('edf', 'simple')),
    ):
        if value not in known:
            raise DataError(f'unknown {name} {value!r}; known are {", ".join(known)}')
    _check_rate(rate_hz)
    check_confidence(confidence)
