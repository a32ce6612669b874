# SPDX-License-Identifier: Apache-2.0
"""Millions of samples reduced to what a figure can show."""

from __future__ import annotations

from imu_bench.metrology import workspace
from imu_bench.metrology.normality import Histogram, histogram
from imu_bench.metrology.spectra.spectrum import Spectrum
from imu_bench.metrology.stamps.timing import Grid
from imu_bench.offline.axis_result import Density, Envelope
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_PIECES = 1000
_PER_DECADE = 30
_BINS = 80
_STAMPS = 2**21


def envelope(values: Floats, grid: Grid, start_s: float = 0.0, pieces: int = _PIECES) -> Envelope:
    """
    Return the extremes of each of many equal pieces of time.

    Parameters
    ----------
    values : ndarray, shape (n,)
        In the order recorded.
    grid : Grid
        Where on the time axis they are.
    start_s : float
        Time of the first one.
    pieces : int
        At most; a short recording keeps every sample.

    Examples
    --------
    >>> from imu_bench.metrology.stamps.timing import grid
    >>> e = envelope(np.arange(6.0), grid(np.arange(6) * 10_000_000), pieces=3)
    >>> e.low.tolist(), e.high.tolist()
    ([0.0, 2.0, 4.0], [1.0, 3.0, 5.0])
    """
    kept, index = values, grid.index
    if not grid.keep.all():
        kept, index = (workspace.chosen(array, grid.keep) for array in (values, grid.index))
    edges = np.unique(np.linspace(0, grid.span, min(pieces, grid.span) + 1).astype(np.int64))
    starts = np.searchsorted(index, edges)
    filled = starts[:-1] < starts[1:]
    low, high = np.full(filled.size, np.nan), np.full(filled.size, np.nan)
    for piece in np.flatnonzero(filled).tolist():
        part = kept[starts[piece] : starts[piece + 1]]
        low[piece], high[piece] = np.fmin.reduce(part), np.fmax.reduce(part)
    return Envelope(np.asarray(start_s + edges[:-1] * grid.period_s, np.float64), low, high)


def intervals(stamps: npt.NDArray[np.int64], period_s: float) -> Histogram | None:
    """
    Return the distribution of the intervals between samples, or None if they are all equal.

    Of a long recording the first two million count; intervals beyond three periods are gaps
    and are left out.

    Examples
    --------
    >>> stamps = np.cumsum(np.random.default_rng(1).normal(1e7, 1e5, 1000)).astype(np.int64)
    >>> found = intervals(stamps, 0.01)
    >>> found.unit, int(found.count.sum())
    ('s', 999)
    """
    steps = np.diff(stamps[:_STAMPS]) * 1e-9
    steps = steps[(steps >= 0.0) & (steps < 3.0 * period_s)]
    if steps.size < 2 or np.ptp(steps) <= 1e-6 * period_s:
        return None
    return histogram(steps, 's', _BINS)


def bands(spectrum: Spectrum, per_decade: int = _PER_DECADE) -> Density:
    """
    Return a spectrum averaged in bands of equal logarithmic width; single bins stay as they are.

    The bin at half the rate is left out: a one-sided density halves it, which looks like a drop.

    Examples
    --------
    >>> from imu_bench.metrology.spectra.spectrum import psd
    >>> white = psd(np.random.default_rng(1).normal(size=100_000), 100.0)
    >>> band = bands(white)
    >>> band.frequency.size < white.frequency.size, round(float(np.median(band.density)), 2)
    (True, 0.02)
    >>> bool(band.frequency[-1] < 50.0 and band.density[-1] > 0.015)
    True
    """
    halved = spectrum.edf.size > 1 and spectrum.edf[-1] < spectrum.edf[-2]
    frequency, density = (
        values[:-1] if halved else values for values in (spectrum.frequency, spectrum.density)
    )
    position = np.floor(np.log10(frequency) * per_decade).astype(np.int64)
    starts = np.flatnonzero(np.concatenate(([True], np.diff(position) > 0)))
    sizes = np.diff(np.append(starts, position.size))
    return Density(
        np.add.reduceat(frequency, starts) / sizes, np.add.reduceat(density, starts) / sizes
    )
