# SPDX-License-Identifier: Apache-2.0
"""Allan deviations and spectra, of one sensor and of many in one figure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
import math
from typing import NamedTuple

from imu_bench.metrology.estimate import CONFIDENCE
from imu_bench.metrology.fitting.noise_model import gauss_markov_variance, NoiseModel, variance_of
from imu_bench.offline.analysis.axis_result import AxisResult
from imu_bench.offline.notation import readable_unit, text
from imu_bench.offline.presentation.figure import (
    ALL,
    AXIS_COLOURS,
    AXIS_DASHES,
    AXIS_MARKERS,
    Figure,
    Floats,
    INK,
    Series,
)
from imu_bench.units import convert
import numpy as np

NOISIEST = 'noisiest axis'
"""What many sensors show at once."""

TAU, FREQUENCY = 'averaging time τ in s', 'frequency in Hz'
_FIT_POINTS = 60
_MARGIN = 1.6  # factor of empty space above and below the data of a logarithmic plot
_HALF_VIEW = 4.0  # factor above and below the middle of a spectrum that is always shown
_BANDS = 10  # of more sensors or runs they cover one another: the pointer shows the intervals
_TALL = 1.2  # height where many sensors share a plot


class Row(NamedTuple):
    """One axis among those of all sensors, and how it is drawn."""

    label: str
    colour: str
    marker: str
    axis: AxisResult


def drawable(axis: AxisResult) -> bool:
    """Return whether a logarithmic plot can show anything of the deviation."""
    return axis.allan is not None and bool(np.any(axis.allan.deviation > 0.0))


def allan(axes: Sequence[AxisResult], name: str) -> Figure:
    """Return Allan deviation, interval, fitted model and its parts, for all axes of a quantity."""
    drawn = [axis for axis in axes if drawable(axis)]
    unit = _allan_unit(axes)
    measured = [_deviation(axis, unit, width=1.8) for axis in drawn]
    fits = [
        Series('fit', tau, axis.model.deviation(tau) * convert(1.0, axis.unit, unit),
               colour=INK, dash='dashed', width=1.2, marker='none', silent=True,
               choices=(ALL, axis.letter))
        for axis in drawn
        if (tau := _fitted_tau(axis)) is not None
    ]  # fmt: skip
    parts = [part for axis in drawn for part in (*_parts(axis, unit), *_named_terms(axis, unit))]
    letters = tuple(axis.letter for axis in drawn)
    confidence = next((axis.allan.confidence for axis in drawn if axis.allan), CONFIDENCE)
    return Figure(
        f'{name}: Allan deviation', TAU, f'Allan deviation in {unit}',
        (*measured, *fits, *parts), log_x=True, log_y=True, view=_allan_view(drawn, unit),
        key=((f'{100.0 * confidence:g} % interval', 'band'),),
        choices=(ALL, *letters) if len(letters) > 1 else letters,
    )  # fmt: skip


def compare_allan(rows: Sequence[Row], title: str) -> Figure:
    axes = [row.axis for row in rows]
    unit = _allan_unit(axes)
    chosen = _choices(rows, _loudness_of_curve)
    quiet = len({row.label for row in rows}) <= _BANDS
    series = tuple(
        Series(row.label, *_points(row.axis, unit), words=_noise_words(row.axis), width=1.5,
               name=f'{row.label} {row.axis.letter}', colour=row.colour, marker=row.marker,
               dash=AXIS_DASHES[row.axis.letter], choices=choices, band=quiet)
        for row, choices in zip(rows, chosen, strict=True)
    )  # fmt: skip
    return Figure(title, TAU, f'Allan deviation in {unit}', series, log_x=True, log_y=True,
                  view=_allan_view(axes, unit), height=_TALL, choices=_offered(rows),
                  key=tuple(AXIS_DASHES.items()))  # fmt: skip


def compare_spectrum(rows: Sequence[Row], title: str) -> Figure:
    axes = [row.axis for row in rows]
    unit = density_unit(axes)
    series = tuple(
        replace(density(row, unit, AXIS_DASHES[row.axis.letter]), choices=choices)
        for row, choices in zip(rows, _choices(rows, _loudness_of_spectrum), strict=True)
    )
    return Figure(title, FREQUENCY, f'amplitude density in {unit}', series, log_x=True,
                  log_y=True, view=density_view(axes, unit), height=_TALL,
                  choices=_offered(rows), key=tuple(AXIS_DASHES.items()))  # fmt: skip


def _offered(rows: Sequence[Row]) -> tuple[str, ...]:
    """Return what can be chosen: nothing where every sensor has one axis only."""
    letters = dict.fromkeys(row.axis.letter for row in rows)
    return (NOISIEST, *letters, ALL) if len(letters) > 1 else ()


def _choices(
    rows: Sequence[Row], loudness: Callable[[AxisResult], float]
) -> Iterator[tuple[str, ...]]:
    """Yield under which choices each axis is seen: one curve per sensor is quiet enough."""
    if not _offered(rows):
        yield from (() for _ in rows)
        return
    loudest = {
        row.label: row.axis.letter for row in sorted(rows, key=lambda row: loudness(row.axis))
    }
    for row in rows:
        first = (NOISIEST,) if loudest[row.label] == row.axis.letter else ()
        yield (*first, row.axis.letter, ALL)


def _loudness_of_curve(axis: AxisResult) -> float:
    """Return the geometric mean of the deviation, as the eye takes a curve on paper."""
    curve = axis.allan
    positive = np.empty(0) if curve is None else curve.deviation[curve.deviation > 0.0]
    return float(np.log(positive).mean()) if positive.size else -math.inf


def _loudness_of_spectrum(axis: AxisResult) -> float:
    return -math.inf if axis.psd is None else float(np.median(axis.psd.density))


def _allan_unit(axes: Sequence[AxisResult]) -> str:
    typical = [float(np.median(axis.allan.deviation)) for axis in axes if axis.allan is not None]
    return readable_unit(axes[0].unit, 'level', typical)


def density_unit(axes: Sequence[AxisResult]) -> str:
    sizes = [axis.white_density.value for axis in axes]
    return readable_unit(axes[0].noise_density.unit, 'density', sizes)


def _points(axis: AxisResult, unit: str) -> tuple[Floats, Floats, Floats, Floats]:
    """Return τ, deviation and the ends of its interval."""
    curve, factor = axis.allan, convert(1.0, axis.unit, unit)
    if curve is None:
        return np.empty(0), np.empty(0), np.empty(0), np.empty(0)
    return curve.tau, curve.deviation * factor, curve.low * factor, curve.high * factor


def datasheet_curve(axes: Sequence[AxisResult], name: str) -> Figure:
    """Return the Allan deviation with N, B and K of the noisiest axis where the curve has them."""
    unit = _allan_unit(axes)
    drawn = [axis for axis in axes if drawable(axis)]
    measured = [replace(_deviation(axis, unit, 1.8), choices=()) for axis in drawn]
    loudest = max(drawn, key=_loudness_of_curve)
    named = [replace(part, choices=()) for part in _named_terms(loudest, unit, of=True)]
    confidence = next((axis.allan.confidence for axis in drawn if axis.allan), CONFIDENCE)
    return Figure(
        f'{name}: Allan deviation', TAU, f'Allan deviation in {unit}', (*measured, *named),
        log_x=True, log_y=True, view=_allan_view(drawn, unit),
        key=((f'{100.0 * confidence:g} % interval', 'band'),),
    )  # fmt: skip


def _deviation(axis: AxisResult, unit: str, width: float) -> Series:
    return Series(axis.letter, *_points(axis, unit), words=_noise_words(axis), width=width,
                  colour=AXIS_COLOURS[axis.letter], marker=AXIS_MARKERS[axis.letter],
                  choices=(ALL, axis.letter))  # fmt: skip


def _noise_words(axis: AxisResult) -> tuple[str, ...]:
    return () if axis.allan is None else tuple(axis.allan.noise)


def density(row: Row, unit: str, dash: str = 'solid') -> Series:
    """Return the amplitude density where a logarithmic plot can show it."""
    psd, letter = row.axis.psd, row.axis.letter
    if psd is None:
        return Series(row.label, np.empty(0), np.empty(0))
    shown = psd.density > 0.0
    height = np.sqrt(psd.density[shown]) * convert(1.0, f'{row.axis.unit}/√Hz', unit)
    return Series(row.label, psd.frequency[shown], height, dash=dash, colour=row.colour,
                  width=1.3, marker=row.marker,
                  name=row.label if row.label == letter else f'{row.label} {letter}')  # fmt: skip


def _model_tau(axis: AxisResult) -> Floats | None:
    """Return averaging times for the curve of the model, or None if there is no model."""
    if axis.allan is None or not (axis.model.fitted or axis.model.values):
        return None
    return np.geomspace(axis.allan.tau[0], axis.allan.tau[-1], _FIT_POINTS)


def _fitted_tau(axis: AxisResult) -> Floats | None:
    """Return those of the range that the model was fitted to."""
    tau = _model_tau(axis)
    if tau is None:
        return None
    return tau[(tau >= axis.model.tau_low) & (tau <= axis.model.tau_high)]


def _parts(axis: AxisResult, unit: str) -> Iterator[Series]:
    """Yield the deviation of each term of the curve that was fitted: observable or not."""
    tau = _model_tau(axis)
    if tau is None:
        return
    factor = convert(1.0, axis.unit, unit)
    for part in _terms(axis.model, tau):
        yield Series('its terms', tau, part * factor, colour=AXIS_COLOURS[axis.letter],
                     dash='dotted', width=1.0, marker='none', silent=True,
                     choices=(axis.letter,))  # fmt: skip


def _named_terms(axis: AxisResult, unit: str, *, of: bool = False) -> Iterator[Series]:
    """Yield N, B and K with their values, each where the curve shows it, perhaps of which axis."""
    curve, model = axis.allan, axis.model
    if curve is None or not axis.shows_constants:
        return
    first, last = float(curve.tau[0]), float(curve.tau[-1])
    # N is read at 1 s and K at 3 s; the floor of B touches the curve where that is lowest
    lowest = float(curve.tau[int(np.argmin(curve.deviation))])
    at = {'N': min(max(1.0, first), last), 'B': lowest, 'K': last}
    seen = {term: axis.coefficient(term) for term in at if getattr(model, term).value is not None}
    if not seen:
        return
    tau = np.array([at[term] for term in seen])
    height = model.deviation(tau) * convert(1.0, axis.unit, unit)
    words = tuple(
        f'{term}{"_" + axis.letter if of else ""} = '
        f'{text(found, readable_unit(found.unit, term, [found.value]))}'
        for term, found in seen.items()
    )
    yield Series('N, B, K', tau, height, kind='marks', colour=AXIS_COLOURS[axis.letter],
                 name=axis.letter, words=words, choices=(axis.letter,))  # fmt: skip


def _terms(model: NoiseModel, tau: Floats) -> Iterator[Floats]:
    for term, size in (model.fitted or model.values).items():
        yield np.sqrt(variance_of({term: size}, tau))
    process = model.gauss_markov
    if process is not None and process.q_c.value and process.T_c.value:
        yield process.q_c.value * np.sqrt(gauss_markov_variance(tau, process.T_c.value))


def _allan_view(axes: Sequence[AxisResult], unit: str) -> tuple[float, float] | None:
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
