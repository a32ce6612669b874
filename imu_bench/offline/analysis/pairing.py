# SPDX-License-Identifier: Apache-2.0
"""
Accelerometer and gyroscope that come as two streams: one sensor again.

Cameras and phones record them separately, each at a rate of its own.  They are measured
separately, because bringing them to one rate would change the noise, and put together after.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import PurePath
import re
from typing import TYPE_CHECKING

from imu_bench.errors import RecordingError
from imu_bench.metrology.workspace import parts
from imu_bench.offline.recordings import Recording
from imu_bench.samples import Samples
from msg_conversions.quantities import ANGULAR_VELOCITY, LINEAR_ACCELERATION, Quantity
import numpy as np
import numpy.typing as npt

# a recording is read while the estimators are imported elsewhere: not with this module
if TYPE_CHECKING:
    from imu_bench.offline.analysis.results import RecordingResult

_WORD = r'(?<![a-z])(?:{})(?![a-z])'
_ACCELEROMETER = re.compile(_WORD.format('acc(?:el(?:erometer|eration)?)?'), re.IGNORECASE)
_GYROSCOPE = re.compile(_WORD.format('gyr(?:o(?:scope)?)?'), re.IGNORECASE)


def halves(recordings: Sequence[Recording]) -> list[Recording]:
    """
    Return recordings without quantities that are zero because another stream has them.

    A message has room for both; a driver that sends them on two topics leaves one at zero.
    """
    found = []
    for recording in recordings:
        other = next((o for o in recordings if one_sensor(recording.topic, o.topic)), None)
        gyroscope = _GYROSCOPE.search(recording.topic) is not None
        missing = LINEAR_ACCELERATION if gyroscope else ANGULAR_VELOCITY
        if (
            other is not None
            and _zero(recording.samples, missing)
            and not _zero(other.samples, missing)
        ):
            note = f'{missing.name} is zero: it comes from {other.topic}'
            recording = replace(
                recording,
                samples=replace(recording.samples, acceleration=None)
                if gyroscope
                else replace(recording.samples, angular_velocity=None),
                notes=(*recording.notes, note),
            )
        found.append(recording)
    return found


def joined(
    results: Sequence[RecordingResult], pairs: Sequence[tuple[str, str]] = ()
) -> list[RecordingResult]:
    """
    Return results in which accelerometer and gyroscope of one sensor are one.

    Parameters
    ----------
    pairs : sequence of (str, str)
        Topics, or names of files, of an accelerometer and a gyroscope.  Streams of one
        recording, and files of one folder, whose names differ in that word only are paired
        without being named.

    Raises
    ------
    RecordingError
        If a name is not found or used twice, or a stream does not measure what it is named for.
    """
    if not results:
        return []  # why, has been told of each recording
    partner: dict[int, int] = {}
    for accelerometer, gyroscope in pairs:
        first = _named(results, accelerometer, LINEAR_ACCELERATION)
        second = _named(results, gyroscope, ANGULAR_VELOCITY)
        if first == second or {first, second} & {*partner, *partner.values()}:
            raise RecordingError(
                f'--pair: {accelerometer} and {gyroscope}: a stream can be half of one pair only'
            )
        partner[first] = second
    for index, result in enumerate(results):
        if index not in partner and _only(result, LINEAR_ACCELERATION):
            for other, candidate in enumerate(results):
                if _halves_of_one(result, candidate) and other not in partner.values():
                    partner[index] = other
    taken = set(partner.values())
    return [
        _together(result, results[partner[index]]) if index in partner else result
        for index, result in enumerate(results)
        if index not in taken
    ]


def _halves_of_one(result: RecordingResult, other: RecordingResult) -> bool:
    """Return whether the names say so: of topics of one file, or of files in one folder."""
    first, second = PurePath(result.source), PurePath(other.source)
    return (
        _only(other, ANGULAR_VELOCITY)
        and are_halves(result.topic, other.topic)
        and (
            first == second
            or (first.parent == second.parent and are_halves(first.name, second.name))
        )
    )


def _together(accelerometer: RecordingResult, gyroscope: RecordingResult) -> RecordingResult:
    from imu_bench.offline.health import Finding, ranked
    from imu_bench.offline.notation import rate_text

    first, second = accelerometer.health, gyroscope.health
    told = Finding(
        'info',
        'paired',
        f'{accelerometer.topic} ({rate_text(first.rate)}) and {gyroscope.topic} '
        f'({rate_text(second.rate)}) are one sensor here.',
        'None: each was measured at its own rate.',
        'Facts about samples and time are those of the gyroscope.',
    )
    findings = [
        replace(finding, text=f'{result.topic}: {finding.text}')
        for result in (accelerometer, gyroscope)
        for finding in result.health.findings
    ]
    health = replace(
        second,
        findings=ranked([*findings, told]),
        resolution={**first.resolution, **second.resolution},
    )
    axes = {
        axis.name: axis
        for result, quantity in (
            (accelerometer, LINEAR_ACCELERATION),
            (gyroscope, ANGULAR_VELOCITY),
        )
        for axis in result.of(quantity.name)
    }
    topic = f'{accelerometer.topic} + {gyroscope.topic}'
    rates = {LINEAR_ACCELERATION.name: first.rate, ANGULAR_VELOCITY.name: second.rate}
    return replace(gyroscope, topic=topic, health=health, axes=axes, rates=rates)


def _named(results: Sequence[RecordingResult], name: str, quantity: Quantity) -> int:
    found = [
        index
        for index, result in enumerate(results)
        if name in (result.topic, result.topic.lstrip('/'), PurePath(result.source).name)
    ]
    if len(found) != 1:
        known = ', '.join(result.topic for result in results)
        fault = 'several streams are' if found else 'no stream is'
        raise RecordingError(f'--pair: {fault} called {name!r}; there are {known}')
    if not results[found[0]].of(quantity.name):
        raise RecordingError(
            f'--pair: {name} does not measure {quantity.name}: name the accelerometer first, '
            'then the gyroscope'
        )
    return found[0]


def are_halves(first: str, second: str) -> bool:
    """
    Return whether names of an accelerometer and a gyroscope differ in that word only.

    Examples
    --------
    >>> are_halves('walk_acc', 'walk_gyro'), are_halves('walk_acc', 'run_gyro')
    (True, False)
    """
    halves_ = (_ACCELEROMETER, first), (_GYROSCOPE, second)
    if any(len(pattern.findall(name)) != 1 for pattern, name in halves_):
        return False
    rests = {pattern.sub('', name) for pattern, name in halves_}
    return len(rests) == 1


def one_sensor(name: str, other: str) -> bool:
    """Return whether two names are those of both halves of one sensor."""
    return are_halves(name, other) or are_halves(other, name)


def _only(result: RecordingResult, quantity: Quantity) -> bool:
    return bool(result.axes) and len(result.of(quantity.name)) == len(result.axes)


def _zero(samples: Samples, quantity: Quantity) -> bool:
    values: npt.NDArray[np.float64] | None = getattr(samples, quantity.field)
    if values is None:
        return False
    return not any(np.any(column[part]) for column in values.T for part in parts(column.size))
