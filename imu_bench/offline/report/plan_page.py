# SPDX-License-Identifier: Apache-2.0
"""The report of a test plan: the answer, what casts doubt on it, tables and figures."""

from __future__ import annotations

import os
from typing import Any

from imu_bench import __version__
from imu_bench.offline.notation import bare
from imu_bench.offline.plans import shown
from imu_bench.offline.plans.result import PlanResult, Table
from imu_bench.offline.plotting import series_colours
from imu_bench.offline.report import plan_figures
from imu_bench.offline.report.document import page, Places
from imu_bench.offline.whole_files import write_text
from imu_bench.units import convert

_NAMED_SOURCES = 12
_DIGITS = 6


def render(result: PlanResult) -> str:
    """Return the report as one HTML document without any reference to the outside."""
    collected = Places()
    colours = series_colours([[s.label for s in figure.series] for figure in result.figures])
    figures = [
        collected.add(plan_figures.draw(figure, chosen), figure.title)
        for figure, chosen in zip(result.figures, colours, strict=True)
    ]
    more = len(result.sources) - _NAMED_SOURCES
    return page(
        'plan.html',
        collected,
        title=result.title,
        version=__version__,
        result=result,
        sources=result.sources[:_NAMED_SOURCES],
        more=max(0, more),
        settings=[(name, text) for name, text in map(_setting, result.settings.items()) if text],
        tables=[_table(table) for table in result.tables],
        figures_of_plan=figures,
    )


def write(result: PlanResult, path: str | os.PathLike[str]) -> None:
    """
    Write the report.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    write_text(path, render(result))


def _table(table: Table) -> dict[str, Any]:
    return {
        'title': table.title,
        'note': table.note,
        'columns': list(zip(table.columns, shown.words(table), strict=True)),
        'rows': shown.cells(table),
    }


def _setting(item: tuple[str, Any]) -> tuple[str, str]:
    name, value = item
    if isinstance(value, dict) and set(value) == {'value', 'unit'}:
        unit = '°' if value['unit'] == 'rad' else value['unit']
        numbers = value['value'] if isinstance(value['value'], list) else [value['value']]
        shown = (bare(convert(one, value['unit'], unit), _DIGITS) for one in numbers)
        return name, f'{", ".join(shown)} {unit}'
    if isinstance(value, list | tuple):
        return name, ', '.join(map(str, value))
    return name, '' if value is None else str(value)
