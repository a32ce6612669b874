# SPDX-License-Identifier: Apache-2.0
"""Figures of test plans on a page."""

from __future__ import annotations

from itertools import cycle

from bokeh.models import (
    BasicTicker,
    ColorBar,
    ColumnDataSource,
    FixedTicker,
    HoverTool,
    LayoutDOM,
    LinearColorMapper,
    Range1d,
    Scatter,
    Segment,
    Step,
    VBar,
)
from bokeh.models import Image as ImageGlyph
from imu_bench.offline.plans.result import Floats, Image, PlanFigure, Series
from imu_bench.offline.plotting import bar_places, SENSOR_COLOURS
from imu_bench.offline.report.chart import Chart, columns
import numpy as np

_PALETTE = 'Viridis256'
_FEW = 400
"""Points that are drawn as dots one can point at."""


def draw(figure: PlanFigure) -> LayoutDOM:
    """Return a figure of a plan."""
    chart = Chart(
        figure.x_label,
        figure.y_label,
        x_axis_type='log' if figure.log_x else 'linear',
        y_axis_type='log' if figure.log_y else 'linear',
    )
    if figure.image is not None:
        _image(chart, figure.image)
    bars = [series for series in figure.series if series.kind == 'bars']
    for series, colour in zip(figure.series, cycle(SENSOR_COLOURS)):
        if series.kind == 'bars':
            _bars(chart, series, colour, bar_places(len(bars), bars.index(series)))
        elif series.kind == 'points':
            _points(chart, series, colour)
        else:
            _line(chart, series, colour)
    if figure.categories:
        _name(chart, figure.categories)
    return chart.finish()


def _source(series: Series, x: Floats | None = None) -> ColumnDataSource:
    arrays = {'x': series.x if x is None else x, 'y': series.y}
    if series.low is not None and series.high is not None:
        arrays |= {'low': series.low, 'high': series.high}
    return columns(**arrays)


def _line(chart: Chart, series: Series, colour: str) -> None:
    source = _source(series)
    if series.low is not None and series.high is not None:
        chart.band(source, 'x', 'low', 'high', colour, series.label)
    style = {'line_color': colour, 'line_width': 1.6}
    style |= {'line_dash': 'dashed'} if series.dashed else {}
    if series.kind == 'step':
        chart.draw(Step(x='x', y='y', mode='after', **style), source, series.label)
    else:
        style = {name.removeprefix('line_'): setting for name, setting in style.items()}
        chart.line(source, 'x', 'y', series.label, **style)
    if len(series.x) <= _FEW:
        dots = Scatter(x='x', y='y', size=4, fill_color=colour, line_color=None)
        renderer = chart.draw(dots, source, series.label)
        chart.hover([renderer], _tips(series))


def _points(chart: Chart, series: Series, colour: str) -> None:
    source = _source(series)
    _whiskers(chart, source, series, colour)
    fill = None if series.dashed else colour
    dots = Scatter(x='x', y='y', size=6, fill_color=fill, line_color=colour)
    chart.hover([chart.draw(dots, source, series.label)], _tips(series))


def _bars(chart: Chart, series: Series, colour: str, place: tuple[float, float]) -> None:
    offset, width = place
    source = _source(series, series.x + offset)
    glyph = VBar(x='x', top='y', width=width, fill_color=colour, line_color=None, fill_alpha=0.85)
    chart.hover([chart.draw(glyph, source, series.label)], _tips(series))
    _whiskers(chart, source, series, '#1f2933')


def _whiskers(chart: Chart, source: ColumnDataSource, series: Series, colour: str) -> None:
    if series.low is not None and series.high is not None:
        glyph = Segment(x0='x', y0='low', x1='x', y1='high', line_color=colour, line_width=1.2)
        chart.draw(glyph, source, series.label)


def _tips(series: Series) -> list[tuple[str, str]]:
    tips = [(series.label or 'value', '@y{0.00000}'), ('at', '@x{0.0000}')]
    if series.low is not None:
        tips.append(('interval', '@low{0.00000} to @high{0.00000}'))
    return tips


def _image(chart: Chart, image: Image) -> None:
    finite = image.values[np.isfinite(image.values)]
    mapper = LinearColorMapper(
        palette=_PALETTE, low=float(finite.min()), high=float(finite.max()), nan_color='white'
    )
    source = ColumnDataSource(
        {
            'image': [image.values.astype(np.float32)],
            'x': [image.x[0]],
            'y': [image.y[0]],
            'dw': [image.x[1] - image.x[0]],
            'dh': [image.y[1] - image.y[0]],
        }
    )
    glyph = ImageGlyph(image='image', x='x', y='y', dw='dw', dh='dh', color_mapper=mapper)
    renderer = chart.draw(glyph, source)
    chart.figure.x_range = Range1d(*image.x)
    chart.figure.y_range = Range1d(*image.y)
    chart.figure.add_tools(
        HoverTool(renderers=[renderer], tooltips=[('at', '$x, $y'), (image.label, '@image')])
    )
    bar = ColorBar(
        color_mapper=mapper, title=image.label, ticker=BasicTicker(), width=10, padding=4,
        title_text_font_style='normal', title_text_font_size='11px',
        major_label_text_font_size='11px', bar_line_color=None,
    )  # fmt: skip
    chart.figure.add_layout(bar, 'right')


def _name(chart: Chart, categories: tuple[str, ...]) -> None:
    chart.figure.xaxis.ticker = FixedTicker(ticks=list(range(len(categories))))
    chart.figure.xaxis.major_label_overrides = dict(enumerate(categories))
    chart.figure.xgrid.visible = False
    longest = max(map(len, categories))
    if longest * len(categories) > 60:
        chart.figure.xaxis.major_label_orientation = 0.7
