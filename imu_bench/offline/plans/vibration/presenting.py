# SPDX-License-Identifier: Apache-2.0
"""Tables of the plan `vibration`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.spectra.tones import Tone
from imu_bench.metrology.trials.envelope import Envelope, Fault
from imu_bench.metrology.trials.vibration import crank_frequency, families, Family
from imu_bench.offline.plans.vibration import bearing
from imu_bench.offline.plans.vibration.comparing import Against, origins
from imu_bench.offline.plans.vibration.measuring import (
    AxisVibration,
    Picture,
    SensorVibration,
    thinned,
)
from imu_bench.offline.presentation.figure import Figure, Series
from imu_bench.offline.presentation.tables import Cell, Column, Table
from msg_conversions.quantities import AXES
import numpy as np

LISTED = 6
"""Tones of an axis in the table; all are in the JSON document."""


@dataclass(frozen=True, eq=False)
class Found:
    """All that the plan found."""

    sensors: Mapping[str, SensorVibration]  # by label
    against: Sequence[Against]
    reference: str
    settings: Mapping[str, Any]

    @property
    def tolerance_hz(self) -> float:
        """How near to a multiple a tone must be."""
        return 0.6 * float(self.settings['resolution'][0])

    @cached_property
    def envelopes(self) -> list[tuple[str, Envelope]]:
        """Envelopes by sensor and axis."""
        named = ((f'{label} {axis.letter}', axis.envelope) for label, _, axis in _axes(self))
        return [(name, one) for name, one in named if one]

    @cached_property
    def faults(self) -> list[tuple[str, Fault]]:
        """Verdicts by sensor and axis."""
        return bearing.verdicts(self.envelopes, self.settings, self.tolerance_hz)

    @property
    def reference_tones(self) -> list[Tone]:
        """Tones of all axes of the reference."""
        base = self.sensors.get(self.reference)
        return [] if base is None else [tone for axis in base.axes for tone in axis.tones]

    def folded(self, label: str) -> dict[int, float]:
        """Return from where tones of a sensor folded, by identity of the tone."""
        sensor = self.sensors[label]
        there = origins(sensor, self.reference_tones, self.tolerance_hz)
        return {id(tone): true for tone, _, true in there}

    def families(self, label: str, axis: AxisVibration) -> tuple[Family, ...]:
        """Return the harmonic families of an axis, without what folded."""
        return families(self._own(label, axis), self.tolerance_hz)

    def _own(self, label: str, axis: AxisVibration) -> list[Tone]:
        folded = self.folded(label)
        return [tone for tone in axis.tones if id(tone) not in folded]

    def crank(self, label: str, axis: AxisVibration) -> Estimate | None:
        """Return revolutions per second, if there is an engine and it is seen."""
        cylinders, own = self.settings['cylinders'], self._own(label, axis)
        if not cylinders or not own:
            return None
        groups = self.families(label, axis)
        firing = groups[0].strongest if groups else own[0]
        return crank_frequency(firing.frequency, cylinders)


def tables(found: Found) -> Iterator[Table]:
    """Yield all tables."""
    if any(sensor.ride is not None for sensor in found.sensors.values()):
        yield _rides(found)
    yield _levels(found)
    if any(axis.tones for sensor in found.sensors.values() for axis in sensor.axes):
        yield _tones(found)
        groups = _families(found)
        if groups.rows:
            yield groups
    yield from bearing.tables(found.envelopes, found.faults)
    if found.against:
        yield _against(found)
    yield _ratios(found)


def _axes(found: Found) -> Iterator[tuple[str, SensorVibration, AxisVibration]]:
    for label, sensor in found.sensors.items():
        for axis in sensor.axes:
            yield label, sensor, axis


def band(sensor: SensorVibration, settings: Mapping[str, Any]) -> str:
    """Return the pass band of the filters in words."""
    high = settings['high_pass'][0]
    if sensor.low_pass is None:
        return f'above {high:g} Hz'
    return f'{high:g} Hz to {sensor.low_pass:g} Hz'


def _levels(found: Found) -> Table:
    rows = tuple(
        (
            f'{label} {axis.letter}',
            band(sensor, found.settings),
            axis.total.rms,
            axis.band.rms,
            axis.band.peak,
            axis.band.peak_to_peak,
            axis.band.crest_factor,
            axis.velocity.rms,
            axis.displacement.peak_to_peak,
        )
        for label, sensor, axis in _axes(found)
    )  # fmt: skip
    columns = (
        Column('sensor, axis'), Column('band'), Column('RMS, all', 'm/s²'), Column('RMS', 'm/s²'),
        Column('peak', 'm/s²'), Column('peak to peak', 'm/s²'), Column('crest factor'),
        Column('velocity RMS', 'mm/s'), Column('displacement, peak to peak', 'mm'),
    )  # fmt: skip
    steps = found.settings['moving_average']
    averaged = f', after a moving average of {steps} samples' if steps > 1 else ''
    note = (
        'Mean, which holds gravity and bias, removed; RMS, all is before any filter. Filters '
        f'without delay{averaged}. Velocity and displacement are integrals with everything '
        'slower than the high-pass taken out before and after.'
    )
    return Table('Vibration in time', columns, rows, note)


def _rides(found: Found) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for label, sensor in found.sensors.items():
        ride = sensor.ride
        if ride is None:
            rows.append((label, *(None,) * 6, sensor.no_ride))
            continue
        rows.append(
            (
                label, ride.smooth_acceleration, ride.peak_acceleration, ride.peak_velocity,
                ride.travel, float(ride.time[-1]), ride.closing, '',
            )
        )  # fmt: skip
    columns = (
        Column('sensor'), Column('acceleration', 'm/s²'), Column('highest reading', 'm/s²'),
        Column('highest speed', 'm/s'), Column('way', 'm'), Column('time', 's'),
        Column('speed taken out', 'm/s'), Column('remark'),
    )  # fmt: skip
    note = (
        'Along gravity, from standstill to standstill. Acceleration is the largest mean over '
        '0.25 s, which is what the cabin did; the highest reading is a single one, vibration '
        'included, and has no interval. Speed taken out is what the integral would have ended '
        'with, had the bias been that of the rest on either side; the intervals of speed and way '
        'count it. An error of the scale of the sensor is not in them.'
    )
    return Table('Ride', columns, tuple(rows), note)


def _tones(found: Found) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for label, _, axis in _axes(found):
        groups, crank = found.families(label, axis), found.crank(label, axis)
        folded = found.folded(label)
        rows += [
            (
                f'{label} {axis.letter}', tone.frequency, tone.amplitude, _multiple(tone, groups),
                None if id(tone) in folded else _order(tone, crank, found.tolerance_hz),
                _kind(tone, folded.get(id(tone))),
            )
            for tone in axis.tones[:LISTED]
        ]  # fmt: skip
    columns = (
        Column('sensor, axis'), Column('frequency', 'Hz'), Column('amplitude', 'm/s²'),
        Column('harmonic'), Column('order'), Column('remark'),
    )  # fmt: skip
    note = (
        'Amplitude is the peak of the sine. Harmonic is the multiple of the fundamental of its '
        'family, order that of the revolutions of the crank shaft (--set cylinders=). A line '
        'wider than the resolution wanders, or is a resonance.'
    )
    return Table(f'Tones, the {LISTED} strongest', columns, tuple(rows), note)


def _multiple(tone: Tone, groups: Sequence[Family]) -> str | None:
    for number, family in enumerate(groups):
        for order, member in family.members:
            if member is tone:
                return f'{order}' if number == 0 else f'{order} of family {number + 1}'
    return None


def _order(tone: Tone, crank: Estimate | None, tolerance_hz: float) -> float | None:
    """Return the order, to a half, which is what a four-stroke engine has."""
    if crank is None or not crank.value:
        return None
    twice = round(2.0 * (tone.frequency.value or 0.0) / crank.value)
    off = abs((tone.frequency.value or 0.0) - 0.5 * twice * crank.value)
    return 0.5 * twice if twice and off <= tolerance_hz else None


def _kind(tone: Tone, folded: float | None) -> str:
    words = [] if tone.steady else ['wider than the resolution']
    if folded is not None:
        words.append(f'{folded:.2f} Hz of the reference, folded')
    return ', '.join(words)


def _families(found: Found) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for label, _, axis in _axes(found):
        crank = found.crank(label, axis)
        for number, family in enumerate(found.families(label, axis)):
            multiples = ', '.join(str(order) for order, _ in family.members)
            speed = crank.to('rpm') if crank is not None and number == 0 else None
            strongest = family.strongest.frequency
            name = f'{label} {axis.letter}'
            rows.append((name, family.fundamental, multiples, strongest, speed))
    columns = (
        Column('sensor, axis'), Column('fundamental', 'Hz'), Column('harmonics seen'),
        Column('strongest at', 'Hz'), Column('engine speed', 'rpm'),
    )  # fmt: skip
    note = (
        'Engine speed takes the strongest tone of the first family for the firing of a '
        'four-stroke engine, cylinders/2 per revolution; it needs --set cylinders=.'
    )
    return Table('Harmonic families', columns, tuple(rows), note)


def _against(found: Found) -> Table:
    base = found.sensors[found.reference]
    rows: list[tuple[Cell, ...]] = []
    most = max((len(one.gains) for one in found.against), default=0)
    for one in found.against:
        response = one.response
        tones: list[Cell] = []
        for tone, gain in one.gains:
            tones += [round(tone.frequency.value or 0.0, 3), gain]
        tones += [None] * (2 * most - len(tones))
        coherent = None if response is None else float(response.coherence.mean())
        offset: Cell = None if response is None else response.offset
        rows.append((f'{one.label} {one.letter}', offset, coherent, one.ratio, *tones, one.why))
    heads = [c for k in range(most) for c in (Column(f'tone {k + 1}', 'Hz'), Column('gain'))]
    columns = (
        Column('sensor, axis'), Column('late by', 'ms'), Column('mean coherence'),
        Column('RMS ratio'), *heads, Column('remark'),
    )  # fmt: skip
    note = (
        f'Against {found.reference} ({base.rate_hz:.5g} Hz), axis by axis. Late by holds the '
        'offset of the clocks and the delay of the filters. Coherence is the mean up to 0.4 times '
        'the lower rate; it falls where a sensor shows its own noise or what folded back. Gain '
        'is |H1| at the strongest tones of the reference.'
    )
    return Table('Against the reference', columns, tuple(rows), note)


def _ratios(found: Found) -> Table:
    rows = tuple((f'{label} {axis.letter}', *axis.snr) for label, _, axis in _axes(found))
    columns = (
        Column('sensor, axis'), Column('before filtering', 'dB'), Column('after filtering', 'dB'),
    )  # fmt: skip
    note = (
        "As MATLAB's snr defines it, which the thesis used: the largest line over all that is "
        'neither it, nor its next five harmonics, nor constant. Of a motion without a sine, such '
        'as a lift ride, it tells how much stands out, not how good the sensor is.'
    )
    return Table('Signal-to-noise ratio (Shabulinzenze 2020, table 5.9)', columns, rows, note)


_PER_DECADE = 150


def figures(found: Found) -> Iterator[Figure]:
    """Yield all figures: the ride, traces, spectra, spectrograms, the comparison."""
    yield from _ride_figures(found)
    yield from _traces(found)
    for letter in AXES:
        yield from _spectra(found, letter)
    yield from _spectrograms(found)
    yield from _responses(found)


def _ride_figures(found: Found) -> Iterator[Figure]:
    rides = [(n, s, s.ride) for n, s in found.sensors.items() if s.ride is not None]
    if not rides:
        return
    for name, title, label in (
        ('acceleration', 'Ride: acceleration along gravity', 'acceleration in m/s²'),
        ('velocity', 'Ride: speed', 'speed in m/s'),
        ('displacement', 'Ride: way', 'way in m'),
    ):
        series = []
        for sensor, kept, ride in rides:
            picture = thinned(getattr(ride, name), kept.rate_hz)
            series.append(Series(sensor, picture.time, picture.middle))
        yield Figure(title, 'time since the ride began, s', label, tuple(series))


def _traces(found: Found) -> Iterator[Figure]:
    for label, sensor in found.sensors.items():
        axis = sensor.strongest
        picture = axis.picture
        yield Figure(
            f'{label} {axis.letter}: acceleration, {band(sensor, found.settings)}', 'time in s',
            'acceleration in m/s²', (_traced(axis.letter, picture),),
        )  # fmt: skip


def _traced(label: str, picture: Picture) -> Series:
    return Series(label, picture.time, picture.middle, picture.low, picture.high)


def _spectra(found: Found, letter: str) -> Iterator[Figure]:
    axes = [
        (label, axis)
        for label, sensor in found.sensors.items()
        for axis in sensor.axes
        if axis.letter == letter
    ]
    series = [_spectrum(label, axis) for label, axis in axes]
    series += [
        _marked(label, axis)
        for label, axis in axes
        if axis.tones and label == (found.reference or label)
    ]
    if series:
        yield Figure(
            f'Spectrum {letter}', 'frequency in Hz', 'amplitude density in (m/s²)/√Hz',
            tuple(series), log_x=True, log_y=True,
        )  # fmt: skip


def _spectrum(label: str, axis: AxisVibration) -> Series:
    """Return the amplitude density; of crowded bins the highest, so that no line is lost."""
    frequency, density = axis.spectrum.frequency, axis.spectrum.density
    place = np.floor(np.log10(frequency / frequency[0]) * _PER_DECADE).astype(np.int64)
    first = np.concatenate([[0], np.flatnonzero(np.diff(place)) + 1])
    return Series(label, frequency[first], np.sqrt(np.maximum.reduceat(density, first)))


def _marked(label: str, axis: AxisVibration) -> Series:
    """Return the tones at the height of their lines."""
    spectrum = axis.spectrum
    x = np.array([tone.frequency.value or 0.0 for tone in axis.tones])
    nearest = np.clip(np.rint(x / spectrum.resolution).astype(np.int64) - 1, 0, None)
    nearest = np.minimum(nearest, spectrum.density.size - 1)
    y = np.sqrt(spectrum.density[nearest])
    return Series(f'tones of {label}', x, y, kind='points')


def _spectrograms(found: Found) -> Iterator[Figure]:
    for label, sensor in found.sensors.items():
        axis = sensor.strongest
        yield Figure(
            f'{label} {axis.letter}: spectrogram', 'time in s', 'frequency in Hz',
            image=axis.spectrogram,
        )  # fmt: skip


def _responses(found: Found) -> Iterator[Figure]:
    for letter in AXES:
        coherent, gains = [], []
        for one in found.against:
            response = one.response
            if response is None or one.letter != letter:
                continue
            at = response.frequency
            coherent.append(
                Series(one.label, at, response.coherence, response.coherence_low,
                       response.coherence_high)
            )  # fmt: skip
            gains.append(
                Series(one.label, at, response.gain, response.gain_low, response.gain_high)
            )
        if coherent:
            title = f'against {found.reference}, {letter}'
            yield Figure(
                f'Coherence {title}', 'frequency in Hz', 'coherence', tuple(coherent), log_x=True
            )
            yield Figure(
                f'Frequency response {title}', 'frequency in Hz', 'gain |H1|', tuple(gains),
                log_x=True, log_y=True,
            )  # fmt: skip
