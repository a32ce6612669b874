# SPDX-License-Identifier: Apache-2.0
"""Every measured number of a result as one CSV table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import csv
import io

from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.axis_result import AxisResult
from imu_bench.offline.results import RecordingResult

COLUMNS = (
    'source', 'topic', 'axis', 'parameter', 'value', 'low', 'high', 'unit', 'convention',
    'confidence', 'observable', 'method', 'reason',
)  # fmt: skip
"""Columns of the table; empty cells are numbers that do not exist."""

_DENSITY = 'continuous-time, one-sided'
_COEFFICIENT = {
    'N': 'continuous-time, two-sided',
    'K': 'continuous-time, two-sided',
    'B': 'flicker floor is 0.664 B',
}
_PROCESS = {'q_c': 'continuous-time, two-sided', 'sigma': 'of the process'}


def table(recordings: Sequence[RecordingResult]) -> str:
    """Return the table: comma separated, one header line, SI units."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator='\n')
    writer.writerow(COLUMNS)
    for recording in recordings:
        for axis, parameter, estimate, convention in _rows(recording):
            writer.writerow([
                recording.source, recording.topic, axis, parameter,
                *(_digits(n) for n in (estimate.value, estimate.low, estimate.high)),
                estimate.unit, convention, f'{estimate.confidence:g}',
                str(estimate.observable).lower(), estimate.method, estimate.reason,
            ])  # fmt: skip
    return out.getvalue()


def _rows(recording: RecordingResult) -> Iterator[tuple[str, str, Estimate, str]]:
    yield '', 'rate', recording.health.rate, ''
    yield '', 'jitter', recording.health.jitter, ''
    for name, axis in recording.axes.items():
        for parameter, estimate in axis.statistics.items():
            yield name, parameter, estimate, 'discrete-time, of the samples'
        yield name, 'noise_density', axis.white_density, _DENSITY
        for method, estimate in axis.noise_density_methods.items():
            yield name, f'noise_density.{method}', estimate, _DENSITY
        for term in axis.model.coefficients:
            estimate = axis.coefficient(term)
            yield name, term, estimate, _COEFFICIENT.get(term, '')
        yield from _checks(name, axis)


def _checks(name: str, axis: AxisResult) -> Iterator[tuple[str, str, Estimate, str]]:
    checks = axis.checks
    if checks is None:
        return
    for method, found in (checks.second.coefficients if checks.second else {}).items():
        for term, estimate in found.items():
            yield name, f'{term}.{method}', estimate, _COEFFICIENT.get(term, '')
    for method, model in (checks.drift.models if checks.drift else {}).items():
        for part in ('T_c', 'sigma', 'q_c'):
            estimate = getattr(model, part)
            yield name, f'{part}.{method}', estimate, _PROCESS.get(part, '')
    if checks.steadiness is not None:
        yield name, 'noise_ratio_over_time', checks.steadiness.ratio, ''


def _digits(number: float | None) -> str:
    return '' if number is None else f'{number:.9g}'
