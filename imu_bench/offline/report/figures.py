# SPDX-License-Identifier: Apache-2.0
"""The figures of the report, one function each: results in, a Bokeh model out."""

from __future__ import annotations

from collections.abc import Sequence

from imu_bench.metrology.normality import Histogram
from imu_bench.offline.axis_result import AxisResult
from imu_bench.offline.notation import number
from imu_bench.offline.plotting import (
    allan_unit,
    allan_view,
    AXIS_COLOURS,
    AXIS_DASHES,
    density_unit,
    density_view,
    drawable,
    FAINT,
    INK,
    level_unit,
    model_parts,
    model_tau,
    of_all,
    time_unit,
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
_MARGIN = 1.6  # factor of empty space above and below the data of a logarithmic plot
_NAMED_TONES = 3
_HALF_VIEW = 4.0  # factor above and below the middle of a spectrum that is always shown


def time_series(axes: Sequence[AxisResult], recording: RecordingResult) -> Model:
    """Return one strip per axis, each about its own mean, with motion shaded."""
    unit = level_unit(axes)
    clock = time_unit(recording.health.duration_s)
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
    unit = allan_unit(axes)
    chart = Chart(_TAU, f'Allan deviation in {unit}', log_x=True, log_y=True)
    drawn = [axis for axis in axes if drawable(axis)]
    for axis in drawn:
        colour = AXIS_COLOURS[axis.letter]
        source = _curve(axis, unit)
        chart.band(source, 'tau', 'low', 'high', colour, axis.letter)
        chart.line(source, 'tau', 'deviation', axis.letter, color=colour, width=1.8)
        dots = chart.draw(
            glyph('Scatter', _AT, size=4, fill_color=colour, line_color=None),
            source,
            axis.letter,
        )
        chart.hover([dots], _curve_tooltips(axis.letter, unit))
    for axis in drawn:
        _model(chart, axis, unit)
    for axis in drawn:
        _parts(chart, axis, unit)
    _show(chart, allan_view(drawn, unit))
    return chart.finish()


def spectrum(axes: Sequence[AxisResult]) -> Model:
    """Return the amplitude density with the white noise density and the tones marked."""
    drawn = [axis for axis in axes if axis.psd is not None]
    unit = density_unit(axes)
    chart = Chart(_FREQUENCY, f'amplitude density in {unit}', log_x=True, log_y=True)
    for axis in drawn:
        _density(chart, axis, unit, AXIS_COLOURS[axis.letter], axis.letter, 'solid')
    for axis in drawn:
        _white_level(chart, axis, unit)
    for axis in drawn:
        _tones(chart, axis, unit)
    _show(chart, density_view(drawn, unit))
    return chart.finish()


def histogram(axes: Sequence[AxisResult]) -> Model:
    """Return the distribution of each axis about its mean, and the normal one of the same σ."""
    unit = level_unit(axes)
    chart = Chart(f'deviation from the mean in {unit}', 'relative frequency')
    _no_scale(chart)
    for axis in axes:
        _bars(chart, axis, unit)
    for axis in axes:
        _normal(chart, axis, unit)
    return chart.finish()


def intervals(recording: RecordingResult) -> Model:
    """Return the distribution of the intervals between samples."""
    chart = Chart('interval between samples in ms', 'relative frequency', height=_LOW)
    _no_scale(chart)
    found = recording.intervals
    if found is not None:
        at = 1e3 * found.edges
        source = columns(left=at[:-1], right=at[1:], count=found.count / found.count.max())
        edges = {'left': 'left', 'right': 'right', 'top': 'count'}
        quad = glyph('Quad', edges, bottom=0, fill_color=FAINT, line_color=None)
        bars = chart.draw(quad, source)
        chart.hover([bars], [('interval', '@left{0.000} to @right{0.000} ms')])
    return chart.finish()


def compare_allan(
    recordings: Sequence[RecordingResult], labels: Sequence[str], quantity: str
) -> Model:
    """Return the Allan deviations of all sensors: one colour each, one dash pattern per axis."""
    rows = [row for row in of_all(recordings, labels, quantity) if drawable(row[2])]
    unit = allan_unit([axis for _, _, axis in rows])
    chart = Chart(_TAU, f'Allan deviation in {unit}', log_x=True, log_y=True, height=_TALL)
    for label, colour, axis in rows:
        source = _curve(axis, unit)
        dash = AXIS_DASHES[axis.letter]
        line = chart.line(source, 'tau', 'deviation', label, color=colour, width=1.5, dash=dash)
        chart.hover([line], _curve_tooltips(f'{label} {axis.letter}', unit))
    _show(chart, allan_view([axis for _, _, axis in rows], unit))
    return chart.finish()


def compare_spectrum(
    recordings: Sequence[RecordingResult], labels: Sequence[str], quantity: str
) -> Model:
    """Return the amplitude densities of all sensors."""
    rows = [row for row in of_all(recordings, labels, quantity) if row[2].psd is not None]
    unit = density_unit([axis for _, _, axis in rows])
    chart = Chart(_FREQUENCY, f'amplitude density in {unit}', log_x=True, log_y=True, height=_TALL)
    for label, colour, axis in rows:
        _density(chart, axis, unit, colour, label, AXIS_DASHES[axis.letter])
    _show(chart, density_view([axis for _, _, axis in rows], unit))
    return chart.finish()


def height_of(model: Model) -> int:
    """Return the height in px that the page must keep free for a figure."""
    parts = model.settings.get('children')
    return sum(map(height_of, parts)) if parts else int(model.settings.get('height', HEIGHT))


def _trace(strip: Chart, axis: AxisResult, unit: str, clock: str) -> None:
    envelope = axis.envelope
    if envelope is None:
        return
    # lowest and highest in turn: at this density the eye sees the filled band of a scope
    values = np.column_stack([envelope.low, envelope.high]).ravel()
    centred = (values - (axis.statistics['mean'].value or 0.0)) * convert(1.0, axis.unit, unit)
    time = np.repeat(envelope.time, 2) * convert(1.0, 's', clock)
    source = columns(time=time, value=centred)
    line = strip.line(source, 'time', 'value', '', color=AXIS_COLOURS[axis.letter])
    strip.hover(
        [line], [('time', f'@time{{0.000}} {clock}'), (axis.letter, f'@value{{0.000}} {unit}')]
    )


def _bars(chart: Chart, axis: AxisResult, unit: str) -> None:
    found = axis.histogram
    if found is None:
        return
    edges = _centred_edges(axis, found, unit)
    quad = glyph(
        'Quad', {'left': 'left', 'right': 'right', 'top': 'share'}, bottom=0, line_color=None,
        fill_color=AXIS_COLOURS[axis.letter], fill_alpha=0.22,
    )  # fmt: skip
    share = found.count / found.count.sum() / np.diff(edges)
    bars = chart.draw(quad, columns(left=edges[:-1], right=edges[1:], share=share), axis.letter)
    chart.hover([bars], [(axis.letter, f'@left{{0.000}} to @right{{0.000}} {unit}')])


def _normal(chart: Chart, axis: AxisResult, unit: str) -> None:
    found = axis.histogram
    if found is None:
        return
    edges = _centred_edges(axis, found, unit)
    source = columns(
        x=0.5 * (edges[1:] + edges[:-1]), y=found.expected / found.count.sum() / np.diff(edges)
    )
    chart.line(source, 'x', 'y', 'normal', color=AXIS_COLOURS[axis.letter], width=1.5)


def _centred_edges(axis: AxisResult, found: Histogram, unit: str) -> Floats:
    return (found.edges - (axis.statistics['mean'].value or 0.0)) * convert(1.0, axis.unit, unit)


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
        (title, f'@deviation{{0.0000}} {unit}'),
        ('interval', '@low{0.0000} to @high{0.0000}'),
        ('τ', '@tau{0.000} s'),
        ('noise', '@noise'),
    ]


def _model(chart: Chart, axis: AxisResult, unit: str) -> None:
    tau = model_tau(axis)
    if tau is not None:
        tau = tau[(tau >= axis.model.tau_low) & (tau <= axis.model.tau_high)]
        fit = axis.model.deviation(tau) * convert(1.0, axis.unit, unit)
        source = columns(tau=tau, fit=fit)
        chart.line(source, 'tau', 'fit', 'fit', color=INK, width=1.2, dash=[6, 3])


def _parts(chart: Chart, axis: AxisResult, unit: str) -> None:
    tau = model_tau(axis)
    if tau is None:
        return
    parts = [part * convert(1.0, axis.unit, unit) for part in model_parts(axis.model, tau)]
    lines = glyph(
        'MultiLine', {'xs': 'tau', 'ys': 'part'}, line_color=AXIS_COLOURS[axis.letter],
        line_dash=[2, 3],
    )  # fmt: skip
    source = columns(tau=np.tile(tau, (len(parts), 1)), part=np.array(parts))
    chart.draw(lines, source, 'its parts')


def _density(
    chart: Chart, axis: AxisResult, unit: str, colour: str, label: str, dash: str
) -> None:
    psd = axis.psd
    if psd is None:
        return
    shown = psd.density > 0.0
    height = np.sqrt(psd.density[shown]) * convert(1.0, f'{axis.unit}/√Hz', unit)
    source = columns(frequency=psd.frequency[shown], density=height)
    line = chart.line(source, 'frequency', 'density', label, color=colour, width=1.3, dash=dash)
    title = label if label == axis.letter else f'{label} {axis.letter}'
    chart.hover([line], [(title, f'@density{{0.000}} {unit}'), ('f', '@frequency{0.000} Hz')])


def _white_level(chart: Chart, axis: AxisResult, unit: str) -> None:
    """Draw the noise density that the table gives, over the whole band."""
    level = axis.noise_density
    if level.value is None or axis.psd is None:
        return
    height = convert(level.value, level.unit, unit)
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


def _no_scale(chart: Chart) -> None:
    """Leave only the shape to the vertical axis."""
    chart.y_axis.set(ticker=Model('FixedTicker', ticks=[]))
    chart.y_grid.set(visible=False)
    chart.figure.set(y_range=Model('DataRange1d', start=0))
