# SPDX-License-Identifier: Apache-2.0
"""The look of the figures, and a canvas that writes each in three formats."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
import re
from typing import Any

from imu_bench.offline.notation import number
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

SUFFIXES = ('svg', 'pdf', 'png')

WIDTH, HEIGHT = 6.3, 3.7  # inches: the text width of an A4 page, 16 cm

_DPI = 200
_FEW_DECADES = 50.0  # ratio of the ends of an axis
_STYLE: dict[str, Any] = {
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
    'lines.markersize': 2.5,
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
    with rc_context(_STYLE):  # type: ignore[arg-type]
        yield


def canvas(rows: int = 1, height: float = HEIGHT) -> tuple[Figure, list[Axes]]:
    """Return a figure with rows of axes that share the time axis."""
    figure = Figure(figsize=(WIDTH, height), layout='constrained')
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    return figure, list(axes)


def save(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Write a figure in every format and return the files."""
    written = []
    for suffix in SUFFIXES:
        path = folder / f'{name}.{suffix}'
        # no date: the same results give the same files
        dates = {'svg': {'Date': None}, 'pdf': {'CreationDate': None}}
        figure.savefig(path, metadata=dates.get(suffix))
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
