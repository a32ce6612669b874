# SPDX-License-Identifier: Apache-2.0
"""Puts the report together: words, tables and figures into one HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timezone
import os
from typing import Any

from imu_bench.offline import comparison
from imu_bench.offline.axis_result import AxisResult
from imu_bench.offline.comparison import Comparison
from imu_bench.offline.plotted import drawable
from imu_bench.offline.report import (
    against_datasheet,
    checks_figures,
    checks_text,
    dead_reckoning,
    figures,
    pasted,
    summary,
    text,
)
from imu_bench.offline.report.document import page, Places
from imu_bench.offline.results import Analysis, RecordingResult
from imu_bench.offline.whole_files import write_text
from imu_bench.samples import IMU_QUANTITIES, Quantity

_BEFORE_CLOCKS = 2000  # stamps of an earlier year are seconds since power-up, not a date


_STAMP_S = 1e-8  # intervals that differ by less than ten steps of a stamp show nothing


def render(analysis: Analysis) -> str:
    """
    Return the report as one HTML document without any reference to the outside.

    Everything that comes from a recording (topics, frames, file names, notes)
    is escaped by the template engine.
    """
    reference, sheets = (analysis.settings.get(name) for name in ('reference', 'datasheets'))
    compared = comparison.compare(analysis.recordings, str(reference or ''), sheets)
    collected = Places()
    together = _together(analysis.recordings, compared, collected)
    sensors = [
        _sensor(recording, label, collected)
        for recording, label in zip(analysis.recordings, compared.labels, strict=True)
    ]
    doubtful = {
        label
        for recording, label in zip(analysis.recordings, compared.labels, strict=True)
        if recording.health.severity != 'info'
    }
    judged = {verdict.label for verdict in compared.verdicts}
    return page(
        'page.html',
        collected,
        title=_title(compared),
        version=analysis.version,
        summary=summary.sentences(analysis, compared),
        reference=compared.reference,
        rankings=text.rankings(analysis, compared),
        judgements=against_datasheet.lines(compared.verdicts, doubtful),
        sheets=against_datasheet.sources(compared.verdicts),
        unjudged=[name for name in compared.labels if name not in judged],
        reckonings=dead_reckoning.tables(analysis.recordings, compared.labels),
        failures=analysis.failures,
        sensors=sensors,
        together=together,
    )


def write(analysis: Analysis, path: str | os.PathLike[str]) -> None:
    """
    Write the report.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    write_text(path, render(analysis))


def _sensor(recording: RecordingResult, label: str, collected: Places) -> dict[str, Any]:
    """Return what the page says about one sensor."""
    health = recording.health
    return {
        'label': label,
        'source': recording.source,
        'topic': recording.topic,
        'frame_id': recording.frame_id,
        'begin': _date(recording.start_ns),
        'words': text.sensor_words(recording),
        'facts': text.health_facts(health),
        'severity': health.severity,
        'findings': health.findings,
        'exports': pasted.blocks(recording),
        'intervals': _intervals(recording, collected),
        'sections': [
            _section(recording, quantity, collected)
            for quantity in IMU_QUANTITIES
            if recording.of(quantity.name)
        ],
    }


def _section(recording: RecordingResult, quantity: Quantity, collected: Places) -> dict[str, Any]:
    """Return what the page says about one quantity of one sensor."""
    axes = recording.of(quantity.name)
    name = text.SIGNAL_NAMES[quantity.name]
    return {
        'name': name,
        'letters': [axis.letter for axis in axes],
        'coefficients': text.coefficient_columns(axes),
        'statistics': [
            *text.statistic_columns(axes, recording.health),
            *checks_text.shape_columns(axes),
        ],
        'methods': text.method_columns(axes),
        'verdicts': text.method_verdicts(axes),
        'remarks': [*text.fit_remarks(axes), *checks_text.fit_words(axes)],
        'others': checks_text.method_columns(axes),
        'disagreements': checks_text.disagreements(axes),
        'drift': checks_text.drift_table(axes),
        'drift_words': checks_text.drift_words(axes),
        'steadiness': checks_text.steadiness_words(axes),
        'figures': _figures(axes, recording, name, collected),
    }


def _intervals(recording: RecordingResult, collected: Places) -> list[dict[str, str]]:
    found = recording.intervals
    if found is None or found.edges[-1] - found.edges[0] < _STAMP_S:
        return []
    return [collected.add(figures.intervals(recording), 'Intervals between samples')]


def _figures(
    axes: Sequence[AxisResult], recording: RecordingResult, name: str, collected: Places
) -> list[dict[str, str]]:
    """Return the places of the figures that the results have data for."""
    places = []
    if any(map(drawable, axes)):
        places.append(collected.add(figures.allan(axes), f'{name}: Allan deviation'))
    if any(axis.psd for axis in axes):
        places.append(collected.add(figures.spectrum(axes), f'{name}: noise spectrum'))
    if any(axis.envelope for axis in axes):
        series = figures.time_series(axes, recording)
        places.append(collected.add(series, f'{name} about the mean of each axis'))
    if any(axis.histogram for axis in axes):
        places.append(collected.add(figures.histogram(axes), f'{name}: distribution'))
    if any(map(checks_figures.has_windows, axes)):
        changing = checks_figures.noise_over_time(axes, recording)
        places.append(collected.add(changing, f'{name}: noise over time'))
    if any(checks_figures.trace_of(axis) for axis in axes):
        tracked = checks_figures.tracked_bias(axes, recording)
        places.append(collected.add(tracked, f'{name}: bias, averaged and tracked'))
    return places


def _together(
    recordings: Sequence[RecordingResult], compared: Comparison, collected: Places
) -> list[dict[str, str]]:
    if len(recordings) < 2:
        return []
    places = []
    for quantity in IMU_QUANTITIES:
        if quantity.name not in compared.standings:
            continue
        name = text.SIGNAL_NAMES[quantity.name]
        arguments = (recordings, compared.labels, quantity.name)
        axes = [axis for recording in recordings for axis in recording.of(quantity.name)]
        if any(map(drawable, axes)):
            curves = figures.compare_allan(*arguments)
            places.append(collected.add(curves, f'{name}: Allan deviation, all sensors'))
        if any(axis.psd for axis in axes):
            spectra = figures.compare_spectrum(*arguments)
            places.append(collected.add(spectra, f'{name}: noise spectrum, all sensors'))
    return places


def _title(compared: Comparison) -> str:
    labels = compared.labels
    if len(labels) == 1:
        return f'Noise of {labels[0]}'
    return f'Noise of {len(labels)} inertial sensors'


def _date(stamp_ns: int) -> str:
    try:
        moment = datetime.fromtimestamp(stamp_ns * 1e-9, tz=timezone.utc)
    except (OverflowError, OSError, ValueError):
        return ''
    return f'{moment:%Y-%m-%d %H:%M} UTC' if moment.year >= _BEFORE_CLOCKS else ''
