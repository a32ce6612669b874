# SPDX-License-Identifier: Apache-2.0
"""The figures, one function each: results in, a matplotlib figure out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from imu_bench.offline.axis_result import AxisResult
from imu_bench.offline.figure_files.style import canvas, HEIGHT, legend_above, logarithmic, MARKERS
from imu_bench.offline.plotting import (
    allan_unit,
    allan_view,
    AXIS_COLOURS,
    AXIS_DASHES,
    AXIS_MARKERS,
    density_unit,
    density_view,
    drawable,
    Drawn,
    FAINT,
    few,
    INK,
    level_unit,
    model_parts,
    model_tau,
    of_all,
    time_unit,
)
from imu_bench.offline.results import RecordingResult
from imu_bench.units import convert
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
import numpy as np

_TAU, _FREQUENCY = 'averaging time τ in s', 'frequency in Hz'
_STRIP = 1.15  # inches: one axis of a time series
_SIGNALS = {'linear_acceleration': 'acceleration', 'angular_velocity': 'angular velocity'}


def allan(axes: Sequence[AxisResult]) -> Figure:
    """Return Allan deviation, interval, fitted model and its parts of one quantity."""
    drawn = [axis for axis in axes if drawable(axis)]
    unit = allan_unit(drawn)
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
        _model(ax, axis, factor, colour)
    logarithmic(ax, _TAU, f'Allan deviation in {unit}', allan_view(drawn, unit))
    level = f'{100.0 * drawn[0].allan.confidence:g} % interval' if drawn[0].allan else 'interval'
    extra = [
        Patch(color=FAINT, alpha=0.25, lw=0, label=level),
        Line2D([], [], color=INK, ls='--', lw=1.0, label='fit'),
        Line2D([], [], color=FAINT, ls=':', lw=0.9, label='its terms'),
    ]
    handles, _ = ax.get_legend_handles_labels()
    legend_above(ax, [*handles, *extra])
    return figure


def _model(ax: Axes, axis: AxisResult, factor: float, colour: str) -> None:
    tau = model_tau(axis)
    if tau is None:
        return
    for part in model_parts(axis.model, tau):
        ax.plot(tau, part * factor, color=colour, ls=':', lw=0.7)
    fitted = tau[(tau >= axis.model.tau_low) & (tau <= axis.model.tau_high)]
    ax.plot(fitted, axis.model.deviation(fitted) * factor, color=INK, ls='--', lw=0.9, zorder=3)


def spectrum(axes: Sequence[AxisResult]) -> Figure:
    """Return the amplitude density with the white noise density of the fit."""
    drawn = [axis for axis in axes if axis.psd is not None]
    unit = density_unit(drawn)
    figure, [ax] = canvas()
    for axis in drawn:
        size = 0 if axis.psd is None else axis.psd.frequency.size
        _density(
            ax, axis, unit, axis.letter,
            color=AXIS_COLOURS[axis.letter], marker=MARKERS[AXIS_MARKERS[axis.letter]],
            markevery=few(size),
        )  # fmt: skip
        level = axis.noise_density
        if level.value is not None and not axis.white_from_spectrum:
            height = convert(level.value, level.unit, unit)
            ax.axhline(height, color=AXIS_COLOURS[axis.letter], ls='--', lw=0.9)
    logarithmic(ax, _FREQUENCY, f'amplitude density in {unit}', density_view(drawn, unit))
    handles, _ = ax.get_legend_handles_labels()
    white = Line2D([], [], color=FAINT, ls='--', lw=0.9, label='√2 N (Allan)')
    legend_above(ax, [*handles, white])
    return figure


def _density(ax: Axes, axis: AxisResult, unit: str, label: str | None, **look: Any) -> None:
    psd = axis.psd
    if psd is None:
        return
    shown = psd.density > 0.0
    height = np.sqrt(psd.density[shown]) * convert(1.0, f'{axis.unit}/√Hz', unit)
    ax.plot(psd.frequency[shown], height, lw=0.9, label=label, **look)


def time_series(axes: Sequence[AxisResult], recording: RecordingResult) -> Figure:
    """Return one strip per axis, each about its own mean, with motion shaded."""
    unit = level_unit(axes)
    clock = time_unit(recording.health.duration_s)
    figure, strips = canvas(len(axes), 0.5 + _STRIP * len(axes))
    for axis, ax in zip(axes, strips, strict=True):
        envelope = axis.envelope
        if envelope is not None:
            # lowest and highest in turn: at this density the eye sees a filled band
            values = np.column_stack([envelope.low, envelope.high]).ravel()
            centred = values - (axis.statistics['mean'].value or 0.0)
            time = np.repeat(envelope.time, 2) * convert(1.0, 's', clock)
            scaled = centred * convert(1.0, axis.unit, unit)
            ax.plot(time, scaled, color=AXIS_COLOURS[axis.letter], lw=0.5)
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
    unit = level_unit(axes)
    figure, [ax] = canvas()
    for axis in axes:
        found = axis.histogram
        if found is None:
            continue
        mean, factor = axis.statistics['mean'].value or 0.0, convert(1.0, axis.unit, unit)
        edges, total = (found.edges - mean) * factor, found.count.sum()
        colour = AXIS_COLOURS[axis.letter]
        width = np.diff(edges)
        ax.stairs(100.0 * found.count / total / width, edges, fill=True, color=colour, alpha=0.25,
                  label=axis.letter)  # fmt: skip
        middle = 0.5 * (edges[1:] + edges[:-1])
        ax.plot(middle, 100.0 * found.expected / total / width, color=colour, lw=1.0)
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
    rows = [row for row in of_all(recordings, labels, quantity) if drawable(row.axis)]
    axes = [row.axis for row in rows]
    unit = allan_unit(axes)
    figure, [ax] = canvas(height=HEIGHT * 1.15)
    for row in rows:
        if row.axis.allan is not None:
            height = row.axis.allan.deviation * convert(1.0, row.axis.unit, unit)
            ax.plot(row.axis.allan.tau, height, lw=1.1, **_look(row, height.size))
    label = f'Allan deviation of {_SIGNALS[quantity]} in {unit}'
    logarithmic(ax, _TAU, label, allan_view(axes, unit))
    _sensors_legend(ax, rows)
    return figure


def compare_spectrum(
    recordings: Sequence[RecordingResult], labels: Sequence[str], quantity: str
) -> Figure:
    """Return the amplitude densities of all sensors."""
    rows = [row for row in of_all(recordings, labels, quantity) if row.axis.psd is not None]
    axes = [row.axis for row in rows]
    unit = density_unit(axes)
    figure, [ax] = canvas(height=HEIGHT * 1.15)
    for row in rows:
        size = 0 if row.axis.psd is None else row.axis.psd.frequency.size
        _density(ax, row.axis, unit, None, **_look(row, size))
    label = f'density of {_SIGNALS[quantity]} in {unit}'
    logarithmic(ax, _FREQUENCY, label, density_view(axes, unit))
    _sensors_legend(ax, rows)
    return figure


def _look(row: Drawn, size: int) -> dict[str, Any]:
    """Return colour and marker of the sensor and dashes of the axis."""
    return {
        'color': row.colour,
        'ls': AXIS_DASHES[row.axis.letter],
        'marker': MARKERS[row.marker],
        'markevery': few(size),
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
