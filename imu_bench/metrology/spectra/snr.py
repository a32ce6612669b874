# SPDX-License-Identifier: Apache-2.0
"""Signal-to-noise ratio of a sine: fundamental against what is neither it nor a harmonic."""

from __future__ import annotations

from dataclasses import dataclass
import math

from imu_bench.errors import DataError
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

KAISER_BETA = 38.0
"""Of the window: Shabulinzenze 2020, section 5.2, and the documentation of MATLAB's snr."""

HARMONICS = 6
"""Lowest harmonics that are neither signal nor noise, the fundamental included."""

FEWEST = 64
"""Samples; the main lobe of the window covers 25 bins."""

_DECIBEL = 10.0 / math.log(10.0)


@dataclass(frozen=True)
class Snr:
    """A sine and the noise beside it."""

    ratio: Estimate  # signal power over noise power in dB
    frequency: float  # of the fundamental, Hz: centroid of its line
    # signal, noise: power in the squared unit of the data
    signal: float
    noise: float
    # power of the second to the last harmonic left out, 0 where none stands out
    harmonics: tuple[float, ...]


def snr(
    data: npt.ArrayLike,
    rate_hz: float,
    *,
    harmonics: int = HARMONICS,
    confidence: float = CONFIDENCE,
) -> Snr:
    """
    Return the signal-to-noise ratio of a sampled sine.

    Parameters
    ----------
    data : array_like, shape (n,)
        On the regular time grid, without gaps.
    rate_hz : float
        Sample rate.
    harmonics : int
        Harmonics left out of the noise, the fundamental included; those above half the
        sample rate count as noise where they fold to.
    confidence : float
        Level of the interval.

    Raises
    ------
    DataError
        If there are fewer than `FEWEST` samples, they are not finite, or constant.

    Notes
    -----
    The definition of MATLAB's ``snr(x, fs, n)`` as its documentation gives it (Signal
    Processing Toolbox, reference page snr, "Algorithms"): periodogram as long as the data
    with a Kaiser window of beta 38; the fundamental is the largest component, its line
    reaches as far as the periodogram falls on either side; the part at 0 Hz and the
    harmonics are left out; under them the noise is the median of the rest, or what is there
    if that is less.  Both documents used that function: Shabulinzenze 2020 (Tampere
    University MSc thesis), section 5.2, and Capriglione et al. 2021, section IV.

    The interval counts the scatter of the noise power, 2 (∫S df)² / (∫S² df / T') degrees of
    freedom with T' the length that the window leaves, and of the amplitude in that noise.

    Examples
    --------
    >>> t = np.arange(48_000) / 48_000.0
    >>> noise = 0.1 * np.random.default_rng(1).normal(size=t.size)
    >>> x = np.cos(2 * np.pi * 1000 * t) + 0.4 * np.sin(2 * np.pi * 2000 * t) + noise
    >>> found = snr(x, 48_000.0).ratio  # 10 log10(0.5 / 0.1²) = 16.99
    >>> abs(found.value - 16.99) < 0.2, found.unit
    (True, 'dB')
    """
    values = _checked(data, rate_hz)
    window = np.kaiser(values.size, KAISER_BETA)
    density = _periodogram(values, window, rate_hz)
    step = rate_hz / values.size
    original, taken = density.copy(), np.zeros(density.size, dtype=np.bool_)
    taken[: _falls(density, 0)[1] + 1] = True
    peak = int(np.argmax(np.where(taken, -1.0, density)))
    if density[peak] <= 0.0:
        raise DataError('the data are constant: no signal-to-noise ratio')
    line = slice(*_line(density, peak))
    taken[line] = True
    centre = float(np.arange(density.size)[line] @ density[line] / density[line].sum())
    others = [_harmonic(density, taken, centre * k) for k in range(2, harmonics + 1)]
    rest = original[~taken]
    if rest.size == 0:
        raise DataError('nothing but the sine and its harmonics is in the spectrum')
    level = float(np.median(rest))
    noise = np.where(taken, np.minimum(original, level), original)
    signal = float(np.sum(original[line] - noise[line])) * step
    power = float(noise.sum()) * step
    if power <= 0.0:
        raise DataError('the data hold no noise at all: no signal-to-noise ratio')
    error = _relative_error(noise, float(noise[peak]), signal, window, step)
    half = _DECIBEL * error * float(scipy.special.ndtri(0.5 + confidence / 2.0))
    ratio = _DECIBEL * math.log(max(signal, np.finfo(float).tiny) / power)
    found = Estimate(
        ratio, ratio - half, ratio + half, 'dB', confidence, method='Kaiser β = 38 periodogram'
    )
    powers = tuple(float(np.sum(original[k] - noise[k])) * step for k in others)
    return Snr(found, centre * step, signal, power, powers)


def _checked(data: npt.ArrayLike, rate_hz: float) -> Floats:
    values = np.asarray(data, dtype=np.float64)
    if values.ndim != 1 or values.size < FEWEST:
        raise DataError(f'a signal-to-noise ratio needs {FEWEST} samples, got {values.shape}')
    if not (rate_hz > 0 and math.isfinite(rate_hz)):
        raise DataError(f'the sample rate must be a positive number of Hz, got {rate_hz}')
    if not np.all(np.isfinite(values)):
        raise DataError('data hold values that are not finite')
    return np.asarray(values - values.mean(), np.float64)


def _periodogram(values: Floats, window: Floats, rate_hz: float) -> Floats:
    """Return the one-sided power spectral density."""
    # The bin at 0 Hz is doubled like the others, so that the line there falls from its top.
    transform = scipy.fft.rfft(values * window)
    density = (transform.real**2 + transform.imag**2) * 2.0 / (rate_hz * float(window @ window))
    if values.size % 2 == 0:
        density[-1] /= 2.0
    return np.asarray(density, np.float64)


def _falls(density: Floats, peak: int) -> tuple[int, int]:
    """Return the first and the last bin around `peak` up to which the density only falls."""
    right = np.flatnonzero(np.diff(density[peak:]) >= 0.0)
    left = np.flatnonzero(np.diff(density[peak::-1]) >= 0.0)
    last = peak + int(right[0]) if right.size else density.size - 1
    first = peak - int(left[0]) if left.size else 0
    return first, last


def _line(density: Floats, peak: int) -> tuple[int, int]:
    first, last = _falls(density, peak)
    return first, last + 1


def _harmonic(density: Floats, taken: Mask, place: float) -> slice:
    """Mark the line of a harmonic; empty if it is beyond the end or part of another line."""
    near = round(place)
    if near >= density.size - 1 or taken[near]:
        return slice(0, 0)
    peak = near - 1 + int(np.argmax(density[near - 1 : near + 2]))
    line = slice(*_line(density, peak))
    taken[line] = True
    return line


def _relative_error(
    noise: Floats, beneath: float, signal: float, window: Floats, step: float
) -> float:
    """Return the standard error of the logarithm of the power ratio."""
    square = float(window @ window)
    # a squared periodogram ordinate is twice the squared density
    scatter = 0.5 * float(noise @ noise) * step
    length = square**2 / (window.size * float(np.sum(window**4)))  # share of the record
    total = float(noise.sum()) * step
    of_noise = scatter * step / length / total**2
    bandwidth = step * window.size * square / float(window.sum()) ** 2
    of_signal = 2.0 * beneath * bandwidth / max(signal, np.finfo(float).tiny)
    return math.sqrt(of_noise + of_signal)
