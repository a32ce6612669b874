# SPDX-License-Identifier: Apache-2.0
"""Draws figures for a page: a described figure in, models of Bokeh out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import math
import re
from typing import Any

from imu_bench.offline.presentation.bokeh_models import columns, Field, glyph, Model, Value
from imu_bench.offline.presentation.figure import (
    ALL,
    bar_places,
    FAINT,
    few,
    Figure,
    Image,
    INK,
    Series,
)
import numpy as np

_HEIGHT = 360  # px
_STRIP, _TOOLS, _LABELS = 98, 26, 34  # px: one strip, its tools, its time axis
_DOTTED = 400
"""Points of a line that are drawn as dots one can point at."""

_AT = {'x': 'x', 'y': 'y'}
_Place = tuple[float, float]  # offset and width, which only bars need

_NARROW, _ENTRY, _LETTER = 310.0, 34.0, 6.5  # px: plot on a phone, legend entry, letter
_ROW = 20  # px: each row of a legend but the first makes the figure higher
_RULE, _FINE_RULE, _AXIS_LINE = '#dde2e8', '#f0f2f5', '#b6bec8'
_FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", sans-serif'
_PRINTF = re.compile(r'([@$]\w+)\{%')
_POWERS = """
const power = Math.floor(Math.log10(tick) + 1e-9);
if (Math.abs(power) < 4) return String(Number(tick.toPrecision(3)));
const times = Number((tick / 10 ** power).toPrecision(3));
const raised = String(power).replace(/./g, (one) => '⁻⁰¹²³⁴⁵⁶⁷⁸⁹'['-0123456789'.indexOf(one)]);
return (times === 1 ? '' : times + '×') + '10' + raised;
"""
"""Words at the ticks of a logarithmic axis: powers of ten as in the tables."""
_MAJOR, _MINOR = 'return imuBenchTicks(cb_data).major', 'return imuBenchTicks(cb_data).minor'
_SHADE = '#e8a33d'
_LOOK = {
    'axis_label_text_font': _FONT,
    'axis_label_text_font_style': 'normal',
    'axis_label_text_font_size': '12px',
    'axis_label_text_color': FAINT,
    'major_label_text_font': _FONT,
    'major_label_text_font_size': '11px',
    'major_label_text_color': FAINT,
    'axis_line_color': _AXIS_LINE,
    'major_tick_line_color': _AXIS_LINE,
    'minor_tick_line_color': _AXIS_LINE,
    'major_tick_in': 0,
    'minor_tick_out': 2,
}


def draw(figure: Figure, colours: Sequence[str]) -> Model:
    """Return a figure as a model of Bokeh, with one colour for each of its series."""
    if figure.strips:
        return _strips(figure.strips)
    return _chart(figure, colours).finish()


def height_of(model: Model) -> int:
    """Return the height in px that the page must keep free for a figure."""
    parts = model.settings.get('children')
    return sum(map(height_of, parts)) if parts else int(model.settings['height'])


def _strips(strips: Sequence[Figure]) -> Model:
    """Return figures one above the other that share the x axis; only the last one names it."""
    drawn: list[Model] = []
    for strip in strips:
        first, last = strip is strips[0], strip is strips[-1]
        chart = _chart(
            strip if last else replace(strip, x_label=''), [s.colour for s in strip.series]
        )
        chart.figure.set(height=_STRIP + _TOOLS * first + _LABELS * last)
        if not first:
            chart.figure.set(x_range=drawn[0].settings['x_range'], toolbar_location=None)
        chart.x_axis.set(visible=last)
        drawn.append(chart.finish())
    return Model('Column', children=drawn, sizing_mode='stretch_width', spacing=0)


def _chart(figure: Figure, colours: Sequence[str]) -> _Chart:
    chart = _Chart(figure.x_label, figure.y_label, log_x=figure.log_x, log_y=figure.log_y)
    chart.figure.set(height=round(_HEIGHT * figure.height))
    chart.crowded = figure.crowded
    if figure.image is not None:
        _image(chart, figure, figure.image)
    for series, colour, place in zip(figure.series, colours, bar_places(figure), strict=True):
        chart.begin(series.choices, series.choices and figure.choices)
        _KINDS.get(series.kind, _line)(chart, figure, series, colour, place)
    for left, right in figure.shaded:
        chart.shade(left, right, _SHADE)
    if figure.categories:
        _name(chart, figure.categories)
    if figure.from_zero:
        chart.figure.set(y_range=Model('DataRange1d', start=0))
    if figure.view is not None:
        chart.figure.set(y_range=Model('Range1d', start=figure.view[0], end=figure.view[1]))
    return chart


def _source(figure: Figure, series: Series) -> Model:
    arrays: dict[str, Any] = {'x': series.x, 'y': series.y}
    if figure.categories:
        arrays['category'] = [figure.categories[round(place)] for place in series.x]
    if series.low is not None and series.high is not None:
        arrays |= {'low': series.low, 'high': series.high}
    if series.words:
        arrays['words'] = list(series.words)
    return columns(**arrays)


def _line(chart: _Chart, figure: Figure, series: Series, colour: str, place: _Place) -> None:
    source = _source(figure, series)
    if series.low is not None and series.high is not None and series.band:
        chart.band(source, 'x', 'low', 'high', colour, series.label)
    style = {'line_color': colour, 'line_width': series.width, 'line_dash': series.dash}
    line = glyph('Step', _AT, mode='after', **style) if series.kind == 'step' else None
    drawn = chart.draw(line or glyph('Line', _AT, **style), source, series.label)
    if series.marker not in ('', 'none'):
        shown = np.flatnonzero(series.y > 0.0)[few(len(series.x))]
        at = columns(x=series.x[shown], y=series.y[shown])
        chart.draw(_dots(series.marker, 6, colour), at, series.label)
    elif not series.marker and len(series.x) <= _DOTTED:
        drawn = chart.draw(_dots('circle', 4, colour), source, series.label)
    if not series.silent:
        chart.hover([drawn], _tips(figure, series))


def _dots(marker: str, size: int, colour: str) -> Model:
    edge = colour if marker in ('plus', 'x') else None
    style = {'fill_color': colour, 'line_color': edge, 'size': size, 'marker': marker}
    return glyph('Scatter', _AT, **style)


def _points(chart: _Chart, figure: Figure, series: Series, colour: str, place: _Place) -> None:
    source = _source(figure, series)
    _whiskers(chart, source, series, colour)
    fill = colour if series.dash == 'solid' else None
    dots = glyph('Scatter', _AT, size=6, fill_color=fill, line_color=colour)
    chart.hover([chart.draw(dots, source, series.label)], _tips(figure, series))


def _bars(chart: _Chart, figure: Figure, series: Series, colour: str, place: _Place) -> None:
    offset, width = place
    source = _source(figure, series)
    source.settings['data'] |= columns(x=series.x + offset).settings['data']
    style = {'fill_color': colour, 'line_color': None, 'fill_alpha': 0.85}
    bar = glyph('VBar', {'x': 'x', 'top': 'y'}, width=width, **style)
    chart.hover([chart.draw(bar, source, series.label)], _tips(figure, series))
    _whiskers(chart, source, series, INK)


def _histogram(chart: _Chart, figure: Figure, series: Series, colour: str, place: _Place) -> None:
    source = columns(left=series.x[:-1], right=series.x[1:], y=series.y)
    edges = {'left': 'left', 'right': 'right', 'top': 'y'}
    alpha = 0.22 if series.label else 1.0
    quad = glyph('Quad', edges, bottom=0, line_color=None, fill_color=colour, fill_alpha=alpha)
    tips = [(series.label, '')] if series.label else []
    tips += [(figure.x_label, '@left{%.4g} to @right{%.4g}'), (figure.y_label, '@y{%.3g}')]
    chart.hover([chart.draw(quad, source, series.label)], tips)


def _marks(chart: _Chart, figure: Figure, series: Series, colour: str, place: _Place) -> None:
    # beside the mark, on the side where the figure has room; where a falling curve is, below it
    first, last = (min(s.x[0] for s in figure.series), max(s.x[-1] for s in figure.series))
    right = series.x > first ** (1.0 - _TURN) * last**_TURN
    below = right & np.array([words.startswith('N') for words in series.words])
    source = columns(
        x=series.x, y=series.y, words=list(series.words),
        align=['right' if turned else 'left' for turned in right],
        beside=np.where(below, -6.0, np.where(right, 4.0, 7.0)),
        below=np.where(below, 18.0, -6.0),
    )  # fmt: skip
    mark = _dots('inverted_triangle', 8, colour)
    words = glyph(
        'Text',
        _AT | {'text': 'words', 'text_align': 'align', 'x_offset': 'beside', 'y_offset': 'below'},
        text_font_size='11px', text_color=INK,
    )  # fmt: skip
    chart.hover([chart.draw(mark, source, series.label)], [(series.name, '@words')])
    chart.draw(words, source)


_KINDS = {'bars': _bars, 'points': _points, 'histogram': _histogram, 'marks': _marks}


def _whiskers(chart: _Chart, source: Model, series: Series, colour: str) -> None:
    if series.low is not None and series.high is not None:
        ends = {'x0': 'x', 'y0': 'low', 'x1': 'x', 'y1': 'high'}
        chart.draw(glyph('Segment', ends, line_color=colour, line_width=1.2), source, series.label)


def _tips(figure: Figure, series: Series) -> list[tuple[str, str]]:
    place = '@category' if figure.categories else '@x{%.5g}'
    name = series.name or series.label
    tips = [(name, '')] if name else []
    tips += [(figure.y_label, '@y{%.5g}'), (figure.x_label, place)]
    if series.low is not None:
        tips.append((f'interval of {figure.y_label}', '@low{%.5g} to @high{%.5g}'))
    return [*tips, ('noise', '@words')] if series.words else tips


def _image(chart: _Chart, figure: Figure, image: Image) -> None:
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


def _name(chart: _Chart, categories: tuple[str, ...]) -> None:
    chart.x_axis.set(
        ticker=Model('FixedTicker', ticks=list(range(len(categories)))),
        major_label_overrides=dict(enumerate(categories)),
    )
    chart.x_grid.set(visible=False)
    longest = max(map(len, categories))
    if longest * len(categories) > _LETTERS:
        many = len(categories) > _UPRIGHT
        chart.x_axis.set(major_label_orientation='vertical' if many else 0.7)


_LETTERS, _UPRIGHT = 36, 12
"""Of the names below an axis: letters that fit on a phone, names from which they stand upright."""

_TURN = 0.6
"""Share of a logarithmic axis behind which words stand to the left of their mark."""


class _Chart:
    """A figure under construction."""

    def __init__(
        self,
        x_label: str,
        y_label: str,
        *,
        log_x: bool = False,
        log_y: bool = False,
        **options: Any,
    ) -> None:
        zoom = Model('BoxZoomTool')
        wheel = Model('WheelZoomTool')
        self._tools = [Model('PanTool'), zoom, wheel, Model('ResetTool'), Model('SaveTool')]
        self._renderers: list[Model] = []
        self._legend: dict[str, list[Model]] = {}
        self.begin((), ())
        self.crowded = False
        self.x_axis, self.y_axis = _axis(x_label, log_x), _axis(y_label, log_y)
        self.x_grid, self.y_grid = _grid(self.x_axis, 0, log_x), _grid(self.y_axis, 1, log_y)
        self._center = [self.x_grid, self.y_grid]
        self.figure = Model(
            'Figure',
            sizing_mode='stretch_width', height=_HEIGHT, toolbar_location='above',
            x_range=Model('DataRange1d'), y_range=Model('DataRange1d'),
            x_scale=_scale(log_x), y_scale=_scale(log_y),
            renderers=self._renderers, left=[self.y_axis], below=[self.x_axis],
            center=self._center, above=[], right=[],
            toolbar=Model(
                'Toolbar', tools=self._tools, logo=None, autohide=True, active_drag=zoom
            ),
            outline_line_color=None, background_fill_color=None, border_fill_color=None,
            min_border_left=56, min_border_right=12,
        )  # fmt: skip
        self.figure.set(**options)

    def begin(self, choices: Sequence[str], offered: Sequence[str]) -> None:
        """Say under which choices what is drawn from now on is seen."""
        self._look: dict[str, Any] = {}
        self._hidden = bool(offered) and offered[0] not in choices
        if offered:
            self._look = {'tags': list(choices)} | ({'visible': False} if self._hidden else {})

    def draw(self, what: Model, source: Model, label: str = '') -> Model:
        """Draw a glyph at each point; glyphs with one label share an entry of the legend."""
        look = self._look | ({'name': label} if self._look and label else {})
        renderer = Model('GlyphRenderer', data_source=source, glyph=what, **look)
        self._renderers.append(renderer)
        if label:
            entry = self._legend.setdefault(label, [])
            if not self._hidden:  # a click on an entry would show it
                entry.append(renderer)
        return renderer

    def band(self, source: Model, x: str, low: str, high: str, colour: str, label: str) -> None:
        """Add a shaded band."""
        edges = {'x': x, 'y1': low, 'y2': high}
        drawn = self.draw(glyph('VArea', edges, fill_color=colour, fill_alpha=0.16), source, label)
        if self.crowded and 'tags' in drawn.settings:
            drawn.set(tags=[choice for choice in drawn.settings['tags'] if choice != ALL])

    def shade(self, left: float, right: float, colour: str) -> None:
        """Mark a stretch of the horizontal axis."""
        shade = Model('BoxAnnotation', left=left, right=right, fill_color=colour, fill_alpha=0.16)
        self._center.append(shade)

    def hover(self, renderers: Sequence[Model], lines: Sequence[tuple[str, str]]) -> None:
        """Show values under the pointer; numbers are formatted as in C: '@value{%.4g} mg'."""
        formats = {name: 'printf' for _, shown in lines for name in _PRINTF.findall(shown)}
        self._tools.append(
            Model(
                'HoverTool',
                renderers=list(renderers), tooltips=list(lines), formatters=formats,
            )
        )  # fmt: skip

    def finish(self) -> Model:
        """Return the figure, with a legend in the order in which things were drawn."""
        if self._legend:
            items = [
                Model('LegendItem', label=Value(label), renderers=seen, visible=bool(seen))
                for label, seen in self._legend.items()
            ]
            legend = Model(
                'Legend',
                items=items, orientation='horizontal', click_policy='hide',
                ncols=_legend_columns(list(self._legend)),
                border_line_color=None, background_fill_color=None, label_text_font=_FONT,
                label_text_font_size='12px', label_text_color=INK, glyph_width=18,
                glyph_height=12, padding=2, margin=2, spacing=14, label_standoff=4,
            )  # fmt: skip
            rows = math.ceil(len(self._legend) / legend.settings['ncols'])
            height = self.figure.settings['height'] + _ROW * (rows - 1)
            self.figure.set(above=[legend], height=height)
        return self.figure


def _axis(label: str, log: bool) -> Model:
    if not log:
        ticks, words = Model('BasicTicker'), Model('BasicTickFormatter')
        return Model('LinearAxis', axis_label=label, ticker=ticks, formatter=words, **_LOOK)
    # Bokeh's own has equal steps below two decades: 500 and 1000, and nothing from 40 to 500
    ticks = Model('CustomJSTicker', major_code=_MAJOR, minor_code=_MINOR)
    words = Model('CustomJSTickFormatter', code=_POWERS)
    return Model('LogAxis', axis_label=label, ticker=ticks, formatter=words, **_LOOK)


def _scale(log: bool) -> Model:
    return Model('LogScale' if log else 'LinearScale')


def _grid(axis: Model, dimension: int, log: bool) -> Model:
    fine = {'minor_grid_line_color': _FINE_RULE} if log else {}
    return Model('Grid', axis=axis, dimension=dimension, grid_line_color=_RULE, **fine)


def _legend_columns(labels: list[str]) -> int:
    """Return how many entries of a legend stand in one row, such that a phone shows them all."""
    widths = [_ENTRY + _LETTER * len(label) for label in labels]
    if sum(widths) <= _NARROW:
        return len(labels)
    return max(1, min(len(labels), int(_NARROW / max(widths))))
