# SPDX-License-Identifier: Apache-2.0
"""What the whole run says, in a few sentences: what a reader came for."""

from __future__ import annotations

from collections.abc import Sequence

from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.fitting.noise_model import TERM_NAMES
from imu_bench.offline.comparison import Comparison, Standing
from imu_bench.offline.notation import count, duration, number, readable_unit, text
from imu_bench.offline.report import against_datasheet
from imu_bench.offline.report.text import NO_CONSTANTS, SENSOR_NAMES
from imu_bench.offline.results import Analysis, RecordingResult
from imu_bench.samples import IMU_QUANTITIES


def sentences(analysis: Analysis, comparison: Comparison) -> list[str]:
    """Return what the whole run says, a sentence each."""
    recordings = analysis.recordings
    lines = [_recorded(analysis)]
    for quantity, rows in comparison.standings.items():
        # a sensor that moved is not loud: compare those that can be compared
        sound = [r for r in rows if recordings[r.index].health.severity != 'severe'] or list(rows)
        lines += _quietest(SENSOR_NAMES[quantity], sound)
        lines += _steadiest(quantity, sound, recordings)
    lines += _without_constants(recordings, comparison.labels)
    lines += against_datasheet.summary(comparison.verdicts)
    lines.append(_health_line(recordings, comparison.labels))
    return lines + _unseen(recordings, comparison.labels)


def _recorded(analysis: Analysis) -> str:
    """Return how much was recorded."""
    recordings = analysis.recordings
    samples = count(sum(r.health.samples for r in recordings), 'sample')
    seconds = [recording.health.duration_s for recording in recordings]
    first, last = duration(min(seconds)), duration(max(seconds))
    length = first if first == last else f'{first} to {last}'
    failed = len(analysis.failures)
    lost = f' {count(failed, "input")} could not be analysed, see below.' if failed else ''
    return f'{count(len(recordings), "sensor")}, {length}, {samples}.{lost}'


def _quietest(sensor: str, rows: Sequence[Standing]) -> list[str]:
    rows = [row for row in rows if row.noise_density.value is not None]
    if not rows:
        return [f'No {sensor} shows white noise.']
    best = rows[0]
    unit = readable_unit(best.noise_density.unit, 'density', [best.noise_density.value])
    value = text(best.noise_density, unit)
    if len(rows) == 1:
        return [f'{sensor.capitalize()} noise density of {best.label}: {value}.']
    alike = [row.label for row in rows[1:] if _overlap(row.noise_density, best.noise_density)]
    tied = f', not told apart from {", ".join(alike)}' if alike else ''
    if len(alike) == len(rows) - 1:
        return [f'Quietest {sensor}: {best.label} with {value}{tied}.']
    last = rows[-1]
    ratio = (last.noise_density.value or 0.0) / (best.noise_density.value or 1.0)
    louder = f'{last.label} has {number(ratio, 2)} times as much'
    return [f'Quietest {sensor}: {best.label} with {value}{tied}; {louder}.']


def _overlap(one: Estimate, other: Estimate) -> bool:
    lows = [e.low or 0.0 for e in (one, other)]
    highs = [e.high for e in (one, other) if e.high is not None]
    return len(highs) == 2 and max(lows) <= min(highs)


def _steadiest(
    quantity: str, rows: Sequence[Standing], recordings: Sequence[RecordingResult]
) -> list[str]:
    """Return which of several sensors has the smallest bias instability on its worst axis."""
    worst = {
        row.label: max((axis.model.B for axis in axes), key=_at_most)
        for row in rows
        if (axes := recordings[row.index].of(quantity))
        and all(axis.shows_constants for axis in axes)
    }
    known = {label: b for label, b in worst.items() if _at_most(b) > 0.0}
    if len(known) < 2:
        return []
    label, best = min(known.items(), key=lambda item: _at_most(item[1]))
    # a bound says nothing of what is below it
    alike = [
        name
        for name, other in known.items()
        if name != label and (other.value is None or _overlap(other, best))
    ]
    if len(alike) == len(known) - 1:
        return []
    tied = f', not told apart from {", ".join(alike)}' if alike else ''
    unit = readable_unit(best.unit, 'B', [_at_most(best)])
    size = text(best, unit).replace('< ', 'below ')
    sensor = SENSOR_NAMES[quantity]
    return [f'Least bias instability of the {sensor}s: {label}, {size} on its worst axis{tied}.']


def _at_most(estimate: Estimate) -> float:
    """Return the value, or the bound where there is none."""
    return estimate.value if estimate.value is not None else estimate.high or 0.0


def _without_constants(recordings: Sequence[RecordingResult], labels: Sequence[str]) -> list[str]:
    return [
        f'{label}: the {SENSOR_NAMES[quantity.name]} {NO_CONSTANTS}; '
        'it suits vibration, not tilt or navigation.'
        for recording, label in zip(recordings, labels, strict=True)
        for quantity in IMU_QUANTITIES
        if (axes := recording.of(quantity.name)) and not any(axis.shows_constants for axis in axes)
    ]


def _health_line(recordings: Sequence[RecordingResult], labels: Sequence[str]) -> str:
    if bad := _found('severe', recordings, labels):
        return f'Not to be trusted without reading its findings: {bad}.'
    if doubtful := _found('warning', recordings, labels):
        return f'Findings affect part of the numbers of {doubtful}.'
    return 'The recordings are in good health: nothing casts doubt on the numbers.'


def _found(severity: str, recordings: Sequence[RecordingResult], labels: Sequence[str]) -> str:
    """Return the sensors with findings of a severity, and what was found."""
    said = []
    for recording, label in zip(recordings, labels, strict=True):
        findings = [f for f in recording.health.findings if f.severity == severity]
        codes = dict.fromkeys(finding.code.replace('_', ' ') for finding in findings)
        if codes:
            said.append(f'{label} ({", ".join(codes)})')
    return '; '.join(said)


def _unseen(recordings: Sequence[RecordingResult], labels: Sequence[str]) -> list[str]:
    """Return one sentence on the coefficients that the recordings were too short for."""
    missing = {
        term: [
            label
            for recording, label in zip(recordings, labels, strict=True)
            if (slow := [axis for axis in recording.axes.values() if axis.shows_constants])
            and all(not getattr(axis.model, term).observable for axis in slow)
        ]
        for term in 'BK'
    }
    return [
        f'No {TERM_NAMES[term]} ({term}) was observable in '
        f'{"any recording" if len(names) == len(labels) else ", ".join(names)}; '
        'the tables give upper bounds and how long to record.'
        for term, names in missing.items()
        if names
    ]
