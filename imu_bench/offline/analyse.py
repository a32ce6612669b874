# SPDX-License-Identifier: Apache-2.0
"""From a recording to results: health first, then every metric of every axis."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
import math
import os
from typing import Any

from imu_bench.errors import DataError, RecordingError
from imu_bench.metrology import allan, coefficients, normality, spectrum, statistics, timing
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
from imu_bench.metrology.spectrum import Spectrum
from imu_bench.metrology.timing import Grid
from imu_bench.offline import health
from imu_bench.offline.axes import axes, Axis
from imu_bench.offline.axis_result import AxisResult, Density, STATISTICS
from imu_bench.offline.health import Health
from imu_bench.offline.health.check import ranked
from imu_bench.offline.health.hum import FALSE_ALARM, tone_findings
from imu_bench.offline.recordings import Recording
from imu_bench.offline.reduction import bands, envelope, intervals
from imu_bench.offline.results import RecordingResult
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

Progress = Callable[[int, int], None]
"""Called with the number of axes done and their number."""

_BINS = 80
_SAMPLES_AT_ONCE = 10_000_000  # about 40 bytes of memory each
_FEWEST = 10  # samples; fewer give no curve worth the name


@dataclass(frozen=True)
class Settings:
    """
    What the user may ask of an analysis.

    Attributes
    ----------
    taus : tuple of float
        Averaging times in s; logarithmically spaced ones if empty.
    start_s, end_s : float or None
        Part to analyse, in s after the first sample.
    window_ns : tuple of int or None
        Part to analyse by stamps, both included: exactly the samples of a live window.
    confidence : float
        Level of every interval.
    reference : str
        Sensor that ratios refer to.

    Raises
    ------
    RecordingError
        If a number makes no sense.
    """

    taus: tuple[float, ...] = ()
    start_s: float | None = None
    end_s: float | None = None
    window_ns: tuple[int, int] | None = None
    confidence: float = CONFIDENCE
    reference: str = ''

    def __post_init__(self) -> None:
        for tau in self.taus:
            if not (math.isfinite(tau) and tau > 0.0):
                raise RecordingError(f'--tau {tau:g}: an averaging time must be above 0 s')
        start, end = self.start_s or 0.0, self.end_s
        if end is not None and not start < end:
            raise RecordingError(
                f'--start {start:g} --end {end:g}: the end must be after the start'
            )

    def to_json(self) -> dict[str, Any]:
        """Return the settings as they stand in the JSON document."""
        return {
            'taus': list(self.taus),
            'start_s': self.start_s,
            'end_s': self.end_s,
            'window_ns': None if self.window_ns is None else list(self.window_ns),
            'confidence': self.confidence,
            'reference': self.reference,
        }


def analyse(
    recording: Recording,
    settings: Settings | None = None,
    *,
    problems: Sequence[str] = (),
    progress: Progress | None = None,
) -> RecordingResult:
    """
    Return health and metrics of one recording.

    Parameters
    ----------
    recording : Recording
    settings : Settings, optional
    problems : sequence of str, optional
        What went wrong while the recording was opened and read.
    progress : callable, optional
        Called with (axes done, axes) after each axis.

    Raises
    ------
    RecordingError
        If the part asked for holds too few samples, or no axis with numbers.
    """
    settings = settings or Settings()
    origin = int(recording.samples.stamps[0])
    part = cut(recording, settings)
    stamps = part.samples.stamps
    where = f'{part.source}, topic {part.topic}'
    if stamps.size < _FEWEST:
        raise RecordingError(
            f'{where}: {stamps.size} samples are too few to analyse, at least {_FEWEST} are needed'
        )
    present = list(axes(part.samples))
    if not present:
        raise RecordingError(f'{where}: no axis holds numbers')
    try:
        clock = timing.analyse(stamps, confidence=settings.confidence)
        grid = timing.grid(stamps)
        state = health.check(part, problems=problems, timing=clock, origin_ns=origin)
        found = _measure(present, grid, (int(stamps[0]) - origin) * 1e-9, settings, progress)
    except DataError as error:
        raise RecordingError(f'{where}: {error}') from error
    return RecordingResult(
        source=part.source,
        topic=part.topic,
        frame_id=part.frame_id,
        start_ns=int(stamps[0]),
        end_ns=int(stamps[-1]),
        origin_ns=origin,
        health=_with_tones(state, found),
        axes=found,
        intervals=intervals(stamps, grid.period_s),
    )


def cut(recording: Recording, settings: Settings) -> Recording:
    """Return the part of a recording that the settings ask for, the whole of it if nothing."""
    stamps = recording.samples.stamps
    first, last = int(stamps[0]), int(stamps.max())
    low, high = settings.window_ns or (first, last)
    if settings.start_s is not None:
        low = first + round(settings.start_s * 1e9)
    if settings.end_s is not None:
        high = first + round(settings.end_s * 1e9)
    if settings.window_ns is None and settings.start_s is None and settings.end_s is None:
        return recording
    inside = np.flatnonzero((stamps >= low) & (stamps <= high))
    if not inside.size:
        raise RecordingError(
            f'{recording.source}, topic {recording.topic}: no sample between {low} and {high} ns; '
            f'the recording goes from {first} to {last} ns ({(last - first) * 1e-9:g} s)'
        )
    # one slice where the stamps are in order: views, not copies
    part = slice(int(inside[0]), int(inside[-1]) + 1)
    received = recording.receive_ns
    return replace(
        recording,
        samples=recording.samples[part],
        receive_ns=None if received is None else received[part],
    )


def _measure(
    present: Sequence[Axis],
    grid: Grid,
    start_s: float,
    settings: Settings,
    progress: Progress | None,
) -> dict[str, AxisResult]:
    """Return the results of all axes, several at a time."""
    found: dict[str, AxisResult] = {}
    # numpy and scipy work outside the interpreter lock for most of this
    pool = ThreadPoolExecutor(_workers(len(present), grid.index.size))
    try:
        pending = {a.name: pool.submit(_axis, a, grid, start_s, settings) for a in present}
        for name, result in pending.items():
            found[name] = result.result()
            if progress is not None:
                progress(len(found), len(present))
    finally:
        pool.shutdown(cancel_futures=True)
    return found


def _workers(axes_: int, samples: int) -> int:
    """Return how many axes to work on at once: each holds a few copies of its samples."""
    return max(1, min(axes_, os.cpu_count() or 1, _SAMPLES_AT_ONCE // samples))


def _axis(axis: Axis, grid: Grid, start_s: float, settings: Settings) -> AxisResult:
    kept = axis.values if grid.keep.all() else axis.values[grid.keep]
    placed, there = timing.place(axis.values, grid)
    valid = None if grid.regular else there
    rate = 1.0 / grid.period_s
    summary = statistics.describe(kept, axis.unit, settings.confidence)
    curve = allan.deviation(
        placed,
        rate,
        tau=settings.taus or 'log',
        valid=valid,
        unit=axis.unit,
        confidence=settings.confidence,
    )
    model = coefficients.fit(curve, confidence=settings.confidence)
    constant = summary.minimum.value == summary.maximum.value
    spread = None if constant else _spectrum(placed, rate, axis.unit, valid, settings)
    density = coefficients.noise_density(model)
    methods = {'allan': density} | _other_densities(summary.std, spread, rate, settings.confidence)
    return AxisResult(
        name=axis.name,
        unit=axis.unit,
        statistics={name: getattr(summary, name) for name in STATISTICS},
        noise_density=density,
        noise_density_methods=methods,
        allan=curve,
        model=model,
        psd=None if spread is None else _density(spread),
        histogram=None if constant else normality.histogram(kept, axis.unit, _BINS),
        envelope=envelope(axis.values, grid, start_s),
    )


def _other_densities(
    std: Estimate, spread: Spectrum | None, rate: float, confidence: float
) -> dict[str, Estimate]:
    """Return the noise density from the spectrum and from σ over half the sample rate."""
    if spread is None:
        return {}
    return {
        'plateau': spectrum.plateau(spread, confidence=confidence),
        'sigma': spectrum.density_from_sigma(std, 0.5 * rate),
    }


def _spectrum(
    placed: Floats, rate: float, unit: str, valid: Bools | None, settings: Settings
) -> Spectrum | None:
    """Return the spectrum, or None where no stretch without a gap is long enough."""
    try:
        return spectrum.psd(placed, rate, unit, valid=valid, confidence=settings.confidence)
    except DataError:
        # the gaps that cause it are a finding of their own
        return None


def _density(spread: Spectrum) -> Density:
    found = spectrum.tones(spread, FALSE_ALARM)
    return replace(bands(spread), tones=tuple((tone.frequency, tone.amplitude) for tone in found))


def _with_tones(state: Health, found: Mapping[str, AxisResult]) -> Health:
    by_axis = {name: axis.psd.tones for name, axis in found.items() if axis.psd is not None}
    std = {name: axis.statistics['std'].value or 0.0 for name, axis in found.items()}
    extra = tuple(tone_findings(by_axis, std))
    return replace(state, findings=ranked([*state.findings, *extra])) if extra else state
