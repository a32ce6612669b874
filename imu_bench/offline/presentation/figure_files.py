# SPDX-License-Identifier: Apache-2.0
"""Draws figures for a thesis: a described figure in, files in three formats out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
import os
from pathlib import Path
from typing import Any

from imu_bench.offline.analysis.results import Analysis
from imu_bench.offline.comparing.sensors import labels
from imu_bench.offline.notation import number
from imu_bench.offline.plans.result import PlanResult
from imu_bench.offline.presentation import analysis_figures
from imu_bench.offline.presentation.figure import (
    bar_places,
    coloured,
    FAINT,
    few,
    Figure,
    Image,
    INK,
    Series,
)
from imu_bench.offline.whole_files import file_names, whole
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Paper
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from msg_conversions.quantities import IMU_QUANTITIES
import numpy as np

SUFFIXES = ('svg', 'pdf', 'png')

WIDTH, HEIGHT = 4.7, 3.0  # inches: 12 cm, between a column of 8 cm and a page of 16 cm

MARKERS = {
    'circle': 'o',
    'square': 's',
    'triangle': '^',
    'diamond': 'D',
    'inverted_triangle': 'v',
    'plus': 'P',
    'x': 'X',
}
"""Names of markers on the page, and in matplotlib."""

_DPI = 300
_LETTER, _HANDLE = 0.062, 0.42  # inches: of a legend
_FEW = 60  # points of a line, each with a dot
_PT_PER_PX = 0.7  # of the width of a line on a page
_STRIP = 1.15  # inches: one of several strips
_KINDS = ('allan', 'spectrum', 'time', 'histogram')
"""Which figures of a sensor become files."""

_FEW_DECADES = 50.0  # ratio of the ends of an axis
_STYLE: Any = {
    'font.family': 'DejaVu Sans',  # comes with matplotlib, and has √, µ and °
    'font.size': 9,
    'axes.titlesize': 9,
    'axes.labelsize': 9,
    'axes.linewidth': 0.6,
    'axes.edgecolor': '#8a939d',
    'axes.axisbelow': True,
    'axes.grid': True,
    'axes.grid.which': 'major',
    'grid.color': '#dde2e8',
    'grid.linewidth': 0.5,
    'xtick.labelsize': 8,
    'ytick.labelsize': 8,
    'xtick.direction': 'in',
    'ytick.direction': 'in',
    'xtick.color': '#3e4852',
    'ytick.color': '#3e4852',
    'legend.fontsize': 8,
    'legend.frameon': False,
    'lines.linewidth': 1.2,
    'lines.markersize': 2.8,
    'savefig.dpi': _DPI,
    'svg.fonttype': 'path',
    'svg.hashsalt': 'imu_bench',  # the same figure is the same file
    'pdf.fonttype': 42,
    'axes.unicode_minus': True,
    'text.parse_math': False,  # a dollar sign in a topic starts no formula
}


@contextmanager
def look() -> Iterator[None]:
    """Apply the style within a block, and leave that of the caller alone."""
    with rc_context(_STYLE):
        yield


def canvas(rows: int = 1, height: float = HEIGHT) -> tuple[Paper, list[Axes]]:
    """Return a figure with rows of axes that share the time axis."""
    paper = Paper(figsize=(WIDTH, height), layout='constrained')
    FigureCanvasAgg(paper)
    axes = paper.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    return paper, list(axes)


def save(paper: Paper, folder: Path, name: str) -> list[Path]:
    """Write a figure in every format and return the files."""
    layout = paper.get_layout_engine()
    if layout is not None:  # once, not anew for each format
        layout.execute(paper)
        paper.set_layout_engine('none')
    written = []
    for suffix in SUFFIXES:
        path = folder / f'{name}.{suffix}'
        # no date: the same results give the same files
        dates = {'svg': {'Date': None}, 'pdf': {'CreationDate': None}}
        with whole(path) as draft:
            paper.savefig(draft, metadata=dates.get(suffix))
        written.append(path)
    return written


def write(analysis: Analysis, folder: str | os.PathLike[str]) -> list[Path]:
    """
    Write every figure as SVG, PDF and PNG, and return the files.

    Named after sensor, quantity and what is drawn: ``chip-linear_acceleration-allan.svg``; with
    several sensors also ``comparison-linear_acceleration-allan.svg``.

    Raises
    ------
    OSError
        If the folder cannot be made or a file not be written.
    """
    names = labels(analysis.recordings)
    *stems, together = file_names([*names, 'comparison'])
    figures = {
        f'{stem}-{quantity.name}-{kind}': figure
        for recording, stem in zip(analysis.recordings, stems, strict=True)
        for quantity in IMU_QUANTITIES
        for kind, figure in analysis_figures.of_sensor(recording, quantity.name)
        if kind in _KINDS
    }
    if len(analysis.sensors) > 1:
        figures |= {
            f'{together}-{quantity.name}-{kind}': figure
            for quantity in IMU_QUANTITIES
            for kind, figure in analysis_figures.of_all(analysis.sensors, names, quantity.name)
        }
    return _written(figures, folder)


def write_plan(result: PlanResult, folder: str | os.PathLike[str]) -> list[Path]:
    """
    Write every figure of a plan as SVG, PDF and PNG, and return the files.

    Raises
    ------
    OSError
        If the folder cannot be made or a file not be written.
    """
    stems = file_names(f'{result.plan}-{figure.title}' for figure in result.figures)
    return _written(dict(zip(stems, result.figures, strict=True)), folder)


def _written(figures: dict[str, Figure], folder: str | os.PathLike[str]) -> list[Path]:
    target = Path(folder)
    target.mkdir(exist_ok=True)
    written: list[Path] = []
    with look():
        for (stem, figure), colours in zip(
            figures.items(), coloured(list(figures.values())), strict=True
        ):
            written += save(draw(figure, colours), target, stem)
    return written


def draw(figure: Figure, colours: Sequence[str] | None = None) -> Paper:
    """Return a figure as one of matplotlib, with one colour for each of its series."""
    if figure.strips:
        return _strips(figure.strips)
    paper, (ax,) = canvas(height=HEIGHT * (1.15 if figure.height > 1.0 else 1.0))
    colours = colours or coloured([figure])[0]
    fill(ax, figure, colours)
    if figure.image is not None:
        _image(paper, ax, figure.image)
    legend(ax, figure, colours)
    return paper


def _strips(strips: Sequence[Figure]) -> Paper:
    paper, axes = canvas(len(strips), 0.5 + _STRIP * len(strips))
    for ax, strip in zip(axes, strips, strict=True):
        fill(ax, strip, [series.colour for series in strip.series])
        ax.margins(x=0.0)
        if strip is not strips[-1]:
            ax.set_xlabel('')
    paper.align_ylabels(axes)
    return paper


def fill(ax: Axes, figure: Figure, colours: Sequence[str]) -> None:
    """Draw the series of a figure and name its axes."""
    drawn = figure.series
    if figure.crowded:
        drawn = tuple(replace(series, band=False) for series in drawn)
    for series, colour, place in zip(drawn, colours, bar_places(figure), strict=True):
        _series(ax, series, colour, place)
    for left, right in figure.shaded:
        ax.axvspan(left, right, color='#e8a33d', alpha=0.2, lw=0)
    for axis, logarithmic in ((ax.xaxis, figure.log_x), (ax.yaxis, figure.log_y)):
        if logarithmic:
            ax.set(**{f'{axis.axis_name}scale': 'log'})
            plain_numbers(axis)
    ax.set_xlabel(figure.x_label)
    ax.set_ylabel(figure.y_label)
    if figure.view is not None:
        ax.set_ylim(*figure.view)
    if figure.from_zero:
        ax.set_ylim(bottom=0.0)
    if figure.log_x and figure.log_y:
        _fine_grid(ax)
    if figure.categories:
        turned = 30 if sum(map(len, figure.categories)) > 60 else 0
        ax.set_xticks(range(len(figure.categories)), figure.categories, rotation=turned)
        ax.grid(axis='x', visible=False)


def _series(ax: Axes, series: Series, colour: str, place: tuple[float, float]) -> None:
    errors = None
    if series.low is not None and series.high is not None:
        errors = np.abs(np.array([series.y - series.low, series.high - series.y]))
    if series.kind == 'bars':
        offset, width = place
        ax.bar(series.x + offset, series.y, width, color=colour)
        if errors is not None:
            ax.errorbar(series.x + offset, series.y, errors, fmt='none', ecolor=INK, elinewidth=1)
    elif series.kind == 'points':
        fill = colour if series.dash == 'solid' else 'none'
        ax.errorbar(series.x, series.y, errors, fmt='o', color=colour, mfc=fill)
    elif series.kind == 'histogram':
        ax.stairs(series.y, series.x, fill=True, color=colour, alpha=0.25)
    elif series.kind != 'marks':  # whose words would cover one another on paper
        _line(ax, series, colour)


def _line(ax: Axes, series: Series, colour: str) -> None:
    marker = MARKERS.get(series.marker, '')
    if not series.marker and len(series.x) <= _FEW and series.dash == 'solid':
        marker = 'o'
    ax.plot(
        series.x, series.y, color=colour, linestyle=series.dash, marker=marker,
        linewidth=_PT_PER_PX * series.width, label=series.label,
        markevery=few(len(series.x)) if series.marker else None,
        drawstyle='steps-post' if series.kind == 'step' else 'default',
    )  # fmt: skip
    if series.band and series.low is not None and series.high is not None:
        ax.fill_between(series.x, series.low, series.high, color=colour, alpha=0.16, linewidth=0)


def _image(paper: Paper, ax: Axes, image: Image) -> None:
    drawn = ax.imshow(
        image.values, origin='lower', aspect='auto', extent=(*image.x, *image.y), cmap='viridis'
    )
    ax.grid(visible=False)
    paper.colorbar(drawn, ax=ax, label=image.label)


def _fine_grid(ax: Axes) -> None:
    low, high = ax.get_ylim()
    if high < _FEW_DECADES * low:  # too few powers of ten in sight to read a value by
        ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.grid(which='minor', color='#f0f2f5', linewidth=0.4)


def legend(ax: Axes, figure: Figure, chosen: Sequence[str]) -> None:
    """Put a legend above the plot, where it covers no data, in as many columns as have room."""
    by_label: dict[str, list[tuple[Series, str]]] = {}
    for series, colour in zip(figure.series, chosen, strict=True):
        if series.label and series.kind != 'marks':
            by_label.setdefault(series.label, []).append((series, colour))
    handles: list[Line2D | Patch] = []
    for label, several in by_label.items():
        colours = {colour for _, colour in several}
        # what has several colours has none in particular
        handles.append(_handle(label, several[0][0], FAINT if len(colours) > 1 else colours.pop()))
    for label, dash in figure.key:
        patch = Patch(color=FAINT, alpha=0.25, lw=0, label=label)
        handles.append(
            patch if dash == 'band' else Line2D([], [], color=FAINT, ls=dash, label=label)
        )
    if not handles:
        return
    widest = max(len(str(handle.get_label())) for handle in handles)
    columns = int((WIDTH - 0.6) / (_HANDLE + _LETTER * widest))
    ax.legend(
        handles=handles, ncols=max(1, min(columns, len(handles))), loc='lower left',
        bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2, columnspacing=1.2, handlelength=1.8,
    )  # fmt: skip


def _handle(label: str, series: Series, colour: str) -> Line2D | Patch:
    if series.kind in ('bars', 'histogram'):
        alpha = 0.25 if series.kind == 'histogram' else 1.0
        return Patch(color=colour, alpha=alpha, lw=0, label=label)
    marker = 'o' if series.kind == 'points' else MARKERS.get(series.marker, '')
    style = 'none' if series.kind == 'points' else 'solid' if marker else series.dash
    return Line2D([], [], color=colour, marker=marker, ls=style, label=label)


def plain_numbers(axis: Axis) -> None:
    """Write the numbers of a logarithmic axis as people do: 0.01, 1, 100."""
    axis.set_major_formatter(FuncFormatter(_plain))
    axis.set_minor_formatter(NullFormatter())


def _plain(value: float, _position: int | None = None) -> str:
    return number(value, 1)
