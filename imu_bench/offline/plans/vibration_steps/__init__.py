# SPDX-License-Identifier: Apache-2.0
"""
Vibration in steps of frequency: the RMS of every axis at each of them.

Table I and figure 2 of Capriglione et al. 2021, Performance analysis of MEMS-based inertial
measurement units in terrestrial vehicles: what a sensor shows of vibration far above its band.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import math
from typing import Any

from imu_bench.config.schema import Setting
from imu_bench.errors import RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.moments import Moments
from imu_bench.offline.analysis.axes import axes
from imu_bench.offline.notation import bare, text
from imu_bench.offline.plans.plan import named, place, Plan, seconds
from imu_bench.offline.plans.result import PlanResult
from imu_bench.offline.presentation.figure import Figure, Series
from imu_bench.offline.presentation.tables import Column, Table
from imu_bench.offline.recordings import Recording
from imu_bench.units import STANDARD_GRAVITY
from msg_conversions.quantities import IMU_QUANTITIES, LINEAR_ACCELERATION
import numpy as np

_GUARD = 0.1
"""Part of a step that is left out at each end: the shaker settles, and clocks differ."""

_FEWEST = 16
"""Samples in a step below which its RMS says little."""

_SHOWN = {'linear_acceleration': 'm/s²', 'angular_velocity': '°/s'}
_NOTE = (
    'RMS about the mean of each step, {guard:.0f} % of it left out at both ends. A frequency '
    'above half the rate of the sensor shows as another one, with the same RMS.'
)


@dataclass(frozen=True, eq=False)
class Shaken:
    """One sensor: frequencies in Hz, and for each of its axes the RMS at each of them."""

    source: str
    topic: str
    frequencies: tuple[float, ...]
    rms: dict[str, tuple[Estimate, ...]]

    def to_json(self) -> dict[str, Any]:
        """Return every number in SI, ready for JSON."""
        return {
            'source': self.source,
            'topic': self.topic,
            'frequency': list(self.frequencies),
            'rms': {axis: [each.to_json() for each in found] for axis, found in self.rms.items()},
        }


class VibrationSteps(Plan[tuple[Shaken, ...]]):
    """RMS against the frequency of a vibration that rises in steps."""

    name = 'vibration-steps'
    title = 'Vibration in steps of frequency'
    document = (
        'Capriglione et al., Performance analysis of MEMS-based inertial measurement units in '
        'terrestrial vehicles, 2021'
    )
    SETTINGS = (
        Setting('amplitude', (2 * STANDARD_GRAVITY,), 'Peak of the vibration.', (), (0.0, 1e5),
                'm/s²', 'quantity'),
        Setting('low', (40.0,), 'First frequency.', (), (1e-3, 1e6), 'Hz', 'quantity'),
        Setting('step', (20.0,), 'Between two frequencies.', (), (1e-3, 1e6), 'Hz', 'quantity'),
        Setting('hold', (25.0,), 'How long each is held.', (), (0.1, 1e5), 's', 'quantity'),
        Setting('begin', (0.0,), 'When the first begins, after the first sample.', (), (0.0, 1e6),
                's', 'quantity'),
    )  # fmt: skip

    def measure(self, source: str, recordings: Sequence[Recording]) -> tuple[Shaken, ...]:
        """Return the RMS of every axis of every sensor at each frequency."""
        return tuple(self._shaken(recording) for recording in recordings)

    def _shaken(self, recording: Recording) -> Shaken:
        low, step, hold, begin = (self.settings[n][0] for n in ('low', 'step', 'hold', 'begin'))
        since = seconds(recording) - begin
        # a last step that is not held to its end, within the guard, counts
        count = int((since[-1] + _GUARD * hold) / hold)
        starts = (np.arange(count) + _GUARD) * hold
        ends = starts + (1.0 - 2.0 * _GUARD) * hold
        edges = np.searchsorted(since, np.column_stack([starts, ends]))
        if not count or int(np.diff(edges, axis=1).min()) < _FEWEST:
            raise RecordingError(
                f'{place(recording)}: no step of {bare(hold)} s with {_FEWEST} samples or more; '
                'see --set hold and --set begin'
            )
        rms = {
            axis.name: tuple(
                Moments.of(np.ascontiguousarray(axis.values[a:b])[None]).rms_estimate(
                    0, axis.unit, self.confidence
                )
                for a, b in edges.tolist()
            )
            for axis in axes(recording.samples)
            if np.isfinite(axis.values).all()
        }
        frequencies = tuple(float(low + step * k) for k in range(count))
        return Shaken(recording.source, recording.topic, frequencies, rms)

    def conclude(self, measured: Sequence[tuple[Shaken, ...]]) -> PlanResult:
        """Return tables and figures of all sensors and runs."""
        sensors = named([one for part in measured for one in part], self.reference)
        applied = self.settings['amplitude'][0] / math.sqrt(2.0)
        return PlanResult(
            self.name,
            self.title,
            tuple(_summary(sensors, applied)),
            tuple(_tables(sensors)),
            tuple(_figures(sensors, applied)),
            (),
            {name: one.to_json() for name, one in sensors},
        )


def _of(one: Shaken, quantity: str) -> dict[str, tuple[Estimate, ...]]:
    return {name: found for name, found in one.rms.items() if name.startswith(f'{quantity}.')}


def _summary(sensors: Sequence[tuple[str, Shaken]], applied: float) -> Iterator[str]:
    for name, one in sensors:
        found = _of(one, LINEAR_ACCELERATION.name)
        if not found:
            continue
        along = max(found, key=lambda axis: found[axis][0].value or 0.0)
        first = found[along][0]
        yield (
            f'{name}: {text(first)} on {along[-1]} at {bare(one.frequencies[0])} Hz, '
            f'{100 * (first.value or 0.0) / applied:.0f} % of the {bare(applied)} m/s² applied.'
        )
        others = {axis: rms for axis, rms in found.items() if axis != along}
        if others:
            worst, place = max(
                ((axis, k) for axis, rms in others.items() for k in range(len(rms))),
                key=lambda at: others[at[0]][at[1]].value or 0.0,
            )
            yield (
                f'{name}: across it at most {text(others[worst][place])} on {worst[-1]}, at '
                f'{bare(one.frequencies[place])} Hz.'
            )


def _tables(sensors: Sequence[tuple[str, Shaken]]) -> Iterator[Table]:
    for name, one in sensors:
        for quantity in IMU_QUANTITIES:
            found = _of(one, quantity.name)
            if found:
                unit = _SHOWN[quantity.name]
                yield Table(
                    f'{name}: {quantity.title.lower()}, RMS against frequency',
                    (Column('frequency', 'Hz'), *(Column(axis[-1], unit) for axis in found)),
                    tuple(zip(one.frequencies, *found.values(), strict=True)),
                    _NOTE.format(guard=100 * _GUARD),
                )


def _figures(sensors: Sequence[tuple[str, Shaken]], applied: float) -> Iterator[Figure]:
    for name, one in sensors:
        frequency = np.array(one.frequencies)
        for quantity in IMU_QUANTITIES:
            unit = _SHOWN[quantity.name]
            series = [
                _line(axis[-1], frequency, rms, unit)
                for axis, rms in _of(one, quantity.name).items()
            ]
            if not series:
                continue
            if quantity is LINEAR_ACCELERATION:
                level = np.full(frequency.size, applied)
                series.append(Series('applied', frequency, level, dash='dashed'))
            yield Figure(
                f'{name}: {quantity.title.lower()} against frequency (Capriglione 2021, figure 2)',
                'frequency in Hz', f'RMS in {unit}', tuple(series), log_x=True, log_y=True,
            )  # fmt: skip


def _line(label: str, frequency: Any, rms: Sequence[Estimate], unit: str) -> Series:
    shown = [each.to(unit) for each in rms]
    value, low, high = (
        np.array([getattr(each, part) or 0.0 for each in shown])
        for part in ('value', 'low', 'high')
    )
    return Series(label, frequency, value, low, high)
