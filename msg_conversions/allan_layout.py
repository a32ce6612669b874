# SPDX-License-Identifier: Apache-2.0
"""
Allan deviation curves inside a std_msgs/Float64MultiArray, and out again.

ROS 2 cannot generate message types in a Python package, so the curves of all axes travel as
one labelled array of three dimensions, ``data[axis][field][tau]``, row-major:

=====  =====================================================================================
dim    label
=====  =====================================================================================
0      ``axis: linear_acceleration.x, …, angular_velocity.z``, the axes in order
1      ``field: tau, deviation, low, high, edf, terms, alpha, log10_tau, log10_deviation``
2      ``tau: start_ns=…, end_ns=…``, the stamps of the first and last sample of the window
=====  =====================================================================================

``size`` and ``stride`` follow std_msgs/MultiArrayDimension: the stride of a dimension is the
number of elements from there to the end.  tau is in s; deviation, low and high in the SI unit
of the quantity (m/s² or rad/s); edf are the equivalent degrees of freedom, terms the
differences that went in, alpha the power-law exponent of the noise.  The logarithms are
there for plotters without logarithmic axes (Foxglove, PlotJuggler).  An axis that cannot be
analysed is NaN throughout, and a curve with fewer points than the longest ends in NaN.
"""

from __future__ import annotations

from collections.abc import Mapping
import re
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

GIVEN = ('tau', 'deviation', 'low', 'high', 'edf', 'terms', 'alpha')
FIELDS = (*GIVEN, 'log10_tau', 'log10_deviation')


class Dimension(NamedTuple):
    """What std_msgs/MultiArrayDimension holds."""

    label: str
    size: int
    stride: int


class AllanArray(NamedTuple):
    """The dimensions and the flat data of the message."""

    dimensions: tuple[Dimension, ...]
    data: Floats


class AllanCurves(NamedTuple):
    """What the message says."""

    # start_ns, end_ns: stamps of the first and the last sample of the window
    start_ns: int
    end_ns: int
    # for each axis its fields (`FIELDS`); an axis that could not be analysed is absent
    curves: dict[str, dict[str, Floats]]


def pack(
    curves: Mapping[str, Mapping[str, npt.ArrayLike] | None], start_ns: int, end_ns: int
) -> AllanArray:
    """
    Return dimensions and data of the message.

    Parameters
    ----------
    curves : mapping of str to mapping or None
        For each axis the fields of `GIVEN`, arrays of shape (k,) with its own k;
        None where there is no curve.
    start_ns, end_ns : int
        Stamps of the first and last sample of the window.

    Raises
    ------
    ValueError
        If the fields of a curve differ in length.

    Examples
    --------
    >>> curve = {name: [1.0, 10.0] for name in GIVEN}
    >>> array = pack({'linear_acceleration.x': curve, 'linear_acceleration.y': None}, 0, 9)
    >>> [dimension.size for dimension in array.dimensions]
    [2, 9, 2]
    >>> array.dimensions[2].label
    'tau: start_ns=0, end_ns=9'
    """
    tables = {}
    for axis, curve in curves.items():
        if curve is not None:
            columns = [np.asarray(curve[name], dtype=np.float64) for name in GIVEN]
            if len({column.shape for column in columns}) != 1:
                raise ValueError(f'the fields of the curve of {axis} differ in length')
            tables[axis] = np.array(columns)
    points = max((table.shape[1] for table in tables.values()), default=0)
    cube = np.full((len(curves), len(FIELDS), points), np.nan)
    for index, axis in enumerate(curves):
        if axis in tables:
            table = tables[axis]
            cube[index, : len(GIVEN), : table.shape[1]] = table
            # a deviation of zero has no logarithm
            logs = np.log10(table[:2], out=np.full_like(table[:2], np.nan), where=table[:2] > 0.0)
            cube[index, len(GIVEN) :, : table.shape[1]] = logs
    labels = (
        'axis: ' + ', '.join(curves),
        'field: ' + ', '.join(FIELDS),
        f'tau: start_ns={start_ns}, end_ns={end_ns}',
    )
    strides = (cube.size, len(FIELDS) * points, points)
    dimensions = map(Dimension, labels, cube.shape, strides)
    return AllanArray(tuple(dimensions), cube.ravel())


def unpack(message: Any) -> AllanCurves:
    """
    Return the curves of a std_msgs/Float64MultiArray that `pack` laid out.

    Parameters
    ----------
    message : std_msgs/Float64MultiArray
        Of rclpy or of rosbags; only its attributes are used.

    Raises
    ------
    ValueError
        If the array is not laid out as this module says.
    """
    dimensions = message.layout.dim
    labels = [dimension.label for dimension in dimensions]
    window = re.fullmatch(r'tau: start_ns=(-?\d+), end_ns=(-?\d+)', labels[-1] if labels else '')
    if (
        len(labels) != 3
        or not labels[0].startswith('axis: ')
        or labels[1] != 'field: ' + ', '.join(FIELDS)
        or window is None
    ):
        raise ValueError(f'no Allan deviation array: its dimensions are labelled {labels}')
    shape = tuple(dimension.size for dimension in dimensions)
    data = np.asarray(message.data, dtype=np.float64)[message.layout.data_offset :]
    axes = labels[0].removeprefix('axis: ').split(', ')
    if data.size != int(np.prod(shape)) or shape[0] != len(axes) or shape[1] != len(FIELDS):
        raise ValueError(f'{data.size} numbers for dimensions of {shape} and axes {axes}')
    curves = {}
    for axis, table in zip(axes, data.reshape(shape), strict=True):
        present = ~np.isnan(table[0])
        if present.any():
            curves[axis] = dict(zip(FIELDS, table[:, present], strict=True))
    return AllanCurves(int(window[1]), int(window[2]), curves)
