# SPDX-License-Identifier: Apache-2.0
"""Tones in a spectrum (mains hum, fans, resonances) with amplitude and frequency."""

from __future__ import annotations

from dataclasses import dataclass
import math

from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.spectra.welch import Spectrum
from imu_bench.metrology.stretches import stretches
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

FALSE_ALARM = 0.01
"""Probability that a spectrum of pure noise shows any tone."""

LOBE = 4
"""Bins on either side of a tone that its line in a Hann spectrum reaches above noise."""

FLOOR_BINS = 101
"""Bins over which the noise floor is the running median."""

OVERLAP = 0.4
"""Segments that overlap by half see the same noise with opposite effect on the frequency:
their mean has (1/8) / (2 * 5/32) of the variance of independent ones."""

_NARROW = 0.75
"""
Share of the power of a line in its three highest bins below which it is wide: that of a steady
tone in a Hann window is 0.98 or more, less what noise adds.
"""


@dataclass(frozen=True)
class Tone:
    """One tone."""

    frequency: Estimate  # Hz
    amplitude: Estimate  # peak amplitude of the sine, in the unit of the signal
    above_floor: float  # height of its line above the noise floor, as a ratio of power densities
    # whether the line is as narrow as the resolution; a line that is wider belongs to a resonance
    # or a tone that wanders
    steady: bool


def floor(spectrum: Spectrum) -> Floats:
    """Return the noise floor under the tones: the running median over neighbouring bins."""
    decibel = np.log(np.maximum(spectrum.density, np.finfo(float).tiny))
    decibel[-1] = decibel[-2:].max()  # the bin at half the rate may hold half the density
    size = decibel.size
    width = min(FLOOR_BINS, max(5, size // 8 * 2 + 1))
    level = scipy.ndimage.median_filter(decibel, width, mode='mirror')
    narrow = width // 4  # the first bins take fewer neighbours, to follow noise that rises there
    while narrow >= 4:
        nearer = scipy.ndimage.median_filter(
            decibel[: 4 * narrow], 2 * (narrow // 2) + 1, mode='mirror'
        )
        level[:narrow] = nearer[:narrow]
        narrow //= 2
    # the median of a chi-squared variable lies below its mean: E. B. Wilson and M. M. Hilferty
    # 1931, Proc. Natl. Acad. Sci. 17:684
    bias = (1.0 - 2.0 / (9.0 * np.median(spectrum.edf))) ** 3
    return np.asarray(np.exp(level) / bias, np.float64)


def tones(spectrum: Spectrum, false_alarm: float = FALSE_ALARM) -> tuple[Tone, ...]:
    """
    Return the tones that stand out of the noise floor, strongest first.

    Parameters
    ----------
    spectrum : Spectrum
        Of `imu_bench.metrology.spectra.welch.psd`.
    false_alarm : float
        Probability that pure noise shows any.

    Notes
    -----
    The frequency comes from the two highest bins of the line, exact for a Hann
    window (T. Grandke 1983, IEEE Trans. Instrum. Meas. IM-32(2):350), the amplitude
    from the power of the line above the floor, which does not depend on where it
    lies between the bins.  Intervals are propagated from the scatter of the bins
    for a tone in noise; a wandering tone is marked not `steady`.

    Examples
    --------
    >>> from imu_bench.metrology.spectra.welch import psd
    >>> t = np.arange(100_000) / 100.0
    >>> x = np.random.default_rng(1).normal(size=t.size) + 0.3 * np.sin(2 * np.pi * 12.5 * t)
    >>> [(round(f.frequency.value, 2), round(f.amplitude.value, 1)) for f in tones(psd(x, 100.0))]
    [(12.5, 0.3)]
    """
    level = floor(spectrum)
    found: list[Tone] = []
    lines = _lines(spectrum, level, false_alarm)
    peaks = [left + int(np.argmax(spectrum.density[left : right + 1])) for left, right in lines]
    strongest = sorted(range(len(lines)), key=lambda k: -spectrum.density[peaks[k]])
    for rank, line in enumerate(strongest):
        stronger = np.array([peaks[k] for k in strongest[:rank]], dtype=np.int64)
        if spectrum.density[peaks[line]] > _leakage(spectrum.density, stronger, peaks[line]):
            found.append(_measured(spectrum, level, peaks[line], *lines[line]))
    return tuple(sorted(found, key=lambda tone: -(tone.amplitude.value or 0.0)))


def _leakage(density: Floats, peaks: npt.NDArray[np.int64], at: int) -> float:
    """Return what side lobes of lines at `peaks` may reach at one bin, with a margin of 4."""
    distance = np.maximum(np.abs(peaks - at) - 0.5, 1.5)
    return float(np.sum(4.0 * density[peaks] / (np.pi * distance * (distance**2 - 1.0)) ** 2))


def tone_mask(spectrum: Spectrum, false_alarm: float = FALSE_ALARM) -> Mask:
    """Return which bins belong to tones."""
    mask = np.zeros(spectrum.density.size, dtype=np.bool_)
    for left, right in _lines(spectrum, floor(spectrum), false_alarm):
        mask[max(0, left - LOBE) : right + LOBE + 1] = True
    return mask


def _lines(spectrum: Spectrum, level: Floats, false_alarm: float) -> list[tuple[int, int]]:
    """Return first and last bin above the threshold of every line."""
    size = spectrum.density.size
    ratio = spectrum.density / level
    # all bins but one or two have the same degrees of freedom
    half, own = np.unique(spectrum.edf / 2.0, return_inverse=True)
    # the floor is a median over a hundred bins: its own scatter counts as well
    scatter = 1.0 + 1.25 * np.sqrt(2.0 / spectrum.edf * np.pi / 2.0 / FLOOR_BINS)
    limit = (scipy.special.gammainccinv(half, false_alarm / size) / half)[own] * scatter
    above = ratio > limit
    above[: min(3, size)] = False  # the mean was removed; nothing is measured here
    above[-1:] = False
    return [(a, b - 1) for a, b in stretches(above).tolist()]


def _measured(spectrum: Spectrum, level: Floats, peak: int, left: int, right: int) -> Tone:
    density, degrees = spectrum.density, spectrum.edf
    bins = np.arange(
        max(0, min(left, peak - LOBE)), min(density.size, max(right, peak + LOBE) + 1)
    )
    # the correction of the median is for noise, a tone has the same power in every segment
    over = (density[bins] - level[bins]) * spectrum.bias
    line = np.clip(over, 0.0, None)
    power = float(np.sum(over)) * spectrum.resolution
    power = max(power, float(over[peak - bins[0]]) * spectrum.resolution)
    near = np.clip(density[peak - 1 : peak + 2] - level[peak - 1 : peak + 2], 0.0, None)
    # a steady tone does not scatter from segment to segment, noise and their product do
    variance = (2.0 * level[bins] * line + level[bins] ** 2) * 2.0 / degrees[bins]
    reach = float(scipy.special.ndtri(0.5 + spectrum.confidence / 2))
    # each bin is correlated with its neighbours: 1 + 2 (2/3 + 1/6) = 8/3 for amplitudes of
    # a Hann window, of which a line covers about three bins
    error = math.sqrt(float(variance.sum())) * spectrum.resolution * math.sqrt(8.0 / 3.0)
    amplitude = math.sqrt(2.0 * power)
    half = reach * error / amplitude
    gain = OVERLAP if spectrum.average == 'mean' else 1.0
    offset, offset_error = _offset(near, float(level[peak]), float(degrees[peak]), gain)
    frequency = float(spectrum.frequency[peak]) + offset * spectrum.resolution
    spread = reach * offset_error * spectrum.resolution
    share = float(near.sum()) / max(float(line.sum()), np.finfo(float).tiny)
    return Tone(
        Estimate(frequency, frequency - spread, frequency + spread, 'Hz', spectrum.confidence),
        Estimate(
            amplitude, max(amplitude - half, 0.0), amplitude + half,
            spectrum.unit, spectrum.confidence,
        ),
        float(density[peak] / level[peak]),
        share >= _NARROW,
    )  # fmt: skip


def _offset(near: Floats, noise: float, degrees: float, gain: float) -> tuple[float, float]:
    """Return the distance of a tone from the highest of three bins, in bins, and its error."""
    # An amplitude in noise of power density n scatters by sqrt(n / edf), however large it
    # is; the amplitudes of neighbouring Hann bins do so with a correlation of 2/3.  The
    # scatter of the noise itself comes on top, independent from bin to bin.
    side = 1 if near[2] >= near[0] else -1
    centre, beside = float(near[1]), max(float(near[1 + side]), noise / degrees)
    ratio = math.sqrt(beside / centre)
    offset = (2.0 * ratio - 1.0) / (ratio + 1.0)
    variance = gain * noise / degrees * (1.0 + ratio**2 - 4.0 / 3.0 * ratio)
    variance += noise**2 / (2.0 * degrees) * (1.0 / beside + ratio**2 / centre)
    error = 3.0 / (1.0 + ratio) ** 2 * math.sqrt(variance / centre)
    return side * min(max(offset, -0.5), 1.0), error
