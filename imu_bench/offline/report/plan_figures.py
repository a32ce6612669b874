# SPDX-License-Identifier: Apache-2.0
"""Figures of test plans on a page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from imu_bench.offline.plans.result import Floats, Image, PlanFigure, Series
from imu_bench.offline.plotting import bar_places, INK
from imu_bench.offline.report.chart import Chart
from imu_bench.offline.report.models import columns, Field, glyph, Model
import numpy as np

_AT = {'x': 'x', 'y': 'y'}
_FEW = 400
"""Points that are drawn as dots one can point at."""


def draw(figure: PlanFigure, colours: Sequence[str]) -> Model:
    """Return a figure of a plan, with one colour for each of its series."""
    chart = Chart(
        figure.x_label,
        figure.y_label,
        log_x=figure.log_x,
        log_y=figure.log_y,
    )
    if figure.image is not None:
        _image(chart, figure, figure.image)
    bars = [series for series in figure.series if series.kind == 'bars']
    for series, colour in zip(figure.series, colours, strict=True):
        if series.kind == 'bars':
            _bars(chart, figure, series, colour, bar_places(len(bars), bars.index(series)))
        elif series.kind == 'points':
            _points(chart, figure, series, colour)
        else:
            _line(chart, figure, series, colour)
    if figure.categories:
        _name(chart, figure.categories)
    return chart.finish()


def _source(figure: PlanFigure, series: Series, x: Floats | None = None) -> Model:
    arrays: dict[str, Any] = {'x': series.x if x is None else x, 'y': series.y}
    if figure.categories:
        arrays['category'] = [figure.categories[round(place)] for place in series.x]
    if series.low is not None and series.high is not None:
        arrays |= {'low': series.low, 'high': series.high}
    return columns(**arrays)


def _line(chart: Chart, figure: PlanFigure, series: Series, colour: str) -> None:
    source = _source(figure, series)
    if series.low is not None and series.high is not None:
        chart.band(source, 'x', 'low', 'high', colour, series.label)
    style = {'line_color': colour, 'line_width': 1.6}
    style |= {'line_dash': 'dashed'} if series.dashed else {}
    line = glyph('Step', _AT, mode='after', **style) if series.kind == 'step' else None
    drawn = chart.draw(line or glyph('Line', _AT, **style), source, series.label)
    if len(series.x) <= _FEW:
        dots = glyph('Scatter', _AT, size=4, fill_color=colour, line_color=None)
        drawn = chart.draw(dots, source, series.label)
    chart.hover([drawn], _tips(figure, series))


def _points(chart: Chart, figure: PlanFigure, series: Series, colour: str) -> None:
    source = _source(figure, series)
    _whiskers(chart, source, series, colour)
    fill = None if series.dashed else colour
    dots = glyph('Scatter', _AT, size=6, fill_color=fill, line_color=colour)
    chart.hover([chart.draw(dots, source, series.label)], _tips(figure, series))


def _bars(
    chart: Chart, figure: PlanFigure, series: Series, colour: str, place: tuple[float, float]
) -> None:
    offset, width = place
    source = _source(figure, series, series.x + offset)
    style = {'fill_color': colour, 'line_color': None, 'fill_alpha': 0.85}
    bar = glyph('VBar', {'x': 'x', 'top': 'y'}, width=width, **style)
    chart.hover([chart.draw(bar, source, series.label)], _tips(figure, series))
    _whiskers(chart, source, series, INK)


def _whiskers(chart: Chart, source: Model, series: Series, colour: str) -> None:
    if series.low is not None and series.high is not None:
        ends = {'x0': 'x', 'y0': 'low', 'x1': 'x', 'y1': 'high'}
        chart.draw(glyph('Segment', ends, line_color=colour, line_width=1.2), source, series.label)


def _tips(figure: PlanFigure, series: Series) -> list[tuple[str, str]]:
    place = '@category' if figure.categories else '@x{%.5g}'
    tips = [(series.label, '')] if series.label else []
    tips += [(figure.y_label, '@y{%.5g}'), (figure.x_label, place)]
    if series.low is not None:
        tips.append(('interval', '@low{%.5g} to @high{%.5g}'))
    return tips


def _image(chart: Chart, figure: PlanFigure, image: Image) -> None:
    from bokeh.palettes import Viridis256  # a quarter of a second, for few figures

    finite = image.values[np.isfinite(image.values)]
    mapper = Model(
        'LinearColorMapper',
        palette=list(Viridis256), low=float(finite.min()), high=float(finite.max()),
        nan_color='white',
    )  # fmt: skip
    (left, right), (bottom, top) = image.x, image.y
    place = {'x': [left], 'y': [bottom], 'dw': [right - left], 'dh': [top - bottom]}
    source = Model('ColumnDataSource', data={'image': [image.values.astype(np.float32)], **place})
    drawn = Model(
        'Image', **{name: Field(name) for name in ('image', *place)}, color_mapper=mapper
    )
    renderer = chart.draw(drawn, source)
    chart.figure.set(
        x_range=Model('Range1d', start=left, end=right),
        y_range=Model('Range1d', start=bottom, end=top),
    )
    chart.hover(
        [renderer],
        [
            (figure.x_label, '$x{%.4g}'),
            (figure.y_label, '$y{%.4g}'),
            (image.label, '@image{%.3g}'),
        ],
    )
    bar = Model(
        'ColorBar',
        color_mapper=mapper, title=image.label, ticker=Model('BasicTicker'), width=10, padding=4,
        title_text_font_style='normal', title_text_font_size='11px',
        major_label_text_font_size='11px', bar_line_color=None,
    )  # fmt: skip
    chart.figure.set(right=[bar])


def _name(chart: Chart, categories: tuple[str, ...]) -> None:
    chart.x_axis.set(
        ticker=Model('FixedTicker', ticks=list(range(len(categories)))),
        major_label_overrides=dict(enumerate(categories)),
    )
    chart.x_grid.set(visible=False)
    longest = max(map(len, categories))
    if longest * len(categories) > 60:
        chart.x_axis.set(major_label_orientation=0.7)
