# SPDX-License-Identifier: Apache-2.0
"""The look of the figures, and a canvas that writes each in three formats."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
import re
from typing import Any

from imu_bench.offline.notation import number
from imu_bench.offline.whole_files import whole
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

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


def canvas(rows: int = 1, height: float = HEIGHT) -> tuple[Figure, list[Axes]]:
    """Return a figure with rows of axes that share the time axis."""
    figure = Figure(figsize=(WIDTH, height), layout='constrained')
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    return figure, list(axes)


def save(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Write a figure in every format and return the files."""
    layout = figure.get_layout_engine()
    if layout is not None:  # once, not anew for each format
        layout.execute(figure)
        figure.set_layout_engine('none')
    written = []
    for suffix in SUFFIXES:
        path = folder / f'{name}.{suffix}'
        # no date: the same results give the same files
        dates = {'svg': {'Date': None}, 'pdf': {'CreationDate': None}}
        with whole(path) as draft:
            figure.savefig(draft, metadata=dates.get(suffix))
        written.append(path)
    return written


def logarithmic(ax: Axes, x_label: str, y_label: str, view: tuple[float, float] | None) -> None:
    """Make both axes logarithmic, with plain numbers and fine grid lines."""
    ax.set_xscale('log')
    ax.set_yscale('log')
    ax.set_xlabel(x_label)
    ax.set_ylabel(y_label)
    if view is not None:
        ax.set_ylim(*view)
    low, high = ax.get_ylim()
    for axis in (ax.xaxis, ax.yaxis):
        plain_numbers(axis)
    if high < _FEW_DECADES * low:  # too few powers of ten in sight to read a value by
        ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.grid(which='minor', color='#f0f2f5', linewidth=0.4)


def legend_above(ax: Axes, handles: Sequence[Artist]) -> None:
    """Put a legend above the plot, where it covers no data, in as many columns as have room."""
    widest = max(len(str(handle.get_label())) for handle in handles)
    columns = int((WIDTH - 0.6) / (_HANDLE + _LETTER * widest))
    ax.legend(
        handles=handles, ncols=max(1, min(columns, len(handles))), loc='lower left',
        bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2, columnspacing=1.2, handlelength=1.8,
    )  # fmt: skip


def plain_numbers(axis: Axis) -> None:
    """Write the numbers of a logarithmic axis as people do: 0.01, 1, 100."""
    axis.set_major_formatter(FuncFormatter(_plain))
    axis.set_minor_formatter(NullFormatter())


def _plain(value: float, _position: int | None = None) -> str:
    return number(value, 1)


def file_names(labels: Iterable[str]) -> list[str]:
    """
    Return names of files for sensors, each once, from characters that every system takes.

    Examples
    --------
    >>> file_names(['imu/left', 'imu:left', '../x'])
    ['imu_left', 'imu_left_2', 'x']
    """
    names: list[str] = []
    for label in labels:
        base = re.sub(r'[^A-Za-z0-9.-]+', '_', label).strip('._') or 'sensor'
        name, number = base, 2
        while name in names:
            name, number = f'{base}_{number}', number + 1
        names.append(name)
    return names
