# SPDX-License-Identifier: Apache-2.0
"""
What a test plan found: words, tables and figures, whoever shows them.

A plan computes; terminal, JSON document, report and figure files show every plan alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
import json
import math
import os
from typing import Any

from imu_bench import __version__
from imu_bench.errors import DataError
from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.failure import Failure
from imu_bench.offline.health import Finding
from imu_bench.offline.whole_files import write_text
import numpy as np
import numpy.typing as npt

SCHEMA = 'imu_bench.plan/1'

Floats = npt.NDArray[np.float64]
Cell = Estimate | str | float | int | None
"""A measured number, words, a setting or count that nobody measured, or nothing."""


@dataclass(frozen=True)
class Column:
    """
    Head of a column.

    Attributes
    ----------
    title : str
    unit : str
        Unit in which its estimates are shown, and of its plain numbers; the estimates'
        own if empty.
    """

    title: str
    unit: str = ''


@dataclass(frozen=True)
class Table:
    """
    One table of a plan.

    Attributes
    ----------
    title : str
    columns : tuple of Column
        The first names the row.
    rows : tuple of tuple of Cell
        Each as long as `columns`.
    note : str
        What to know when reading it: definitions, signs, where its form comes from.
    """

    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ''

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise DataError(
                    f'table {self.title!r}: a row of {len(row)} cells, not {len(self.columns)}'
                )
            for cell in row:
                if isinstance(cell, float) and not math.isfinite(cell):
                    raise DataError(f'table {self.title!r} cannot hold {cell}')


@dataclass(frozen=True, eq=False)
class Series:
    """
    One line, row of points or set of bars of a figure.

    Attributes
    ----------
    label : str
    x, y : ndarray, shape (n,)
        In the units of the figure; of bars, x is the number of the figure's category.
    low, high : ndarray, shape (n,), or None
        Interval of y: a band of a line, an error bar of points and bars.
    kind : {'line', 'step', 'points', 'bars'}
    dashed : bool
        Set values and models, beside what was measured.
    """

    label: str
    x: Floats
    y: Floats
    low: Floats | None = None
    high: Floats | None = None
    kind: str = 'line'
    dashed: bool = False


@dataclass(frozen=True, eq=False)
class Image:
    """
    A value over two axes, as in a spectrogram.

    Attributes
    ----------
    values : ndarray, shape (rows, columns)
        Row 0 at the bottom.
    x, y : (float, float)
        Edges of the first and the last column and row.
    label : str
        What the colour shows, with unit.
    """

    values: Floats
    x: tuple[float, float]
    y: tuple[float, float]
    label: str


@dataclass(frozen=True, eq=False)
class PlanFigure:
    """
    One figure of a plan.

    Attributes
    ----------
    title, x_label, y_label : str
        Labels with units.
    series : tuple of Series
    image : Image or None
        Drawn under the series.
    categories : tuple of str
        Names on the x axis where it has no numbers, as for bars.
    log_x, log_y : bool
    """

    title: str
    x_label: str
    y_label: str
    series: tuple[Series, ...] = ()
    image: Image | None = None
    categories: tuple[str, ...] = ()
    log_x: bool = False
    log_y: bool = False


@dataclass(frozen=True, eq=False)
class PlanResult:
    """
    What a test plan found.

    Attributes
    ----------
    plan, title : str
        Name as given to ``--plan``; heading of the report.
    summary : tuple of str
        The answer in sentences, the most important first.
    tables : tuple of Table
    figures : tuple of PlanFigure
        Not in the JSON document.
    findings : tuple of Finding
        What casts doubt on the result.
    values : mapping of str to object
        JSON-ready numbers for programs, in SI; Estimates through ``to_json``.
    settings : mapping of str to object
        What the user asked for.
    sources : tuple of str
        Recordings it rests on.
    failures : tuple of Failure
        Recordings without a result.
    """

    plan: str
    title: str
    summary: tuple[str, ...]
    tables: tuple[Table, ...] = ()
    figures: tuple[PlanFigure, ...] = ()
    findings: tuple[Finding, ...] = ()
    values: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    sources: tuple[str, ...] = ()
    failures: tuple[Failure, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return the JSON document of schema imu_bench.plan/1."""
        return {
            'schema': SCHEMA,
            'package': {'name': 'imu_bench', 'version': __version__},
            'plan': self.plan,
            'title': self.title,
            'settings': dict(self.settings),
            'sources': list(self.sources),
            'summary': list(self.summary),
            'findings': [finding.to_json() for finding in self.findings],
            'values': dict(self.values),
            'tables': [_table_json(table) for table in self.tables],
            'failures': [{'source': f.source, 'error': f.error} for f in self.failures],
        }


def _table_json(table: Table) -> dict[str, Any]:
    return {
        'title': table.title,
        'note': table.note,
        'columns': [{'title': column.title, 'unit': column.unit} for column in table.columns],
        'rows': [
            [cell.to_json() if isinstance(cell, Estimate) else cell for cell in row]
            for row in table.rows
        ],
    }


def write(result: PlanResult, path: str | os.PathLike[str]) -> None:
    """
    Write the JSON document.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    text = json.dumps(result.to_json(), ensure_ascii=False, allow_nan=False, indent=1)
    write_text(path, text + '\n')
