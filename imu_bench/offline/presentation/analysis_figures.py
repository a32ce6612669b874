# SPDX-License-Identifier: Apache-2.0
"""The figures of an analysis, described for whoever draws them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import cycle

from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.analysis.axis_result import AxisResult
from imu_bench.offline.analysis.drift import Trace
from imu_bench.offline.analysis.results import RecordingResult
from imu_bench.offline.comparing.runs import distinct
from imu_bench.offline.notation import number, readable_unit
from imu_bench.offline.presentation.figure import (
    AXIS_COLOURS,
    AXIS_MARKERS,
    FAINT,
    Figure,
    Floats,
    SENSOR_COLOURS,
    SENSOR_MARKERS,
    Series,
)
from imu_bench.offline.presentation.noise_figures import (
    allan,
    compare_allan,
    compare_spectrum,
    density,
    density_unit,
    density_view,
    drawable,
    FREQUENCY,
    Row,
)
from imu_bench.units import convert
from msg_conversions.quantities import BY_NAME
import numpy as np

_NAMED_TONES = 3  # in order of amplitude; more names than these cover one another
_NAMED_RUNS = 10
_LOW, _SMALL = 0.6, 0.75  # height where the shape says it all, and where three are side by side
_ASIDE = 0.2  # of the distance between two runs: the points of three axes do not cover one another
_STAMP_S = 1e-8  # intervals that differ by less than ten steps of a stamp show nothing


def of_sensor(recording: RecordingResult, quantity: str) -> Iterator[tuple[str, Figure]]:
    """Yield the figures of a quantity of one sensor that it has data for, by a short name."""
    axes, name = recording.of(quantity), BY_NAME[quantity].title
    if any(map(drawable, axes)):
        yield 'allan', allan(axes, name)
    if any(axis.psd for axis in axes):
        yield 'spectrum', spectrum(axes, name)
    if any(axis.envelope for axis in axes):
        yield 'time', time_series(axes, recording, name)
    if any(axis.histogram for axis in axes):
        yield 'histogram', histogram(axes, name)
    if any(map(_has_windows, axes)):
        yield 'noise', noise_over_time(axes, recording, name)
    if any(map(_trace_of, axes)):
        yield 'bias', tracked_bias(axes, recording, name)
    if recording.runs:
        yield from from_run_to_run(recording, quantity)


def from_run_to_run(recording: RecordingResult, quantity: str) -> Iterator[tuple[str, Figure]]:
    """Yield the trend of bias and noise over the runs of a pooled sensor, and their curves."""
    runs, names = recording.runs, distinct([run.source for run in recording.runs])
    name = BY_NAME[quantity].title
    # the curves; spectra of every run are scatter on scatter
    for short, figure in of_all(runs, names, quantity, ', every run'):
        if short == 'allan':
            # a legend of many runs is larger than the figure: the pointer names them
            curves = [replace(s, label=s.label if len(runs) <= _NAMED_RUNS else '')
                      for s in figure.series]  # fmt: skip
            yield 'runs', replace(figure, series=tuple(curves), height=1.0)
    unit = _level_unit(recording.of(quantity))
    axes = recording.of(quantity)
    bias = [_trend(a, [run.axes[a.name].statistics['mean'] for run in runs], unit) for a in axes]
    noise = [_trend(a, [run.axes[a.name].white_density for run in runs]) for a in axes]
    for short, series, title, label in (
        ('trend_bias', bias, 'bias by run', f'bias less its mean, {unit}'),
        ('trend_noise', noise, 'noise by run', 'density in % of its mean'),
    ):
        yield (
            short,
            Figure(
                f'{name}: {title}', '', label, tuple(series), categories=tuple(names), height=_LOW
            ),
        )


def _trend(axis: AxisResult, found: Sequence[Estimate], unit: str = '') -> Series:
    """Return a number by run: about the mean of the runs in a unit, or in per cent of the mean."""
    numbers = np.array([[np.nan if end is None else end for end in (e.value, e.low, e.high)]
                        for e in found])  # fmt: skip
    seen = np.flatnonzero(np.isfinite(numbers[:, 0]))
    mean = float(numbers[seen, 0].mean()) if seen.size else 1.0
    shift, factor = (mean, convert(1.0, axis.unit, unit)) if unit else (0.0, 100.0 / mean)
    value, low, high = (np.asarray(column - shift) * factor for column in numbers[seen].T)
    # side by side with those of the other axes
    places = np.asarray(seen + _ASIDE * ('xyz'.index(axis.letter) - 1), np.float64)
    return Series(axis.letter, places, value, low, high, kind='points',
                  colour=AXIS_COLOURS[axis.letter])  # fmt: skip


def of_all(
    recordings: Sequence[RecordingResult], labels: Sequence[str], quantity: str, which: str = ''
) -> Iterator[tuple[str, Figure]]:
    """Yield the figures in which all sensors, or all runs of one, stand together."""
    looks = zip(recordings, labels, cycle(SENSOR_COLOURS), cycle(SENSOR_MARKERS))
    rows = [
        Row(label, colour, marker, axis)
        for recording, label, colour, marker in looks
        for axis in recording.of(quantity)
    ]
    title = f'{BY_NAME[quantity].title}: {{}}{which}'
    if shown := [row for row in rows if drawable(row.axis)]:
        yield 'allan', compare_allan(shown, title.format('Allan deviation'))
    if shown := [row for row in rows if row.axis.psd is not None]:
        yield 'spectrum', compare_spectrum(shown, title.format('noise spectrum'))


def of_each_axis(figure: Figure) -> list[Figure]:
    """Return a small figure, without a legend, for each axis that a figure lets choose."""
    return [
        replace(figure, title=letter, choices=(), height=_SMALL, series=tuple(
            replace(series, label='', name=series.label, dash='solid', choices=())
            for series in figure.series if letter in series.choices
        ))
        for letter in AXIS_COLOURS if letter in figure.choices
    ]  # fmt: skip


def spectrum(axes: Sequence[AxisResult], name: str) -> Figure:
    """Return the amplitude density with the white noise density and the tones marked."""
    drawn = [axis for axis in axes if axis.psd is not None]
    unit = density_unit(drawn)
    densities = [
        density(Row(a.letter, AXIS_COLOURS[a.letter], AXIS_MARKERS[a.letter], a), unit)
        for a in drawn
    ]
    levels = [level for axis in drawn for level in _white_level(axis, unit)]
    tones = [found for axis in drawn for found in _tones(axis, unit)]
    return Figure(
        f'{name}: noise spectrum', FREQUENCY, f'amplitude density in {unit}',
        (*densities, *levels, *tones), log_x=True, log_y=True, view=density_view(drawn, unit),
    )  # fmt: skip


def time_series(axes: Sequence[AxisResult], recording: RecordingResult, name: str) -> Figure:
    """Return one strip per axis, each about its own mean, with motion shaded."""
    unit = _level_unit(axes)
    clock, scale = _clock(recording)
    moved = tuple((begin * scale, end * scale) for begin, end in recording.health.motion)
    strips = tuple(
        Figure('', f'time in {clock}', f'{axis.letter} in {unit}', shaded=moved, series=(
            Series('', *_trace(axis, unit, scale), name=axis.letter, width=1.0, marker='none',
                   colour=AXIS_COLOURS[axis.letter]),
        ))
        for axis in axes
        if axis.envelope is not None
    )  # fmt: skip
    return Figure(f'{name} about the mean of each axis', strips=strips)


def histogram(axes: Sequence[AxisResult], name: str) -> Figure:
    """Return the distribution of each axis about its mean, and the normal one of the same σ."""
    unit = _level_unit(axes)
    bars, normal = [], []
    for axis in axes:
        found = axis.histogram
        if found is None:
            continue
        colour, edges = AXIS_COLOURS[axis.letter], _centred(axis, found.edges, unit)
        per_sample = 100.0 / found.count.sum() / np.diff(edges)
        bars.append(Series(axis.letter, edges, found.count * per_sample, kind='histogram',
                           colour=colour))  # fmt: skip
        middle = 0.5 * (edges[1:] + edges[:-1])
        normal.append(Series('normal of the same σ', middle, found.expected * per_sample,
                             colour=colour, width=1.5, marker='none', silent=True))  # fmt: skip
    return Figure(
        f'{name}: distribution', f'deviation from the mean in {unit}', f'share in % per {unit}',
        (*bars, *normal), from_zero=True,
    )  # fmt: skip


def intervals(recording: RecordingResult) -> Figure | None:
    """Return the distribution of the intervals between samples, None if they are all equal."""
    found = recording.intervals
    if found is None or found.edges[-1] - found.edges[0] < _STAMP_S:
        return None
    share = 100.0 * found.count / found.count.sum()
    bars = Series('', 1e3 * found.edges, share, kind='histogram', colour=FAINT)
    return Figure('Intervals between samples', 'interval between samples in ms', 'share in %',
                  (bars,), from_zero=True, height=_LOW)  # fmt: skip


def noise_over_time(axes: Sequence[AxisResult], recording: RecordingResult, name: str) -> Figure:
    """Return the deviation of each window over that of all of them, with its interval."""
    clock, scale = _clock(recording)
    series = []
    for axis in axes:
        steady = axis.checks.steadiness
        if steady is None or not steady.start.size:
            continue
        percent = 100.0 / float(np.sqrt(np.mean(steady.deviation**2)))
        middle = (steady.start + 0.5 * steady.window_s) * scale
        series.append(Series(
            axis.letter, middle, percent * steady.deviation, percent * steady.low,
            percent * steady.high, colour=AXIS_COLOURS[axis.letter], marker='none',
            name=f'{axis.letter} at τ = {steady.tau:.3g} s',
        ))  # fmt: skip
    return Figure(f'{name}: noise over time', f'time in {clock}', 'noise in %', tuple(series),
                  height=_LOW)  # fmt: skip


def tracked_bias(axes: Sequence[AxisResult], recording: RecordingResult, name: str) -> Figure:
    """Return the moving average of each axis and the bias that the filter tracks in it."""
    clock, scale = _clock(recording)
    drawn = [(axis, trace) for axis in axes if (trace := _trace_of(axis)) is not None]
    sizes = [float(np.nanstd(trace.measured)) for _, trace in drawn]
    unit = readable_unit(axes[0].unit, 'level', sizes)
    begin = (recording.start_ns - recording.origin_ns) * 1e-9
    averages, tracked = [], []
    for axis, trace in drawn:
        time, wide = (begin + trace.time) * scale, 2.0 * trace.deviation
        averages.append(Series('average', time, _centred(axis, trace.measured, unit),
                               colour=FAINT, width=1.0, marker='none', silent=True))  # fmt: skip
        bias, low, high = (
            _centred(axis, values, unit)
            for values in (trace.bias, trace.bias - wide, trace.bias + wide)
        )
        tracked.append(Series(axis.letter, time, bias, low, high, marker='none',
                              colour=AXIS_COLOURS[axis.letter]))  # fmt: skip
    return Figure(f'{name}: bias, averaged and tracked', f'time in {clock}', f'bias in {unit}',
                  (*averages, *tracked), height=_LOW)  # fmt: skip


def _has_windows(axis: AxisResult) -> bool:
    """Return whether the noise was measured in several windows."""
    return bool(axis.checks.steadiness and axis.checks.steadiness.start.size)


def _trace_of(axis: AxisResult) -> Trace | None:
    """Return the tracked bias, if there is one."""
    drift = axis.checks.drift
    return drift.tracking.trace if drift and drift.tracking else None


def _clock(recording: RecordingResult) -> tuple[str, float]:
    """Return the unit in which the time of a recording is read, and how many make a second."""
    seconds = recording.health.duration_s
    clock = 's' if seconds < 600.0 else 'min' if seconds < 7200.0 else 'h'
    return clock, convert(1.0, 's', clock)


def _level_unit(axes: Sequence[AxisResult]) -> str:
    sizes = [axis.statistics['std'].value for axis in axes]
    return readable_unit(axes[0].unit, 'level', sizes)


def _centred(axis: AxisResult, values: Floats, unit: str) -> Floats:
    mean = axis.statistics['mean'].value or 0.0
    return np.asarray((values - mean) * convert(1.0, axis.unit, unit))


def _trace(axis: AxisResult, unit: str, scale: float) -> tuple[Floats, Floats]:
    """Return lowest and highest in turn: the eye sees the filled band of an oscilloscope."""
    if axis.envelope is None:
        return np.empty(0), np.empty(0)
    values = np.column_stack([axis.envelope.low, axis.envelope.high]).ravel()
    return np.repeat(axis.envelope.time, 2) * scale, _centred(axis, values, unit)


def _white_level(axis: AxisResult, unit: str) -> Iterator[Series]:
    """Yield the noise density that the table gives, unless it was read off the spectrum."""
    level = axis.noise_density
    if level.value is None or axis.white_from_spectrum or axis.psd is None:
        return
    height = convert(level.value, level.unit, unit)
    yield Series('√2 N (Allan)', axis.psd.frequency[[0, -1]], np.full(2, height), dash='dashed',
                 colour=AXIS_COLOURS[axis.letter], width=1.2, marker='none',
                 silent=True)  # fmt: skip


def _tones(axis: AxisResult, unit: str) -> Iterator[Series]:
    if axis.psd is None or not axis.psd.tones:
        return
    frequency = np.array([f.value or 0.0 for f, _ in axis.psd.tones[:_NAMED_TONES]])
    top = np.sqrt(np.interp(frequency, axis.psd.frequency, axis.psd.density))
    height = 1.25 * top * convert(1.0, f'{axis.unit}/√Hz', unit)
    yield Series('tones', frequency, height, kind='marks', colour=AXIS_COLOURS[axis.letter],
                 name=f'tone of {axis.letter}',
                 words=tuple(f'{number(f, 4)} Hz' for f in frequency))  # fmt: skip
