# SPDX-License-Identifier: Apache-2.0
"""Puts the report together: words, tables and figures into one HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from datetime import datetime, timezone
import os
from pathlib import Path
from typing import Any

from imu_bench.offline import comparison
from imu_bench.offline.axis_result import AxisResult
from imu_bench.offline.comparison import Comparison
from imu_bench.offline.plotting import drawable
from imu_bench.offline.report import checks_figures, checks_text, figures, pasted, text
from imu_bench.offline.report.document import page, Places
from imu_bench.offline.results import Analysis, RecordingResult
from imu_bench.offline.workers import answer, Here, Workers
from imu_bench.samples import IMU_QUANTITIES, Quantity

_BEFORE_CLOCKS = 2000  # stamps of an earlier year are seconds since power-up, not a date


def render(analysis: Analysis, workers: Workers | None = None) -> str:
    """
    Return the report as one HTML document without any reference to the outside.

    Everything that comes from a recording (topics, frames, file names, notes)
    is escaped by the template engine.

    Parameters
    ----------
    analysis : Analysis
    workers : Workers, optional
        Who draws the figures; this process if nobody is given.
    """
    draw = (workers or Here()).submit
    compared = comparison.compare(analysis.recordings, str(analysis.settings.get('reference', '')))
    numbered = list(enumerate(analysis.recordings))
    heads = [draw(_intervals, recording, f'{n}-') for n, recording in numbered]
    parts = [
        [
            draw(_section, recording, quantity, f'{n}-{quantity.field}-')
            for quantity in IMU_QUANTITIES
            if recording.of(quantity.name)
        ]
        for n, recording in numbered
    ]
    joint = draw(_together, analysis.recordings, compared, 'together-')
    collected = Places()

    def collect(future: Future[tuple[Any, list[str]]]) -> Any:
        content, items = answer(future)
        collected.items += items
        return content

    sensors = [
        _sensor(recording, label)
        | {'intervals': collect(head), 'sections': list(map(collect, own))}
        for recording, label, head, own in zip(
            analysis.recordings, compared.labels, heads, parts, strict=True
        )
    ]
    together = collect(joint)
    return page(
        'page.html',
        collected,
        title=_title(compared),
        version=analysis.version,
        summary=text.summary(analysis, compared),
        rankings=text.rankings(analysis, compared),
        judgements=text.judgements(compared.verdicts),
        failures=analysis.failures,
        sensors=sensors,
        together=together,
    )


def write(
    analysis: Analysis, path: str | os.PathLike[str], workers: Workers | None = None
) -> None:
    """
    Write the report; parameters as `render`.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    Path(path).write_text(render(analysis, workers), encoding='utf-8')


def _sensor(recording: RecordingResult, label: str) -> dict[str, Any]:
    """Return what the page says about one sensor, without figures."""
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
    }


def _section(
    recording: RecordingResult, quantity: Quantity, prefix: str
) -> tuple[dict[str, Any], list[str]]:
    """Return what the page says about one quantity of one sensor, and its figures."""
    collected = Places(prefix)
    axes = recording.of(quantity.name)
    name = text.SIGNAL_NAMES[quantity.name]
    content = {
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
    return content, collected.items


def _intervals(recording: RecordingResult, prefix: str) -> tuple[list[dict[str, str]], list[str]]:
    if recording.intervals is None:
        return [], []
    collected = Places(prefix)
    place = collected.add(figures.intervals(recording), 'Intervals between samples')
    return [place], collected.items


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
    recordings: Sequence[RecordingResult], compared: Comparison, prefix: str
) -> tuple[list[dict[str, str]], list[str]]:
    collected = Places(prefix)
    if len(recordings) < 2:
        return [], []
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
    return places, collected.items


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
