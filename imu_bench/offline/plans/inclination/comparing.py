# SPDX-License-Identifier: Apache-2.0
"""A tilted sensor against the angles that were set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

from imu_bench.errors import RecordingError
from imu_bench.metrology.combining import shifted
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.trials import inclination
from imu_bench.offline.plans.inclination.measuring import Tilted

DEGREE = math.degrees(1.0)

CLEAR = 1.0 / 3.0
"""
An angle may be this part of a step away from the multiple it is taken for; a half is undecided.
"""


@dataclass(frozen=True, eq=False)
class Judged:
    """A sensor with its errors; without set angles there are none."""

    name: str
    tilted: Tilted
    wanted: tuple[float, ...]  # set angles, rad; empty if nobody said
    errors: tuple[Estimate, ...] = ()
    compensated: tuple[Estimate, ...] = ()
    statistics: inclination.ErrorStatistics | None = None
    line: inclination.Line | None = None
    turns: tuple[inclination.Turn, ...] = ()
    # smallest step for every averaging time in s
    detectable: tuple[tuple[float, Estimate], ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return every number in SI, ready for JSON."""
        document: dict[str, Any] = {
            'source': self.tilted.source,
            'topic': self.tilted.topic,
            'axis': self.tilted.axis,
            'steps': [self._step(index) for index in range(len(self.tilted.steps))],
            'smallest_step': [
                {'averaging_s': tau, 'step': step.to_json()} for tau, step in self.detectable
            ],
            'hysteresis': [
                {'set': t.angle, 'up': t.up.to_json(), 'down': t.down.to_json(),
                 'difference': t.hysteresis.to_json()}
                for t in self.turns
            ],
        }  # fmt: skip
        if self.statistics is not None:
            document['errors'] = {
                'mean': self.statistics.mean.to_json(),
                'variance': self.statistics.variance,
                'three_sigma': self.statistics.three_sigma.to_json(),
                'largest': self.statistics.largest,
            }
        if self.line is not None:
            document['offset'] = self.line.offset.to_json()
            document['scale_error'] = self.line.scale_error.to_json()
            document['linearity'] = self.line.linearity
        return document

    def _step(self, index: int) -> dict[str, Any]:
        step = self.tilted.steps[index]
        found: dict[str, Any] = {
            'begin_s': step.begin_s,
            'end_s': step.end_s,
            'samples': step.samples,
            'mean': step.mean.to_json(),
            'three_sigma': step.three_sigma.to_json(),
        }
        if self.wanted:
            found['set'] = self.wanted[index]
            found['error'] = self.errors[index].to_json()
            found['compensated_error'] = self.compensated[index].to_json()
        if step.on_chip is not None and step.disagreement is not None:
            found['on_chip'] = step.on_chip.to_json()
            found['on_chip_minus_trigonometry'] = step.disagreement.to_json()
        return found


def judge(
    name: str,
    tilted: Tilted,
    wanted: Sequence[float],
    probability: float,
    confidence: float,
) -> Judged:
    """Return a sensor with its errors."""
    means = [shown.mean for shown in tilted.steps]
    detectable: tuple[tuple[float, Estimate], ...] = ()
    if tilted.at_rest is not None:
        found = inclination.smallest_step(tilted.at_rest, probability)
        detectable = tuple(zip(tilted.at_rest.tau.tolist(), found, strict=True))
    if not wanted:
        return Judged(name, tilted, (), detectable=detectable)
    if len(wanted) != len(means):
        spans = ', '.join(f'{s.begin_s:.0f}-{s.end_s:.0f}' for s in tilted.steps)
        raise RecordingError(
            f'{tilted.source}: {len(wanted)} set angles for the {len(means)} steps of {name}, '
            f'found at {spans} s: give one angle for each'
        )
    errors = tuple(shifted(mean, -angle) for mean, angle in zip(means, wanted, strict=True))
    values = [mean.value or 0.0 for mean in means]
    straight = len(wanted) > 2 and len(set(wanted)) > 1
    return Judged(
        name, tilted, tuple(wanted), errors, inclination.compensated(means, wanted),
        inclination.error_statistics([e.value or 0.0 for e in errors], 'rad', confidence),
        inclination.straight_line(wanted, values, confidence) if straight else None,
        inclination.hysteresis(wanted, means),
        detectable,
    )  # fmt: skip


def multiples(sensors: Sequence[tuple[str, Tilted]], step: float) -> dict[str, tuple[float, ...]]:
    """
    Return the set angles of the sensors on one table, in rad by name.

    They are multiples of the step, counted from the first angle, nearest to what the sensor
    shows that knows its angles best; a sensor that was mounted the other way round has them
    with the other sign.
    """
    name, best = min(sensors, key=lambda pair: max(_width(s.mean) for s in pair[1].steps))
    found = []
    for place, angle in enumerate(_from_first(best), 1):
        times = round(angle / step)
        if abs(angle / step - times) > CLEAR:
            raise RecordingError(
                f'{best.source}: step {place} of {name} is {angle * DEGREE:.4f}° from the '
                f'first, no multiple of {step * DEGREE:g}°; give every angle with --set angles='
            )
        found.append(times * step)
    return {
        other: tuple(angle * _sign(_from_first(tilted), found) for angle in found)
        for other, tilted in sensors
    }


def _from_first(tilted: Tilted) -> list[float]:
    means = [shown.mean.value or 0.0 for shown in tilted.steps]
    return [mean - means[0] for mean in means]


def _width(mean: Estimate) -> float:
    return (mean.high or 0.0) - (mean.low or 0.0)


def _sign(angles: Sequence[float], wanted: Sequence[float]) -> float:
    return math.copysign(1.0, sum(a * b for a, b in zip(angles, wanted, strict=True)))
