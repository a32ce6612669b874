# SPDX-License-Identifier: Apache-2.0
"""Logs of evaluation programs that do not name their columns."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from imu_bench.offline.recordings import cells
from imu_bench.offline.recordings.layout import Layout
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_SAMPLE = 1 << 16
_LEAST_ROWS = 10
_MURATA_WIDTH = 8
_SIZE = 0.15
"""Acceleration of a still sensor may be this far from 1 g, relative: it is moved between tests."""
_ANGLE_DEG = 1.0


class Preset(NamedTuple):
    """Options that a log needs, and what the user is told."""

    columns: str
    units: str
    note: str


def recognise(path: Path, layout: Layout) -> Preset | None:
    """
    Return how to read a log of "Murata MEMS Demo", None if it is none.

    Its columns are time in s, one that is not used, acceleration z, y, x in g, inclination z,
    y, x in degrees, and others (thesis on Murata SCL3300 and TDK IIM-42652, appendices 8, 10
    and 11).  The file proves it: the inclinations are the angles of the accelerations,
    atan(a_x / sqrt(a_y² + a_z²)) and so on (Murata SCL3300 data sheet, section 2.3.4), and these
    are one g long.
    """
    if layout.width < _MURATA_WIDTH or not all(layout.numeric[:_MURATA_WIDTH]):
        return None
    with path.open('rb') as file:
        file.seek(layout.start)
        block = file.read(_SAMPLE)
    complete = block[: block.rfind(b'\n') + 1]
    rows = cells.parse(complete, layout, range(_MURATA_WIDTH), None).values
    rows = rows[np.isfinite(rows).all(axis=1)]
    if len(rows) < _LEAST_ROWS or not (np.diff(rows[:, 0]) > 0).all():
        return None
    return _MURATA if _fits(rows[:, 2:5], rows[:, 5:8]) else None


def _fits(acceleration: Floats, degrees: Floats) -> bool:
    """Return whether accelerations are one g, and angles are theirs."""
    with np.errstate(over='ignore', invalid='ignore'):
        size = np.linalg.norm(acceleration, axis=1)
        others = np.sqrt(np.maximum(size[:, None] ** 2 - acceleration**2, 0.0))
        expected = np.degrees(np.arctan2(acceleration, others))
        off = np.abs(np.abs(degrees) - np.abs(expected))
    return bool(
        abs(float(np.median(size)) - 1.0) < _SIZE
        and (np.median(off, axis=0) < _ANGLE_DEG).all()
        and np.ptp(expected) > 3 * _ANGLE_DEG
    )


_MURATA = Preset(
    'stamp,-,linear_acceleration.z,linear_acceleration.y,linear_acceleration.x',
    'stamp=s,linear_acceleration=g',
    'read as a log of Murata MEMS Demo: time in s, acceleration z, y, x in g (its angles fit '
    'them); name the columns with --columns if it is something else',
)
