# SPDX-License-Identifier: Apache-2.0
"""
The loop closed: what went into a simulated sensor against what an analysis finds in its output.

Every parameter has to lie inside the 95 % interval that the analysis gives it, in 95 of 100
recordings.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
import math

from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.analysis.axis_result import AxisResult
from imu_bench.offline.analysis.recording import analyse
from imu_bench.samples import Samples
from imu_bench.simulation.chip import SensorSource
from imu_bench.simulation.sensor_errors import Errors
from imu_bench.simulation.simulated import expected_coefficients, rounding_shows_noise
from msg_conversions.quantities import AXES, IMU_QUANTITIES
from scipy.stats import binom

from benchmarks._analyzed import recording

CONFIDENCE = 0.95

SURE = 1e-3
"""Chance of calling a right analysis wrong, per parameter of a sensor."""


Row = tuple[str, bool, bool]
"""A parameter, whether the truth lay inside, whether it was claimed."""


@dataclass(frozen=True)
class Check:
    """One parameter of one axis."""

    # axis, parameter: such as 'linear_acceleration.x' and 'N'
    axis: str
    parameter: str
    truth: float  # what went in; zero for a noise that was not there
    found: Estimate

    @property
    def inside(self) -> bool:
        """Whether the truth lies in the interval, or below the bound of what was not seen."""
        low, high = self.found.low, self.found.high
        return low is not None and high is not None and low <= self.truth <= high

    @property
    def row(self) -> Row:
        """What counts of it."""
        return self.parameter, self.inside, self.found.observable


@dataclass(frozen=True)
class Coverage:
    """How often a parameter lay inside its interval, and how often it was claimed at all."""

    inside: int
    total: int
    claimed: int

    @property
    def share(self) -> float:
        """The share inside."""
        return self.inside / self.total

    @property
    def acceptable(self) -> bool:
        """Whether chance alone can explain that so many were outside."""
        return bool(binom.cdf(self.inside, self.total, CONFIDENCE) > SURE)


def coverage(rows: Iterable[Row]) -> dict[str, Coverage]:
    """Return per parameter how many checks were inside, and how many claimed it."""
    counted: dict[str, list[tuple[bool, bool]]] = {}
    for parameter, inside, claimed in rows:
        counted.setdefault(parameter, []).append((inside, claimed))
    return {
        parameter: Coverage(sum(i for i, _ in found), len(found), sum(c for _, c in found))
        for parameter, found in counted.items()
    }


def check(source: SensorSource, run: Samples) -> Iterator[Check]:
    """
    Yield every parameter of a source that a recording at rest must give back.

    The noise coefficients where the resolution does not hide them; the offset where no slow noise
    moves it; of a sensor without constant values the noise density of its spectrum; and the
    output rate: all as `imu-bench analyze` finds them.
    """
    result = analyse(recording(run))
    yield Check('stamps', 'rate', source.rate_hz, result.health.rate)
    start = source.at_start()
    for quantity in IMU_QUANTITIES:
        if quantity.field not in source.quantities:
            continue
        errors = source.model.errors[quantity.field]
        for axis, letter in enumerate(AXES):
            if errors.has(axis):
                ideal = float(start[quantity.field][axis])
                found = result.axes[f'{quantity.name}.{letter}']
                yield from _axis(errors, axis, source.rate_hz, found, ideal)


def _axis(
    errors: Errors, axis: int, rate_hz: float, found: AxisResult, ideal: float
) -> Iterator[Check]:
    name = found.name
    if errors.high_pass[axis]:
        density = found.noise_density_methods['plateau']
        yield Check(name, 'density', float(errors.white_density[axis]), density)
        return
    if not rounding_shows_noise(errors, axis, rate_hz):
        return
    went_in = expected_coefficients(errors, axis, rate_hz, ideal)
    for term, truth in went_in.items():
        parameter = term if truth else f'no {term}'
        yield Check(name, parameter, truth, found.coefficient(term))
    if not went_in['B'] and not went_in['K'] and math.isfinite(ideal):
        yield Check(name, 'bias', ideal, found.statistics['mean'])
