# SPDX-License-Identifier: Apache-2.0
"""Units that were mistaken, told by the noise that the datasheet of a sensor gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import math

from imu_bench.offline.analysis.results import RecordingResult
from imu_bench.offline.comparing.sensors import Comparison
from imu_bench.offline.health.check import ranked
from imu_bench.offline.health.finding import Finding
from imu_bench.offline.notation import number
from msg_conversions.quantities import ANGULAR_VELOCITY

_DEGREES = math.degrees(1.0)

_SCATTER = 4.0
"""Factor between the noise of a part at rest and its typical value: the MPU-6050 of the data set
mpu6050_static has 10.6 to 15.8 m°/s/√Hz, its data sheet (PS-MPU-6000A rev. 3.4, 6.1) 5."""

_MISTAKES = (
    (_DEGREES, '°/s given as rad/s', '--units angular_velocity=deg/s'),
    (1.0 / _DEGREES, 'rad/s given as °/s', '--units angular_velocity=rad/s'),
)


def doubted(recordings: Sequence[RecordingResult], compared: Comparison) -> list[RecordingResult]:
    """
    Return recordings with a severe finding where the gyroscope was in another unit than it says.

    At rest nothing but its noise tells: that of every axis is then 57.3 times what the datasheet
    gives, or a 57.3th of it.  A sensor that moved, or has no datasheet, is not judged.
    """
    return [
        _judged(recording, label, compared)
        for recording, label in zip(recordings, compared.labels, strict=True)
    ]


def _judged(recording: RecordingResult, label: str, compared: Comparison) -> RecordingResult:
    found = [
        verdict
        for verdict in compared.verdicts
        if verdict.label == label
        and verdict.parameter == 'noise density'
        and verdict.axis.startswith(ANGULAR_VELOCITY.name)
    ]
    ratios = [verdict.measured.value / verdict.typical for verdict in found
              if verdict.measured.value]  # fmt: skip
    if not ratios or len(ratios) < len(found) or recording.health.moved:
        return recording
    for factor, mistake, remedy in _MISTAKES:
        if all(factor / _SCATTER <= ratio <= factor * _SCATTER for ratio in ratios):
            middle = sorted(ratios)[len(ratios) // 2]
            finding = Finding(
                'severe',
                'angle_unit',
                f'The noise of the gyroscope is {number(middle, 2)} times that of its datasheet '
                f'({found[0].source}), on every axis: it looks like {mistake}.',
                'Every angular velocity is then off by a factor of 57.3.',
                f'Check the unit in the driver, or give it: {remedy}.',
            )
            health = replace(
                recording.health, findings=ranked([finding, *recording.health.findings])
            )
            return replace(recording, health=health)
    return recording
