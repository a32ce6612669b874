# SPDX-License-Identifier: Apache-2.0
"""The runs of a campaign, grouped by condition, axis and sensor, with RR, SR and SNR of each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import math
from typing import Any, NamedTuple

from imu_bench.metrology.combining import difference
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.trials.crosstalk import (
    Compatibility,
    compatibility,
    magnitude,
    ratio_db,
    Repeated,
    repeated,
)
from imu_bench.offline.plans.sine_on_random.measuring import AxisRun, SensorRun
from imu_bench.units import convert
from msg_conversions.quantities import AXES, IMU_QUANTITIES, LINEAR_ACCELERATION, Quantity

PAIRS = tuple((i, j) for j in AXES for i in AXES if i != j)
"""Axis not excited and axis excited, in the order of tables V and VI."""

INDICES = ('RR', 'SR')
_SHOWN = {'linear_acceleration': 'g', 'angular_velocity': '°/s'}


class Case(NamedTuple):
    """What is repeated: a sensor under one condition along one axis."""

    condition: str
    axis: str
    sensor: str
    random: bool


@dataclass(frozen=True, eq=False)
class Campaign:
    """All runs."""

    runs: dict[Case, list[SensorRun]]  # the repetitions, in order
    confidence: float
    coverage: float

    @classmethod
    def of(cls, runs: Sequence[SensorRun], confidence: float, coverage: float) -> Campaign:
        """Group runs, in the order of their repetition, then as given."""
        groups: dict[Case, list[SensorRun]] = {}
        for run in runs:
            own = run.identity
            case = Case(own.condition, own.axis, run.sensor, own.random)
            groups.setdefault(case, []).append(run)
        for group in groups.values():
            group.sort(key=lambda run: run.identity.repetition or 0)
        return cls(dict(sorted(groups.items())), confidence, coverage)

    @property
    def conditions(self) -> list[str]:
        """Service conditions with random vibration, sorted."""
        return sorted({case.condition for case in self.runs if case.random})

    @property
    def sensors(self) -> list[str]:
        """Names of the sensors, sorted."""
        return sorted({case.sensor for case in self.runs})

    @property
    def pairs(self) -> list[tuple[str, str]]:
        """Axes not excited and excited, of the axes that are excited in some run."""
        excited = {case.axis for case in self.runs if case.random}
        return [pair for pair in PAIRS if pair[1] in excited]

    def index(
        self, name: str, quantity: Quantity, case: Case, axis: str
    ) -> tuple[list[Estimate], Repeated | None]:
        """Return RR or SR of an axis that is not excited: of each repetition, and over all."""
        level = _rejection if name == 'RR' else _spurious
        values = [
            magnitude(found)
            for run in self.runs.get(case, [])
            if (found := level(run, quantity, axis, self.confidence)) is not None
        ]
        return values, repeated(values, self.confidence) if values else None

    def ratio(self, case: Case) -> Repeated | None:
        """Return the SNR of the excited axis over the repetitions."""
        runs = self.runs.get(case)
        return repeated([run.snr for run in runs], self.confidence) if runs else None

    def loss(self, case: Case) -> Estimate:
        """Return what random vibration costs: SNR of the sine alone less SNR with it."""
        random, alone = self.ratio(case), self.ratio(case._replace(random=False))
        if alone is None:
            reason = (
                'no recording of the sine without random vibration; name it like '
                f'{case.condition.lower()}_{case.axis}_sine'
            )
            return Estimate.not_observable('dB', reason, confidence=self.confidence)
        if random is None:
            reason = 'no recording with random vibration'
            return Estimate.not_observable('dB', reason, confidence=self.confidence)
        return difference(alone.mean, random.mean)

    def quiet(self, quantity: Quantity, sensor: str) -> Iterator[tuple[SensorRun, AxisRun]]:
        """Yield every run and axis whose quiet zones can be compared."""
        for case, runs in self.runs.items():
            for run in runs if case.sensor == sensor else ():
                for name, axis in run.axes.items():
                    if name.startswith(quantity.name) and axis.after is not None:
                        yield run, axis

    def compared(self, axis: AxisRun) -> Compatibility | None:
        """
        Return whether the quiet zones agree within the scatter of their readings.

        As in table IV: mean and standard deviation of the readings of either zone.
        """
        if axis.after is None:
            return None
        (mean, spread), (later, again) = axis.before, axis.after
        numbers = (mean.value, spread.value, later.value, again.value)
        if any(number is None for number in numbers):
            return None
        first, u_first, second, u_second = (number or 0.0 for number in numbers)
        if u_first == 0.0 and u_second == 0.0 and first != second:
            return Compatibility(second - first, 0.0, math.inf, False)
        return compatibility((first, u_first), (second, u_second), self.coverage)


def _rejection(
    run: SensorRun, quantity: Quantity, axis: str, confidence: float
) -> Estimate | None:
    """Return the RMS of an axis over that of the excited accelerometer axis, with its sign."""
    excited = run.axes[f'{LINEAR_ACCELERATION.name}.{run.identity.axis}']
    other = run.axes.get(f'{quantity.name}.{axis}')
    if other is None:
        return None
    # in the units of the document: only they give a number to °/s over g
    top = other.shaken * convert(1.0, other.unit, _SHOWN[quantity.name]) ** 2
    bottom = excited.shaken * convert(1.0, excited.unit, 'g') ** 2
    return ratio_db(top, bottom, paired=True, confidence=confidence)


def _spurious(run: SensorRun, quantity: Quantity, axis: str, confidence: float) -> Estimate | None:
    """Return the RMS of an axis in the test zone over that in the zone before."""
    other = run.axes.get(f'{quantity.name}.{axis}')
    if other is None:
        return None
    return ratio_db(other.shaken, other.quiet, paired=False, confidence=confidence)


def values(campaign: Campaign) -> dict[str, Any]:
    """Return everything that was measured, for programs: one entry per run of a sensor."""
    return {
        'runs': [
            _run(campaign, case, run, number)
            for case, runs in campaign.runs.items()
            for number, run in enumerate(runs, 1)
        ]
    }


def _run(campaign: Campaign, case: Case, run: SensorRun, number: int) -> dict[str, Any]:
    levels = {'RR': _rejection, 'SR': _spurious}
    return {
        'source': run.source,
        'condition': case.condition,
        'axis': case.axis,
        'sensor': case.sensor,
        'random': case.random,
        'repetition': number,
        'zones_s': {
            name: None if zone is None else [zone.begin_s, zone.end_s]
            for name, zone in zip(('before', 'test', 'after'), (
                run.zones.before, run.zones.test, run.zones.after
            ), strict=True)
        },
        'snr': run.snr.to_json(),
        'fundamental_hz': run.fundamental,
        'axes': {name: _axis(campaign, axis) for name, axis in run.axes.items()},
        **{
            name: {
                f'{quantity.name}.{axis}': magnitude(found).to_json()
                for quantity in IMU_QUANTITIES
                for axis in AXES
                if axis != case.axis
                and (found := level(run, quantity, axis, campaign.confidence)) is not None
            }
            for name, level in levels.items()
        },
    }  # fmt: skip


def _axis(campaign: Campaign, axis: AxisRun) -> dict[str, Any]:
    document: dict[str, Any] = {
        'before': {'mean': axis.before[0].to_json(), 'std': axis.before[1].to_json()}
    }
    verdict = campaign.compared(axis)
    if axis.after is not None and verdict is not None:
        document['after'] = {'mean': axis.after[0].to_json(), 'std': axis.after[1].to_json()}
        document['compatible'] = verdict.compatible
        document['ratio'] = verdict.ratio if math.isfinite(verdict.ratio) else None
    return document
