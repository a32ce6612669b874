# SPDX-License-Identifier: Apache-2.0
"""Vibration in time and in orders: levels, velocity and displacement, harmonic families."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

from imu_bench.errors import DataError
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
from imu_bench.metrology.spectra.filtering import zero_phase
from imu_bench.metrology.spectra.tones import FALSE_ALARM, floor, Tone, tones
from imu_bench.metrology.spectra.welch import psd, Spectrum
from imu_bench.metrology.statistics import describe
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]

MOST_ORDERS = 32
"""Highest harmonic of a family: beyond, some multiple is near to any tone."""

_PARTS = 8
_SEGMENTS_PER_PART = 3
"""Parts in which a tone is found again, and segments that each needs for a spectrum of its own."""

_HIGHEST_DIVISOR = 16
"""
The strongest tone is this harmonic at most: of a bearing, a resonance makes a high one strongest.
"""

_SHARPEST = 0.1
"""Least share of the tolerance: a neighbour moves a line by some hundredths of a bin."""

_BY_CHANCE = 0.1
"""Families that the tones of one record form by chance, on average."""

_REACH = 4.0
"""Bins on either side of a tone that its line reaches, as `tones.LOBE`."""

_LASTING = 0.5
"""Part of its amplitude that the lower end of the interval of a lasting tone exceeds."""


@dataclass(frozen=True)
class Levels:
    """Levels of a vibration about its mean."""

    # peak, peak_to_peak: of this record; they grow with its length and carry no interval
    peak: Estimate
    peak_to_peak: Estimate
    rms: Estimate
    crest_factor: Estimate  # peak over RMS, with the interval that the RMS gives it


def levels(data: npt.ArrayLike, unit: str, confidence: float = CONFIDENCE) -> Levels:
    """
    Return peak, peak to peak, RMS and crest factor.

    Shabulinzenze 2020, Tampere University MSc thesis, section 4.4.2 and figure 4.6.

    Parameters
    ----------
    data : array_like, shape (n,)
        Of one axis; what is not finite is left out.
    unit : str
        That of the data.
    confidence : float
        Level of the intervals.

    Raises
    ------
    DataError
        If no finite sample is left.

    Examples
    --------
    >>> found = levels(np.sin(2 * np.pi * np.arange(8000) / 80), 'm/s²')
    >>> [round(e.value, 3) for e in (found.peak, found.peak_to_peak, found.rms)]
    [1.0, 2.0, 0.707]
    >>> round(found.crest_factor.value, 3)
    1.414
    """
    known = describe(data, unit, confidence)
    peak, rms = known.peak.value, known.rms
    if peak is None or not rms.value or not rms.low or not rms.high:
        crest = Estimate.not_observable('1', 'nothing moves', confidence=confidence)
    else:
        crest = Estimate(peak / rms.value, peak / rms.high, peak / rms.low, '1', confidence)
    return Levels(known.peak, known.peak_to_peak, rms, crest)


def integrals(data: npt.ArrayLike, rate_hz: float, high_pass: float) -> tuple[Floats, Floats]:
    """
    Return velocity and displacement of a vibration.

    Before and after each integration what is slower than `high_pass` is taken out, without
    delay: it holds bias, gravity and drift, which integration would let grow without limit.
    The ends are within the reach of the filter; a period of it is set to zero there.

    Parameters
    ----------
    data : array_like, shape (n,)
        Acceleration in m/s².
    high_pass : float
        Hz.

    Returns
    -------
    velocity, displacement : ndarray, shape (n,)
        m/s and m.

    Examples
    --------
    >>> t = np.arange(20_000) / 1000.0
    >>> v, d = integrals(9.8 + np.cos(2 * np.pi * 20 * t), 1000.0, 2.0)
    >>> round(float(v[5000:15000].max()) * 2 * np.pi * 20, 2)
    1.0
    """
    period = 1.0 / rate_hz
    values = np.asarray(data, dtype=np.float64)
    pure = zero_phase(values - values.mean(), rate_hz, high_pass=high_pass)
    steps = []
    for _ in range(2):
        pure = scipy.integrate.cumulative_trapezoid(pure, dx=period, initial=0.0)
        pure = zero_phase(pure - pure.mean(), rate_hz, high_pass=high_pass)
        steps.append(pure.copy())
    edge = min(values.size // 4, round(rate_hz / high_pass))
    for step in steps:
        step[:edge] = step[-edge:] = 0.0
    return steps[0], steps[1]


def dominant(
    data: npt.ArrayLike,
    rate_hz: float,
    unit: str,
    *,
    resolution_hz: float,
    confidence: float = CONFIDENCE,
    false_alarm: float = FALSE_ALARM,
) -> tuple[Spectrum, tuple[Tone, ...]]:
    """
    Return the spectrum of a vibration and its tones, strongest first.

    The frequency of a machine wanders.  What `tones` says of a tone holds for a steady one;
    here each tone is found again in up to eight parts of the record.  Where they scatter more
    than a steady tone would, the frequency is the centroid of its power, and the intervals are
    those of the parts; what is not there in most of them, such as the ringing of a thud, is left
    out.

    Parameters
    ----------
    data : array_like, shape (n,)
        On the regular time grid.
    resolution_hz : float
        Distance of the bins.
    false_alarm : float
        Probability that pure noise shows any.

    Raises
    ------
    DataError
        If the record is shorter than one segment of this resolution.

    Examples
    --------
    >>> t = np.arange(60_000) / 1000.0
    >>> x = np.sin(2 * np.pi * 26.67 * t) + 0.1 * np.random.default_rng(1).normal(size=t.size)
    >>> _, found = dominant(x, 1000.0, 'm/s²', resolution_hz=0.5)
    >>> round(found[0].frequency.value, 2), round(found[0].amplitude.value, 2)
    (26.67, 1.0)
    """
    values = np.asarray(data, dtype=np.float64)
    spectrum = psd(values, rate_hz, unit, resolution_hz=resolution_hz, confidence=confidence)
    found = tones(spectrum, false_alarm)
    segment = rate_hz / resolution_hz
    parts = int(min(_PARTS, values.size / (_SEGMENTS_PER_PART * segment)))
    if not found or parts < 3:
        return spectrum, found
    whole = _Lines(spectrum, floor(spectrum))
    pieces = [
        _Lines(piece, floor(piece))
        for part in np.array_split(values, parts)
        for piece in (psd(part, rate_hz, unit, resolution_hz=resolution_hz),)
    ]
    scattered = [_wandering(tone, whole, pieces) for tone in found]
    return spectrum, tuple(tone for tone in scattered if _lasting(tone))


def _lasting(tone: Tone) -> bool:
    """Return whether a tone is there throughout, and no bump or thud."""
    amplitude = tone.amplitude
    return (amplitude.low or 0.0) > _LASTING * (amplitude.value or 0.0)


@dataclass(frozen=True, eq=False)
class _Lines:
    """A spectrum and its floor."""

    spectrum: Spectrum
    level: Floats

    def around(self, frequency_hz: float) -> tuple[float, float]:
        """Return centroid and amplitude of what is above the floor near a frequency."""
        step = self.spectrum.resolution
        near = np.abs(self.spectrum.frequency - frequency_hz) <= _REACH * step
        power = np.clip(self.spectrum.density[near] - self.level[near], 0.0, None)
        total = float(power.sum())
        if total == 0.0:
            return frequency_hz, 0.0
        centre = float(self.spectrum.frequency[near] @ power) / total
        return centre, math.sqrt(2.0 * total * step)


def _wandering(tone: Tone, whole: _Lines, pieces: Sequence[_Lines]) -> Tone:
    """Return a tone with the scatter over the parts, where that is more than of a steady one."""
    centre = tone.frequency.value or 0.0
    parts = [piece.around(centre) for piece in pieces]
    frequencies, amplitudes = zip(*parts, strict=True)
    return Tone(
        _wider(tone.frequency, whole.around(centre)[0], frequencies),
        _wider(tone.amplitude, tone.amplitude.value or 0.0, amplitudes),
        tone.above_floor,
        tone.steady,
    )


def _wider(estimate: Estimate, middle: float, parts: Sequence[float]) -> Estimate:
    """Return `middle` with the scatter of the parts, or the estimate if that is surer of less."""
    if estimate.value is None or estimate.low is None or estimate.high is None:
        return estimate
    confidence, count = estimate.confidence, len(parts)
    error = float(np.std(parts, ddof=1)) / math.sqrt(count)
    half = error * float(scipy.special.stdtrit(count - 1, 0.5 + confidence / 2.0))
    if half <= 0.5 * (estimate.high - estimate.low):
        return estimate
    low = middle - half if estimate.unit == 'Hz' else max(middle - half, 0.0)
    return Estimate(middle, low, middle + half, estimate.unit, confidence, method='parts')


@dataclass(frozen=True)
class Family:
    """Tones at whole multiples of one frequency."""

    fundamental: Estimate  # Hz, from the strongest member
    members: tuple[tuple[int, Tone], ...]  # multiple and tone, in rising order

    @property
    def strongest(self) -> Tone:
        """The member of the largest amplitude."""
        return max((tone for _, tone in self.members), key=lambda t: t.amplitude.value or 0.0)


def families(found: Sequence[Tone], tolerance_hz: float) -> tuple[Family, ...]:
    """
    Return the families of harmonics among tones, the strongest first.

    A family has a tone at its fundamental and at least one more, and more of the others than
    tones without relation would put near its multiples (binomial).  Of the strongest tone and
    what it is a harmonic of, the fundamental is what chance explains least; a fundamental comes
    before the families at its multiples.  The d-th divisor and the r-th strongest tone count
    d(d + 1) and r(r + 1) times, so that all that are tried together give `_BY_CHANCE` families
    by chance.

    Parameters
    ----------
    tolerance_hz : float
        How near to a multiple a tone must be at most; nearer where the intervals of both say so.

    Examples
    --------
    >>> made = [Tone(Estimate(f, None, None, 'Hz'), Estimate(a, None, None, 'm/s²'), 1e3, True)
    ...         for f, a in ((26.67, 1.2), (53.33, 0.6), (13.33, 0.2), (41.0, 0.1))]
    >>> family = families(made, 0.1)[0]
    >>> round(family.fundamental.value, 2), [order for order, _ in family.members]
    (13.34, [1, 2, 4])
    """
    left = sorted(found, key=lambda tone: -(tone.amplitude.value or 0.0))
    groups: list[Family] = []
    rank = 0
    while len(left) >= 2:
        rank += 1
        strongest = left[0]
        top = strongest.frequency.value or 0.0
        judged: list[tuple[float, int, list[tuple[int, Tone]]]] = []
        for d in range(1, _HIGHEST_DIVISOR + 1):
            base = strongest.frequency.scaled(1.0 / d, 'Hz')
            if top / d > 4.0 * tolerance_hz:
                members = _members(left, base, tolerance_hz)
                if len(members) >= 2 and members[0][0] == 1:
                    chance = _chance(len(members), left, base, tolerance_hz)
                    judged.append((chance * d * (d + 1), d, members))
        chance, divisor, members = min(judged, key=lambda item: item[:2], default=(1.0, 1, []))
        if chance * rank * (rank + 1) < _BY_CHANCE:
            base = strongest.frequency.scaled(1.0 / divisor, 'Hz')
            groups.append(Family(base, tuple(members)))
            taken = {id(tone) for _, tone in members}
            left = [tone for tone in left if id(tone) not in taken]
        else:
            left = left[1:]
    return tuple(_fundamentals_first(groups, tolerance_hz))


def _chance(members: int, found: Sequence[Tone], base: Estimate, tolerance_hz: float) -> float:
    """Return the probability that so many tones lie near multiples of a base by chance."""
    hz = base.value or 0.0
    reach = (MOST_ORDERS + 0.5) * hz
    near = [
        2.0 * _reach(tone, base, round((tone.frequency.value or 0.0) / hz), tolerance_hz) / hz
        for tone in found
        if (tone.frequency.value or 0.0) < reach
    ]
    others = len(near) - 1
    # the strongest tone is at a multiple by construction
    share = min(float(np.mean(near)), 1.0)
    return (
        float(scipy.special.betainc(members - 1, others - members + 2, share)) if others else 1.0
    )


def _reach(tone: Tone, base: Estimate, order: int, most: float) -> float:
    """Return how near to a multiple of a base a tone has to be: twice the intervals of both."""
    known = tone.frequency
    if known.low is None or known.high is None or base.low is None or base.high is None:
        return most
    width = known.high - known.low + order * (base.high - base.low)
    return min(most, max(width, _SHARPEST * most))


def _fundamentals_first(groups: Sequence[Family], tolerance_hz: float) -> list[Family]:
    """Return families, each one before those whose fundamental is a multiple of its own."""
    ordered: list[Family] = []
    for group in groups:
        own = group.fundamental.value or 0.0
        after = [
            at
            for at, other in enumerate(ordered)
            if (base := other.fundamental.value or 0.0) > 1.5 * own
            and abs(base - round(base / own) * own) <= tolerance_hz
        ]
        ordered.insert(min(after, default=len(ordered)), group)
    return ordered


def _members(found: Sequence[Tone], base: Estimate, most: float) -> list[tuple[int, Tone]]:
    """Return multiples and tones at multiples of `base`; of several at one, the strongest."""
    members: dict[int, Tone] = {}
    hz = base.value or 0.0
    for tone in found:
        frequency = tone.frequency.value or 0.0
        order = round(frequency / hz)
        off = abs(frequency - order * hz)
        if 1 <= order <= MOST_ORDERS and off <= _reach(tone, base, order, most):
            members.setdefault(order, tone)
    return sorted(members.items())


def crank_frequency(firing: Estimate, cylinders: int) -> Estimate:
    """
    Return revolutions per second of a four-stroke engine from its firing frequency.

    Each cylinder fires every second revolution: Shabulinzenze 2020, Tampere University MSc
    thesis, section 4.4.4, where four cylinders at 800 rpm give 26.667 Hz.

    Raises
    ------
    DataError
        If there is no cylinder.

    Examples
    --------
    >>> round(crank_frequency(Estimate(26.667, 26.66, 26.68, 'Hz'), 4).to('rpm').value)
    800
    """
    if cylinders < 1:
        raise DataError(f'an engine has cylinders, not {cylinders}')
    return firing.scaled(2.0 / cylinders, 'Hz')
