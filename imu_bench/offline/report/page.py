# SPDX-License-Identifier: Apache-2.0
"""Puts the report together: words, tables and figures into one HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timezone
from functools import cache
import json
import os
from pathlib import Path
from typing import Any

import bokeh
from bokeh.document import Document
from bokeh.models import LayoutDOM
from bokeh.resources import Resources
from imu_bench.offline import comparison
from imu_bench.offline.axis_result import AxisResult
from imu_bench.offline.comparison import Comparison
from imu_bench.offline.report import figures, text
from imu_bench.offline.results import Analysis, RecordingResult
from imu_bench.samples import IMU_QUANTITIES
import jinja2
from markupsafe import Markup

_FOLDER = Path(__file__).parent
_BEFORE_CLOCKS = 2000  # stamps of an earlier year are seconds since power-up, not a date


class _Places:
    """Collects figures; the page gets empty places and one JSON document each."""

    def __init__(self) -> None:
        self.items: list[dict[str, Any]] = []

    def add(self, model: LayoutDOM, caption: str) -> dict[str, str]:
        """Return the identifier of the place and the caption."""
        name = f'figure-{len(self.items) + 1}'
        # what bokeh.embed.json_item makes, which walks over all models twice more
        document = Document(title='')
        document.add_root(model)
        content = {
            'root_id': model.id,
            'doc': document.to_json(deferred=False),
            'version': bokeh.__version__,
        }
        self.items.append({'target_id': name, **content})
        return {'id': name, 'caption': caption, 'height': str(figures.height_of(model))}


def render(analysis: Analysis) -> str:
    """
    Return the report as one HTML document without any reference to the outside.

    Everything that comes from a recording (topics, frames, file names, notes)
    is escaped by the template engine.
    """
    compared = comparison.compare(analysis.recordings, str(analysis.settings.get('reference', '')))
    collected = _Places()
    sensors = [
        _sensor(recording, label, collected)
        for recording, label in zip(analysis.recordings, compared.labels, strict=True)
    ]
    together = _together(analysis.recordings, compared, collected)
    template = _environment().get_template('page.html')
    return template.render(
        title=_title(compared),
        version=analysis.version,
        summary=text.summary(analysis, compared),
        rankings=text.rankings(analysis, compared),
        judgements=text.judgements(compared.verdicts),
        failures=analysis.failures,
        sensors=sensors,
        together=together,
        style=Markup((_FOLDER / 'page.css').read_text(encoding='utf-8')),
        script=Markup((_FOLDER / 'page.js').read_text(encoding='utf-8')),
        library=Markup(_library()),
        figures=[Markup(_script_safe(item)) for item in collected.items],
    )


def write(analysis: Analysis, path: str | os.PathLike[str]) -> None:
    """
    Write the report.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    Path(path).write_text(render(analysis), encoding='utf-8')


def _sensor(recording: RecordingResult, label: str, collected: _Places) -> dict[str, Any]:
    health = recording.health
    sections = []
    for quantity in IMU_QUANTITIES:
        axes = recording.of(quantity.name)
        if not axes:
            continue
        name = text.SIGNAL_NAMES[quantity.name]
        sections.append(
            {
                'name': name,
                'letters': [axis.letter for axis in axes],
                'coefficients': text.coefficient_columns(axes),
                'statistics': text.statistic_columns(axes, health),
                'methods': text.method_columns(axes),
                'verdicts': text.method_verdicts(axes),
                'remarks': text.fit_remarks(axes),
                'figures': _figures(axes, recording, name, collected),
            }
        )
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
        'intervals': _intervals(recording, collected),
        'sections': sections,
    }


def _intervals(recording: RecordingResult, collected: _Places) -> list[dict[str, str]]:
    if recording.intervals is None:
        return []
    return [collected.add(figures.intervals(recording), 'Intervals between samples')]


def _figures(
    axes: Sequence[AxisResult], recording: RecordingResult, name: str, collected: _Places
) -> list[dict[str, str]]:
    """Return the places of the figures that the results have data for."""
    places = []
    if any(map(figures.drawable, axes)):
        places.append(collected.add(figures.allan(axes), f'{name}: Allan deviation'))
    if any(axis.psd for axis in axes):
        places.append(collected.add(figures.spectrum(axes), f'{name}: noise spectrum'))
    if any(axis.envelope for axis in axes):
        series = figures.time_series(axes, recording)
        places.append(collected.add(series, f'{name} about the mean of each axis'))
    if any(axis.histogram for axis in axes):
        places.append(collected.add(figures.histogram(axes), f'{name}: distribution'))
    return places


def _together(
    recordings: Sequence[RecordingResult], compared: Comparison, collected: _Places
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
        if any(map(figures.drawable, axes)):
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


def _script_safe(document: dict[str, Any]) -> str:
    """Return JSON that cannot end the script element it stands in."""
    return json.dumps(document, separators=(',', ':')).replace('<', '\\u003c')


@cache
def _library() -> str:
    """Return the plotting library that came with the Python package, without its widgets."""
    return '\n'.join(Resources(mode='inline', components=['bokeh']).js_raw)


@cache
def _environment() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(_FOLDER),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
