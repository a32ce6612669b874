# SPDX-License-Identifier: Apache-2.0
"""
Thermal test: sensors heated and cooled, their bias against temperature and time.

The test of section 4.2.1 of the MSc thesis on two MEMS inclinometers for antenna masts (SCL3300,
IIM-42652): from room temperature to about 80 °C.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from imu_bench.errors import RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.comparing.sensors import labels
from imu_bench.offline.health import Finding
from imu_bench.offline.notation import text
from imu_bench.offline.plans.plan import named, Plan
from imu_bench.offline.plans.result import PlanResult
from imu_bench.offline.plans.thermal import measuring
from imu_bench.offline.plans.thermal.presenting import (
    coefficient_unit,
    figures,
    level_unit,
    tables,
)
from imu_bench.offline.recordings import Recording
from msg_conversions.quantities import IMU_QUANTITIES


class Thermal(Plan[tuple[measuring.Heated, ...]]):
    """Bias against temperature."""

    name = 'thermal'
    title = 'Bias against temperature'
    document = (
        'the MSc thesis on two MEMS inclinometers for antenna masts (SCL3300, IIM-42652), '
        'section 4.2.1'
    )

    def measure(
        self, source: str, recordings: Sequence[Recording]
    ) -> tuple[measuring.Heated, ...]:
        """Return what heating does to every sensor with a thermometer."""
        topics = dict(zip(labels(recordings), (r.topic for r in recordings), strict=True))
        found = measuring.thermometers(source, recordings, topics.get(self.reference, ''))
        own = {r.topic for r in recordings if found.get(r.topic) is not None}
        lent = found.get(topics.get(self.reference, ''))
        return tuple(
            measuring.measure(
                r, found[r.topic],
                found[r.topic] is not lent or r.topic == topics.get(self.reference),
                self.confidence,
            )
            for r in recordings
            if r.topic in own
        )  # fmt: skip

    def conclude(self, measured: Sequence[tuple[measuring.Heated, ...]]) -> PlanResult:
        """Return the coefficients of all sensors."""
        sensors = named([one for part in measured for one in part], self.reference)
        if not sensors:
            raise RecordingError('no sensor with a temperature is left')
        return PlanResult(
            self.name,
            self.title,
            tuple(_summary(sensors)),
            tuple(tables(sensors)),
            tuple(figures(sensors)),
            tuple(_findings(sensors)),
            {name: one.to_json() for name, one in sensors},
        )


def _summary(sensors: Sequence[tuple[str, measuring.Heated]]) -> Iterator[str]:
    for quantity in IMU_QUANTITIES:
        ranked = sorted(
            (abs(found.coefficient.value or 0.0), name, axis, found.coefficient)
            for name, one in sensors
            for axis, found in one.axes.items()
            if axis.startswith(quantity.name)
        )
        if not ranked:
            continue
        unit = coefficient_unit(ranked[0][2])
        words = quantity.name.replace('_', ' ').capitalize()
        _, name, axis, least = ranked[0]
        line = f'{words}: {name} {axis[-1]} moves least, {text(least, unit)}'
        if len(ranked) > 1:
            _, name, axis, most = ranked[-1]
            line += f'; {name} {axis[-1]} most, {text(most, unit)}'
        yield f'{line}.'
    for name, one in sensors:
        yield (
            f'{name}: from {one.lowest:.1f} to {one.highest:.1f} °C by its own thermometer.'
            if one.own
            else f'{name}: from {one.lowest:.1f} to {one.highest:.1f} °C by {one.thermometer}.'
        )


def _findings(sensors: Sequence[tuple[str, measuring.Heated]]) -> Iterator[Finding]:
    for name, one in sensors:
        if not one.phases.cooled:
            yield Finding(
                'warning', 'not_cooled',
                f'{name}: the temperature does not come back.',
                'What drifts in time counts as temperature, and there is no hysteresis.',
                'Let it cool in the same recording.',
            )  # fmt: skip
        if not one.own:
            yield Finding(
                'warning', 'foreign_thermometer',
                f'{name}: has no temperature of its own, that of {one.thermometer} counts.',
                'A difference of temperature between the two is in every number.',
                'Keep them close together, and heat slowly.',
            )  # fmt: skip
        for axis, found in one.axes.items():
            for what, number in (('curvature', found.curvature), ('hysteresis', found.hysteresis)):
                if _real(number):
                    yield Finding(
                        'info', what,
                        f'{name} {axis}: {what} of {text(number, level_unit(axis))}.',
                        'A straight line alone does not describe this axis.',
                        f'Take the {what} into account when compensating.',
                    )  # fmt: skip


def _real(number: Estimate) -> bool:
    """Return whether zero is outside the interval by more than its width."""
    if number.value is None or number.low is None or number.high is None:
        return False
    return abs(number.value) > number.high - number.low
