# SPDX-License-Identifier: Apache-2.0
"""One figure in the style of the report: colours, sizes, tools, legend."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bokeh.core.properties import value
from bokeh.models import (
    BoxZoomTool,
    CDSView,
    ColumnDataSource,
    Glyph,
    GlyphRenderer,
    HoverTool,
    Legend,
    LegendItem,
    Line,
    LogTickFormatter,
    PanTool,
    ResetTool,
    SaveTool,
    VArea,
)
from bokeh.plotting import figure
from imu_bench.offline.plotting import FAINT, INK
import numpy as np
import numpy.typing as npt

HEIGHT = 360

_NARROW, _ENTRY, _LETTER = 310.0, 34.0, 6.5  # px: plot on a phone, legend entry, letter
_RULE, _FINE_RULE, _AXIS_LINE = '#dde2e8', '#f0f2f5', '#b6bec8'
_FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", sans-serif'


class Chart:
    """
    A figure under construction.

    Glyphs are added to Bokeh's figure directly: its convenience methods make six more models
    for each of them, and the number of models is what a report of sixty figures costs.

    Parameters
    ----------
    x_label, y_label : str
        With units.
    log : bool
        Whether both axes are logarithmic.
    options
        Passed to Bokeh's figure.
    """

    def __init__(self, x_label: str, y_label: str, *, log: bool = False, **options: Any) -> None:
        kind = {'x_axis_type': 'log', 'y_axis_type': 'log'} if log else {}
        zoom = BoxZoomTool()
        self.figure = figure(
            sizing_mode='stretch_width',
            tools=[PanTool(), zoom, ResetTool(), SaveTool()],
            x_axis_label=x_label,
            y_axis_label=y_label,
            **({'height': HEIGHT, 'toolbar_location': 'above'} | kind | options),
        )
        self.figure.toolbar.active_drag = zoom
        self._view = CDSView()
        self._legend: dict[str, list[GlyphRenderer]] = {}
        self._style(log)

    def draw(self, glyph: Glyph, source: ColumnDataSource, label: str = '') -> GlyphRenderer:
        """Add a glyph; glyphs with the same label share one entry of the legend."""
        renderer = self.figure.add_glyph(source, glyph, view=self._view)
        if label:
            self._legend.setdefault(label, []).append(renderer)
        return renderer

    def line(
        self, source: ColumnDataSource, x: str, y: str, label: str, **style: Any
    ) -> GlyphRenderer:
        """Add a line."""
        named = {f'line_{key}': setting for key, setting in style.items()}
        return self.draw(Line(x=x, y=y, **named), source, label)

    def band(
        self, source: ColumnDataSource, x: str, low: str, high: str, colour: str, label: str
    ) -> None:
        """Add a shaded band."""
        area = VArea(x=x, y1=low, y2=high, fill_color=colour, fill_alpha=0.16)
        self.draw(area, source, label)

    def hover(self, renderers: Sequence[GlyphRenderer], lines: Sequence[tuple[str, str]]) -> None:
        """Show values under the pointer."""
        self.figure.add_tools(HoverTool(renderers=list(renderers), tooltips=list(lines)))

    def finish(self) -> figure:
        """Return the figure, with a legend in the order in which things were drawn."""
        if self._legend:
            items = [
                LegendItem(label=value(label), renderers=renderers)
                for label, renderers in self._legend.items()
            ]
            legend = Legend(
                items=items, orientation='horizontal', click_policy='hide',
                ncols=_legend_columns(list(self._legend)),
                border_line_color=None, background_fill_color=None, label_text_font=_FONT,
                label_text_font_size='12px', label_text_color=INK, glyph_width=18,
                glyph_height=12, padding=2, margin=2, spacing=14, label_standoff=4,
            )  # fmt: skip
            self.figure.add_layout(legend, 'above')
        return self.figure

    def _style(self, log: bool) -> None:
        chart = self.figure
        chart.toolbar.logo = None
        chart.toolbar.autohide = True
        chart.outline_line_color = None
        chart.background_fill_color = chart.border_fill_color = None
        chart.min_border_left, chart.min_border_right = 56, 12
        look = {
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
        for axis in chart.axis:
            axis.update(**look)
            if log:
                axis.formatter = LogTickFormatter(min_exponent=4)
        for grid in chart.grid:
            grid.grid_line_color = _RULE
            if log:
                grid.minor_grid_line_color = _FINE_RULE


def _legend_columns(labels: list[str]) -> int:
    """Return how many entries of a legend stand in one row, such that a phone shows them all."""
    widths = [_ENTRY + _LETTER * len(label) for label in labels]
    if sum(widths) <= _NARROW:
        return len(labels)
    return max(1, min(len(labels), int(_NARROW / max(widths))))


def columns(**arrays: npt.ArrayLike) -> ColumnDataSource:
    """Return columns in single precision: half the file, and still finer than any screen."""
    return ColumnDataSource({name: _packed(np.asarray(values)) for name, values in arrays.items()})


def _packed(array: npt.NDArray[Any]) -> Any:
    if array.ndim == 2:  # one line per row
        return [_packed(row) for row in array]
    return array.astype(np.float32) if array.dtype.kind == 'f' else array.tolist()
