# SPDX-License-Identifier: Apache-2.0
"""Figures of the report on what qualifies the metrics: noise over time, and the tracked bias."""

from __future__ import annotations

from collections.abc import Sequence

from imu_bench.offline.axis_result import AxisResult
from imu_bench.offline.gauss_markov_result import Trace
from imu_bench.offline.notation import readable_unit
from imu_bench.offline.plotted import time_unit
from imu_bench.offline.plotting import AXIS_COLOURS, FAINT
from imu_bench.offline.report.chart import Chart
from imu_bench.offline.report.models import columns, Model
from imu_bench.offline.results import RecordingResult
from imu_bench.units import convert
import numpy as np

_LOW = 220  # px


def noise_over_time(axes: Sequence[AxisResult], recording: RecordingResult) -> Model:
    """Return the deviation of each window over that of all of them, with its interval."""
    clock = time_unit(recording.health.duration_s)
    chart = Chart(f'time in {clock}', 'noise in %', height=_LOW)
    for axis in axes:
        steady = axis.checks.steadiness if axis.checks else None
        if steady is None or not steady.start.size:
            continue
        scale = 100.0 / float(np.sqrt(np.mean(steady.deviation**2)))
        middle = (steady.start + 0.5 * steady.window_s) * convert(1.0, 's', clock)
        source = columns(
            time=middle,
            noise=scale * steady.deviation,
            low=scale * steady.low,
            high=scale * steady.high,
        )
        colour = AXIS_COLOURS[axis.letter]
        chart.band(source, 'time', 'low', 'high', colour, axis.letter)
        line = chart.line(source, 'time', 'noise', axis.letter, color=colour, width=1.6)
        chart.hover(
            [line],
            [(axis.letter, '@noise{%.4g} % (@low{%.4g} to @high{%.4g} %)'),
             ('time', f'@time{{%.4g}} {clock}'), ('at τ', f'{steady.tau:.3g} s')],
        )  # fmt: skip
    return chart.finish()


def has_windows(axis: AxisResult) -> bool:
    """Return whether the noise was measured in several windows."""
    return bool(axis.checks and axis.checks.steadiness and axis.checks.steadiness.start.size)


def trace_of(axis: AxisResult) -> Trace | None:
    """Return the tracked bias, if there is one."""
    drift = axis.checks.drift if axis.checks else None
    return drift.tracking.trace if drift and drift.tracking else None


def tracked_bias(axes: Sequence[AxisResult], recording: RecordingResult) -> Model:
    """Return the moving average of each axis and the bias that the filter tracks in it."""
    clock = time_unit(recording.health.duration_s)
    drawn = [(axis, trace) for axis in axes if (trace := trace_of(axis)) is not None]
    sizes = [float(np.nanstd(trace.measured)) for _, trace in drawn]
    unit = readable_unit(axes[0].unit, 'level', sizes)
    chart = Chart(f'time in {clock}', f'bias in {unit}', height=_LOW)
    sources = [_tracked(axis, trace, recording, unit, clock) for axis, trace in drawn]
    for (axis, _), source in zip(drawn, sources, strict=True):
        colour = AXIS_COLOURS[axis.letter]
        chart.band(source, 'time', 'low', 'high', colour, axis.letter)
    for source in sources:
        chart.line(source, 'time', 'measured', 'average', color=FAINT, width=1.0)
    for (axis, _), source in zip(drawn, sources, strict=True):
        colour = AXIS_COLOURS[axis.letter]
        line = chart.line(source, 'time', 'bias', axis.letter, color=colour, width=1.6)
        chart.hover(
            [line],
            [(axis.letter, f'@bias{{%.4g}} {unit}'), ('average', f'@measured{{%.4g}} {unit}'),
             ('time', f'@time{{%.4g}} {clock}')],
        )  # fmt: skip
    return chart.finish()


def _tracked(
    axis: AxisResult, trace: Trace, recording: RecordingResult, unit: str, clock: str
) -> Model:
    begin = (recording.start_ns - recording.origin_ns) * 1e-9
    mean, factor = axis.statistics['mean'].value or 0.0, convert(1.0, axis.unit, unit)
    return columns(
        time=(begin + trace.time) * convert(1.0, 's', clock),
        measured=(trace.measured - mean) * factor,
        bias=(trace.bias - mean) * factor,
        low=(trace.bias - 2.0 * trace.deviation - mean) * factor,
        high=(trace.bias + 2.0 * trace.deviation - mean) * factor,
    )
