# SPDX-License-Identifier: Apache-2.0
"""What figures on a page and in files share: colours, units, ranges, the parts of a model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import NamedTuple

from imu_bench.metrology.fitting.noise_model import gauss_markov_variance, NoiseModel, variance_of
from imu_bench.offline.axis_result import AxisResult
from imu_bench.offline.notation import readable_unit
from imu_bench.offline.results import RecordingResult
from imu_bench.units import convert
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

AXIS_COLOURS = {'x': '#c8492e', 'y': '#2f9e74', 'z': '#1f4690'}
"""Red, green and blue as in every 3-D viewer; L* of 49, 58 and 31 keeps them apart in grey."""

AXIS_MARKERS = {'x': 'circle', 'y': 'square', 'z': 'triangle'}

SENSOR_COLOURS = (
    '#2f62b0',
    '#d9822b',
    '#2a8a5f',
    '#c8492e',
    '#7b5ba6',
    '#8a6d3b',
    '#d06ba0',
    '#5f6b7a',
    '#a3a329',
    '#2aa1b3',
)
"""For sensors in one plot, in their order; they repeat after ten."""

SENSOR_MARKERS = ('circle', 'square', 'triangle', 'diamond', 'inverted_triangle', 'plus', 'x')
"""Beside the colours, for print in grey and for those who see few colours."""

AXIS_DASHES = {'x': 'solid', 'y': 'dashed', 'z': 'dotted'}

INK, FAINT = '#1f2933', '#66727f'

_MARGIN = 1.6  # factor of empty space above and below the data of a logarithmic plot
_HALF_VIEW = 4.0  # factor above and below the middle of a spectrum that is always shown


def time_unit(duration_s: float) -> str:
    """Return the unit in which a time axis of this length is read."""
    return 's' if duration_s < 600.0 else 'min' if duration_s < 7200.0 else 'h'


def bar_places(groups: int, group: int) -> tuple[float, float]:
    """
    Return offset and width of the bars of one series, side by side with those of the others.

    Examples
    --------
    >>> bar_places(2, 0)
    (-0.2, 0.4)
    """
    width = 0.8 / max(1, groups)
    return (group - (groups - 1) / 2.0) * width, width


def drawable(axis: AxisResult) -> bool:
    """Return whether a logarithmic plot can show anything of the deviation."""
    return axis.allan is not None and bool(np.any(axis.allan.deviation > 0.0))


class Drawn(NamedTuple):
    """One axis among those of all sensors, and how its sensor is drawn."""

    label: str
    colour: str
    marker: str
    axis: AxisResult


def of_all(
    recordings: Sequence[RecordingResult], labels: Sequence[str], quantity: str
) -> list[Drawn]:
    """Return every axis of a quantity with the look of its sensor."""
    looks = zip(recordings, labels, cycle(SENSOR_COLOURS), cycle(SENSOR_MARKERS))
    return [
        Drawn(label, colour, marker, axis)
        for recording, label, colour, marker in looks
        for axis in recording.of(quantity)
    ]


def few(size: int, wanted: int = 9) -> slice:
    """
    Return which points of a curve get a marker.

    Examples
    --------
    >>> list(range(20))[few(20, 5)]
    [0, 4, 8, 12, 16]
    """
    return slice(None, None, max(1, size // wanted))


def series_colours(figures: Sequence[Sequence[str]]) -> list[list[str]]:
    """
    Return the colours of the labels of each figure: a sensor has one colour on the whole page.

    Labels that begin with the letter of an axis have the colour of the axis. Where two sensors,
    or two lines of one sensor, would share a colour, the figure counts through the colours.

    Examples
    --------
    >>> series_colours([['a', 'b'], ['b z'], ['x', 'x set']]) == [
    ...     list(SENSOR_COLOURS[:2]), [SENSOR_COLOURS[1]], [AXIS_COLOURS['x']] * 2]
    True
    """
    words = dict.fromkeys(
        label.split(' ')[0] for labels in figures for label in labels if not _of_axis(label)
    )
    known = dict(zip(words, cycle(SENSOR_COLOURS)))
    return [_colours(labels, known) for labels in figures]


def _colours(labels: Sequence[str], known: Mapping[str, str]) -> list[str]:
    if labels and all(map(_of_axis, labels)):
        return [AXIS_COLOURS[label[0]] for label in labels]
    found = [known.get(label.split(' ')[0], '') for label in labels]
    if '' not in found and len(set(found)) == len(set(labels)):
        return found
    counted = dict(zip(dict.fromkeys(labels), cycle(SENSOR_COLOURS)))
    return [counted[label] for label in labels]


def _of_axis(label: str) -> bool:
    return label.split(' ')[0] in AXIS_COLOURS


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


def model_parts(model: NoiseModel, tau: Floats) -> list[Floats]:
    """Return the deviation of each term of the curve that was fitted: observable or not."""
    sizes = model.fitted or model.values
    parts = [np.sqrt(variance_of({term: size}, tau)) for term, size in sizes.items()]
    process = model.gauss_markov
    if process is not None and process.q_c.value and process.T_c.value:
        parts.append(process.q_c.value * np.sqrt(gauss_markov_variance(tau, process.T_c.value)))
    return parts


def model_tau(axis: AxisResult) -> Floats | None:
    """Return averaging times for the curve of the model, or None if there is no model."""
    if axis.allan is None or not (axis.model.fitted or axis.model.values):
        return None
    return np.geomspace(axis.allan.tau[0], axis.allan.tau[-1], 60)


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
