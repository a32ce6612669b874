# SPDX-License-Identifier: Apache-2.0
"""
The envelope of a vibration: impacts that repeat, and which part of a bearing makes them.

A damaged bearing hits a resonance at every passage of the damage.  The spectrum shows the
resonance; how often it is hit stands in the spectrum of its squared envelope.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math

from imu_bench.errors import DataError
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
from imu_bench.metrology.spectra.tones import FALSE_ALARM, Tone
from imu_bench.metrology.spectra.welch import Spectrum
from imu_bench.metrology.trials.vibration import dominant
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]
Band = tuple[float, float]

SLIP = 0.02
"""
Part by which a fault frequency may be off the one of the geometry: the rollers slip, "typically
1 to 2 %" (R. B. Randall and J. Antoni, Mech. Syst. Signal Process. 25 (2011) 485, section 2).
"""

BY_CHANCE = 0.01
"""Probability that any fault is seen of those looked for, though no line belongs to it."""

_OCTAVES = 3
_HIGHEST = 0.45
"""Bands tried: octaves below this share of the rate, near to which no filter lets anything by."""

SLOWEST = 400.0
"""
Sample rate over resolution from which on the lowest octave has a spectrum: it holds an eighth of
so many bins, and its floor is a median of 50 at least.
"""

_FIRST = 2
"""A rolling element hits both races: its second harmonic is there, its first may not be."""

_ORDERS = 6
"""Harmonics of a fault that are looked for."""

_MIDDLE = 0.5 * (1 + _ORDERS)
"""The middle one: the reach of the others grows with their order."""


@dataclass(frozen=True, eq=False)
class Envelope:
    """
    The spectrum of the squared envelope of one band.

    Attributes
    ----------
    band : (float, float)
        Hz.
    mean : float
        Mean of the squared envelope: twice the power in the band.
    spectrum : Spectrum
        Of the squared envelope.
    tones : tuple of Tone
        Its lines, strongest first: how often something happens, and by how much the power varies.
    """

    band: Band
    mean: float
    spectrum: Spectrum
    tones: tuple[Tone, ...]

    def depth(self, tone: Tone) -> Estimate:
        """Return the part of the mean by which the squared envelope varies with a tone."""
        return tone.amplitude.scaled(1.0 / self.mean, '1')


def squared_envelope(data: npt.ArrayLike, rate_hz: float, band: Band) -> tuple[Floats, float]:
    """
    Return the squared envelope of a band, and its sample rate.

    The envelope is the size of the analytic signal, whose negative frequencies are taken out
    (D. Gabor 1946, J. IEE 93(III):429).  Moved down to zero it needs no more samples than
    twice the width of the band, which is what it gets.

    Parameters
    ----------
    data : array_like, shape (n,)
        Finite samples on the regular time grid.
    band : (float, float)
        Hz, inside 0 to half the rate.

    Raises
    ------
    DataError
        If the band is not between 0 and half the rate, or holds no frequency.

    Examples
    --------
    >>> t = np.arange(8000) / 1000.0
    >>> x = (1.0 + 0.5 * np.cos(2 * np.pi * 5 * t)) * np.cos(2 * np.pi * 200 * t)
    >>> square, rate = squared_envelope(x, 1000.0, (150.0, 250.0))
    >>> round(float(square.max()), 3), 200.0 <= rate < 210.0
    (2.25, True)
    """
    values = np.asarray(data, dtype=np.float64)
    low, high = band
    if not 0.0 < low < high <= 0.5 * rate_hz:
        raise DataError(
            f'an envelope of {low:g} to {high:g} Hz: give a band between 0 and half the rate of '
            f'{rate_hz:.5g} Hz'
        )
    spectrum = scipy.fft.rfft(values - values.mean())
    step = rate_hz / values.size
    part = spectrum[math.ceil(low / step) : math.floor(high / step) + 1]
    if part.size < 2:
        raise DataError(f'{values.size} samples resolve nothing between {low:g} and {high:g} Hz')
    size = int(scipy.fft.next_fast_len(2 * part.size))
    analytic = scipy.fft.ifft(part, size) * (2.0 * size / values.size)
    return analytic.real**2 + analytic.imag**2, size * step


def envelope(
    data: npt.ArrayLike,
    rate_hz: float,
    unit: str,
    *,
    resolution_hz: float,
    band: Band | None = None,
    confidence: float = CONFIDENCE,
) -> Envelope:
    """
    Return the envelope spectrum of a vibration.

    Parameters
    ----------
    data : array_like, shape (n,)
        On the regular time grid.
    unit : str
        That of the data.
    resolution_hz : float
        Distance of the bins.
    band : (float, float), optional
        Hz.  By default the one of the three highest octaves whose envelope has the line that
        stands out most; as three are tried, each may show one by chance a third as often.

    Raises
    ------
    DataError
        If the band or the resolution does not fit the record.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> x = rng.normal(size=60_000)
    >>> x[::150] += 20.0
    >>> found = envelope(x, 3000.0, 'm/s²', resolution_hz=0.5)
    >>> round(min(tone.frequency.value for tone in found.tones), 1)
    20.0
    """
    tried = [band] if band else _octaves(rate_hz)
    found = [
        _envelope(data, rate_hz, unit, one, resolution_hz, confidence, FALSE_ALARM / len(tried))
        for one in tried
    ]
    return max(found, key=lambda one: max((t.above_floor for t in one.tones), default=0.0))


def _octaves(rate_hz: float) -> list[Band]:
    top = _HIGHEST * rate_hz
    return [(top / 2.0 ** (k + 1), top / 2.0**k) for k in range(_OCTAVES)]


def _envelope(
    data: npt.ArrayLike, rate_hz: float, unit: str, band: Band, resolution_hz: float,
    confidence: float, false_alarm: float,
) -> Envelope:  # fmt: skip
    square, rate = squared_envelope(data, rate_hz, band)
    spectrum, tones = dominant(
        square, rate, f'({unit})²',
        resolution_hz=resolution_hz, confidence=confidence, false_alarm=false_alarm,
    )  # fmt: skip
    return Envelope(band, float(square.mean()), spectrum, tones)


def bearing_frequencies(
    speed_hz: float, elements: int, diameter: float, pitch: float, angle_rad: float = 0.0
) -> dict[str, float]:
    """
    Return how often each part of a bearing is hit, in Hz, when the inner race turns.

    R. B. Randall and J. Antoni, Mech. Syst. Signal Process. 25 (2011) 485, equations 1 to 4.  A
    damaged rolling element hits both races, twice per turn about itself.

    Parameters
    ----------
    speed_hz : float
        Revolutions of the shaft per second.
    elements : int
        Rolling elements.
    diameter, pitch : float
        Of an element and of the circle of their centres, in the same unit.
    angle_rad : float
        Contact angle.

    Raises
    ------
    DataError
        If there is no such bearing.

    Examples
    --------
    >>> found = bearing_frequencies(1.0, 9, 0.3126, 1.537)
    >>> [(part, round(hz, 4)) for part, hz in found.items()]
    [('cage', 0.3983), ('element', 2.3567), ('outer race', 3.5848), ('inner race', 5.4152)]
    """
    if elements < 1 or not 0.0 < diameter < pitch or not speed_hz > 0.0:
        raise DataError(
            f'no bearing: {elements} elements of {diameter:g} on a circle of {pitch:g} at '
            f'{speed_hz:g} Hz'
        )
    share = diameter / pitch * math.cos(angle_rad)
    return {
        'cage': speed_hz / 2.0 * (1.0 - share),
        'element': speed_hz * pitch / (2.0 * diameter) * (1.0 - share**2),
        'outer race': elements * speed_hz / 2.0 * (1.0 - share),
        'inner race': elements * speed_hz / 2.0 * (1.0 + share),
    }


@dataclass(frozen=True)
class Fault:
    """
    What an envelope says about one fault.

    Attributes
    ----------
    name : str
        What is damaged.
    expected_hz : float
        Frequency of its impacts, in Hz.
    seen : bool
        Whether its lines are more than chance puts there.
    frequency, depth : Estimate
        Of its strongest line: Hz over its order, and part of the mean by which the squared
        envelope varies; not observable where nothing is seen.
    orders : tuple of int
        Harmonics that have a line.
    chance : float
        Probability that lines without relation to it lie as near; 1 where there are none.
    """

    name: str
    expected_hz: float
    seen: bool
    frequency: Estimate
    depth: Estimate
    orders: tuple[int, ...]
    chance: float


def faults(
    found: Envelope, expected: Mapping[str, float], tolerance_hz: float
) -> tuple[Fault, ...]:
    """
    Return the verdict on every fault, at an expected frequency in Hz by its name.

    A line within `SLIP` of the frequency or of twice that fixes how far the elements slip; others
    have to be at its multiples then.  Lines that have nothing to do with it lie there by chance,
    which a fault has to exceed; the r-th strongest line counts r(r + 1) times, as it is one of
    many that are tried.  Lines of the surest fault say nothing about the others: three passages
    of the outer race take about as long as two of the inner one.
    """
    limit = BY_CHANCE / max(1, len(expected))
    lines, left = list(found.tones), dict(expected)
    verdicts: dict[str, Fault] = {}
    while left:
        tried = [_fault(found, lines, name, hz, tolerance_hz, limit) for name, hz in left.items()]
        fault, members = min(tried, key=lambda one: one[0].chance)
        if not fault.seen:
            verdicts |= {one.name: one for one, _ in tried}
            break
        verdicts[fault.name] = fault
        del left[fault.name]
        taken = {id(tone) for _, tone in members}
        lines = [tone for tone in lines if id(tone) not in taken]
    return tuple(verdicts[name] for name in expected)


def _fault(
    found: Envelope, lines: Sequence[Tone], name: str, expected: float, tolerance: float,
    limit: float,
) -> tuple[Fault, list[tuple[int, Tone]]]:  # fmt: skip
    span, confidence = float(found.spectrum.frequency[-1]), found.spectrum.confidence
    near = _MIDDLE * 2.0 * tolerance * len(lines) / span
    best: tuple[float, float, list[tuple[int, Tone]]] = (1.0, expected, [])
    for order in range(1, _FIRST + 1):
        reach = max(SLIP * order * expected, tolerance)
        for rank, tone in enumerate(lines, 1):
            at = tone.frequency.value or 0.0
            if abs(at - order * expected) > reach:
                continue
            members = _multiples(lines, at / order, tolerance)
            by_chance = min(1.0, _FIRST * 2.0 * reach / span * rank * (rank + 1))
            by_chance *= _others(len(members) - 1, min(1.0, near))
            best = min(best, (by_chance, at / order, members), key=lambda one: one[0])
    chance, _, members = best
    orders = tuple(order for order, _ in members)
    if chance >= limit:
        reason = 'no more lines than chance puts there' if members else 'no line near it'
        hz, depth = (
            Estimate.not_observable(unit, reason, confidence=confidence) for unit in ('Hz', '1')
        )
        return Fault(name, expected, False, hz, depth, orders, chance), members
    order, tone = max(members, key=lambda one: one[1].amplitude.value or 0.0)
    frequency = tone.frequency.scaled(1.0 / order, 'Hz')
    return Fault(name, expected, True, frequency, found.depth(tone), orders, chance), members


def _multiples(tones: Sequence[Tone], base: float, tolerance: float) -> list[tuple[int, Tone]]:
    """Return the strongest tone near each of the first multiples of a frequency."""
    members: dict[int, Tone] = {}
    for tone in tones:
        at = tone.frequency.value or 0.0
        order = round(at / base)
        # slip that comes and goes moves the harmonics the more the higher they are
        if 1 <= order <= _ORDERS and abs(at - order * base) <= order * tolerance:
            members.setdefault(order, tone)
    return sorted(members.items())


def _others(count: int, near: float) -> float:
    """Return the probability of so many lines or more at the other multiples."""
    if count < 1:
        return 1.0
    return float(scipy.special.betainc(count, _ORDERS - count, near))
