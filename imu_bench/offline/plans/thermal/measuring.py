# SPDX-License-Identifier: Apache-2.0
"""What heating does to the axes of one sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from imu_bench.errors import DataError, RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.trials import thermal
from imu_bench.metrology.trials.warm_up import warm_up, WarmUp
from imu_bench.offline.analysis.axes import axes
from imu_bench.offline.plans.plan import Floats, place, seconds
from imu_bench.offline.recordings import Recording
from imu_bench.offline.recordings.companions import Companion, companion
import numpy as np


@dataclass(frozen=True, eq=False)
class Heated:
    """One sensor that was heated."""

    source: str
    topic: str
    thermometer: str  # topic of the temperature
    own: bool  # whether that is the sensor's own
    axes: dict[str, thermal.Thermal]  # by name: 'linear_acceleration.x'
    phases: thermal.Phases
    warm_up: WarmUp
    # lowest, highest: °C
    lowest: float
    highest: float

    def per_kelvin(self, axis: str) -> Estimate:
        """Return the drift from the start to the hottest time, per kelvin between them."""
        found = self.axes[axis]
        held = found.averages.temperature
        rise = float(held.max() - held[0])
        return found.change_hot.scaled(1.0 / rise, f'{found.change_hot.unit}/K')

    def to_json(self) -> dict[str, Any]:
        """Return every number in SI, ready for JSON."""
        return {
            'source': self.source,
            'topic': self.topic,
            'temperature_topic': self.thermometer,
            'lowest': self.lowest,
            'highest': self.highest,
            'heating_s': self.phases.heating,
            'self_heating': self.warm_up.rise.to_json(),
            'warm_up_time': self.warm_up.time_constant.to_json(),
            'axes': {
                name: {
                    'coefficient': found.coefficient.to_json(),
                    'reference': found.reference,
                    'bias_at_reference': found.at_reference.to_json(),
                    'curvature': found.curvature.to_json(),
                    'hysteresis': found.hysteresis.to_json(),
                    'branches': [
                        {'temperature': celsius, 'difference': apart.to_json()}
                        for celsius, apart in found.branches
                    ],
                    'change': found.change.to_json(),
                    'change_hot': found.change_hot.to_json(),
                    'warm_up': found.warm_up.to_json(),
                }
                for name, found in self.axes.items()
            },
        }


def thermometers(
    source: str, recordings: Sequence[Recording], instead: str
) -> dict[str, Companion]:
    """Return the temperature to use for every topic that has one."""
    found = {r.topic: t for r in recordings if (t := companion(r, 'temperature')) is not None}
    if instead in found:
        found = {r.topic: found.get(r.topic, found[instead]) for r in recordings}
    if not found:
        raise RecordingError(
            f'{source}: no temperature in it: record the topic temperature beside imu/data_raw, '
            'or add a column temperature'
        )
    return found


def measure(recording: Recording, temperature: Companion, own: bool, confidence: float) -> Heated:
    """Return what heating does to one sensor."""
    since = int(recording.samples.stamps[0])
    when = seconds(recording)
    known = np.asarray((temperature.stamps - since) * 1e-9, np.float64)
    celsius: Floats = np.interp(when, known, temperature.values[:, 0])
    found: dict[str, thermal.Thermal] = {}
    try:
        for axis in axes(recording.samples):
            there = np.isfinite(axis.values)
            found[axis.name] = thermal.analyse(
                when[there], axis.values[there], celsius[there], axis.unit, confidence
            )
        if not found:
            raise DataError('no axis holds numbers')
        held = next(iter(found.values())).averages
        phases = thermal.phases(held.time, held.temperature)
    except DataError as error:
        raise RecordingError(f'{place(recording)}: {error}') from error
    warm = warm_up(known, temperature.values[:, 0], phases.heating, confidence)
    return Heated(
        recording.source, recording.topic, temperature.topic, own, found, phases, warm,
        float(held.temperature.min()), float(held.temperature.max()),
    )  # fmt: skip
