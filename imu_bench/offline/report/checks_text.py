# SPDX-License-Identifier: Apache-2.0
"""Words and tables of the report on what qualifies the metrics: other methods, drift, change."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.axis_result import AxisResult
from imu_bench.offline.gauss_markov_result import DriftModel, METHODS, Tracking
from imu_bench.offline.notation import duration, number, percent, readable_unit, text
from imu_bench.offline.report.text import Cell, cell, Column, column

_BY = {'whittle': 'spectrum (Whittle)', 'tangent': 'slope tangent'}


class Row(NamedTuple):
    """One line of a table of models: axis, name of the model, and its numbers."""

    letter: str
    name: str
    cells: list[Cell]


class Table(NamedTuple):
    """A table with more than one line per axis: titles with units, and the lines."""

    heads: list[tuple[str, str]]
    rows: list[Row]


def method_columns(axes: Sequence[AxisResult]) -> list[Column]:
    """Return N, B and K by the other methods."""
    found = [axis.checks.second if axis.checks else None for axis in axes]
    if not any(found):
        return []
    columns = []
    for term in 'NBK':
        for name, title in _BY.items():
            blank = Estimate.not_observable(getattr(axes[0].model, term).unit, 'not computed')
            estimates = [s.coefficients[name][term] if s else blank for s in found]
            columns.append(column(f'{term}, {title}', term, estimates))
    return columns


def disagreements(axes: Sequence[AxisResult]) -> list[str]:
    """Return where the spectrum contradicts the fit."""
    return [
        f'{axis.letter}: {sentence}.'
        for axis in axes
        if axis.checks and axis.checks.second
        for sentence in axis.checks.second.disagreements
    ]


def drift_table(axes: Sequence[AxisResult]) -> Table | None:
    """Return every Gauss-Markov model found, or None if there is none."""
    found = [(axis.letter, name, model) for axis in axes for name, model in _models(axis)]
    if not found:
        return None
    models = [model for _, _, model in found]
    sigma = readable_unit(axes[0].unit, 'level', [m.sigma.value for m in models])
    strength = models[0].q_c.unit
    walk = readable_unit(strength, 'K', [m.q_c.value for m in models])
    rows = [
        Row(
            letter,
            METHODS[name],
            [cell(model.T_c, 's'), cell(model.sigma, sigma), cell(model.q_c, walk)],
        )
        for letter, name, model in found
    ]
    heads = [('Correlation time T_c', 's'), ('σ of the process', sigma), ('Strength q_c', walk)]
    return Table(heads, rows)


def _models(axis: AxisResult) -> Iterator[tuple[str, DriftModel]]:
    if axis.checks and axis.checks.drift:
        models = axis.checks.drift.models
        yield from ((name, models[name]) for name in METHODS if name in models and
                    models[name].process)  # fmt: skip


def drift_words(axes: Sequence[AxisResult]) -> list[str]:
    """Return how well a filter with these models follows the bias."""
    lines = []
    for axis in axes:
        drift = axis.checks.drift if axis.checks else None
        if drift is not None and drift.tracking is not None:
            lines.append(f'{axis.letter}: {_tracking_words(drift.tracking)}')
    return lines


def _tracking_words(found: Tracking) -> str:
    unit = readable_unit(found.rmse.unit, 'level', [found.rmse.value])
    claimed = number(found.deviation.to(unit).value or 0.0, 2)
    verdict = (
        'its innovations are white, so this model describes the drift'
        if found.white
        else 'its innovations are not white, so the drift is more than this one process'
    )
    return (
        f'a Kalman filter with the process of the {METHODS[found.source]} follows the bias to '
        f'{claimed} {unit} by its own account; it differs by {text(found.rmse, unit)} RMS from '
        f'the average over {duration(found.window_s)}; {verdict} (normalised variance '
        f'{number(found.variance, 3)}).'
    )


def steadiness_words(axes: Sequence[AxisResult]) -> list[str]:
    """Return whether the noise stayed the same, one line for axes that say the same."""
    said: dict[str, list[str]] = {}
    for axis in axes:
        if axis.checks and axis.checks.steadiness:
            said.setdefault(axis.checks.steadiness.text, []).append(axis.letter)
    return [f'{", ".join(letters)}: {words}.' for words, letters in said.items()]


def shape_columns(axes: Sequence[AxisResult]) -> list[Column]:
    """Return outliers and normality as columns."""
    columns = []
    if all(axis.outliers is not None for axis in axes):
        counts = [Cell(f'{axis.outliers}', '', '', True) for axis in axes]
        columns.append(Column('Outliers', '', counts))
    shapes = [axis.checks.normality if axis.checks else None for axis in axes]
    if any(shapes):
        cells = [
            Cell('–', '', 'not tested', False)
            if shape is None
            else Cell(shape.verdict, f'D = {percent(shape.distance.value or 0.0)}', '', True)
            for shape in shapes
        ]
        columns.append(Column('Distribution', '', cells))
    return columns


def fit_words(axes: Sequence[AxisResult]) -> list[str]:
    """Return over which averaging times the models were fitted, and how well they fit."""
    said: dict[str, list[str]] = {}
    for axis in axes:
        model = axis.model
        if model.fitted and axis.allan is not None:
            last = min(model.tau_high, float(axis.allan.tau[-1]))
            terms = ', '.join(model.fitted) + (' and T_c' if model.gauss_markov else '')
            taus = f'τ = {duration(model.tau_low)} to {duration(last)}'
            line = (
                f'fitted from {taus} with {terms}; mean squared residual '
                f'{number(model.chi2, 2)} times that expected'
            )
            said.setdefault(line, []).append(axis.letter)
    return [f'{", ".join(letters)} – {line}.' for line, letters in said.items()]
