# SPDX-License-Identifier: Apache-2.0
"""Figures of test plans in files."""

from __future__ import annotations

from collections.abc import Sequence
import os
from pathlib import Path

from imu_bench.offline.figure_files.style import (
    canvas,
    file_names,
    legend_above,
    look,
    plain_numbers,
    save,
)
from imu_bench.offline.plans.result import Image, PlanFigure, PlanResult, Series
from imu_bench.offline.plotting import bar_places, INK, series_colours
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

_FEW = 60


def write(result: PlanResult, folder: str | os.PathLike[str]) -> list[Path]:
    """
    Write every figure of a plan as SVG, PDF and PNG, and return the files.

    Raises
    ------
    OSError
        If the folder cannot be made or a file not be written.
    """
    target = Path(folder)
    target.mkdir(exist_ok=True)
    stems = file_names(f'{result.plan}-{figure.title}' for figure in result.figures)
    colours = series_colours([[s.label for s in figure.series] for figure in result.figures])
    written: list[Path] = []
    with look():
        for figure, stem, chosen in zip(result.figures, stems, colours, strict=True):
            written += save(draw(figure, chosen), target, stem)
    return written


def draw(figure: PlanFigure, colours: Sequence[str]) -> Figure:
    """Return one figure, with one colour for each of its series."""
    paper, (ax,) = canvas()
    if figure.image is not None:
        _image(paper, ax, figure.image)
    bars = [series for series in figure.series if series.kind == 'bars']
    for series, colour in zip(figure.series, colours, strict=True):
        place = bar_places(len(bars), bars.index(series)) if series in bars else (0.0, 0.0)
        _series(ax, series, colour, place)
    for axis, logarithmic in ((ax.xaxis, figure.log_x), (ax.yaxis, figure.log_y)):
        if logarithmic:
            ax.set(**{f'{axis.axis_name}scale': 'log'})
            plain_numbers(axis)
    ax.set_xlabel(figure.x_label)
    ax.set_ylabel(figure.y_label)
    if figure.categories:
        turned = 30 if sum(map(len, figure.categories)) > 60 else 0
        ax.set_xticks(range(len(figure.categories)), figure.categories, rotation=turned)
        ax.grid(axis='x', visible=False)
    if any(series.label for series in figure.series):
        handles, _ = ax.get_legend_handles_labels()
        legend_above(ax, handles)
    return paper


def _series(ax: Axes, series: Series, colour: str, place: tuple[float, float]) -> None:
    errors = None
    if series.low is not None and series.high is not None:
        errors = np.abs(np.array([series.y - series.low, series.high - series.y]))
    if series.kind == 'bars':
        offset, width = place
        ax.bar(series.x + offset, series.y, width, color=colour, label=series.label)
        if errors is not None:
            ax.errorbar(series.x + offset, series.y, errors, fmt='none', ecolor=INK, elinewidth=1)
        return
    if series.kind == 'points':
        fill = 'none' if series.dashed else colour
        ax.errorbar(
            series.x, series.y, errors, fmt='o', color=colour, mfc=fill, label=series.label
        )
        return
    style = 'dashed' if series.dashed else 'solid'
    mark = 'o' if len(series.x) <= _FEW and not series.dashed else ''
    steps = 'steps-post' if series.kind == 'step' else 'default'
    ax.plot(
        series.x, series.y, color=colour, linestyle=style, marker=mark, drawstyle=steps,
        label=series.label,
    )  # fmt: skip
    if series.low is not None and series.high is not None:
        ax.fill_between(series.x, series.low, series.high, color=colour, alpha=0.16, linewidth=0)


def _image(paper: Figure, ax: Axes, image: Image) -> None:
    drawn = ax.imshow(
        image.values, origin='lower', aspect='auto', extent=(*image.x, *image.y), cmap='viridis'
    )
    ax.grid(visible=False)
    paper.colorbar(drawn, ax=ax, label=image.label)
