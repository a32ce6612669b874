# SPDX-License-Identifier: Apache-2.0
"""What figures on a page and in files show of a result: its curves, their units and ranges."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from imu_bench.metrology.fitting.noise_model import gauss_markov_variance, NoiseModel, variance_of
from imu_bench.offline.axis_result import AxisResult
from imu_bench.offline.notation import readable_unit
from imu_bench.units import convert
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_MARGIN = 1.6  # factor of empty space above and below the data of a logarithmic plot
_HALF_VIEW = 4.0  # factor above and below the middle of a spectrum that is always shown


class Curve(NamedTuple):
    """A line to be drawn."""

    x: Floats
    y: Floats


class Bars(NamedTuple):
    """A histogram about the mean, and the normal distribution of the same σ, in % per unit."""

    edges: Floats
    share: Floats
    expected: Floats

    @property
    def middle(self) -> Floats:
        """Return the middle of each bar."""
        return 0.5 * (self.edges[1:] + self.edges[:-1])


def drawable(axis: AxisResult) -> bool:
    """Return whether a logarithmic plot can show anything of the deviation."""
    return axis.allan is not None and bool(np.any(axis.allan.deviation > 0.0))


def time_unit(duration_s: float) -> str:
    """Return the unit in which a time axis of this length is read."""
    return 's' if duration_s < 600.0 else 'min' if duration_s < 7200.0 else 'h'


def level_unit(axes: Sequence[AxisResult]) -> str:
    """Return the unit in which the levels of these axes are read."""
    sizes = [axis.statistics['std'].value for axis in axes]
    return readable_unit(axes[0].unit, 'level', sizes)


def allan_unit(axes: Sequence[AxisResult]) -> str:
    """Return the unit in which the Allan deviations of these axes are read."""
    if not axes:
        return '1'
    typical = [float(np.median(axis.allan.deviation)) for axis in axes if axis.allan is not None]
    return readable_unit(axes[0].unit, 'level', typical)


def density_unit(axes: Sequence[AxisResult]) -> str:
    """Return the unit in which the densities of these axes are read."""
    if not axes:
        return '1'
    sizes = [axis.white_density.value for axis in axes]
    return readable_unit(axes[0].noise_density.unit, 'density', sizes)


def trace(axis: AxisResult, unit: str, clock: str) -> Curve | None:
    """Return the signal about its mean over time, None if the result has none."""
    envelope = axis.envelope
    if envelope is None:
        return None
    # lowest and highest in turn: at this density the eye sees the filled band of a scope
    values = np.column_stack([envelope.low, envelope.high]).ravel()
    time = np.repeat(envelope.time, 2) * convert(1.0, 's', clock)
    return Curve(time, _centred(axis, values, unit))


def bars(axis: AxisResult, unit: str) -> Bars | None:
    """Return the distribution, None if the result has none."""
    found = axis.histogram
    if found is None:
        return None
    edges = _centred(axis, found.edges, unit)
    per_sample = 100.0 / found.count.sum() / np.diff(edges)
    return Bars(edges, found.count * per_sample, found.expected * per_sample)


def _centred(axis: AxisResult, values: Floats, unit: str) -> Floats:
    mean = axis.statistics['mean'].value or 0.0
    return np.asarray((values - mean) * convert(1.0, axis.unit, unit))


def density(axis: AxisResult, unit: str) -> Curve | None:
    """Return the amplitude density where a logarithmic plot can show it, None without one."""
    psd = axis.psd
    if psd is None:
        return None
    shown = psd.density > 0.0
    height = np.sqrt(psd.density[shown]) * convert(1.0, f'{axis.unit}/√Hz', unit)
    return Curve(psd.frequency[shown], height)


def white_level(axis: AxisResult, unit: str) -> float | None:
    """Return the noise density that the table gives, None if it was read off the spectrum."""
    level = axis.noise_density
    if level.value is None or axis.white_from_spectrum:
        return None
    return convert(level.value, level.unit, unit)


def fitted(axis: AxisResult, unit: str) -> Curve | None:
    """Return the Allan deviation of the model over the range it was fitted to, None without."""
    tau = _model_tau(axis)
    if tau is None:
        return None
    tau = tau[(tau >= axis.model.tau_low) & (tau <= axis.model.tau_high)]
    return Curve(tau, axis.model.deviation(tau) * convert(1.0, axis.unit, unit))


def fitted_parts(axis: AxisResult, unit: str) -> list[Curve]:
    """Return the Allan deviation of each term of the model over the whole curve."""
    tau = _model_tau(axis)
    if tau is None:
        return []
    factor = convert(1.0, axis.unit, unit)
    return [Curve(tau, part * factor) for part in _parts(axis.model, tau)]


def _model_tau(axis: AxisResult) -> Floats | None:
    """Return averaging times for the curve of the model, or None if there is no model."""
    if axis.allan is None or not (axis.model.fitted or axis.model.values):
        return None
    return np.geomspace(axis.allan.tau[0], axis.allan.tau[-1], 60)


def _parts(model: NoiseModel, tau: Floats) -> list[Floats]:
    """Return the deviation of each term of the curve that was fitted: observable or not."""
    sizes = model.fitted or model.values
    parts = [np.sqrt(variance_of({term: size}, tau)) for term, size in sizes.items()]
    process = model.gauss_markov
    if process is not None and process.q_c.value and process.T_c.value:
        parts.append(process.q_c.value * np.sqrt(gauss_markov_variance(tau, process.T_c.value)))
    return parts


def allan_view(axes: Sequence[AxisResult], unit: str) -> tuple[float, float] | None:
    """Return the range that keeps the data in view: the parts of a model run far below it."""
    seen = [
        values[values > 0.0]
        for axis in axes
        if (curve := axis.allan) is not None
        for values in (curve.deviation, curve.low, np.minimum(curve.high, 5.0 * curve.deviation))
    ]
    if not seen:
        return None
    together = np.concatenate(seen) * convert(1.0, axes[0].unit, unit)
    return float(together.min()) / _MARGIN, float(together.max()) * _MARGIN


def density_view(axes: Sequence[AxisResult], unit: str) -> tuple[float, float] | None:
    """Return at least a decade: the scatter of a flat spectrum must not look like structure."""
    seen = [axis.psd.density[axis.psd.density > 0.0] for axis in axes if axis.psd is not None]
    seen = [density for density in seen if density.size]
    if not seen:
        return None
    together = np.sqrt(np.concatenate(seen)) * convert(1.0, f'{axes[0].unit}/√Hz', unit)
    middle = float(np.median(together))
    low = min(float(together.min()) / 1.3, middle / _HALF_VIEW)
    return low, max(float(together.max()) * _MARGIN, middle * _HALF_VIEW)
