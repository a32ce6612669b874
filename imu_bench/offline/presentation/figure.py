# SPDX-License-Identifier: Apache-2.0
"""
What a figure is, whoever draws it: a page in the browser or files for a thesis.

A figure is described once, as data; `page_figures` and `figure_files` know nothing of results.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

AXIS_COLOURS = {'x': '#c8492e', 'y': '#2f9e74', 'z': '#1f4690'}
"""Red, green and blue as in every 3-D viewer; L* of 49, 58 and 31 keeps them apart in grey."""

AXIS_MARKERS = {'x': 'circle', 'y': 'square', 'z': 'triangle'}

AXIS_DASHES = {'x': 'solid', 'y': 'dashed', 'z': 'dotted'}

SENSOR_COLOURS = (
    '#2f62b0',
    '#d9822b',
    '#2a8a5f',
    '#c8492e',
    '#7b5ba6',
    '#8a6d3b',
    '#d06ba0',
    '#5f6b7a',
    '#a3a329',
    '#2aa1b3',
)
"""For sensors in one plot, in their order; they repeat after ten."""

SENSOR_MARKERS = ('circle', 'square', 'triangle', 'diamond', 'inverted_triangle', 'plus', 'x')
"""Beside the colours, for print in grey and for those who see few colours."""

INK, FAINT = '#1f2933', '#66727f'

ALL = 'all axes'
"""The choice of every series of a figure."""

_BANDS = 3  # one for each axis of a sensor


@dataclass(frozen=True, eq=False)
class Series:
    """One line, row of points or set of bars of a figure."""

    label: str  # in the legend, and beside the pointer; series of one label are one entry
    # x, y: in the units of the figure; of bars, x is the number of the figure's category, of a
    # histogram the n + 1 edges
    x: Floats
    y: Floats
    # low, high: interval of y: a band of a line, an error bar of points and bars
    low: Floats | None = None
    high: Floats | None = None
    kind: str = 'line'  # marks are triangles with words above them
    dash: str = 'solid'  # dashed are set values and models, beside what was measured
    colour: str = ''  # chosen by `series_colours` if empty
    width: float = 1.6  # of the line in px
    # shape at a few points of a line; dots at all points of a short line if empty, no shape if
    # 'none'
    marker: str = ''
    name: str = ''  # shown beside the pointer where the label does not tell series apart
    # one for every point, shown beside the pointer; of marks, above them
    words: tuple[str, ...] = ()
    band: bool = True  # whether the interval of a line is drawn, not only shown beside the pointer
    silent: bool = False  # whether the pointer shows nothing of it
    # under which of the figure's choices it is shown; always if empty
    choices: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Image:
    """A value over two axes, as in a spectrogram."""

    values: Floats  # row 0 at the bottom
    # x, y: edges of the first and the last column and row
    x: tuple[float, float]
    y: tuple[float, float]
    label: str  # what the colour shows, with unit


@dataclass(frozen=True, eq=False)
class Figure:
    """One figure."""

    # title, x_label, y_label: labels with units
    title: str
    x_label: str = ''
    y_label: str = ''
    series: tuple[Series, ...] = ()  # in the order in which they are drawn
    image: Image | None = None  # drawn under the series
    categories: tuple[str, ...] = ()  # names on the x axis where it has no numbers, as for bars
    # log_x, log_y: whether an axis is logarithmic
    log_x: bool = False
    log_y: bool = False
    view: tuple[float, float] | None = None  # ends of the y axis; None for those of the data
    from_zero: bool = False  # whether the y axis begins at zero
    shaded: tuple[tuple[float, float], ...] = ()  # stretches of the x axis that are marked
    height: float = 1.0  # beside that of other figures
    # entries of a printed legend beside those of the series: label and dash, or 'band'
    key: tuple[tuple[str, str], ...] = ()
    # what a reader of a page can choose to see, the first at once; paper shows all of it
    choices: tuple[str, ...] = ()
    # drawn one above the other with one x axis, instead of anything else here
    strips: tuple[Figure, ...] = ()

    @property
    def crowded(self) -> bool:
        """Whether the bands of all lines over one another would show nothing."""
        lines = (s for s in self.series if s.kind == 'line' and s.band and s.low is not None)
        return sum(1 for _ in lines) > _BANDS


def bar_places(figure: Figure) -> list[tuple[float, float]]:
    """Return offset and width of the bars of each series, side by side in their category."""
    groups = sum(series.kind == 'bars' for series in figure.series)
    width = 0.8 / max(1, groups)
    places, group = [], 0
    for series in figure.series:
        places.append(((group - (groups - 1) / 2.0) * width, width))
        group += series.kind == 'bars'
    return places


def few(size: int, wanted: int = 9) -> slice:
    """Return which points of a curve get a marker."""
    return slice(None, None, max(1, size // wanted))


def series_colours(figures: Sequence[Sequence[str]]) -> list[list[str]]:
    """
    Return the colours of the labels of each figure: a sensor has one colour on the whole page.

    Labels that begin with the letter of an axis have the colour of the axis. Where two sensors,
    or two lines of one sensor, would share a colour, the figure counts through the colours.
    """
    words = dict.fromkeys(
        label.split(' ')[0] for labels in figures for label in labels if not _of_axis(label)
    )
    known = dict(zip(words, cycle(SENSOR_COLOURS)))
    return [_colours(labels, known) for labels in figures]


def _colours(labels: Sequence[str], known: Mapping[str, str]) -> list[str]:
    if labels and all(map(_of_axis, labels)):
        return [AXIS_COLOURS[label[0]] for label in labels]
    found = [known.get(label.split(' ')[0], '') for label in labels]
    if '' not in found and len(set(found)) == len(set(labels)):
        return found
    counted = dict(zip(dict.fromkeys(labels), cycle(SENSOR_COLOURS)))
    return [counted[label] for label in labels]


def _of_axis(label: str) -> bool:
    return label.split(' ')[0] in AXIS_COLOURS


def coloured(figures: Sequence[Figure]) -> list[list[str]]:
    """Return the colour of every series of figures on one page: its own, or one chosen for it."""
    chosen = series_colours([[series.label for series in figure.series] for figure in figures])
    return [
        [series.colour or colour for series, colour in zip(figure.series, colours, strict=True)]
        for figure, colours in zip(figures, chosen, strict=True)
    ]
