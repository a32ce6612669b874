# SPDX-License-Identifier: Apache-2.0
"""
Noise numbers in the form, unit and convention of the programs that want them.

Every number is written with its unit, whether it is continuous or discrete, and one- or
two-sided, where that makes a difference; every file says from which recording it came.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
import csv
import io

from imu_bench.bags.topic_info import meant
from imu_bench.errors import RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.analysis.axis_result import AxisResult
from imu_bench.offline.analysis.results import Analysis, RecordingResult
from imu_bench.offline.comparing.sensors import labels
from imu_bench.offline.exports import ros, vio
from imu_bench.offline.exports.numbers import Numbers
from imu_bench.offline.whole_files import file_names

_WRITERS: dict[str, Callable[[Numbers], str]] = {
    'kalibr': vio.kalibr,
    'openvins': vio.openvins,
    'orb-slam3': vio.orb_slam3,
    'vins': vio.vins,
    'gtsam': vio.gtsam,
    'robot_localization': ros.robot_localization,
    'sensor_msgs': ros.sensor_msgs,
    'gz-sim': ros.gz_sim,
    'kalman': ros.kalman,
}

FORMATS = (*_WRITERS, 'csv')
"""Names of the exports."""

_SUFFIXES = {'gtsam': 'py', 'gz-sim': 'sdf', 'kalman': 'py', 'csv': 'csv'}
"""Of the files; YAML for the others."""


def render(analysis: Analysis, to: str, topic: str = '', *, conservative: bool = False) -> str:
    """
    Return an export as text.

    Parameters
    ----------
    analysis : Analysis
        A result, in memory or read from its JSON document.
    to : str
        One of `FORMATS`.
    topic : str
        Topic or label of the sensor; not needed where there is one only.  The table 'csv' holds
        all of them if none is named.
    conservative : bool
        Upper ends of intervals instead of values; 'csv' holds both in any case.

    Raises
    ------
    RecordingError
        If the format or the sensor is not known, or the result lacks what the format needs.
    """
    chosen = choose(analysis, [topic] if topic else [])
    if to == 'csv':
        return table(list(chosen.values()))
    if to not in _WRITERS:
        raise RecordingError(f'unknown export {to!r}; known are {", ".join(FORMATS)}')
    if len(chosen) > 1:
        problem = f'{topic!r} names several sensors' if topic else 'the result has several sensors'
        raise RecordingError(
            f'{problem}: choose one with --topic, or write them all with -o FOLDER: '
            f'{_known(chosen)}'
        )
    return _WRITERS[to](Numbers(next(iter(chosen.values())), conservative))


def files(
    recordings: Mapping[str, RecordingResult],
    to: str,
    *,
    conservative: bool = False,
    lacking: list[str] | None = None,
) -> dict[str, str]:
    """
    Return an export of every sensor by the name of its file.

    A sensor without what the format needs, such as one without a gyroscope, is left out where
    there are others, and why is added to `lacking`; without that list it is an error.
    """
    if to == 'csv':
        return {f'numbers.{_SUFFIXES[to]}': table(list(recordings.values()))}
    suffix = _SUFFIXES.get(to, 'yaml')
    made = {
        f'{name}.{suffix}': _written(Numbers(recording, conservative), to)
        for name, recording in zip(file_names(recordings), recordings.values(), strict=True)
    }
    texts = {name: text for name, text in made.items() if isinstance(text, str)}
    problems = [error for error in made.values() if isinstance(error, RecordingError)]
    if problems and (lacking is None or not texts):
        raise problems[0]
    if lacking is not None:
        lacking.extend(map(str, problems))
    return texts


def _written(numbers: Numbers, to: str) -> str | RecordingError:
    """Return an export, or why there is none."""
    try:
        return _WRITERS[to](numbers)
    except RecordingError as error:
        return error


def choose(analysis: Analysis, topics: Sequence[str] = ()) -> dict[str, RecordingResult]:
    """
    Return the recordings of topics or labels by label, all of them if none is named.

    Raises
    ------
    RecordingError
        If one names no sensor.
    """
    rows = dict(zip(labels(analysis.recordings), analysis.recordings, strict=True))
    wanted: set[str] = set()
    for topic in topics:
        found = {name for name, recording in rows.items() if topic in (name, recording.topic)}
        if not found:
            ends = meant(topic, (recording.topic for recording in rows.values()))
            found = {name for name, recording in rows.items() if [recording.topic] == ends}
        if not found:
            raise RecordingError(
                f'no sensor {topic!r} in this result; there are: {_known(rows) or "none"}'
            )
        wanted |= found
    return {
        name: recording
        for name, recording in rows.items()
        if (name in wanted if topics else recording in analysis.sensors)
    }


def _known(rows: Mapping[str, RecordingResult]) -> str:
    return ', '.join(
        name if name == recording.topic else f'{name} (topic {recording.topic})'
        for name, recording in rows.items()
    )


COLUMNS = (
    'source', 'topic', 'axis', 'parameter', 'value', 'low', 'high', 'unit', 'convention',
    'confidence', 'observable', 'method', 'reason', 'severe', 'simulated',
)  # fmt: skip
"""Columns of the table; empty cells are numbers that do not exist, or no severe findings."""

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
    for row in rows(recordings):
        writer.writerow(map(_cell, row))
    return out.getvalue()


def rows(recordings: Sequence[RecordingResult]) -> Iterator[tuple[str | float | bool | None, ...]]:
    """Yield the rows of the table, one number each, as `COLUMNS` says."""
    for recording in recordings:
        for axis, parameter, estimate, convention in _rows(recording):
            yield (
                recording.source, recording.topic, axis, parameter,
                estimate.value, estimate.low, estimate.high,
                estimate.unit, convention, estimate.confidence,
                estimate.observable, estimate.method, estimate.reason,
                ' '.join(sorted({found.code for found in recording.health.severe})),
                bool(recording.simulated),
            )  # fmt: skip


def _cell(value: str | float | bool | None) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return value if isinstance(value, str) else _digits(value)


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
        if axis.temperature is not None:
            yield name, 'temperature_coefficient', axis.temperature.coefficient, 'of the bias'
        yield from _checks(name, axis)


def _checks(name: str, axis: AxisResult) -> Iterator[tuple[str, str, Estimate, str]]:
    checks = axis.checks
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
