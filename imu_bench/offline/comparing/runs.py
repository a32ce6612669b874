# SPDX-License-Identifier: Apache-2.0
"""Runs against one another: what changed between two results beyond its uncertainty."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
import math
import os
from pathlib import Path, PurePath
from typing import Any

from imu_bench.errors import RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.analysis.axis_result import AxisResult
from imu_bench.offline.analysis.results import Analysis, read, RecordingResult
from imu_bench.offline.analysis.typed import plain
from imu_bench.offline.comparing.sensors import labels
from imu_bench.version import __version__

SCHEMA = 'imu_bench.comparison/1'

PARAMETERS = ('mean', 'std', 'noise_density', 'B', 'K')
"""What is compared of every axis, by the names of the JSON document; and 'rate' of a sensor."""

_LONGEST_WAY = 700.0
"""Logarithm of a ratio, at most: a little more is no float."""

_SLOW = ('B', 'K')

_SAY_NOTHING = ('result', 'results', 'analysis')
"""Names of files that `docs` and `campaign` use for every run."""


@dataclass(frozen=True)
class Run:
    """A result with a short name, unique among those compared."""

    name: str
    path: str
    analysis: Analysis


@dataclass(frozen=True)
class Change:
    """One number of one run against that of the reference run."""

    # sensor, run: name of the sensor and of the run that is held against the reference
    sensor: str
    run: str
    # axis, parameter: axis name, or empty for the sensor as a whole, and one of `PARAMETERS` or
    # 'rate'
    axis: str
    parameter: str
    # reference, value: in the reference run and in this one
    reference: Estimate
    value: Estimate
    # value over reference; not observable where one of them is not, or crosses zero
    ratio: Estimate
    difference: Estimate  # value minus reference, with the combined uncertainty
    # difference over its combined uncertainty at the confidence of the estimates
    e_n: float | None
    verdict: str  # 'same', 'higher', 'lower' or 'undecided'


@dataclass(frozen=True)
class RunComparison:
    """Several runs against the first."""

    runs: tuple[Run, ...]  # the reference first
    lines: tuple[Change, ...]  # by sensor, run, axis and parameter
    unmatched: tuple[tuple[str, str], ...]  # run and sensor of what has no counterpart
    # the recordings of each sensor by run, for figures
    sensors: Mapping[str, Mapping[str, RecordingResult]]

    @property
    def doubted(self) -> dict[tuple[str, str], RecordingResult]:
        """The recordings with findings that affect their numbers, by sensor and run."""
        return {
            (sensor, run): recording
            for sensor, runs in self.sensors.items()
            for run, recording in runs.items()
            if recording.health.severity != 'info'
        }

    def to_json(self) -> dict[str, Any]:
        """Return the JSON document."""
        return {
            'schema': SCHEMA,
            'package': {'name': 'imu_bench', 'version': __version__},
            'reference': self.runs[0].name,
            'runs': [{'name': run.name, 'path': run.path} for run in self.runs],
            'health': [
                {
                    'sensor': sensor,
                    'run': run,
                    'severity': recording.health.severity,
                    'findings': plain(recording.health.findings),
                }
                for sensor, runs in self.sensors.items()
                for run, recording in runs.items()
            ],
            'lines': plain(self.lines),
            'unmatched': [{'run': run, 'sensor': sensor} for run, sensor in self.unmatched],
        }


def named(paths: Sequence[str], analyses: Sequence[Analysis]) -> tuple[Run, ...]:
    """Return runs named after their files, or folders where a file is called as all are."""
    return tuple(map(Run, distinct(paths), paths, analyses))


def distinct(paths: Sequence[str]) -> list[str]:
    """Return the names of files: more of the path, and then numbers, where they are the same."""
    stems = [_stem(Path(path)) for path in paths]
    used = Counter(stems)
    names = [
        stem if used[stem] == 1 else str(PurePath(path).with_suffix(''))
        for path, stem in zip(paths, stems, strict=True)
    ]
    again = Counter(names)
    return [
        name if again[name] == 1 else f'{name} ({index})' for index, name in enumerate(names, 1)
    ]


def _stem(path: Path) -> str:
    """Return the name of a file, that of its folder if it says nothing."""
    return path.absolute().parent.name or path.stem if path.stem in _SAY_NOTHING else path.stem


def compare(paths: Sequence[str | os.PathLike[str]]) -> RunComparison:
    """
    Return results in JSON files against the first of them.

    Raises
    ------
    RecordingError
        If there are fewer than two, one is not a result, or no sensor of one is in another.
    """
    return compare_runs(named([str(path) for path in paths], [read(path) for path in paths]))


def compare_runs(runs: Sequence[Run]) -> RunComparison:
    """
    Return every run against the first one, sensor by sensor.

    Sensors are matched by topic, then by name; two runs of one sensor each are matched in any
    case, so that one part can be held against another.
    """
    if len(runs) < 2:
        raise RecordingError('one result alone cannot be compared: name two or more')
    reference = runs[0]
    lines: list[Change] = []
    unmatched: list[tuple[str, str]] = []
    sensors: dict[str, dict[str, RecordingResult]] = {}
    for run in runs[1:]:
        pairs, alone = _matched(reference, run)
        unmatched += alone
        for sensor, first, second in pairs:
            lines += _lines(sensor, run.name, first, second)
            sensors.setdefault(sensor, {reference.name: first})[run.name] = second
    if not lines:
        raise RecordingError(
            f'no sensor of {reference.path} is in the other results; its sensors are '
            f'{", ".join(labels(reference.analysis.recordings)) or "none"}'
        )
    return RunComparison(tuple(runs), tuple(lines), tuple(dict.fromkeys(unmatched)), sensors)


def _matched(
    reference: Run, run: Run
) -> tuple[list[tuple[str, RecordingResult, RecordingResult]], list[tuple[str, str]]]:
    """Return the sensors of both with their common name, and those that are in one only."""
    first, second = reference.analysis.recordings, run.analysis.recordings
    names, others = labels(first), labels(second)
    if len(first) == len(second) == 1:
        name = names[0] if names == others else f'{names[0]} / {others[0]}'
        return [(name, first[0], second[0])], []
    pairs, taken = [], set()
    for name, recording in zip(names, first, strict=True):
        at = next(
            (
                index
                for index, (other, candidate) in enumerate(zip(others, second, strict=True))
                if index not in taken
                and (_topic(candidate) == _topic(recording) != '' or other == name)
            ),
            None,
        )
        if at is not None:
            taken.add(at)
            pairs.append((name, recording, second[at]))
    matched = {name for name, _, _ in pairs}
    alone = [(reference.name, name) for name in names if name not in matched]
    alone += [(run.name, other) for index, other in enumerate(others) if index not in taken]
    return pairs, alone


def _topic(recording: RecordingResult) -> str:
    """Return the topic if it is one of ROS: those of files are the names of the files."""
    return recording.topic if recording.topic.startswith('/') else ''


def _lines(
    sensor: str, run: str, reference: RecordingResult, other: RecordingResult
) -> Iterator[Change]:
    yield _line(sensor, run, '', 'rate', reference.health.rate, other.health.rate)
    for name, axis in reference.axes.items():
        counterpart = other.axes.get(name)
        if counterpart is None:
            continue
        for parameter in PARAMETERS:
            first, second = _of(axis, parameter), _of(counterpart, parameter)
            if first is not None and second is not None:
                line = _line(sensor, run, name, parameter, first, second)
                # a process in one model only holds what B and K hold in the other
                if parameter in _SLOW and _models_differ(axis, counterpart):
                    line = replace(line, verdict='undecided')
                yield line


def _models_differ(first: AxisResult, second: AxisResult) -> bool:
    return (first.model.gauss_markov is None) != (second.model.gauss_markov is None)


def _of(axis: AxisResult, parameter: str) -> Estimate | None:
    if parameter == 'noise_density':
        return axis.white_density
    return axis.statistics.get(parameter) or axis.model.coefficients.get(parameter)


def _line(
    sensor: str, run: str, axis: str, parameter: str, first: Estimate, second: Estimate
) -> Change:
    difference = _difference(first, second)
    half = _half(difference)
    e_n = None
    if difference.value is not None and half:
        e_n = difference.value / half
    # a mean crosses zero: only its difference has a meaning
    ratio = _ratio(first, second) if parameter != 'mean' else _none('1', 'a bias has no ratio')
    verdict = _verdict(first, second, e_n)
    return Change(sensor, run, axis, parameter, first, second, ratio, difference, e_n, verdict)


def _difference(first: Estimate, second: Estimate) -> Estimate:
    """Return second minus first; the sides of independent uncertainties add as squares."""
    if first.value is None or second.value is None:
        return _none(first.unit, first.reason or second.reason)
    value = second.value - first.value
    if None in (first.low, first.high, second.low, second.high):
        return Estimate(value, None, None, first.unit, first.confidence)
    low = math.hypot(second.value - (second.low or 0.0), (first.high or 0.0) - first.value)
    high = math.hypot((second.high or 0.0) - second.value, first.value - (first.low or 0.0))
    return Estimate(value, value - low, value + high, first.unit, first.confidence)


def _half(difference: Estimate) -> float | None:
    """Return the uncertainty on the side of zero."""
    if difference.value is None or difference.low is None or difference.high is None:
        return None
    if difference.value > 0.0:
        return difference.value - difference.low
    return difference.high - difference.value


def _ratio(first: Estimate, second: Estimate) -> Estimate:
    if not first.value or not second.value:
        return _none('1', first.reason or second.reason or 'a value is zero')
    value = second.value / first.value
    if not (first.low and first.high and second.low and second.high):
        return Estimate(value, None, None, '1', first.confidence)
    signs = (first.value * first.low, first.value * first.high,
             second.value * second.low, second.value * second.high)  # fmt: skip
    if min(signs) <= 0.0:
        return Estimate(value, None, None, '1', first.confidence)
    down = math.hypot(math.log(second.value / second.low), math.log(first.high / first.value))
    up = math.hypot(math.log(second.high / second.value), math.log(first.value / first.low))
    down, up = min(down, _LONGEST_WAY), min(up, _LONGEST_WAY)
    return Estimate(value, value * math.exp(-down), value * math.exp(up), '1', first.confidence)


def _none(unit: str, reason: str) -> Estimate:
    return Estimate.not_observable(unit, reason or 'no number to compare')


def _verdict(first: Estimate, second: Estimate, e_n: float | None) -> str:
    """Return the verdict."""
    # Two values are the same where |E_n| ≤ 1 (ISO/IEC 17043:2010 annex B: difference over
    # the root of the sum of the squared uncertainties).  A value and an upper bound differ where
    # the value is surely above the bound.
    if e_n is not None:
        return 'same' if abs(e_n) <= 1.0 else 'higher' if e_n > 0.0 else 'lower'
    if first.low and second.value is None and second.high is not None and second.high < first.low:
        return 'lower'
    if second.low and first.value is None and first.high is not None and first.high < second.low:
        return 'higher'
    if first.value is not None and first.value == second.value:
        return 'same'
    return 'undecided'
