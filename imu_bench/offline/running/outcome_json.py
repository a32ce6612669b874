# SPDX-License-Identifier: Apache-2.0
"""The JSON form of what became of one recording, with what the report shows of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
import math
from typing import Any

from imu_bench.errors import RecordingError
from imu_bench.offline.analysis.axis_result import AxisResult, Envelope
from imu_bench.offline.analysis.drift import Correlation, Trace
from imu_bench.offline.analysis.json_forms import (
    histogram_from_json,
    histogram_to_json,
    rows_from_json,
)
from imu_bench.offline.analysis.results import RecordingResult
from imu_bench.offline.analysis.typed import check
from imu_bench.offline.running.pipeline import Outcome

_SCHEMA = 'imu_bench.finished/2'
_ENVELOPE = ('time', 'low', 'high')
_CORRELATION = ('lag', 'value')
_TRACE = ('time', 'measured', 'bias', 'deviation')


def outcome_to_json(outcome: Outcome) -> dict[str, Any]:
    """Return the JSON document of an outcome without failures."""
    return {
        'schema': _SCHEMA,
        'results': [result.to_json() for result in outcome.results],
        'figures': [
            {name: _figures(axis) for name, axis in result.axes.items()}
            for result in outcome.results
        ],
    }


def outcome_from_json(document: Mapping[str, Any]) -> Outcome:
    """Return the outcome that `outcome_to_json` wrote."""
    if document['schema'] != _SCHEMA:
        raise RecordingError(f'schema {document["schema"]!r}, not {_SCHEMA}')
    found = []
    for described, figures in zip(document['results'], document['figures'], strict=True):
        result = RecordingResult.from_json(described)
        if figures.keys() != result.axes.keys():
            raise RecordingError('the figures are those of other axes')
        axes = {name: _with_figures(axis, figures[name]) for name, axis in result.axes.items()}
        found.append(replace(result, axes=axes))
        check(found[-1])
    return Outcome(tuple(found))


def _figures(axis: AxisResult) -> dict[str, Any]:
    """Return what the report shows of an axis beside its results."""
    drift = axis.checks.drift
    trace = drift.tracking.trace if drift and drift.tracking else None
    decay = drift.correlation if drift else None
    return {
        'histogram': None if axis.histogram is None else histogram_to_json(axis.histogram),
        'envelope': None if axis.envelope is None else _rows(axis.envelope, _ENVELOPE),
        'correlation': None if decay is None else _rows(decay, _CORRELATION),
        'trace': None if trace is None else _rows(trace, _TRACE),
    }


def _with_figures(axis: AxisResult, document: Mapping[str, Any]) -> AxisResult:
    histogram, envelope, trace = (document[name] for name in ('histogram', 'envelope', 'trace'))
    if histogram is not None:
        axis = replace(axis, histogram=histogram_from_json(histogram))
    if envelope is not None:
        axis = replace(axis, envelope=Envelope(*rows_from_json(envelope, _ENVELOPE)))
    checks = axis.checks
    if (decay := document['correlation']) is not None and checks.drift:
        shown_decay = Correlation(*rows_from_json(decay, _CORRELATION))
        checks = replace(checks, drift=replace(checks.drift, correlation=shown_decay))
        axis = replace(axis, checks=checks)
    if trace is not None and checks.drift and checks.drift.tracking:
        shown = Trace(*rows_from_json(trace, _TRACE))
        drift = replace(checks.drift, tracking=replace(checks.drift.tracking, trace=shown))
        axis = replace(axis, checks=replace(checks, drift=drift))
    return axis


def _rows(
    of: Correlation | Envelope | Trace, names: Sequence[str]
) -> dict[str, list[float | None]]:
    """Return rows of numbers; where there is none, JSON has null."""
    return {
        name: [None if math.isnan(value) else value for value in getattr(of, name).tolist()]
        for name in names
    }
