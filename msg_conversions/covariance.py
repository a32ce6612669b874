# SPDX-License-Identifier: Apache-2.0
"""
Covariance matrices of sensor messages by the rules of REP-145 and sensor_msgs/Imu.msg.

Unknown is all zeros; known is the square of the standard deviation on the diagonal;
a quantity that the sensor does not report has -1 as its first element.
"""

from __future__ import annotations

import math

SIZE = 9
"""Elements of a 3 × 3 matrix, row-major (REP-103)."""

UNKNOWN = (0.0,) * SIZE
NOT_REPORTED = (-1.0, *(0.0,) * (SIZE - 1))


def diagonal(stddev: float) -> tuple[float, ...]:
    """
    Return the covariance of three independent axes with one standard deviation.

    Parameters
    ----------
    stddev : float
        In the SI unit of the quantity; 0 for unknown (REP-145, "Common Parameters").

    Returns
    -------
    tuple of 9 float
        Row-major.

    Raises
    ------
    ValueError
        If `stddev` is negative or not finite.

    Examples
    --------
    >>> diagonal(0.5)
    (0.25, 0.0, 0.0, 0.0, 0.25, 0.0, 0.0, 0.0, 0.25)
    >>> diagonal(0.0) == UNKNOWN
    True
    """
    if not math.isfinite(stddev) or stddev < 0.0:
        raise ValueError(f'a standard deviation is finite and not negative, got {stddev}')
    variance = float(stddev) ** 2
    return tuple(variance if index % 4 == 0 else 0.0 for index in range(SIZE))


def reported(first_element: float) -> bool:
    """
    Return whether a message reports the quantity at all.

    Parameters
    ----------
    first_element : float
        Element 0 of its covariance.

    Examples
    --------
    >>> reported(NOT_REPORTED[0]), reported(UNKNOWN[0])
    (False, True)
    """
    return first_element != -1.0
