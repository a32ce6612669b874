# SPDX-License-Identifier: Apache-2.0
"""
Power spectral density with intervals.

Every density here is one-sided: it holds the whole power between 0 and half the
sample rate.  Twice the two-sided density, and for amplitude densities sqrt(2)
times (`two_sided` in `imu_bench.metrology.spectra.spectrum`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
import math
from typing import Literal

from imu_bench.errors import DataError
from imu_bench.metrology.estimate import check_confidence, CONFIDENCE
from imu_bench.metrology.stretches import stretches
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

GROUPS = 63
"""
The median is taken over at most this many averages of successive segments; odd, for a middle.
"""

SHORTEST = 16
LONGEST = 1 << 17
"""Samples of a segment."""

SEGMENTS = 31
"""Segments at least, where the resolution is not given: a density is then known to 18 %."""

_AT_ONCE = 1 << 20


@dataclass(frozen=True, eq=False)
class Spectrum:
    """A one-sided power spectral density.  Arrays have shape (k,); the bin at 0 Hz is left out."""

    frequency: Floats  # Hz
    # density, low, high: power spectral density and its chi-squared interval, unit²/Hz
    density: Floats
    low: Floats
    high: Floats
    edf: Floats  # equivalent degrees of freedom
    unit: str  # unit of the signal
    resolution: float  # distance of the bins in Hz; a Hann window resolves two of them
    segments: int  # overlapping segments averaged
    samples: int  # samples that went into them
    average: str  # 'mean' or 'median'
    # what the median of noise was divided by, 1 for the mean; the line of a steady tone has none
    bias: float
    confidence: float  # level of the interval

    def __repr__(self) -> str:
        ends = f'{self.frequency[0]:.4g} to {self.frequency[-1]:.4g} Hz'
        return f'<spectrum in {self.density_unit}: {ends}, {self.segments} segments>'

    @property
    def density_unit(self) -> str:
        """Unit of `density`."""
        return f'({self.unit})²/Hz'

    @property
    def amplitude_unit(self) -> str:
        """Unit of the square root of `density`."""
        return f'{self.unit}/√Hz'


def psd(
    data: npt.ArrayLike,
    rate_hz: float,
    unit: str = '1',
    *,
    resolution_hz: float | None = None,
    average: Literal['mean', 'median'] = 'mean',
    detrend: Literal['constant', 'linear'] = 'constant',
    valid: npt.ArrayLike | None = None,
    confidence: float = CONFIDENCE,
) -> Spectrum:
    """
    Return the power spectral density after Welch: Hann window, half overlap.

    Parameters
    ----------
    data : array_like, shape (n,)
        Rate data on the regular time grid.
    rate_hz : float
        Sample rate.
    unit : str
        Unit of the data.
    resolution_hz : float, optional
        Distance of the bins; by default such that about 31 segments are averaged.
    average : {'mean', 'median'}
        The median over groups of successive segments ignores transients; its
        bias is removed.
    detrend : {'constant', 'linear'}
        What is removed from each segment.
    valid : array_like of bool, shape (n,), optional
        False where a sample is missing; segments lie between gaps.
    confidence : float
        Level of the interval.

    Notes
    -----
    P. D. Welch 1967, IEEE Trans. Audio Electroacoust. AU-15(2):70.  Memory does
    not grow with the length of the record, time does so linearly.

    Examples
    --------
    >>> x = np.random.default_rng(1).normal(size=50_000)
    >>> s = psd(x, 100.0, 'm/s²')
    >>> bool(abs(s.density.mean() - 2 / 100.0) < 2e-4), s.density_unit
    (True, '(m/s²)²/Hz')
    """
    values = np.asarray(data, dtype=np.float64)
    if values.ndim != 1:
        raise DataError(f'data must have shape (n,), got {values.shape}')
    if not (rate_hz > 0 and math.isfinite(rate_hz)):
        raise DataError(f'the sample rate must be a positive number of Hz, got {rate_hz}')
    if average not in ('mean', 'median') or detrend not in ('constant', 'linear'):
        raise DataError(f'unknown average {average!r} or detrend {detrend!r}; see psd')
    runs = _runs(values.size, valid)
    length = _length(runs, rate_hz, resolution_hz)
    step = length // 2
    starts = np.concatenate([np.arange(a, b - length + 1, step) for a, b in runs])
    groups = min(GROUPS, starts.size - 1 + starts.size % 2) if average == 'median' else 1
    sums, sizes = _periodograms(values, starts, length, groups, detrend)
    per_group = _segment_edf(float(sizes.mean()), length, step)
    density = sums / sizes[:, None]
    if average == 'median':
        bias, edf = _median_factors(per_group, groups)
        mean = np.median(density, axis=0)
    else:
        bias, edf, mean = 1.0, per_group, density[0]
    mean = np.asarray(mean[1:] * 2.0 / rate_hz / bias, np.float64)
    degrees = np.full(mean.size, edf)
    if length % 2 == 0:  # the bin at half the rate is real, and holds its power alone
        mean[-1] /= 2.0
        degrees[-1] /= 2.0
    low, high = _interval(mean, degrees, confidence)
    frequency = np.asarray(np.arange(1, mean.size + 1) * (rate_hz / length), np.float64)
    used = int(
        np.sum([(b - a - length) // step * step + length for a, b in runs if b - a >= length])
    )
    return Spectrum(
        frequency, mean, low, high, degrees, unit, rate_hz / length,
        int(starts.size), used, average, bias, confidence,
    )  # fmt: skip


def _runs(n: int, valid: npt.ArrayLike | None) -> list[tuple[int, int]]:
    if valid is None:
        return [(0, n)]
    mask = np.asarray(valid, dtype=np.bool_)
    if mask.shape != (n,):
        raise DataError(f'valid has shape {mask.shape}, the data ({n},)')
    return [(a, b) for a, b in stretches(mask).tolist()]


def _length(runs: list[tuple[int, int]], rate_hz: float, resolution_hz: float | None) -> int:
    """Return the samples per segment: as asked, or so that about `SEGMENTS` fit in the runs."""
    sizes = np.array([b - a for a, b in runs], dtype=np.int64)
    longest = int(sizes.max(initial=0))
    if resolution_hz is not None:
        if not (resolution_hz > 0 and rate_hz / resolution_hz >= SHORTEST):
            raise DataError(
                f'a resolution of {resolution_hz:g} Hz needs a rate of '
                f'{SHORTEST * resolution_hz:g} Hz or more, not {rate_hz:g} Hz'
            )
        length = int(scipy.fft.next_fast_len(round(rate_hz / resolution_hz), real=True))
        if length > longest:
            raise DataError(
                f'a resolution of {resolution_hz:g} Hz needs {length} samples without a gap; '
                f'the longest run has {longest}'
            )
        return length
    if longest < SHORTEST:
        raise DataError(
            f'a spectrum needs {SHORTEST} samples without a gap; the longest run has {longest}'
        )
    length = SHORTEST
    while length < LONGEST:
        longer = 2 * length
        fitting = sizes[sizes >= longer]
        segments = int(np.sum((fitting - longer) // (longer // 2) + 1))
        # do not let a finer resolution leave out much of the record
        if segments < SEGMENTS or fitting.sum() < 0.7 * sizes.sum():
            break
        length = longer
    return length


def _periodograms(
    values: Floats, starts: Integers, length: int, groups: int, detrend: str
) -> tuple[Floats, Floats]:
    """Return the sum of modified periodograms of each group of segments, and their number."""
    window = _hann(length)
    window /= math.sqrt(float(window @ window))
    sums = np.zeros((groups, length // 2 + 1))
    sizes = np.zeros(groups)
    ramp = np.arange(length) - 0.5 * (length - 1)
    ramp /= math.sqrt(float(ramp @ ramp))
    batch = max(1, _AT_ONCE // length)
    owner = np.arange(starts.size) * groups // starts.size
    views = np.lib.stride_tricks.sliding_window_view(values, length)
    for first in range(0, starts.size, batch):
        part = views[starts[first : first + batch]]  # a copy
        part -= part.mean(axis=1, keepdims=True)
        if detrend == 'linear':
            part -= np.outer(part @ ramp, ramp)
        part *= window
        transform = scipy.fft.rfft(part, axis=1, overwrite_x=True)
        power = transform.real**2 + transform.imag**2
        if not np.all(np.isfinite(power[:, 0])):
            raise DataError('data hold values that are not finite; mark them in `valid`')
        own = owner[first : first + batch]
        edges = np.concatenate([[0], np.flatnonzero(np.diff(own)) + 1])
        sums[own[edges]] += np.add.reduceat(power, edges, axis=0)
        sizes[: own[-1] + 1] += np.bincount(own, minlength=own[-1] + 1)
    return sums, sizes


def _hann(length: int) -> Floats:
    """Return the periodic Hann window."""
    return np.asarray(0.5 - 0.5 * np.cos(2.0 * np.pi / length * np.arange(length)), np.float64)


@lru_cache(maxsize=64)
def _overlap_correlation(length: int, step: int) -> tuple[float, ...]:
    window = _hann(length)
    total = float(window @ window)
    shifts = range(step, length, step)
    return tuple(float(window[s:] @ window[:-s] / total) ** 2 for s in shifts)


def _segment_edf(segments: float, length: int, step: int) -> float:
    """Return the degrees of freedom of an average of overlapping segments."""
    # P. D. Welch 1967, IEEE Trans. Audio Electroacoust. AU-15(2):70.  Derived here: in white noise
    # densities of segments that overlap correlate by the squared autocorrelation of the window, so
    # the mean of K has (1 + 2 Σ (1 − m/K) ρ_m²)/K of the variance of one.
    correlated = _overlap_correlation(length, step)
    excess = sum(max(0.0, 1.0 - (m + 1) / segments) * r for m, r in enumerate(correlated))
    return 2.0 * segments / (1.0 + 2.0 * excess)


@lru_cache(maxsize=64)
def _median_factors(freedom: float, groups: int) -> tuple[float, float]:
    """Return the bias of the median of `groups` averages (odd), and its degrees of freedom."""
    # Mean and variance of the middle order statistic of chi-squared variables,
    # whose distribution function is Beta distributed (H. A. David and H. N.
    # Nagaraja 2003, Order Statistics, 3rd ed.).  For two degrees of
    # freedom the bias is the alternating harmonic sum of B. Allen et al. 2012,
    # Phys. Rev. D 85:122006, appendix B.
    nodes, weights = np.polynomial.legendre.leggauss(2000)
    u, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    quantile = scipy.special.gammaincinv(freedom / 2.0, u) * 2.0 / freedom

    log = 0.5 * (groups - 1) * (np.log(u) + np.log1p(-u))
    density = weights * np.exp(log - scipy.special.betaln((groups + 1) / 2, (groups + 1) / 2))
    mean = float(density @ quantile)
    variance = float(density @ (quantile - mean) ** 2)
    return mean, 2.0 * mean**2 / variance


def _interval(density: Floats, degrees: Floats, confidence: float) -> tuple[Floats, Floats]:
    check_confidence(confidence)
    tail = (1.0 - confidence) / 2.0
    # all bins but one or two have the same degrees of freedom
    half, own = np.unique(degrees / 2.0, return_inverse=True)
    low = density * (half / scipy.special.gammainccinv(half, tail))[own]
    high = density * (half / scipy.special.gammaincinv(half, tail))[own]
    return low, high
