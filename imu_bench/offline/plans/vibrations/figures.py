# SPDX-License-Identifier: Apache-2.0
"""Figures of the plan `vibration`."""

from __future__ import annotations

from collections.abc import Iterator

from imu_bench.offline.plans.result import PlanFigure, Series
from imu_bench.offline.plans.vibrations.measuring import AxisVibration
from imu_bench.offline.plans.vibrations.pictures import Picture, thinned
from imu_bench.offline.plans.vibrations.tables import band, Found
from imu_bench.samples import AXES
import numpy as np

_PER_DECADE = 150


def figures(found: Found) -> Iterator[PlanFigure]:
    """Yield all figures: the ride, traces, spectra, spectrograms, the comparison."""
    yield from _rides(found)
    yield from _traces(found)
    for letter in AXES:
        yield from _spectra(found, letter)
    yield from _spectrograms(found)
    yield from _responses(found)


def _rides(found: Found) -> Iterator[PlanFigure]:
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
        yield PlanFigure(title, 'time since the ride began, s', label, tuple(series))


def _traces(found: Found) -> Iterator[PlanFigure]:
    for label, sensor in found.sensors.items():
        axis = sensor.strongest
        picture = axis.picture
        yield PlanFigure(
            f'{label} {axis.letter}: acceleration, {band(sensor, found.settings)}', 'time in s',
            'acceleration in m/s²', (_traced(axis.letter, picture),),
        )  # fmt: skip


def _traced(label: str, picture: Picture) -> Series:
    return Series(label, picture.time, picture.middle, picture.low, picture.high)


def _spectra(found: Found, letter: str) -> Iterator[PlanFigure]:
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
        yield PlanFigure(
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


def _spectrograms(found: Found) -> Iterator[PlanFigure]:
    for label, sensor in found.sensors.items():
        axis = sensor.strongest
        yield PlanFigure(
            f'{label} {axis.letter}: spectrogram', 'time in s', 'frequency in Hz',
            image=axis.spectrogram,
        )  # fmt: skip


def _responses(found: Found) -> Iterator[PlanFigure]:
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
            yield PlanFigure(
                f'Coherence {title}', 'frequency in Hz', 'coherence', tuple(coherent), log_x=True
            )
            yield PlanFigure(
                f'Frequency response {title}', 'frequency in Hz', 'gain |H1|', tuple(gains),
                log_x=True, log_y=True,
            )  # fmt: skip
