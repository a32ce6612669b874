# SPDX-License-Identifier: Apache-2.0
"""When, how long and how well the recordings of a test plan were taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from imu_bench.errors import DataError, RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.analysis.results import RecordingResult
from imu_bench.offline.analysis.typed import fields_of
from imu_bench.offline.health import check, Finding, Health, worst
from imu_bench.offline.notation import count, date, duration, grouped, rate_text
from imu_bench.offline.presentation.tables import Cell, Column, Shown, Table
from imu_bench.offline.recordings import Recording

_OF_THE_TEST = ('motion', 'temperature', 'outliers', 'gravity', 'short')
"""Findings that spoil noise, and that a test which moves, shakes or heats a sensor brings."""


@dataclass(frozen=True)
class Recorded:
    """One stream that a plan has measured."""

    source: str
    topic: str
    start_ns: int  # stamp of its first sample
    duration_s: float
    rate: Estimate  # true sample rate in Hz
    missing: int  # samples that the time grid lacks
    findings: tuple[Finding, ...]  # about the recording, without those that the test brings

    @property
    def severity(self) -> str:
        """The worst severity among the findings."""
        return worst(self.findings)

    def to_json(self) -> dict[str, Any]:
        """Return the object in JSON of schema imu_bench.plan/1."""
        return {'severity': self.severity, **fields_of(self)}


def examined(recording: Recording, problems: Sequence[str]) -> Recorded:
    """Return when and how well a recording was taken; raises RecordingError if it has no time."""
    try:
        health = check(recording, problems=problems)
    except DataError as error:
        raise RecordingError(f'{recording.source}, {recording.topic}: {error}') from error
    findings = tuple(found for found in health.findings if found.code not in _OF_THE_TEST)
    start_ns = int(recording.samples.stamps[0])
    return _recorded(recording.source, recording.topic, start_ns, health, findings)


def analysed(result: RecordingResult) -> Recorded:
    """Return when and how well a recording was taken that was analysed for its noise."""
    health = result.health
    return _recorded(result.source, result.topic, result.start_ns, health, health.findings)


def _recorded(
    source: str, topic: str, start_ns: int, health: Health, findings: tuple[Finding, ...]
) -> Recorded:
    return Recorded(
        source, topic, start_ns, health.duration_s, health.rate, health.missing, findings
    )


def sentence(found: Sequence[Recorded]) -> str:
    """Return when, how long and how well in one sentence; empty for nothing."""
    if not found:
        return ''
    sources = len({each.source for each in found})
    first, last = (date(pick(each.start_ns for each in found)) for pick in (min, max))
    when = f', from {first}' if first else ''
    when += f' to {last}' if last != first else ''
    lengths = list(
        dict.fromkeys(duration(pick(each.duration_s for each in found)) for pick in (min, max))
    )
    long = ' to '.join(lengths) + (' each' if sources > 1 else '')
    doubted = {
        severity: sum(each.severity == severity for each in found)
        for severity in ('severe', 'warning')
    }
    said = [f'{number} with a {name} finding' for name, number in doubted.items() if number]
    return (
        f'{count(len(found), "stream")} of {count(sources, "recording")}{when}, {long}; '
        f'health: {", ".join(said) or "good"}.'
    )


def doubts(found: Sequence[Recorded]) -> list[Finding]:
    """Return what casts doubt on recordings, each kind of it once."""
    kinds: dict[tuple[str, str], list[Finding]] = {}
    for each in found:
        for finding in each.findings:
            if finding.severity != 'info':
                said = replace(finding, text=f'{each.topic}: {finding.text}')
                kinds.setdefault((finding.severity, finding.code), []).append(said)
    return [
        replace(first, text=f'{first.text} The same of {count(len(more), "more stream")}.')
        if more
        else first
        for first, *more in kinds.values()
    ]


def table(found: Sequence[Recorded]) -> Table:
    """Return a row for every stream."""
    columns = (
        Column('recording'), Column('topic'), Column('begin'), Column('duration'),
        Column('rate'), Column('missing'), Column('health'),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = [
        (each.source, each.topic, date(each.start_ns) or '–', duration(each.duration_s),
         rate_text(each.rate), grouped(each.missing), _health(each))
        for each in found
    ]  # fmt: skip
    return Table('Recordings', columns, tuple(rows), heads=2)


def _health(each: Recorded) -> Shown:
    codes = [f.code.replace('_', ' ') for f in each.findings if f.severity != 'info']
    word = 'good' if each.severity == 'info' else each.severity
    return Shown(word, small=tuple(dict.fromkeys(codes)), kind=f'badge {each.severity}')
