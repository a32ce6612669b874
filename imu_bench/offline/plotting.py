# SPDX-License-Identifier: Apache-2.0
"""How figures on a page and in files look: the colours, markers and dashes of axes and sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import NamedTuple

from imu_bench.offline.axis_result import AxisResult
from imu_bench.offline.results import RecordingResult

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
