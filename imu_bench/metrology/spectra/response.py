# SPDX-License-Identifier: Apache-2.0
"""
Two sensors on one plate: time offset, frequency response, coherence.

Sensors run on clocks and at rates of their own.  Both are brought to the time grid of the slower
one, the offset between them is found by cross-correlation, and what the one shows of the other
is the frequency response H1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

from imu_bench.errors import DataError
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]
Complexes = npt.NDArray[np.complex128]

USABLE = 0.4
"""Share of the lower sample rate up to which two sensors are compared."""

_UPSAMPLED = 8.0
"""Points per period of half the lower rate, at least, between which splines interpolate."""

_KAISER = 8.0
_TAPS = 51
"""
Taps of the anti-alias filter per ratio of the rates.  With Kaiser's beta = 8, which is 81 dB
down, a transition of Δω takes 73 / (2.285 Δω) of them (J. F. Kaiser's formula, as in
`signal.kaiserord`); here it goes from `USABLE` to half the lower rate.
"""

_BIN_CORRELATION = 35.0 / 18.0
"""Of neighbouring bins of a Hann window, as in `imu_bench.metrology.spectra.spectrum`."""

_CHANCE = 0.05
"""Probability that independent noise is taken for coherent in any bin."""

_SIGNIFICANT = 6.0
"""
Times the RMS of the whitened correlation that its peak is at least: of independent noise one lag
in 10⁹ is as high.
"""

_LEAST_CORRELATION = 0.05
"""Or the plain correlation at the peak: a tone in common alone makes no peak that stands out."""

_WHITENING = 0.7
"""Power of the cross spectrum that is divided out: 0 is the plain correlation, which follows
tones, 1 the phase transform, which follows noise."""


@dataclass(frozen=True, eq=False)
class Trace:
    """One axis on its regular time grid."""

    values: Floats  # without gaps
    rate_hz: float
    start_s: float  # time of the first sample

    @property
    def end_s(self) -> float:
        """Time of the last sample."""
        return self.start_s + (self.values.size - 1) / self.rate_hz


@dataclass(frozen=True, eq=False)
class Response:
    """What a sensor shows of what the reference shows.  Arrays have shape (k,)."""

    # time by which the sensor is late, in s: of its clock and of its filter together
    offset: Estimate
    frequency: Floats  # Hz
    # gain, gain_low, gain_high: |H1| and its interval
    gain: Floats
    gain_low: Floats
    gain_high: Floats
    phase: Floats  # rad, with the offset taken out
    # coherence, coherence_low, coherence_high: magnitude squared, and its interval
    coherence: Floats
    coherence_low: Floats
    coherence_high: Floats
    averages: float  # independent averages

    def at(self, frequency_hz: float, confidence: float = CONFIDENCE) -> Estimate:
        """Return the gain at one frequency; not observable outside the range compared."""
        k = int(np.argmin(np.abs(self.frequency - frequency_hz)))
        step = float(self.frequency[1] - self.frequency[0])
        if abs(float(self.frequency[k]) - frequency_hz) > step:
            reason = f'compared up to {self.frequency[-1]:.4g} Hz only'
            return Estimate.not_observable('1', reason, confidence=confidence)
        return Estimate(
            float(self.gain[k]), float(self.gain_low[k]), float(self.gain_high[k]), '1',
            confidence, method='H1',
        )  # fmt: skip


def compare(
    sensor: Trace,
    reference: Trace,
    *,
    resolution_hz: float,
    low_hz: float,
    longest_offset_s: float | None = None,
    confidence: float = CONFIDENCE,
) -> Response:
    """
    Return how a sensor answers to what the reference shows.

    Parameters
    ----------
    sensor, reference : Trace
        Their times need not agree.
    resolution_hz : float
        Distance of the bins.
    low_hz : float
        Lowest frequency that is compared; the offset is found from what is above it.
    longest_offset_s : float, optional
        Largest time offset looked for; half of the shorter record if not given.

    Raises
    ------
    DataError
        If the two do not overlap long enough, or show nothing in common.

    Notes
    -----
    H1 = S_xy / S_xx of Welch spectra, coherence γ² = |S_xy|² / (S_xx S_yy), random error of gain
    and phase √(1 − γ²) / (|γ| √(2 n)): J. S. Bendat and A. G. Piersol 2010, Random Data, 4th ed.,
    equation (9.90).  Interval of the coherence: artanh |γ| has about the variance 1 / (2 n − 2)
    (the tests find the same).  The offset is where the partly whitened cross-correlation is
    largest, made finer by the slope of the phase, weighted with its error (C. H. Knapp and
    G. C. Carter 1976, IEEE Trans. Acoust. Speech Signal Process. ASSP-24(4):320); what does not
    fit the straight line widens the interval.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> x = scipy.signal.lfilter([1.0], [1.0, -0.5], rng.normal(size=40_000))
    >>> late = Trace(0.9 * np.roll(x, 30), 1000.0, 0.0)
    >>> found = compare(late, Trace(x, 1000.0, 0.0), resolution_hz=1.0, low_hz=5.0)
    >>> round(found.offset.value, 4), round(found.at(50.0).value, 2)
    (0.03, 0.9)
    """
    rate = min(sensor.rate_hz, reference.rate_hz)
    coarse = _coarse(sensor, reference, rate, low_hz, longest_offset_s)
    moved = replace(sensor, start_s=sensor.start_s - coarse)
    a, b = _common(moved, reference, rate)
    length = int(scipy.fft.next_fast_len(round(rate / resolution_hz), real=True))
    if a.size < 2 * length:
        raise DataError(
            f'they overlap for {a.size / rate:.3g} s; a resolution of {resolution_hz:g} Hz needs '
            f'{2 * length / rate:.3g} s'
        )
    frequency, xx, yy, xy, averages = _spectra(b, a, rate, length)
    keep = (frequency >= low_hz) & (frequency <= USABLE * rate) & (xx > 0) & (yy > 0)
    if np.count_nonzero(keep) < 3:
        raise DataError(f'nothing to compare between {low_hz:g} Hz and {USABLE * rate:.4g} Hz')
    frequency, xx, yy, xy = frequency[keep], xx[keep], yy[keep], xy[keep]
    coherence = np.clip(np.abs(xy) ** 2 / (xx * yy), 1e-12, 1.0 - 1e-12)
    slope, error = _slope(frequency, xy, coherence, averages)
    reach = float(scipy.special.ndtri(0.5 + confidence / 2.0))
    late = coarse + slope
    offset = Estimate(
        late, late - reach * error, late + reach * error, 's', confidence,
        method='cross-correlation and phase',
    )  # fmt: skip
    gain = np.abs(xy) / xx
    spread = reach * gain * np.sqrt((1.0 - coherence) / (2.0 * averages * coherence))
    fisher, width = np.arctanh(np.sqrt(coherence)), reach / math.sqrt(2.0 * max(averages, 2.0) - 2)
    phase = np.angle(xy * np.exp(2j * np.pi * frequency * slope))
    return Response(
        offset, frequency, gain, np.maximum(gain - spread, 0.0), gain + spread, phase,
        coherence, np.tanh(np.maximum(fisher - width, 0.0)) ** 2, np.tanh(fisher + width) ** 2,
        averages,
    )  # fmt: skip


def _coarse(
    sensor: Trace, reference: Trace, rate: float, low_hz: float, longest_s: float | None
) -> float:
    """Return the time by which the sensor is late, to a sample, from the cross-correlation."""
    step = 1.0 / rate
    a = _band(_resampled(sensor, sensor.start_s, rate), rate, low_hz)
    b = _band(_resampled(reference, reference.start_s, rate), rate, low_hz)
    size = int(scipy.fft.next_fast_len(a.size + b.size, real=True))
    product = scipy.fft.rfft(a, size) * np.conj(scipy.fft.rfft(b, size))
    lags = np.arange(size)
    lags[lags >= a.size] -= size
    # a lag of the arrays, and what their first samples lie apart
    late = lags * step + (sensor.start_s - reference.start_s)
    most = 0.5 * min(a.size, b.size) * step if longest_s is None else longest_s
    allowed = np.abs(late) <= most
    if not allowed.any():
        raise DataError(
            f'their clocks are {abs(sensor.start_s - reference.start_s):.3g} s apart, more than '
            f'the {most:.3g} s looked for'
        )
    # a tone repeats itself, and with it the largest correlation: what is weak must count as well
    bins = np.arange(product.size)
    used = (bins >= low_hz * size / rate) & (bins <= USABLE * size)
    power = np.abs(product)
    white = np.where(used, product / np.maximum(power, np.finfo(float).tiny) ** _WHITENING, 0.0)
    strength = np.abs(scipy.fft.irfft(white, size))
    best = int(np.argmax(np.where(allowed, strength, -1.0)))
    stands_out = float(strength[best]) > _SIGNIFICANT * math.sqrt(float(np.mean(strength**2)))
    energy = math.sqrt(float(a @ a) * float(b @ b))
    alike = abs(float(scipy.fft.irfft(product, size)[best])) > _LEAST_CORRELATION * energy
    if energy == 0.0 or not (stands_out or alike):
        raise DataError('they show nothing in common: no time offset can be found')
    return float(late[best])


def _band(values: Floats, rate: float, low_hz: float) -> Floats:
    """Return the band that is compared, without its mean, fading at the ends."""
    sections = scipy.signal.butter(2, 2.0 * low_hz / rate, 'highpass', output='sos')
    pure = scipy.signal.sosfiltfilt(sections, values - values.mean())
    # without a window the ends of both records are alike, and look like no offset at all
    return np.asarray(pure * np.hanning(pure.size), np.float64)


def _resampled(trace: Trace, start_s: float, rate: float, count: int | None = None) -> Floats:
    """Return a trace at `count` points from `start_s` on at a lower or equal rate."""
    values, own = trace.values - trace.values.mean(), trace.rate_hz
    if own > 1.001 * rate:
        # what lies above half the lower rate must not fold
        count_of_taps = 2 * math.ceil(0.5 * _TAPS * own / rate) + 1
        middle = (USABLE + 0.5) * rate / own
        taps = scipy.signal.firwin(count_of_taps, middle, window=('kaiser', _KAISER))
        values = scipy.signal.fftconvolve(values, taps, mode='same')
    up = max(1, math.ceil(_UPSAMPLED * rate / own / 2.0))
    if up > 1:
        values = scipy.signal.resample_poly(values, up, 1)
    if count is None:
        count = math.floor((trace.end_s - start_s) * rate) + 1
    wanted = start_s + np.arange(count) / rate
    at = (wanted - trace.start_s) * own * up
    line = scipy.interpolate.CubicSpline(np.arange(values.size), values)
    return np.asarray(line(np.clip(at, 0, values.size - 1)), np.float64)


def _common(sensor: Trace, reference: Trace, rate: float) -> tuple[Floats, Floats]:
    """Return both at the same times, where both have samples."""
    begin = max(sensor.start_s, reference.start_s)
    end = min(sensor.end_s, reference.end_s)
    count = math.floor((end - begin) * rate)
    if count < 64:
        raise DataError('they do not overlap in time')
    return _resampled(sensor, begin, rate, count), _resampled(reference, begin, rate, count)


def _spectra(
    x: Floats, y: Floats, rate: float, length: int
) -> tuple[Floats, Floats, Floats, Complexes, float]:
    """Return frequency, both power spectra, the cross spectrum, and independent averages."""
    options = {'fs': rate, 'nperseg': length, 'noverlap': length - length // 2}
    frequency, xx = scipy.signal.welch(x, **options)
    _, yy = scipy.signal.welch(y, **options)
    _, xy = scipy.signal.csd(x, y, **options)
    segments = 1 + (x.size - length) // (length // 2)
    # P. D. Welch 1967: Hann segments that overlap by half are correlated by 1/6
    averages = segments / (1.0 + 2.0 / 36.0 * (1.0 - 1.0 / segments))
    return frequency, xx, yy, xy, averages


def _slope(
    frequency: Floats, xy: Complexes, coherence: Floats, averages: float
) -> tuple[float, float]:
    """Return delay of the phase, s, and its standard error."""
    omega = 2.0 * np.pi * frequency
    weight = 2.0 * averages * coherence / (1.0 - coherence) / _BIN_CORRELATION
    # what independent noise reaches in none of the bins
    chance = 1.0 - (_CHANCE / frequency.size) ** (1.0 / max(averages - 1.0, 1.0))
    weight = weight * (coherence > chance)
    if not weight.any():
        return 0.0, 0.5 / float(frequency[-1])
    # a mounting upside down is a phase of pi everywhere
    middle = np.sum(weight * xy / np.abs(xy))
    flipped = xy if middle.real >= 0.0 else -xy
    phase = np.angle(flipped)
    steep = float(np.sum(weight * omega**2))
    delay = -float(np.sum(weight * omega * phase)) / steep
    rest = np.angle(flipped * np.exp(1j * omega * delay))
    used = np.count_nonzero(weight)
    excess = float(np.sum(weight * rest**2)) / max(used / _BIN_CORRELATION - 1.0, 1.0)
    return delay, math.sqrt(max(1.0, excess) / steep)
