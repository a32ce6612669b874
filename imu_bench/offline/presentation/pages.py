# SPDX-License-Identifier: Apache-2.0
"""The pages: report of an analysis, of a test plan, of runs against one another, of a campaign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import os
from pathlib import Path
from typing import Any

from imu_bench.bags.problems import SIMULATED
from imu_bench.errors import RecordingError
from imu_bench.metrology.estimate import CONFIDENCE
from imu_bench.offline import exports
from imu_bench.offline.analysis.results import Analysis, RecordingResult
from imu_bench.offline.comparing.runs import distinct, RunComparison
from imu_bench.offline.comparing.sensors import compare
from imu_bench.offline.health import ranked, worst
from imu_bench.offline.notation import bare, count, date, percent
from imu_bench.offline.plans import recorded
from imu_bench.offline.plans.result import PlanResult
from imu_bench.offline.presentation import (
    analysis_figures,
    axis_tables,
    run_tables,
    sensor_tables,
    sentences,
    uses,
)
from imu_bench.offline.presentation.datasheet import Sheet, sheet
from imu_bench.offline.presentation.document import Nowhere, page, Places
from imu_bench.offline.whole_files import file_names, write_text
from imu_bench.units import convert
from imu_bench.version import __version__
from msg_conversions.quantities import IMU_QUANTITIES, Quantity

_EXPORTS = tuple(name for name in exports.FORMATS if name != 'csv')
_AGREED = (
    'The spectrum agrees with the fit of the Allan deviation. The slope tangent has no '
    'uncertainty and always gives three numbers; it is here for comparison with other tools.'
)


def render_report(analysis: Analysis) -> str:
    """
    Return the report as one HTML document without any reference to the outside.

    Everything that comes from a recording (topics, frames, file names, notes)
    is escaped by the template engine.
    """
    reference, sheets = (analysis.settings.get(name) for name in ('reference', 'datasheets'))
    compared = compare(analysis.recordings, str(reference or ''), sheets)
    collected = Places()
    asked = analysis.sensors
    names = compared.labels[: len(asked)]
    together = [
        _together(asked, names, quantity, collected)
        for quantity in IMU_QUANTITIES
        if quantity.name in compared.standings and len(asked) > 1
    ]
    sensors = [
        _sensor(recording, label, collected)
        for recording, label in zip(analysis.recordings, compared.labels, strict=True)
    ]
    doubtful = {
        label
        for recording, label in zip(asked, names, strict=True)
        if recording.health.severity != 'info'
    }
    level = float(analysis.settings.get('confidence', CONFIDENCE))
    banner = sentences.of_simulation([recording.simulated for recording in asked])
    return page(
        'page.html',
        collected,
        level=percent(level),
        title=_title(names),
        version=analysis.version,
        banner=banner,
        summary=sentences.of_all(analysis, compared)[len(banner) :],
        numbers=uses.filter_numbers(dict(zip(compared.labels, analysis.sensors, strict=False))),
        tables=[
            # of one sensor, its own tables say the same
            *(sensor_tables.rankings(asked, compared, level) if len(asked) > 1 else ()),
            *sensor_tables.errors(asked, names),
            *sensor_tables.against_datasheets(compared, doubtful, simulated=bool(banner)),
        ],
        failures=analysis.failures,
        sensors=sensors,
        first_of_others=len(asked) if len(asked) < len(sensors) else None,
        of_others=sentences.OF_OTHERS,
        together=together,
    )


def _together(
    recordings: Sequence[RecordingResult], names: Sequence[str], quantity: Quantity, to: Places
) -> dict[str, Any]:
    """Return the figures that all sensors share, and the Allan deviations of each axis."""
    found = dict(analysis_figures.of_all(recordings, names, quantity.name, ', all sensors'))
    axes = analysis_figures.of_each_axis(found['allan']) if 'allan' in found else []
    return {'name': quantity.title, 'figures': to.add(found.values()), 'axes': to.add(axes)}


def write_report(analysis: Analysis, path: str | os.PathLike[str]) -> None:
    """Write the report; raises OSError if the file cannot be written."""
    write_text(path, render_report(analysis))


def _sensor(recording: RecordingResult, label: str, collected: Places) -> dict[str, Any]:
    """Return what the page says about one sensor."""
    health = recording.health
    return {
        'label': label,
        'source': recording.source,
        'topic': recording.topic,
        'frame_id': recording.frame_id,
        'begin': date(recording.start_ns),
        'words': sentences.of_sensor(recording),
        'facts': sentences.health_facts(health),
        'severity': health.severity,
        # of simulated data the line below the name says so, and the banner
        'findings': [found for found in health.findings if found.code != SIMULATED],
        'simulated': recording.simulated,
        'exports': _exports(recording),
        'intervals': collected.add(filter(None, [analysis_figures.intervals(recording)])),
        'sections': [
            _section(recording, quantity, collected)
            for quantity in IMU_QUANTITIES
            if recording.of(quantity.name)
        ],
        'runs': _runs(recording),
    }


def _runs(recording: RecordingResult) -> dict[str, Any] | None:
    """Return the runs of a pooled sensor: a table, and what stands behind each of its rows."""
    if not recording.runs:
        return None
    names = distinct([run.source for run in recording.runs])
    behind = [
        _sensor(run, name, Nowhere()) for name, run in zip(names, recording.runs, strict=True)
    ]
    return {'table': axis_tables.of_runs(recording, names), 'behind': behind}


def _section(recording: RecordingResult, quantity: Quantity, collected: Places) -> dict[str, Any]:
    """Return what the page says about one quantity of one sensor."""
    axes = recording.of(quantity.name)
    name = quantity.title
    parts = (
        ('Noise density in three ways', axis_tables.densities(axes),
         sentences.density_verdicts(axes)),
        ('Coefficients by other methods', axis_tables.other_methods(axes),
         sentences.disagreements(axes) or [_AGREED]),
        ('Drift as a Gauss-Markov process', axis_tables.drift(axes), sentences.tracking(axes)),
    )  # fmt: skip
    return {
        'name': name,
        'between': axis_tables.between(axes),
        'coefficients': axis_tables.coefficients(axes, recording.health),
        'remarks': [*sentences.fit_remarks(axes), *sentences.fits(axes)],
        'statistics': axis_tables.statistics(axes, recording.health),
        'checks': [(title, table, lines) for title, table, lines in parts if table is not None],
        'steadiness': sentences.steadiness(axes),
        'figures': collected.add(
            figure for _, figure in analysis_figures.of_sensor(recording, quantity.name)
        ),
    }


def _title(labels: Sequence[str]) -> str:
    if len(labels) == 1:
        return f'Noise of {labels[0]}'
    return f'Noise of {len(labels)} inertial sensors'


def _exports(recording: RecordingResult) -> list[tuple[str, str]]:
    """Return name and text of every export that the recording has the numbers for."""
    found = [(name, _block(recording, name)) for name in _EXPORTS]
    return [(name, text) for name, text in found if text]


def _block(recording: RecordingResult, name: str) -> str:
    try:
        return exports.render(Analysis((recording,)), name)
    except RecordingError:
        # one sensor of the two, or no bound: what the export needs is not there
        return ''


_NAMED_SOURCES = 12
_DIGITS = 6
_ON_PAGE = {'rad': '°', '(m/s²)²/Hz': 'g²/Hz'}
"""Units of settings as test documents and vibration profiles have them."""


def render_datasheet(described: Sheet) -> str:
    """Return a measured datasheet as one HTML document without any reference to the outside."""
    collected = Places()
    places = collected.add(described.figures)
    version = dict(described.provenance)['Software'].rpartition(' ')[2]
    return page(
        'datasheet.html',
        collected,
        title=described.title,
        version=version,
        banner=described.banner,
        sheet=described,
        places=places,
    )


def write_datasheets(
    analysis: Analysis, folder: str | os.PathLike[str], *, pdf: bool = False
) -> list[Path]:
    """Write the measured datasheet of every sensor, one page and perhaps one PDF each."""
    target = Path(folder)
    target.mkdir(exist_ok=True)
    reference, sheets = (analysis.settings.get(name) for name in ('reference', 'datasheets'))
    compared = compare(analysis.recordings, str(reference or ''), sheets)
    names = file_names(compared.labels)
    written = []
    for name, recording, label in zip(names, analysis.recordings, compared.labels, strict=True):
        described = sheet(recording, label, compared, analysis.settings, analysis.version)
        written.append(target / f'{name}.html')
        write_text(written[-1], render_datasheet(described))
        if pdf:
            from imu_bench.offline.presentation import paper  # needs matplotlib

            written.append(target / f'{name}.pdf')
            paper.write(described, written[-1])
    return written


def render_plan(result: PlanResult) -> str:
    """Return the report as one HTML document without any reference to the outside."""
    collected = Places()
    figures = collected.add(result.figures)
    more = len(result.sources) - _NAMED_SOURCES
    return page(
        'plan.html',
        collected,
        title=result.title,
        version=__version__,
        result=result,
        banner=sentences.of_simulation([result.simulated]),
        findings=ranked([f for f in result.findings if f.code != SIMULATED]),  # the banner says it
        taken=recorded.sentence(result.recorded),
        streams=recorded.table(result.recorded),
        sources=result.sources[:_NAMED_SOURCES],
        more=max(0, more),
        settings=[(name, text) for name, text in map(_setting, result.settings.items()) if text],
        figures_of_plan=figures,
    )


def write_plan(result: PlanResult, path: str | os.PathLike[str]) -> None:
    """Write the report; raises OSError if the file cannot be written."""
    write_text(path, render_plan(result))


def _setting(item: tuple[str, Any]) -> tuple[str, str]:
    name, value = item
    if isinstance(value, dict) and set(value) == {'value', 'unit'}:
        given = str(value['unit'])
        unit = _ON_PAGE.get(given, given)
        numbers = value['value'] if isinstance(value['value'], list) else [value['value']]
        shown = (bare(convert(one, given, unit), _DIGITS) for one in numbers)
        return name, f'{", ".join(shown)} {unit}'
    if isinstance(value, list | tuple):
        return name, ', '.join(map(str, value))
    return name, '' if value is None else str(value)


def render_runs(compared: RunComparison) -> str:
    """Return the comparison as one HTML document without any reference to the outside."""
    collected = Places()
    return page(
        'runs.html',
        collected,
        title=f'{len(compared.runs)} runs compared',
        version=__version__,
        banner=sentences.of_simulation(
            [each.simulated for runs in compared.sensors.values() for each in runs.values()]
        ),
        summary=run_tables.summary(compared),
        reference=compared.runs[0].name,
        sensors=[_sensor_of_runs(compared, name, collected) for name in compared.sensors],
    )


def write_runs(compared: RunComparison, path: str | os.PathLike[str]) -> None:
    """Write the page; raises OSError if the file cannot be written."""
    write_text(path, render_runs(compared))


def _sensor_of_runs(compared: RunComparison, name: str, collected: Places) -> dict[str, Any]:
    recordings = compared.sensors[name]
    places = [
        place
        for quantity in IMU_QUANTITIES
        for place in collected.add(
            figure
            for _, figure in analysis_figures.of_all(
                list(recordings.values()), list(recordings), quantity.name
            )
        )
    ]
    runs = dict.fromkeys(line.run for line in compared.lines if line.sensor == name)
    tables = [run_tables.table(compared, name, run, run_tables.ON_PAGE) for run in runs]
    doubts = [
        (run, [f for f in recording.health.findings if f.severity != 'info'])
        for (sensor, run), recording in compared.doubted.items()
        if sensor == name
    ]
    return {'name': name, 'figures': places, 'tables': tables, 'doubts': doubts}


@dataclass(frozen=True, eq=False)
class Chapter:
    """One test of a campaign."""

    name: str
    title: str
    plan: str
    result: PlanResult | None = None  # None if the test has failed
    link: str = ''  # its report, relative to the page
    runs: int = 0
    failure: str = ''  # why there is no result

    @property
    def failed(self) -> bool:
        """Whether a part of the test has no result."""
        return self.result is None or bool(self.result.failures)

    @property
    def taken(self) -> str:
        """When, how long and how well its recordings were taken."""
        return '' if self.result is None else recorded.sentence(self.result.recorded)

    @property
    def severity(self) -> str:
        """The worst of its findings."""
        return 'severe' if self.result is None else worst(self.result.findings)


def overview(chapters: Sequence[Chapter]) -> list[str]:
    """Return how the campaign went, a sentence each."""
    titles = [chapter.title or chapter.name for chapter in chapters]
    named = list(zip(titles, chapters, strict=True))
    lost = [title for title, chapter in named if chapter.result is None]
    partial = [title for title, chapter in named if chapter.failed and chapter.result is not None]
    found = [title for title, chapter in named if chapter.severity == 'severe' and chapter.result]
    said = count(len(chapters), 'test')
    said += f'; no result of {", ".join(lost)}.' if lost else ', all with a result.'
    lines = [said]
    if short := [title for title, each in named if each.result and each.result.form]:
        lines.append(f'In a short form, and not as the document has it: {", ".join(short)}.')
    if partial:
        lines.append(f'A part could not be measured in {", ".join(partial)}.')
    if found:
        lines.append(f'Not to be trusted without reading the findings: {", ".join(found)}.')
    return lines


def write_campaign(title: str, chapters: Sequence[Chapter], path: str | os.PathLike[str]) -> None:
    """Write the page; raises OSError if the file cannot be written."""
    text = page(
        'campaign.html',
        Places(),
        title=title,
        version=__version__,
        chapters=chapters,
        banner=sentences.of_simulation([c.result.simulated for c in chapters if c.result]),
        overview=overview(chapters),
    )
    write_text(path, text)
