# SPDX-License-Identifier: Apache-2.0
"""The measured datasheet of one sensor, as makers print theirs: described once, page or paper."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
import hashlib
from pathlib import Path
from typing import Any

from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.fitting.noise_model import TERM_NAMES
from imu_bench.offline.analysis.axis_result import AxisResult
from imu_bench.offline.analysis.results import RecordingResult
from imu_bench.offline.comparing.sensors import Comparison, Verdict
from imu_bench.offline.notation import (
    date,
    duration,
    number,
    percent,
    rate_text,
    unit_of,
    value_text,
)
from imu_bench.offline.presentation import sentences
from imu_bench.offline.presentation.figure import Figure
from imu_bench.offline.presentation.noise_figures import datasheet_curve, drawable
from imu_bench.offline.presentation.tables import Cell, Column, Shown, Table
from msg_conversions.quantities import ANGULAR_VELOCITY, IMU_QUANTITIES, Quantity

_BLOCK = 1 << 20  # bytes read at a time
_MOST_FILES = 4  # of a bag whose sums are printed


@dataclass(frozen=True, eq=False)
class Sheet:
    """
    What stands on a measured datasheet.

    Attributes
    ----------
    title : str
        The sensor.
    banner : tuple of str
        That the data are simulated, if they are.
    health, severity : str
        One sentence, and how bad it is.
    tables : tuple of Table
        One per quantity, then rate and range.
    figures : tuple of Figure
        The Allan deviation of each quantity.
    provenance : tuple of (str, str)
        Where the numbers come from.
    """

    title: str
    banner: tuple[str, ...]
    health: str
    severity: str
    tables: tuple[Table, ...]
    figures: tuple[Figure, ...]
    provenance: tuple[tuple[str, str], ...]


def sheet(
    recording: RecordingResult,
    label: str,
    compared: Comparison,
    settings: Mapping[str, Any],
    version: str,
) -> Sheet:
    """Return the measured datasheet of one sensor of an analysis."""
    verdicts = {
        (verdict.axis, verdict.parameter): verdict
        for verdict in compared.verdicts
        if verdict.label == label
    }
    quantities = [quantity for quantity in IMU_QUANTITIES if recording.of(quantity.name)]
    return Sheet(
        f'{label}: measured datasheet',
        tuple(sentences.of_simulation([recording.simulated])),
        _health(recording),
        recording.health.severity,
        tuple(_table(recording, quantity, verdicts) for quantity in quantities),
        tuple(
            datasheet_curve(recording.of(quantity.name), quantity.title)
            for quantity in quantities
            if any(map(drawable, recording.of(quantity.name)))
        ),
        tuple(_provenance(recording, settings, version)),
    )


def _health(recording: RecordingResult) -> str:
    findings = [f for f in recording.health.findings if f.severity != 'info']
    if not findings:
        return 'Health: nothing found that casts doubt on the numbers.'
    said = ' '.join(f'{found.text} {found.effect}' for found in findings)
    return f'Health: {recording.health.severity}. {said}'


def _table(
    recording: RecordingResult, quantity: Quantity, verdicts: Mapping[tuple[str, str], Verdict]
) -> Table:
    axes = recording.of(quantity.name)
    lines = list(_lines(recording, quantity, axes))
    of_role: dict[str, list[Estimate]] = {}
    for _, role, found, _ in lines:
        of_role.setdefault(role, []).extend(found)
    units = {role: unit_of(found, role) for role, found in of_role.items()}
    rows = [
        _row(axes, title, units[role], found, condition, verdicts)
        for title, role, found, condition in lines
    ]
    verdict = 'Verdict on the simulation' if recording.simulated else 'Verdict'
    columns = (
        Column('Parameter'), *(Column(axis.letter) for axis in axes), Column('Unit'),
        Column('Condition'), Column('Maker'), Column(verdict),
    )  # fmt: skip
    sources = dict.fromkeys(
        verdict.source for (axis, _), verdict in verdicts.items() if axis.startswith(quantity.name)
    )
    level = percent(axes[0].white_density.confidence)
    note = f'±: {level} interval; “<” is an upper bound: the recording cannot show the term.'
    if sources:
        note += f' Maker: {"; ".join(sources)}; as specified within a factor of 1.2.'
    return Table(quantity.title, columns, tuple(rows), note)


_Line = tuple[str, str, list[Estimate], str]
"""Title, role (numbers of one have one unit), a number of each axis, under which condition."""


def _lines(
    recording: RecordingResult, quantity: Quantity, axes: Sequence[AxisResult]
) -> Iterator[_Line]:
    rate = rate_text(recording.rate_of(quantity.name))
    yield 'Noise density', 'density', [a.white_density for a in axes], f'one-sided, {rate}'
    for term, condition in (('N', 'τ = 1 s'), ('B', 'floor is 0.664 B'), ('K', 'τ = 3 s')):
        name = f'{TERM_NAMES[term].capitalize()} {term}'
        yield name, term, [a.coefficient(term) for a in axes], condition
    if all(a.shows_constants and drawable(a) for a in axes):
        floors = [_floor(a) for a in axes]
        times = [duration(tau) for tau, _ in floors]
        at = ' / '.join(times if len(set(times)) > 1 else times[:1])
        yield 'In-run bias stability', 'B', [e for _, e in floors], f'lowest point, τ = {at}'
    if any(a.model.bandwidth for a in axes):
        none = Estimate.not_observable('Hz', 'the curve shows no filter')
        seen = [a.model.bandwidth or none for a in axes]
        yield 'Bandwidth', 'rate', seen, '−3 dB, from the bend of the Allan deviation'
    bias = 'Bias' if quantity is ANGULAR_VELOCITY else 'Mean, with gravity'
    condition = 'this run' if quantity is ANGULAR_VELOCITY else 'tilt not taken off'
    yield bias, 'level', [a.statistics['mean'] for a in axes], condition
    if any(a.per_kelvin for a in axes):
        still = Estimate.not_observable(f'{quantity.unit}/K', 'the temperature hardly changed')
        warm = [a.temperature for a in axes if a.temperature is not None]
        span = f'{min(w.low for w in warm):.1f} to {max(w.high for w in warm):.1f} °C'
        slopes = [a.per_kelvin or still for a in axes]
        yield 'Temperature coefficient', 'per kelvin', slopes, f'of the bias, {span}'
    if all('mean' in a.between for a in axes):
        runs = axes[0].between['mean'].records
        scatter = [a.between['mean'].std for a in axes]
        yield 'Bias repeatability', 'level', scatter, f'σ of {runs} runs'
    for end in ('minimum', 'maximum'):
        seen = [a.statistics[end] for a in axes if end in a.statistics]
        if len(seen) == len(axes):
            yield f'{end.capitalize()} seen', 'level', seen, 'whole recording'


def _floor(axis: AxisResult) -> tuple[float, Estimate]:
    """Return the lowest point of the Allan deviation, which makers call in-run stability."""
    curve = axis.allan
    if curve is None:
        return 0.0, Estimate.not_observable(axis.unit, 'no curve')
    at = int(curve.deviation.argmin())
    value, low, high = (float(part[at]) for part in (curve.deviation, curve.low, curve.high))
    return float(curve.tau[at]), Estimate(
        value, low, high, curve.unit, curve.confidence, method='lowest point of the curve'
    )


def _row(
    axes: Sequence[AxisResult],
    title: str,
    unit: str,
    found: Sequence[Estimate],
    condition: str,
    verdicts: Mapping[tuple[str, str], Verdict],
) -> tuple[Cell, ...]:
    judged = [verdicts.get((axis.name, title.lower().removesuffix(' b'))) for axis in axes]
    given = [v for v in judged if v is not None]
    typical = dict.fromkeys(
        number(Estimate(v.typical, None, None, v.measured.unit).to(unit).value or 0.0, 3)
        for v in given
    )
    said = dict.fromkeys(v.verdict for v in given)
    kind = f'verdict-{next(iter(said)).replace(" ", "-")}' if len(said) == 1 else ''
    return (
        title,
        *(Shown(value_text(estimate.to(unit)), estimate.reason) for estimate in found),
        Shown(unit, kind='unit'),
        condition,
        Shown(' / '.join(typical) or '–'),
        Shown(' / '.join(v.verdict for v in given) if len(said) > 1 else next(iter(said), '–'),
              kind=kind),
    )  # fmt: skip


def _provenance(
    recording: RecordingResult, settings: Mapping[str, Any], version: str
) -> Iterator[tuple[str, str]]:
    health = recording.health
    yield 'Data', f'simulated: {recording.simulated}' if recording.simulated else 'measured'
    yield 'Sensor', ', '.join(filter(None, (recording.topic, recording.frame_id)))
    if recording.serial:
        yield 'Serial number', recording.serial
    if day := date(recording.start_ns):
        yield 'Recorded', day
    yield 'Duration', f'{duration(health.duration_s)}, {health.samples} samples'
    yield 'Rate, jitter', f'{rate_text(health.rate)}, {sentences.in_time_unit(health.jitter)}'
    if health.temperature:
        begin, end = health.temperature
        yield 'Temperature', f'{begin:.1f} °C at the start, {end:.1f} °C at the end'
    yield 'Input', recording.source
    for run in recording.runs[:_MOST_FILES] or (recording,):
        yield from _sums(Path(run.source))
    if len(recording.runs) > _MOST_FILES:
        yield 'Other runs', f'{len(recording.runs) - _MOST_FILES}, without their sums'
    if command := settings.get('command'):
        yield 'Command', str(command)
    yield 'Software', f'imu-bench {version}'


def _sums(source: Path) -> Iterator[tuple[str, str]]:
    """Yield the SHA-256 of a file, or of the files of a bag."""
    if source.is_dir():
        found = sorted(path for path in source.iterdir() if path.is_file())
    else:
        found = [source] if source.is_file() else []
    for path in found[:_MOST_FILES]:
        yield f'SHA-256 of {path.name}', sha256(path)
    if len(found) > _MOST_FILES:
        yield 'Other files', f'{len(found) - _MOST_FILES}, without their sums'


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal."""
    found = hashlib.sha256()
    with path.open('rb') as file:
        while block := file.read(_BLOCK):
            found.update(block)
    return found.hexdigest()
