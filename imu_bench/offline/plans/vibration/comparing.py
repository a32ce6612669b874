# SPDX-License-Identifier: Apache-2.0
"""Every sensor against the reference: offset of the clocks, coherence, amplitude."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from imu_bench.errors import DataError, RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.spectra.response import compare, Response
from imu_bench.metrology.spectra.tones import Tone
from imu_bench.metrology.trials.crosstalk import ratio_db
from imu_bench.offline.plans.vibration.measuring import AxisVibration, SensorVibration

TONES = 3
"""Tones of the reference at which amplitudes are compared."""


@dataclass(frozen=True, eq=False)
class Against:
    """One axis against the same axis of the reference."""

    label: str
    letter: str
    response: Response | None  # None with the reason in `why`
    why: str
    gains: tuple[tuple[Tone, Estimate], ...]  # at the strongest tones of the reference
    ratio: Estimate  # RMS after the filters over that of the reference


def against(
    sensors: Mapping[str, SensorVibration],
    reference: str,
    settings: Mapping[str, Any],
    confidence: float,
) -> list[Against]:
    """Return every axis of every sensor that the reference has as well."""
    if reference not in sensors:
        raise RecordingError(
            f'--reference {reference}: not among the sensors: {", ".join(sensors)}'
        )
    base = sensors[reference]
    axes = {axis.letter: axis for axis in base.axes}
    return [
        _one((label, axis), axes[axis.letter], longest, settings, confidence)
        for label, sensor in sensors.items()
        if label != reference
        for longest in (_longest(sensor, base, settings),)
        for axis in sensor.axes
        if axis.letter in axes
    ]


def _longest(
    sensor: SensorVibration, base: SensorVibration, settings: Mapping[str, Any]
) -> float | None:
    """Return how far apart clocks may be: in one recording little, across recordings anything."""
    if sensor.source != base.source:
        return None
    longest: float = settings['max_offset'][0]
    return longest


def _one(
    named: tuple[str, AxisVibration],
    base: AxisVibration,
    longest_s: float | None,
    settings: Mapping[str, Any],
    confidence: float,
) -> Against:
    label, axis = named
    ratio = _ratio(axis, base, longest_s is not None, confidence)
    strongest = base.tones[:TONES]
    own, other = axis.trace, base.trace
    if own is None or other is None:
        raise RecordingError(f'{label}: no trace was kept of it')
    if longest_s is None:  # clocks that know nothing of each other: where each began does not say
        own, other = replace(own, start_s=0.0), replace(other, start_s=0.0)
    try:
        response = compare(
            own, other,
            resolution_hz=settings['resolution'][0], low_hz=settings['high_pass'][0],
            longest_offset_s=longest_s, confidence=confidence,
        )  # fmt: skip
    except DataError as error:
        missing = Estimate.not_observable('1', str(error), confidence=confidence)
        unseen = tuple((tone, missing) for tone in strongest)
        return Against(label, axis.letter, None, str(error), unseen, ratio)
    gains = tuple(
        (tone, response.at(tone.frequency.value or 0.0, confidence)) for tone in strongest
    )
    return Against(label, axis.letter, response, '', gains, ratio)


def _ratio(axis: AxisVibration, base: AxisVibration, paired: bool, confidence: float) -> Estimate:
    """Return the ratio of two RMS values, of the same motion if they are of one recording."""
    level = ratio_db(axis.blocks, base.blocks, paired=paired, confidence=confidence)
    if level.value is None or level.low is None or level.high is None:
        return Estimate.not_observable('1', level.reason, confidence=confidence)
    value, low, high = (10.0 ** (db / 20.0) for db in (level.value, level.low, level.high))
    return Estimate(value, low, high, '1', confidence, method=level.method)


def origins(
    sensor: SensorVibration, reference: Sequence[Tone], tolerance_hz: float
) -> Iterator[tuple[Tone, Tone, float]]:
    """Yield tones that a sensor folded, with the tone of the reference and its frequency."""
    for axis in sensor.axes:
        for tone in axis.tones:
            seen = tone.frequency.value or 0.0
            if any(abs(seen - (t.frequency.value or 0.0)) <= tolerance_hz for t in reference):
                continue
            for other in reference:
                true = other.frequency.value or 0.0
                folded = abs(true - sensor.rate_hz * round(true / sensor.rate_hz))
                if true > 0.5 * sensor.rate_hz and abs(folded - seen) <= tolerance_hz:
                    yield tone, other, true
                    break
