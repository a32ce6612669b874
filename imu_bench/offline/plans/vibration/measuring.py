# SPDX-License-Identifier: Apache-2.0
"""What is kept of the accelerometer of one recording."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any

from imu_bench.errors import DataError, RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.spectra.filtering import moving_average, zero_phase
from imu_bench.metrology.spectra.response import Trace
from imu_bench.metrology.spectra.snr import snr
from imu_bench.metrology.spectra.tones import Tone
from imu_bench.metrology.spectra.welch import Spectrum
from imu_bench.metrology.stamps.time_grid import grid, place
from imu_bench.metrology.trials.crosstalk import mean_squares
from imu_bench.metrology.trials.envelope import Envelope, envelope, SLOWEST
from imu_bench.metrology.trials.ride import find_ride, integrate_ride, Ride
from imu_bench.metrology.trials.vibration import dominant, integrals, Levels, levels
from imu_bench.offline.analysis.axes import axes
from imu_bench.offline.notation import number
from imu_bench.offline.plans.vibration import bearing
from imu_bench.offline.presentation.figure import Image
from imu_bench.offline.recordings import Recording
from imu_bench.units import STANDARD_GRAVITY
from msg_conversions.quantities import AXES, LINEAR_ACCELERATION
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]

LONGEST = 1 << 22
"""Samples of an axis that are analysed: an hour at 1 kHz, in less than 1 GB of memory."""

FEWEST = 1024
"""Samples: a spectrum of 128 bins in eight segments."""

PERIODS = 4.0
"""Periods of the high-pass that a vibration lasts at least: one at each end is the filter's."""

_HIGHEST = 0.45
"""Share of the sample rate above which a low-pass is left out: next to nothing is above it."""

_SHOWN = 4.0
"""A spectrogram reaches up to so many times the low-pass."""

_GRAVITY_SEEN = 0.5
"""A sensor whose mean is less than this share of gravity does not see it."""


@dataclass(frozen=True, eq=False)
class AxisVibration:
    """Vibration of one axis."""

    letter: str
    total: Levels  # of everything but the mean
    band: Levels  # after the filters
    # velocity, displacement: of what is faster than the high-pass
    velocity: Levels
    displacement: Levels
    blocks: Floats  # mean squares of successive blocks after the filters
    snr: tuple[Estimate, Estimate]  # before and after the filters
    spectrum: Spectrum
    tones: tuple[Tone, ...]
    envelope: Envelope | None  # None where the sensor is too slow for the band, or for any
    trace: Trace | None  # for the comparison with a reference
    picture: Picture
    spectrogram: Image


@dataclass(frozen=True, eq=False)
class SensorVibration:
    """One sensor."""

    source: str
    topic: str
    # rate_hz, length_s, missing: sample rate, length of the part analysed, and share of its
    # samples that are missing
    rate_hz: float
    length_s: float
    missing: float
    gravity: float  # size of the median acceleration, m/s²
    axes: tuple[AxisVibration, ...]
    ride: Ride | None  # None with the reason in `no_ride`
    no_ride: str
    low_pass: float | None  # that was used
    cut: bool  # whether the recording is longer than what was analysed

    @property
    def strongest(self) -> AxisVibration:
        """The axis that moves most."""
        return max(self.axes, key=lambda axis: axis.band.rms.value or 0.0)


def measure(
    source: str,
    recordings: Sequence[Recording],
    settings: Mapping[str, Any],
    confidence: float,
    *,
    traces: bool,
) -> tuple[SensorVibration, ...]:
    """Return what is kept of every accelerometer of a recording."""
    found = tuple(
        _Sensor(recording, settings, confidence, traces).measured()
        for recording in recordings
        if any(axis.quantity is LINEAR_ACCELERATION for axis in axes(recording.samples))
    )
    if not found:
        raise RecordingError(f'{source}: no accelerometer in it')
    return found


@dataclass(frozen=True, eq=False)
class _Sensor:
    recording: Recording
    settings: Mapping[str, Any]
    confidence: float
    traces: bool

    def measured(self) -> SensorVibration:
        recording, settings = self.recording, self.settings
        where = f'{recording.source}, {recording.topic}'
        on_grid = grid(recording.samples.stamps)
        rate = 1.0 / on_grid.period_s
        part, cut = self._window(on_grid.span, rate, where)
        columns: dict[str, Floats] = {}
        missing = 0.0
        for axis in axes(recording.samples):
            if axis.quantity is LINEAR_ACCELERATION:
                values, valid = place(axis.values, on_grid)
                columns[axis.name[-1]] = _filled(values[part], valid[part])
                missing = 1.0 - float(valid[part].mean())
        low_pass = settings['low_pass'][0]
        if low_pass >= _HIGHEST * rate:
            low_pass = None
        high_pass = settings['high_pass'][0]
        if low_pass is not None and low_pass <= high_pass:
            raise RecordingError(
                f'{where}: nothing is left between a high-pass at {high_pass:g} Hz and a low-pass '
                f'at {low_pass:g} Hz'
            )
        start_s = float(recording.samples.stamps[0]) * 1e-9 + (part.start or 0) / rate
        try:
            measured = tuple(
                self._axis(letter, values, rate, start_s, low_pass)
                for letter, values in columns.items()
            )
        except DataError as error:
            raise RecordingError(f'{where}: {error}') from error
        # the median: a hand that picks the sensor up tilts its mean
        mean = np.array([np.median(columns[a]) if a in columns else 0.0 for a in AXES])
        ride, no_ride = self._ride(columns, mean, rate)
        length = (part.stop - part.start) / rate
        return SensorVibration(
            recording.source, recording.topic, rate, length, missing,
            float(np.linalg.norm(mean)), measured, ride, no_ride, low_pass, cut,
        )  # fmt: skip

    def _window(self, span: int, rate: float, where: str) -> tuple[slice, bool]:
        """Return the samples that are analysed, and whether there are more."""
        begin, end = self.settings['begin'], self.settings['end']
        first = 0 if begin is None else round(begin[0] * rate)
        last = span if end is None else min(span, round(end[0] * rate))
        slowest = self.settings['high_pass'][0]
        fewest = max(FEWEST, math.ceil(PERIODS / slowest * rate))
        if last - first < fewest:
            raise RecordingError(
                f'{where}: {max(0.0, (last - first) / rate):.3g} s from {first / rate:.4g} s on; '
                f'a vibration from {slowest:g} Hz on needs {fewest / rate:.3g} s or more '
                '(--set begin=, --set end=, --set high_pass=)'
            )
        return slice(first, min(last, first + LONGEST)), last - first > LONGEST

    def _axis(
        self, letter: str, values: Floats, rate: float, start_s: float, low_pass: float | None
    ) -> AxisVibration:
        settings, unit = self.settings, LINEAR_ACCELERATION.unit
        high_pass = settings['high_pass'][0]
        pure = values - values.mean()
        band = zero_phase(
            moving_average(pure, settings['moving_average']), rate,
            high_pass=high_pass, low_pass=low_pass,
        )  # fmt: skip
        velocity, displacement = integrals(pure, rate, high_pass)
        spectrum, tones = dominant(
            pure, rate, unit,
            resolution_hz=self._resolution(values.size, rate), confidence=self.confidence,
        )  # fmt: skip
        inner = slice(*_inner(values.size, rate, high_pass))
        trace = Trace(values.astype(np.float64), rate, start_s) if self.traces else None
        return AxisVibration(
            letter,
            levels(pure, unit, self.confidence),
            levels(band[inner], unit, self.confidence),
            levels(velocity[inner], 'm/s', self.confidence),
            levels(displacement[inner], 'm', self.confidence),
            mean_squares(band[inner]),
            (self._snr(pure, rate), self._snr(band, rate)),
            spectrum,
            tones,
            self._envelope(pure, rate),
            trace,
            thinned(band, rate),
            spectrogram(pure, rate, settings['spectrogram'][0], _SHOWN * settings['low_pass'][0]),
        )

    def _resolution(self, size: int, rate: float) -> float:
        """Return the distance of bins; coarser where the record is short."""
        asked: float = self.settings['resolution'][0]
        return max(asked, 4.0 * rate / size)

    def _envelope(self, pure: Floats, rate: float) -> Envelope | None:
        band = bearing.band(self.settings)
        if rate < (2.0 * band[1] if band else SLOWEST * self._resolution(pure.size, rate)):
            return None
        return envelope(
            pure, rate, LINEAR_ACCELERATION.unit,
            resolution_hz=self._resolution(pure.size, rate), band=band,
            confidence=self.confidence,
        )  # fmt: skip

    def _snr(self, values: Floats, rate: float) -> Estimate:
        try:
            return snr(values, rate, confidence=self.confidence).ratio
        except DataError as error:
            return Estimate.not_observable('dB', str(error), confidence=self.confidence)

    def _ride(
        self, columns: Mapping[str, Floats], mean: Floats, rate: float
    ) -> tuple[Ride | None, str]:
        """Return the ride along the vertical, or why there is none."""
        size = float(np.linalg.norm(mean))
        if size < _GRAVITY_SEEN * STANDARD_GRAVITY:
            return None, (
                f'it shows {number(size, 2)} m/s² of gravity: what is as slow as a ride does not '
                'reach it'
            )
        vertical = sum(
            columns[letter] * (mean[index] / size)
            for index, letter in enumerate(AXES)
            if letter in columns
        )
        try:
            span = find_ride(vertical, rate)
            return integrate_ride(vertical, rate, span, self.confidence), ''
        except DataError as error:
            return None, str(error)


def _filled(values: Floats, valid: npt.NDArray[np.bool_]) -> Floats:
    """Return the values with straight lines across gaps."""
    if valid.all():
        return values
    known = np.flatnonzero(valid)
    if known.size == 0:
        return np.zeros(values.size)
    return np.interp(np.arange(values.size), known, values[known])


def _inner(size: int, rate: float, high_pass: float) -> tuple[int, int]:
    """Return the samples that the ends of a filter do not reach."""
    edge = min(size // 4, math.ceil(rate / high_pass))
    return edge, size - edge


def sensors(measured: Sequence[tuple[SensorVibration, ...]]) -> Iterator[SensorVibration]:
    """Yield every sensor of every recording."""
    for recording in measured:
        yield from recording


POINTS = 1200
COLUMNS, ROWS = 300, 200
_DECADES = 6.0


@dataclass(frozen=True, eq=False)
class Picture:
    """Mean, lowest and highest value of successive pieces, with their time in s."""

    time: Floats
    middle: Floats
    low: Floats
    high: Floats


def thinned(values: Floats, rate_hz: float) -> Picture:
    """Return a signal in at most `POINTS` pieces."""
    size = max(1, -(-values.size // POINTS))
    count = values.size // size
    pieces = values[: count * size].reshape(count, size)
    time = np.asarray((np.arange(count) + 0.5) * (size / rate_hz), np.float64)
    return Picture(time, pieces.mean(axis=1), pieces.min(axis=1), pieces.max(axis=1))


def spectrogram(values: Floats, rate_hz: float, resolution_hz: float, highest_hz: float) -> Image:
    """Return the spectrogram of a signal up to a frequency: density in dB above 1 (m/s²)²/Hz."""
    length = min(values.size // 4, max(32, round(rate_hz / resolution_hz)))
    step = max(1, length // 2, (values.size - length) // COLUMNS)
    frequency, time, density = scipy.signal.spectrogram(
        values, rate_hz, window='hann', nperseg=length, noverlap=max(0, length - step)
    )
    shown = frequency <= highest_hz
    frequency, density = frequency[shown], density[shown]
    group = max(1, -(-frequency.size // ROWS))
    rows = frequency.size // group
    density = density[: rows * group].reshape(rows, group, -1).mean(axis=1)
    top = float(density.max())
    decibel = 10.0 * np.log10(np.maximum(density, max(top * 10.0**-_DECADES, 1e-300)))
    half = 0.5 * step / rate_hz
    return Image(
        np.asarray(decibel, np.float64),
        (float(time[0]) - half, float(time[-1]) + half),
        (0.0, rows * group * rate_hz / length),
        'density in dB above 1 (m/s²)²/Hz',
    )
