# SPDX-License-Identifier: Apache-2.0
"""
Noise density of a sensor: from the spectrum, from sigma and bandwidth, and how they compare.

Every density here is one-sided, as datasheets give it.  The coefficient N of
an Allan curve is the square root of the two-sided density: one-sided = sqrt(2) N.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Literal

from imu_bench.errors import DataError
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
from imu_bench.metrology.spectra.tones import Tone, tone_mask, tones
from imu_bench.metrology.spectra.welch import psd, Spectrum
import numpy as np
import numpy.typing as npt
import scipy

__all__ = [
    'NoiseDensities',
    'Spectrum',
    'Tone',
    'compare_densities',
    'density_from_sigma',
    'equivalent_noise_bandwidth',
    'one_sided',
    'plateau',
    'psd',
    'tones',
    'two_sided',
]

Floats = npt.NDArray[np.float64]

FLAT = 0.05
"""
A plateau is where the density stays within this of its mean, besides its scatter: 2.5 % of a noise
density in unit/√Hz.
"""

LEVEL = 0.3
"""
The power law of the density on a plateau is no steeper than this, with its error; flicker noise
has −1, what a low-pass leaves −2.
"""

_BANDS_PER_DECADE = 12
_NARROWEST = 0.5 * math.log(2.0)
"""Narrowest plateau: half an octave, two bands."""

_BIN_CORRELATION = 35.0 / 18.0
"""Sum of squared correlations of neighbouring bins of a Hann window: 1 + 2 (4/9 + 1/36)."""

_ORDERS = {'ideal': 0, 'first-order': 1, 'second-order': 2}


def equivalent_noise_bandwidth(
    bandwidth_hz: float, filter: Literal['ideal', 'first-order', 'second-order'] = 'ideal'
) -> float:
    """
    Return the width of the ideal filter that passes as much white noise, in Hz.

    A Butterworth filter of order n passes the integral of 1 / (1 + x^2n) over x > 0,
    (pi / 2n) / sin(pi / 2n), times its -3 dB bandwidth: pi/2 = 1.571 for n = 1, 1.111 for
    n = 2.
    """
    if not (bandwidth_hz > 0 and math.isfinite(bandwidth_hz)):
        raise DataError(f'a bandwidth is a positive number of Hz, got {bandwidth_hz}')
    if filter not in _ORDERS:
        raise DataError(f'unknown filter {filter!r}; known are {", ".join(_ORDERS)}')
    order = _ORDERS[filter]
    if order == 0:
        return bandwidth_hz
    angle = math.pi / (2 * order)
    return bandwidth_hz * angle / math.sin(angle)


def density_from_sigma(
    sigma: Estimate,
    bandwidth_hz: float,
    filter: Literal['ideal', 'first-order', 'second-order'] = 'ideal',
) -> Estimate:
    """
    Return the one-sided noise density of white noise from its standard deviation.

    Shabulinzenze 2020, Tampere University MSc thesis, equation (5.1):
    density = sigma / sqrt(bandwidth).  With an ideal filter, as there, the
    bandwidth is taken for the noise bandwidth; a real one lets more noise pass.

    Parameters
    ----------
    sigma : Estimate
        Standard deviation.
    bandwidth_hz : float
        -3 dB bandwidth of the signal, at most half the sample rate.
    filter : {'ideal', 'first-order', 'second-order'}
        How the sensor's own low-pass falls off.

    Raises
    ------
    DataError
        If the bandwidth is not positive or the filter unknown.

    Examples
    --------
    >>> sigma = Estimate(0.0116, 0.0115, 0.0117, 'm/s²')
    >>> round(density_from_sigma(sigma, 375.0).to('µg/√Hz').value, 1)
    61.1
    """
    width = equivalent_noise_bandwidth(bandwidth_hz, filter)
    scaled = sigma.scaled(1.0 / math.sqrt(width), f'{sigma.unit}/√Hz')
    method = f'sigma over {width:g} Hz'
    return Estimate(
        scaled.value, scaled.low, scaled.high, scaled.unit,
        scaled.confidence, scaled.observable, scaled.reason, method,
    )  # fmt: skip


def two_sided(density: Estimate) -> Estimate:
    """
    Return a one-sided amplitude density as a two-sided one.

    Examples
    --------
    >>> round(two_sided(Estimate(1.0, None, None, 'm/s²/√Hz')).value, 4)
    0.7071
    """
    return density.scaled(math.sqrt(0.5), density.unit)


def one_sided(density: Estimate) -> Estimate:
    """Return a two-sided amplitude density, such as N of an Allan curve, as a one-sided one."""
    return density.scaled(math.sqrt(2.0), density.unit)


@dataclass(frozen=True, eq=False)
class _Bands:
    """Means of the density over logarithmic bands, tones left out."""

    low: Floats
    high: Floats
    density: Floats
    bins: Floats
    error: Floats  # relative


def _bands(
    spectrum: Spectrum, keep: npt.NDArray[np.bool_], low_hz: float, high_hz: float
) -> _Bands:
    lowest = max(low_hz, float(spectrum.frequency[min(3, spectrum.frequency.size - 1)]))
    decades = math.log10(max(high_hz / lowest, 1.0))
    count = max(1, math.ceil(decades * _BANDS_PER_DECADE))
    edges = lowest * (high_hz / lowest) ** (np.arange(count + 1) / count)
    inside = np.flatnonzero(
        keep & (spectrum.frequency >= lowest) & (spectrum.frequency <= high_hz)
    )
    band = np.clip(
        np.searchsorted(edges, spectrum.frequency[inside], side='right') - 1, 0, count - 1
    )
    bins = np.bincount(band, minlength=count).astype(np.float64)
    total = np.bincount(band, spectrum.density[inside], minlength=count)
    used = bins > 0
    edf = float(np.median(spectrum.edf))
    error = np.sqrt(2.0 / edf / np.maximum(bins[used] / _BIN_CORRELATION, 1.0))
    return _Bands(edges[:-1][used], edges[1:][used], total[used] / bins[used], bins[used], error)


def plateau(
    spectrum: Spectrum,
    *,
    low_hz: float | None = None,
    high_hz: float | None = None,
    confidence: float = CONFIDENCE,
) -> Estimate:
    """
    Return the one-sided noise density of the flat part of a spectrum.

    Parameters
    ----------
    low_hz, high_hz : float, optional
        Look for it between these frequencies only.
    confidence : float
        Level of the interval.

    Returns
    -------
    Estimate
        In unit/√Hz; not observable where no part is flat.

    Notes
    -----
    Tones are left out.  The plateau is the range that spans the largest frequency
    ratio among those whose bands (12 per decade) all stay within `FLAT` of their
    common mean and three times their own scatter, and which certainly rise or fall
    by less than the power `LEVEL` of frequency; of a spectrum that falls
    towards its end, as behind a low-pass filter, and rises at its beginning, as
    with flicker noise, neither end is in it.  What unevenness is left widens
    the interval.

    Examples
    --------
    >>> x = np.random.default_rng(1).normal(size=100_000)
    >>> found = plateau(psd(x, 100.0, 'm/s²'))
    >>> bool(abs(found.value - np.sqrt(0.02)) < 0.002), found.unit
    (True, 'm/s²/√Hz')
    """
    nyquist = float(spectrum.frequency[-1])
    top = min(high_hz or nyquist, nyquist)
    keep = ~tone_mask(spectrum)
    keep[-1] = False
    bands = _bands(spectrum, keep, low_hz or 0.0, top)
    unit = spectrum.amplitude_unit
    span = _flattest(bands)
    if span is None or not np.any(bands.density > 0):
        return Estimate.not_observable(
            unit, 'no part of the spectrum is surely flat; record longer, or see the Allan curve',
            confidence=confidence, method='plateau',
        )  # fmt: skip
    part = slice(span[0], span[1] + 1)
    bins = bands.bins[part]
    level = float(bins @ bands.density[part] / bins.sum())
    freedom = float(np.median(spectrum.edf)) * max(bins.sum() / _BIN_CORRELATION, 1.0)
    half, tail = freedom / 2.0, (1.0 - confidence) / 2.0
    uneven = _unevenness(bands, part, level)
    if span != (0, bands.density.size - 1):  # something bounds it, and reaches into it
        uneven += FLAT
    low = level * (half / float(scipy.special.gammainccinv(half, tail)) - uneven)
    high = level * (half / float(scipy.special.gammaincinv(half, tail)) + uneven)
    return Estimate(
        math.sqrt(level), math.sqrt(max(low, 0.0)), math.sqrt(high), unit, confidence,
        method=f'plateau {bands.low[span[0]]:.3g} Hz to {bands.high[span[1]]:.3g} Hz',
    )  # fmt: skip


def _unevenness(bands: _Bands, part: slice, level: float) -> float:
    """Return how far, beyond their scatter, the ends of a plateau are from its mean."""
    density, bins, error = bands.density[part], bands.bins[part], bands.error[part]
    quarter = max(1, density.size // 4)
    found = 0.0
    for end in (slice(None, quarter), slice(-quarter, None)):
        off = abs(float(bins[end] @ density[end] / bins[end].sum()) / level - 1.0)
        found = max(found, off - 1.0 / math.sqrt(float(np.sum(error[end] ** -2))))
    return found


def _flattest(bands: _Bands) -> tuple[int, int] | None:
    """Return first and last band of the flat range of the largest frequency ratio."""
    width = np.log(bands.high[None, :] / bands.low[:, None])
    first, last = np.nonzero(width >= _NARROWEST)
    for k in np.argsort(-width[first, last], kind='stable'):
        if _is_flat(bands, slice(int(first[k]), int(last[k]) + 1)):
            return int(first[k]), int(last[k])
    return None


def _is_flat(bands: _Bands, part: slice) -> bool:
    """Return whether the bands are level: one by one, and without a slope."""
    density, bins, error = bands.density[part], bands.bins[part], bands.error[part]
    level = float(bins @ density / bins.sum())
    if level <= 0 or np.any(np.abs(density / level - 1.0) > FLAT + 3.0 * error):
        return False
    middle = np.log(np.sqrt(bands.low[part] * bands.high[part]))
    middle = middle - float(np.average(middle, weights=error**-2))
    spread = float(np.sum((middle / error) ** 2))
    slope = float(np.sum(middle / error**2 * density / level)) / spread
    return abs(slope) + 2.0 / math.sqrt(spread) <= LEVEL


AGREE = 0.10
"""
Densities that differ by no more than this are called equal whatever their intervals: a bandwidth
that is off by 20 % makes as much of sigma/√bandwidth.
"""


@dataclass(frozen=True)
class NoiseDensities:
    """One-sided noise density by three methods, and what their difference means."""

    from_sigma: Estimate  # standard deviation over the square root of the noise bandwidth
    from_plateau: Estimate  # flat part of the spectrum
    from_allan: Estimate  # square root of 2 times N
    agree: bool  # whether all that are observable agree
    verdict: str  # one sentence for the user


def compare_densities(
    from_sigma: Estimate, from_plateau: Estimate, from_allan: Estimate
) -> NoiseDensities:
    """
    Return the three one-sided noise densities with a verdict on whether they agree.

    Parameters
    ----------
    from_sigma : Estimate
        Of `spectrum.density_from_sigma`.
    from_plateau : Estimate
        Of `spectrum.plateau`.
    from_allan : Estimate
        One-sided, `spectrum.one_sided(N)`.

    Notes
    -----
    Two densities agree when their intervals overlap or they differ by less than
    `AGREE`.  The plateau and N are two views of the same white noise; sigma
    counts everything in the band, and trusts the bandwidth it is given.

    Examples
    --------
    >>> def density(value):
    ...     return Estimate(value, 0.99 * value, 1.01 * value, 'm/s²/√Hz')
    >>> compare_densities(density(1.5), density(1.0), density(1.02)).agree
    False
    """
    found = {'sigma': from_sigma, 'plateau': from_plateau, 'allan': from_allan}
    units = {estimate.unit for estimate in found.values()}
    if len(units) > 1:
        raise DataError(f'densities in different units: {", ".join(sorted(units))}')
    present = {name: e for name, e in found.items() if e.observable}
    if len(present) < 2:
        verdict = 'fewer than two methods give a noise density; nothing to compare'
        return NoiseDensities(from_sigma, from_plateau, from_allan, True, verdict)
    verdict = _difference(present)
    return NoiseDensities(
        from_sigma, from_plateau, from_allan, not verdict,
        verdict or f'{len(present)} methods agree',
    )  # fmt: skip


def _agree(first: Estimate, second: Estimate) -> bool:
    a, b = first.value or 0.0, second.value or 0.0
    if abs(a - b) <= AGREE * max(a, b):
        return True
    bounds = (first.low, first.high, second.low, second.high)
    low1, high1, low2, high2 = (math.nan if bound is None else bound for bound in bounds)
    return low1 <= high2 and low2 <= high1


def _difference(present: dict[str, Estimate]) -> str:
    """Return why the densities disagree; empty if they agree."""

    def ratio(first: str, second: str) -> float:
        return (present[first].value or 0.0) / (present[second].value or math.inf)

    if {'plateau', 'allan'} <= present.keys() and not _agree(present['plateau'], present['allan']):
        return (
            f'the plateau of the spectrum is {ratio("plateau", "allan"):.2f} times the density '
            'from N: the noise is not white between the plateau and the averaging times of N '
            '(tones, a filter, flicker or quantisation noise); trust the plateau in its own band'
        )
    white = 'plateau' if 'plateau' in present else 'allan'
    if 'sigma' not in present or white not in present or _agree(present['sigma'], present[white]):
        return ''
    if ratio('sigma', white) > 1:
        return (
            f'sigma over the bandwidth is {ratio("sigma", white):.2f} times the white noise: '
            'tones, drift or motion add to sigma, or the true noise bandwidth is wider than given'
        )
    return (
        f'sigma over the bandwidth is {ratio("sigma", white):.2f} times the white noise: '
        'the true noise bandwidth is narrower than given'
    )
