# SPDX-License-Identifier: Apache-2.0
"""Every metric of one axis."""

from __future__ import annotations

from dataclasses import replace

from imu_bench.errors import DataError
from imu_bench.metrology import allan, coefficients, normality, statistics, workspace
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.noise_fit import fitted
from imu_bench.metrology.spectra import spectrum
from imu_bench.metrology.spectra.spectrum import Spectrum
from imu_bench.metrology.stamps import timing
from imu_bench.metrology.stamps.timing import Grid
from imu_bench.offline.axes import Axis
from imu_bench.offline.axis_result import AxisResult, Density, STATISTICS
from imu_bench.offline.checks import examine, Signal
from imu_bench.offline.health.hum import FALSE_ALARM
from imu_bench.offline.reduction import bands, envelope
from imu_bench.offline.settings import Settings
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

_BINS = 80


def measure(axis: Axis, grid: Grid, start_s: float, settings: Settings) -> AxisResult:
    """
    Return everything that is measured on one axis.

    Parameters
    ----------
    axis : Axis
    grid : Grid
        Where on the time axis its samples are.
    start_s : float
        Time of the first sample.
    settings : Settings

    Raises
    ------
    DataError
        If not one averaging time can be had, or the numbers are too large.
    """
    kept = axis.values if grid.keep.all() else workspace.chosen(axis.values, grid.keep)
    placed, valid = _placed(axis.values, grid)
    rate = 1.0 / grid.period_s
    summary = statistics.describe(kept, axis.unit, settings.confidence)
    curve = allan.deviation(
        placed,
        rate,
        tau=settings.taus or 'log',
        valid=valid,
        unit=axis.unit,
        confidence=settings.confidence,
        min_share=settings.min_share,
        # whoever has several cores works on several axes
        threads=1,
    )
    model = fitted(curve, settings.confidence)
    constant = summary.minimum.value == summary.maximum.value
    spread = None if constant else _spectrum(placed, rate, axis.unit, valid, settings)
    density = coefficients.noise_density(model)
    methods = {'allan': density} | _other_densities(summary.std, spread, rate, settings.confidence)
    signal = Signal(placed, valid, rate, axis.unit, start_s)
    return AxisResult(
        name=axis.name,
        unit=axis.unit,
        statistics={name: getattr(summary, name) for name in STATISTICS},
        noise_density=density,
        noise_density_methods=methods,
        allan=curve,
        model=model,
        psd=None if spread is None else _density(spread),
        checks=None if constant else examine(signal, curve, model, settings.confidence),
        outliers=summary.outliers.count,
        histogram=None if constant else normality.histogram(kept, axis.unit, _BINS),
        envelope=envelope(axis.values, grid, start_s),
    )


def _placed(values: Floats, grid: Grid) -> tuple[Floats, Bools | None]:
    """Return samples on the regular grid, and where there are any; None for everywhere."""
    return (values, None) if grid.regular else timing.place(values, grid)


def _other_densities(
    std: Estimate, spread: Spectrum | None, rate: float, confidence: float
) -> dict[str, Estimate]:
    """Return the noise density from the spectrum and from σ over half the sample rate."""
    if spread is None:
        return {}
    return {
        'plateau': spectrum.plateau(spread, confidence=confidence),
        'sigma': spectrum.density_from_sigma(std, 0.5 * rate),
    }


def _spectrum(
    placed: Floats, rate: float, unit: str, valid: Bools | None, settings: Settings
) -> Spectrum | None:
    """Return the spectrum, or None where no stretch without a gap is long enough."""
    try:
        return spectrum.psd(placed, rate, unit, valid=valid, confidence=settings.confidence)
    except DataError:
        # the gaps that cause it are a finding of their own
        return None


def _density(spread: Spectrum) -> Density:
    found = spectrum.tones(spread, FALSE_ALARM)
    return replace(bands(spread), tones=tuple((tone.frequency, tone.amplitude) for tone in found))
