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

from imu_bench.metrology import allan, coefficients, statistics
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.spectra import spectrum
from imu_bench.metrology.stamps import timing
from imu_bench.samples import AXES, IMU_QUANTITIES, Quantity, Samples
from imu_bench.simulation.chip import SensorSource
from imu_bench.simulation.expected import expected_coefficients, rounding_shows_noise
from imu_bench.simulation.sensor_errors import Array
from scipy.stats import binom

CONFIDENCE = 0.95

SURE = 1e-3
"""Chance of calling a right analysis wrong, per parameter of a sensor."""


@dataclass(frozen=True)
class Check:
    """
    One parameter of one axis.

    Attributes
    ----------
    axis, parameter : str
        Such as 'linear_acceleration.x' and 'N'.
    truth : float
        What went in; zero for a noise that was not there.
    found : Estimate
    """

    axis: str
    parameter: str
    truth: float
    found: Estimate

    @property
    def inside(self) -> bool:
        """Whether the truth lies in the interval, or below the bound of what was not seen."""
        low, high = self.found.low, self.found.high
        return low is not None and high is not None and low <= self.truth <= high


@dataclass(frozen=True)
class Coverage:
    """How often a parameter lay inside its interval."""

    inside: int
    total: int

    @property
    def share(self) -> float:
        """The share inside."""
        return self.inside / self.total

    @property
    def acceptable(self) -> bool:
        """Whether chance alone can explain that so many were outside."""
        return bool(binom.cdf(self.inside, self.total, CONFIDENCE) > SURE)


def coverage(checks: Iterable[Check]) -> dict[str, Coverage]:
    """
    Return per parameter how many checks were inside.

    Examples
    --------
    >>> found = Estimate(1.0, 0.9, 1.1, 'm/s²')
    >>> coverage([Check('x', 'B', 1.05, found), Check('y', 'B', 1.2, found)])
    {'B': Coverage(inside=1, total=2)}
    """
    counted: dict[str, list[bool]] = {}
    for check in checks:
        counted.setdefault(check.parameter, []).append(check.inside)
    return {name: Coverage(sum(found), len(found)) for name, found in counted.items()}


def check(source: SensorSource, run: Samples) -> Iterator[Check]:
    """
    Yield every parameter of a source that a recording at rest must give back.

    The noise coefficients where the resolution does not hide them, from the whole curve as
    `imu-bench analyze` takes it; the offset where no slow noise moves it; of a sensor without
    constant values the noise density of its spectrum; and the output rate.

    Parameters
    ----------
    source : SensorSource
        At rest.
    run : Samples
        Everything it made.
    """
    rate = timing.analyse(run.stamps).rate
    yield Check('stamps', 'rate', source.rate_hz, rate)
    start = source.at_start()
    for quantity in IMU_QUANTITIES:
        if quantity.field not in source.quantities:
            continue
        columns = getattr(run, quantity.field)
        for axis in range(len(AXES)):
            if source.model.errors[quantity.field].has(axis):
                ideal = float(start[quantity.field][axis])
                yield from _axis(source, quantity, axis, columns[:, axis], ideal)


def _axis(
    source: SensorSource, quantity: Quantity, axis: int, values: Array, ideal: float
) -> Iterator[Check]:
    errors = source.model.errors[quantity.field]
    name, rate = f'{quantity.name}.{AXES[axis]}', source.rate_hz
    if errors.high_pass[axis]:
        density = spectrum.plateau(spectrum.psd(values, rate, quantity.unit))
        yield Check(name, 'density', float(errors.white_density[axis]), density)
        return
    if not rounding_shows_noise(errors, axis, rate):
        return
    model = coefficients.fit(allan.deviation(values, rate, unit=quantity.unit))
    went_in = expected_coefficients(errors, axis, rate, ideal)
    for term, truth in went_in.items():
        parameter = term if truth else f'no {term}'
        yield Check(name, parameter, truth, model.coefficients[term])
    if not went_in['B'] and not went_in['K'] and math.isfinite(ideal):
        yield Check(name, 'bias', ideal, statistics.describe(values, quantity.unit).mean)
