# SPDX-License-Identifier: Apache-2.0
"""Every metric of one axis."""

from __future__ import annotations

from dataclasses import replace

from imu_bench.errors import DataError
from imu_bench.metrology import allan, coefficients, normality, statistics, workspace
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.likelihood.verdict import judged
from imu_bench.metrology.noise_fit import fitted
from imu_bench.metrology.normality import Histogram, histogram
from imu_bench.metrology.spectra import spectrum
from imu_bench.metrology.spectra.spectrum import Spectrum
from imu_bench.metrology.stamps import timing
from imu_bench.metrology.stamps.timing import Grid
from imu_bench.offline.analysis.axes import Axis
from imu_bench.offline.analysis.axis_result import AxisResult, Density, Envelope, STATISTICS
from imu_bench.offline.analysis.checks import examine, hear, NO_CHECKS, Signal, slow_part
from imu_bench.offline.analysis.settings import Settings
from imu_bench.offline.analysis.temperature import effect, Warmth
from imu_bench.offline.health.finding import FALSE_ALARM
from imu_bench.offline.stages import stage
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

_BINS = 80


@stage('statistics')
def measure(
    axis: Axis, grid: Grid, start_s: float, settings: Settings, warm: Warmth | None = None
) -> AxisResult:
    """Return everything that is measured on one axis."""
    kept = _kept(axis.values, grid)
    rate = 1.0 / grid.period_s
    summary = statistics.describe(kept, axis.unit, settings.confidence)
    settled, std = axis.values, summary.std
    if axis.spikes.size:
        settled = statistics.without_spikes(axis.values, axis.spikes)
        std = statistics.describe(_kept(settled, grid), axis.unit, settings.confidence).std
    placed, valid = _placed(settled, grid)
    with stage('deviations'):
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
    constant = summary.minimum.value == summary.maximum.value
    signal = Signal(placed, valid, rate, axis.unit, start_s)
    with stage('fits'):
        fit = fitted(curve, settings.confidence)
        blocks = None if constant else slow_part(signal)
        heard = None if blocks is None else hear(fit, signal, blocks, settings.confidence)
        model = fit if heard is None else judged(fit, *heard, curve)
        checks = NO_CHECKS
        if blocks is not None:
            checks = examine(signal, blocks, curve, fit, heard, model, settings.confidence)
        thermal = None
        if blocks is not None and warm is not None:
            thermal = effect(warm, blocks, axis.unit, settings.confidence)
    with stage('spectra'):
        spread = None if constant else _spectrum(placed, rate, axis.unit, valid, settings)
        psd = None if spread is None else _density(spread)
    density = coefficients.noise_density(model)
    methods = {'allan': density} | _other_densities(std, spread, rate, settings.confidence)
    return AxisResult(
        name=axis.name,
        unit=axis.unit,
        statistics={name: getattr(summary, name) for name in STATISTICS},
        noise_density=density,
        noise_density_methods=methods,
        allan=curve,
        model=model,
        psd=psd,
        choice=None if heard is None else heard[0],
        checks=checks,
        temperature=thermal,
        outliers=summary.outliers.count,
        histogram=None if constant else normality.histogram(kept, axis.unit, _BINS),
        envelope=envelope(axis.values, grid, start_s),
    )


def _kept(values: Floats, grid: Grid) -> Floats:
    """Return the samples that have a place on the grid."""
    return values if grid.keep.all() else workspace.chosen(values, grid.keep)


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


_PIECES = 1000
_PER_DECADE = 30
_BINS = 80
_STAMPS = 2**21


def envelope(values: Floats, grid: Grid, start_s: float = 0.0, pieces: int = _PIECES) -> Envelope:
    """Return the extremes of each of many equal pieces of time."""
    kept, index = values, grid.index
    if not grid.keep.all():
        kept, index = (workspace.chosen(array, grid.keep) for array in (values, grid.index))
    edges = np.unique(np.linspace(0, grid.span, min(pieces, grid.span) + 1).astype(np.int64))
    starts = np.searchsorted(index, edges)
    filled = starts[:-1] < starts[1:]
    low, high = np.full(filled.size, np.nan), np.full(filled.size, np.nan)
    inside = kept[: starts[-1]]
    low[filled] = np.fmin.reduceat(inside, starts[:-1][filled])
    high[filled] = np.fmax.reduceat(inside, starts[:-1][filled])
    return Envelope(np.asarray(start_s + edges[:-1] * grid.period_s, np.float64), low, high)


def intervals(stamps: npt.NDArray[np.int64], period_s: float) -> Histogram | None:
    """
    Return the distribution of the intervals between samples, or None if they are all equal.

    Of a long recording the first two million count; intervals beyond three periods are gaps
    and are left out.
    """
    steps = np.diff(stamps[:_STAMPS]) * 1e-9
    steps = steps[(steps >= 0.0) & (steps < 3.0 * period_s)]
    if steps.size < 2 or np.ptp(steps) <= 1e-6 * period_s:
        return None
    return histogram(steps, 's', _BINS)


def bands(spectrum: Spectrum, per_decade: int = _PER_DECADE) -> Density:
    """
    Return a spectrum averaged in bands of equal logarithmic width; single bins stay as they are.

    The bin at half the rate is left out: a one-sided density halves it, which looks like a drop.
    """
    halved = spectrum.edf.size > 1 and spectrum.edf[-1] < spectrum.edf[-2]
    frequency, density = (
        values[:-1] if halved else values for values in (spectrum.frequency, spectrum.density)
    )
    position = np.floor(np.log10(frequency) * per_decade).astype(np.int64)
    starts = np.flatnonzero(np.concatenate(([True], np.diff(position) > 0)))
    sizes = np.diff(np.append(starts, position.size))
    return Density(
        np.add.reduceat(frequency, starts) / sizes, np.add.reduceat(density, starts) / sizes
    )
