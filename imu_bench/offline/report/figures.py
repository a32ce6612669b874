# SPDX-License-Identifier: Apache-2.0
"""The figures of the report, one function each: results in, a Bokeh model out."""

from __future__ import annotations

from collections.abc import Sequence

from imu_bench.offline import plotted
from imu_bench.offline.axis_result import AxisResult
from imu_bench.offline.notation import number
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
from imu_bench.offline.report.chart import Chart, HEIGHT
from imu_bench.offline.report.models import columns, glyph, Model
from imu_bench.offline.results import RecordingResult
from imu_bench.units import convert
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_AT = {'x': 'tau', 'y': 'deviation'}
_TAU, _FREQUENCY = 'averaging time τ in s', 'frequency in Hz'
_LOW = 200  # px, where the shape says it all
_TALL = 440  # px, where many sensors share a plot
_STRIP, _TOOLS, _LABELS = 98, 26, 34  # px: one axis of a time series, its tools, its time axis
_NAMED_TONES = 3


def time_series(axes: Sequence[AxisResult], recording: RecordingResult) -> Model:
    """Return one strip per axis, each about its own mean, with motion shaded."""
    unit = plotted.level_unit(axes)
    clock = plotted.time_unit(recording.health.duration_s)
    strips: list[Model] = []
    shared: Model | None = None
    for axis in axes:
        first, last = axis is axes[0], axis is axes[-1]
        strip = Chart(
            f'time in {clock}' if last else '',
            f'{axis.letter} in {unit}',
            height=_STRIP + _TOOLS * first + _LABELS * last,
        )
        if first:
            shared = strip.figure.settings['x_range']
        else:
            strip.figure.set(x_range=shared, toolbar_location=None)
        strip.x_axis.set(visible=last)
        _trace(strip, axis, unit, clock)
        for begin, end in recording.health.motion:
            strip.shade(convert(begin, 's', clock), convert(end, 's', clock), '#e8a33d')
        strips.append(strip.finish())
    return Model('Column', children=strips, sizing_mode='stretch_width', spacing=0)


def allan(axes: Sequence[AxisResult]) -> Model:
    """Return Allan deviation, interval, fitted model and its parts, for all axes of a quantity."""
    unit = plotted.allan_unit(axes)
    chart = Chart(_TAU, f'Allan deviation in {unit}', log_x=True, log_y=True)
    drawn = [axis for axis in axes if plotted.drawable(axis)]
    for axis in drawn:
        colour = AXIS_COLOURS[axis.letter]
        source = _curve(axis, unit)
        chart.band(source, 'tau', 'low', 'high', colour, axis.letter)
        chart.line(source, 'tau', 'deviation', axis.letter, color=colour, width=1.8)
        dots = chart.draw(
            _dots(AXIS_MARKERS[axis.letter], 5, colour),
            source,
            axis.letter,
        )
        chart.hover([dots], _curve_tooltips(axis.letter, unit))
    for axis in drawn:
        _model(chart, axis, unit)
    for axis in drawn:
        _parts(chart, axis, unit)
    _show(chart, plotted.allan_view(drawn, unit))
    return chart.finish()


def spectrum(axes: Sequence[AxisResult]) -> Model:
    """Return the amplitude density with the white noise density and the tones marked."""
    drawn = [axis for axis in axes if axis.psd is not None]
    unit = plotted.density_unit(axes)
    chart = Chart(_FREQUENCY, f'amplitude density in {unit}', log_x=True, log_y=True)
    for axis in drawn:
        colour = AXIS_COLOURS[axis.letter]
        _density(chart, axis, unit, colour, axis.letter, 'solid')
        _mark_density(chart, Drawn(axis.letter, colour, AXIS_MARKERS[axis.letter], axis), unit)
    for axis in drawn:
        _white_level(chart, axis, unit)
    for axis in drawn:
        _tones(chart, axis, unit)
    _show(chart, plotted.density_view(drawn, unit))
    return chart.finish()


def histogram(axes: Sequence[AxisResult]) -> Model:
    """Return the distribution of each axis about its mean, and the normal one of the same σ."""
    unit = plotted.level_unit(axes)
    chart = Chart(f'deviation from the mean in {unit}', f'share in % per {unit}')
    chart.figure.set(y_range=Model('DataRange1d', start=0))
    drawn = [(axis, bars) for axis in axes if (bars := plotted.bars(axis, unit)) is not None]
    for axis, bars in drawn:
        _bars(chart, axis, bars, unit)
    for axis, bars in drawn:
        source = columns(x=bars.middle, y=bars.expected)
        chart.line(source, 'x', 'y', 'normal', color=AXIS_COLOURS[axis.letter], width=1.5)
    return chart.finish()


def intervals(recording: RecordingResult) -> Model:
    """Return the distribution of the intervals between samples."""
    chart = Chart('interval between samples in ms', 'share in %', height=_LOW)
    chart.figure.set(y_range=Model('DataRange1d', start=0))
    found = recording.intervals
    if found is not None:
        at = 1e3 * found.edges
        source = columns(left=at[:-1], right=at[1:], share=100.0 * found.count / found.count.sum())
        edges = {'left': 'left', 'right': 'right', 'top': 'share'}
        quad = glyph('Quad', edges, bottom=0, fill_color=FAINT, line_color=None)
        bars = chart.draw(quad, source)
        chart.hover(
            [bars],
            [('interval', '@left{%.5g} to @right{%.5g} ms'), ('share', '@share{%.3g} %')],
        )
    return chart.finish()


def compare_allan(
    recordings: Sequence[RecordingResult], labels: Sequence[str], quantity: str
) -> Model:
    """Return the Allan deviations of all sensors: one colour each, one dash pattern per axis."""
    rows = [row for row in of_all(recordings, labels, quantity) if plotted.drawable(row.axis)]
    axes = [row.axis for row in rows]
    unit = plotted.allan_unit(axes)
    chart = Chart(_TAU, f'Allan deviation in {unit}', log_x=True, log_y=True, height=_TALL)
    for row in rows:
        source = _curve(row.axis, unit)
        line = chart.line(
            source, 'tau', 'deviation', row.label,
            color=row.colour, width=1.5, dash=AXIS_DASHES[row.axis.letter],
        )  # fmt: skip
        chart.hover([line], _curve_tooltips(f'{row.label} {row.axis.letter}', unit))
        if (curve := row.axis.allan) is not None:
            height = curve.deviation * convert(1.0, row.axis.unit, unit)
            _mark(chart, row, curve.tau, height)
    _show(chart, plotted.allan_view(axes, unit))
    return chart.finish()


def compare_spectrum(
    recordings: Sequence[RecordingResult], labels: Sequence[str], quantity: str
) -> Model:
    """Return the amplitude densities of all sensors."""
    rows = [row for row in of_all(recordings, labels, quantity) if row.axis.psd is not None]
    axes = [row.axis for row in rows]
    unit = plotted.density_unit(axes)
    chart = Chart(_FREQUENCY, f'amplitude density in {unit}', log_x=True, log_y=True, height=_TALL)
    for row in rows:
        _density(chart, row.axis, unit, row.colour, row.label, AXIS_DASHES[row.axis.letter])
        _mark_density(chart, row, unit)
    _show(chart, plotted.density_view(axes, unit))
    return chart.finish()


def height_of(model: Model) -> int:
    """Return the height in px that the page must keep free for a figure."""
    parts = model.settings.get('children')
    return sum(map(height_of, parts)) if parts else int(model.settings.get('height', HEIGHT))


def _dots(marker: str, size: int, colour: str) -> Model:
    style = {'fill_color': colour, 'line_color': colour if marker in ('plus', 'x') else None}
    return glyph('Scatter', _AT, marker=marker, size=size, **style)


def _mark(chart: Chart, row: Drawn, x: Floats, y: Floats) -> None:
    """Mark a few points of a curve with the shape of its sensor or axis."""
    shown = np.flatnonzero(y > 0.0)[few(len(x))]
    source = columns(tau=x[shown], deviation=y[shown])
    chart.draw(_dots(row.marker, 6, row.colour), source, row.label)


def _mark_density(chart: Chart, row: Drawn, unit: str) -> None:
    if (curve := plotted.density(row.axis, unit)) is not None:
        _mark(chart, row, *curve)


def _trace(strip: Chart, axis: AxisResult, unit: str, clock: str) -> None:
    trace = plotted.trace(axis, unit, clock)
    if trace is None:
        return
    source = columns(time=trace.x, value=trace.y)
    line = strip.line(source, 'time', 'value', '', color=AXIS_COLOURS[axis.letter])
    strip.hover(
        [line], [('time', f'@time{{%.4g}} {clock}'), (axis.letter, f'@value{{%.4g}} {unit}')]
    )


def _bars(chart: Chart, axis: AxisResult, shown: plotted.Bars, unit: str) -> None:
    quad = glyph(
        'Quad', {'left': 'left', 'right': 'right', 'top': 'share'}, bottom=0, line_color=None,
        fill_color=AXIS_COLOURS[axis.letter], fill_alpha=0.22,
    )  # fmt: skip
    source = columns(left=shown.edges[:-1], right=shown.edges[1:], share=shown.share)
    bars = chart.draw(quad, source, axis.letter)
    chart.hover(
        [bars],
        [
            (axis.letter, f'@left{{%.4g}} to @right{{%.4g}} {unit}'),
            ('share', f'@share{{%.3g}} % per {unit}'),
        ],
    )


def _curve(axis: AxisResult, unit: str) -> Model:
    curve, factor = axis.allan, convert(1.0, axis.unit, unit)
    if curve is None:
        return columns(tau=[], deviation=[], low=[], high=[], noise=[])
    return columns(
        tau=curve.tau,
        deviation=curve.deviation * factor,
        low=curve.low * factor,
        high=curve.high * factor,
        noise=curve.noise,
    )


def _curve_tooltips(title: str, unit: str) -> list[tuple[str, str]]:
    return [
        (title, f'@deviation{{%.4g}} {unit}'),
        ('interval', f'@low{{%.4g}} to @high{{%.4g}} {unit}'),
        ('τ', '@tau{%.4g} s'),
        ('noise', '@noise'),
    ]


def _model(chart: Chart, axis: AxisResult, unit: str) -> None:
    if (fit := plotted.fitted(axis, unit)) is not None:
        source = columns(tau=fit.x, fit=fit.y)
        chart.line(source, 'tau', 'fit', 'fit', color=INK, width=1.2, dash=[6, 3])


def _parts(chart: Chart, axis: AxisResult, unit: str) -> None:
    parts = plotted.fitted_parts(axis, unit)
    if not parts:
        return
    lines = glyph(
        'MultiLine', {'xs': 'tau', 'ys': 'part'}, line_color=AXIS_COLOURS[axis.letter],
        line_dash=[2, 3],
    )  # fmt: skip
    tau, part = np.array(parts).transpose(1, 0, 2)
    source = columns(tau=tau, part=part)
    chart.draw(lines, source, 'its parts')


def _density(
    chart: Chart, axis: AxisResult, unit: str, colour: str, label: str, dash: str
) -> None:
    curve = plotted.density(axis, unit)
    if curve is None:
        return
    source = columns(frequency=curve.x, density=curve.y)
    line = chart.line(source, 'frequency', 'density', label, color=colour, width=1.3, dash=dash)
    title = label if label == axis.letter else f'{label} {axis.letter}'
    chart.hover([line], [(title, f'@density{{%.4g}} {unit}'), ('f', '@frequency{%.4g} Hz')])


def _white_level(chart: Chart, axis: AxisResult, unit: str) -> None:
    """Draw the noise density that the table gives, over the whole band."""
    height = plotted.white_level(axis, unit)
    if height is None or axis.psd is None:
        return
    source = columns(x=axis.psd.frequency[[0, -1]], y=np.full(2, height))
    colour = AXIS_COLOURS[axis.letter]
    chart.line(source, 'x', 'y', '√2 N', color=colour, width=1.2, dash=[6, 3])


def _tones(chart: Chart, axis: AxisResult, unit: str) -> None:
    if axis.psd is None or not axis.psd.tones:
        return
    # the list is in order of amplitude; more names than these cover one another
    frequency = np.array([f.value or 0.0 for f, _ in axis.psd.tones[:_NAMED_TONES]])
    top = np.sqrt(np.interp(frequency, axis.psd.frequency, axis.psd.density))
    source = columns(
        frequency=frequency,
        height=1.25 * top * convert(1.0, f'{axis.unit}/√Hz', unit),
        words=[f'{number(f, 4)} Hz' for f in frequency],
    )
    place = {'x': 'frequency', 'y': 'height'}
    mark = glyph(
        'Scatter', place, marker='inverted_triangle', size=8, line_color=None,
        fill_color=AXIS_COLOURS[axis.letter],
    )  # fmt: skip
    words = glyph(
        'Text', place | {'text': 'words'}, text_font_size='10px', text_color=FAINT,
        text_align='center', y_offset=-6,
    )  # fmt: skip
    chart.hover([chart.draw(mark, source, 'tones')], [('tone', '@words'), ('axis', axis.letter)])
    chart.draw(words, source)


def _show(chart: Chart, view: tuple[float, float] | None) -> None:
    if view is not None:
        chart.figure.set(y_range=Model('Range1d', start=view[0], end=view[1]))
