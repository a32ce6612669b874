# SPDX-License-Identifier: Apache-2.0
"""One figure in the style of the report: colours, sizes, tools, legend."""

from __future__ import annotations

from collections.abc import Sequence
import math
import re
from typing import Any

from imu_bench.offline.plotting import FAINT, INK
from imu_bench.offline.report.models import glyph, Model, Value

HEIGHT = 360

_NARROW, _ENTRY, _LETTER = 310.0, 34.0, 6.5  # px: plot on a phone, legend entry, letter
_ROW = 20  # px: each row of a legend but the first makes the figure higher
_RULE, _FINE_RULE, _AXIS_LINE = '#dde2e8', '#f0f2f5', '#b6bec8'
_FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", sans-serif'
_PRINTF = re.compile(r'([@$]\w+)\{%')
_MAJOR, _MINOR = 'return imuBenchTicks(cb_data).major', 'return imuBenchTicks(cb_data).minor'
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


class Chart:
    """
    A figure under construction.

    Parameters
    ----------
    x_label, y_label : str
        With units.
    log_x, log_y : bool
        Whether an axis is logarithmic.
    options
        Settings of the figure.

    Attributes
    ----------
    figure, x_axis, y_axis, x_grid, y_grid : Model
    """

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
        self._tools = [Model('PanTool'), zoom, Model('ResetTool'), Model('SaveTool')]
        self._renderers: list[Model] = []
        self._legend: dict[str, list[Model]] = {}
        self.x_axis, self.y_axis = _axis(x_label, log_x), _axis(y_label, log_y)
        self.x_grid, self.y_grid = _grid(self.x_axis, 0, log_x), _grid(self.y_axis, 1, log_y)
        self._center = [self.x_grid, self.y_grid]
        self.figure = Model(
            'Figure',
            sizing_mode='stretch_width', height=HEIGHT, toolbar_location='above',
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

    def draw(self, what: Model, source: Model, label: str = '') -> Model:
        """Draw a glyph at each point; glyphs with one label share an entry of the legend."""
        renderer = Model('GlyphRenderer', data_source=source, glyph=what)
        self._renderers.append(renderer)
        if label:
            self._legend.setdefault(label, []).append(renderer)
        return renderer

    def line(self, source: Model, x: str, y: str, label: str, **style: Any) -> Model:
        """Add a line."""
        named = {f'line_{key}': setting for key, setting in style.items()}
        return self.draw(glyph('Line', {'x': x, 'y': y}, **named), source, label)

    def band(self, source: Model, x: str, low: str, high: str, colour: str, label: str) -> None:
        """Add a shaded band."""
        edges = {'x': x, 'y1': low, 'y2': high}
        self.draw(glyph('VArea', edges, fill_color=colour, fill_alpha=0.16), source, label)

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
                Model('LegendItem', label=Value(label), renderers=renderers)
                for label, renderers in self._legend.items()
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
    words = Model('LogTickFormatter', min_exponent=4)
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
