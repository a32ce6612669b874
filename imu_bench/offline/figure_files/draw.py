# SPDX-License-Identifier: Apache-2.0
"""The figures, one function each: results in, a matplotlib figure out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from imu_bench.offline import plotted
from imu_bench.offline.axis_result import AxisResult
from imu_bench.offline.figure_files.style import canvas, HEIGHT, legend_above, logarithmic, MARKERS
from imu_bench.offline.plotting import (
    AXIS_COLOURS,
    AXIS_DASHES,
    AXIS_MARKERS,
    Drawn,
    FAINT,
    few,
    INK,
    of_all,
)
from imu_bench.offline.results import RecordingResult
from imu_bench.units import convert
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

_TAU, _FREQUENCY = 'averaging time τ in s', 'frequency in Hz'
_STRIP = 1.15  # inches: one axis of a time series
_SIGNALS = {'linear_acceleration': 'acceleration', 'angular_velocity': 'angular velocity'}


def allan(axes: Sequence[AxisResult]) -> Figure:
    """Return Allan deviation, interval, fitted model and its parts of one quantity."""
    drawn = [axis for axis in axes if plotted.drawable(axis)]
    unit = plotted.allan_unit(drawn)
    figure, [ax] = canvas()
    for axis in drawn:
        curve, colour = axis.allan, AXIS_COLOURS[axis.letter]
        if curve is None:
            continue
        factor = convert(1.0, axis.unit, unit)
        ax.fill_between(
            curve.tau, curve.low * factor, curve.high * factor, color=colour, alpha=0.16, lw=0
        )
        ax.plot(
            curve.tau, curve.deviation * factor, color=colour, label=axis.letter,
            marker=MARKERS[AXIS_MARKERS[axis.letter]],
        )  # fmt: skip
        _model(ax, axis, unit, colour)
    logarithmic(ax, _TAU, f'Allan deviation in {unit}', plotted.allan_view(drawn, unit))
    level = f'{100.0 * drawn[0].allan.confidence:g} % interval' if drawn[0].allan else 'interval'
    extra = [
        Patch(color=FAINT, alpha=0.25, lw=0, label=level),
        Line2D([], [], color=INK, ls='--', lw=1.0, label='fit'),
        Line2D([], [], color=FAINT, ls=':', lw=0.9, label='its terms'),
    ]
    handles, _ = ax.get_legend_handles_labels()
    legend_above(ax, [*handles, *extra])
    return figure


def _model(ax: Axes, axis: AxisResult, unit: str, colour: str) -> None:
    for part in plotted.fitted_parts(axis, unit):
        ax.plot(*part, color=colour, ls=':', lw=0.7)
    fit = plotted.fitted(axis, unit)
    if fit is not None:
        ax.plot(*fit, color=INK, ls='--', lw=0.9, zorder=3)


def spectrum(axes: Sequence[AxisResult]) -> Figure:
    """Return the amplitude density with the white noise density of the fit."""
    drawn = [axis for axis in axes if axis.psd is not None]
    unit = plotted.density_unit(drawn)
    figure, [ax] = canvas()
    for axis in drawn:
        colour, marker = AXIS_COLOURS[axis.letter], MARKERS[AXIS_MARKERS[axis.letter]]
        _density(ax, axis, unit, axis.letter, color=colour, marker=marker)
        height = plotted.white_level(axis, unit)
        if height is not None:
            ax.axhline(height, color=colour, ls='--', lw=0.9)
    logarithmic(ax, _FREQUENCY, f'amplitude density in {unit}', plotted.density_view(drawn, unit))
    handles, _ = ax.get_legend_handles_labels()
    white = Line2D([], [], color=FAINT, ls='--', lw=0.9, label='√2 N (Allan)')
    legend_above(ax, [*handles, white])
    return figure


def _density(ax: Axes, axis: AxisResult, unit: str, label: str | None, **look: Any) -> None:
    curve = plotted.density(axis, unit)
    if curve is not None:
        ax.plot(*curve, lw=0.9, label=label, markevery=few(curve.x.size), **look)


def time_series(axes: Sequence[AxisResult], recording: RecordingResult) -> Figure:
    """Return one strip per axis, each about its own mean, with motion shaded."""
    unit = plotted.level_unit(axes)
    clock = plotted.time_unit(recording.health.duration_s)
    figure, strips = canvas(len(axes), 0.5 + _STRIP * len(axes))
    for axis, ax in zip(axes, strips, strict=True):
        trace = plotted.trace(axis, unit, clock)
        if trace is not None:
            ax.plot(*trace, color=AXIS_COLOURS[axis.letter], lw=0.5)
        for begin, end in recording.health.motion:
            left, right = convert(begin, 's', clock), convert(end, 's', clock)
            ax.axvspan(left, right, color='#e8a33d', alpha=0.2, lw=0)
        ax.set_ylabel(f'{axis.letter} in {unit}')
        ax.margins(x=0.0)
    strips[-1].set_xlabel(f'time in {clock}')
    figure.align_ylabels(strips)
    return figure


def histogram(axes: Sequence[AxisResult]) -> Figure:
    """Return the distribution of each axis about its mean with the normal one of the same σ."""
    unit = plotted.level_unit(axes)
    figure, [ax] = canvas()
    for axis in axes:
        bars = plotted.bars(axis, unit)
        if bars is None:
            continue
        colour = AXIS_COLOURS[axis.letter]
        ax.stairs(bars.share, bars.edges, fill=True, color=colour, alpha=0.25, label=axis.letter)
        ax.plot(bars.middle, bars.expected, color=colour, lw=1.0)
    handles, _ = ax.get_legend_handles_labels()
    normal = Line2D([], [], color=FAINT, lw=1.0, label='normal of the same σ')
    legend_above(ax, [*handles, normal])
    ax.set_xlabel(f'deviation from the mean in {unit}')
    ax.set_ylabel(f'share in % per {unit}')
    ax.set_ylim(bottom=0.0)
    return figure


def compare_allan(
    recordings: Sequence[RecordingResult], labels: Sequence[str], quantity: str
) -> Figure:
    """Return the Allan deviations of all sensors: one colour each, one dash pattern per axis."""
    rows = [row for row in of_all(recordings, labels, quantity) if plotted.drawable(row.axis)]
    axes = [row.axis for row in rows]
    unit = plotted.allan_unit(axes)
    figure, [ax] = canvas(height=HEIGHT * 1.15)
    for row in rows:
        if row.axis.allan is not None:
            height = row.axis.allan.deviation * convert(1.0, row.axis.unit, unit)
            every = few(height.size)
            ax.plot(row.axis.allan.tau, height, lw=1.1, markevery=every, **_look(row))
    label = f'Allan deviation of {_SIGNALS[quantity]} in {unit}'
    logarithmic(ax, _TAU, label, plotted.allan_view(axes, unit))
    _sensors_legend(ax, rows)
    return figure


def compare_spectrum(
    recordings: Sequence[RecordingResult], labels: Sequence[str], quantity: str
) -> Figure:
    """Return the amplitude densities of all sensors."""
    rows = [row for row in of_all(recordings, labels, quantity) if row.axis.psd is not None]
    axes = [row.axis for row in rows]
    unit = plotted.density_unit(axes)
    figure, [ax] = canvas(height=HEIGHT * 1.15)
    for row in rows:
        _density(ax, row.axis, unit, None, **_look(row))
    label = f'density of {_SIGNALS[quantity]} in {unit}'
    logarithmic(ax, _FREQUENCY, label, plotted.density_view(axes, unit))
    _sensors_legend(ax, rows)
    return figure


def _look(row: Drawn) -> dict[str, Any]:
    """Return colour and marker of the sensor and dashes of the axis."""
    return {
        'color': row.colour,
        'ls': AXIS_DASHES[row.axis.letter],
        'marker': MARKERS[row.marker],
        'ms': 3.5,
    }


def _sensors_legend(ax: Axes, rows: Sequence[Drawn]) -> None:
    """Add a legend of sensors by colour and marker and of axes by dash, above the plot."""
    sensors = dict.fromkeys((row.label, row.colour, row.marker) for row in rows)
    handles = [
        Line2D([], [], color=colour, marker=MARKERS[marker], ms=3.5, label=label)
        for label, colour, marker in sensors
    ]
    handles += [
        Line2D([], [], color=FAINT, ls=dash, label=letter) for letter, dash in AXIS_DASHES.items()
    ]
    legend_above(ax, handles)
