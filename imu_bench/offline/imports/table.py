# SPDX-License-Identifier: Apache-2.0
"""The native CSV: stamps in s with nine decimals, SI units, every digit that a number has."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from imu_bench.offline.imports.tracks import reported
from imu_bench.offline.recordings import Recording
from imu_bench.samples import AXES, Samples
import numpy as np
import numpy.typing as npt

BLOCK = 1 << 14
"""Rows that are written at once."""

_NANO = 1_000_000_000
_VECTORS = {
    'linear_acceleration': 'acceleration',
    'angular_velocity': 'angular_velocity',
    'magnetic_field': 'magnetic_field',
}


def write(path: Path, recording: Recording, step: Callable[[int], None]) -> None:
    """
    Write a recording as the CSV that needs no option to be read.

    Parameters
    ----------
    path : Path
    recording : Recording
    step : callable
        Called with the number of rows written since.

    Raises
    ------
    OSError
        If the disk is full or fails.
    """
    columns = named_columns(recording.samples, turns=reported(recording))
    with path.open('w', encoding='ascii', newline='') as file:
        file.write(','.join(['stamp_s', *columns]) + '\n')
        for start in range(0, len(recording), BLOCK):
            part = slice(start, min(start + BLOCK, len(recording)))
            table = np.column_stack([column[part] for column in columns.values()])
            file.write(rows(recording.samples.stamps[part], table))
            step(part.stop - part.start)


def named_columns(samples: Samples, *, turns: bool = False) -> dict[str, npt.NDArray[np.float64]]:
    """
    Return the columns that hold numbers, by their names in the header.

    Examples
    --------
    >>> list(named_columns(Samples(stamps=[0], angular_velocity=[[np.nan, np.nan, 0.1]])))
    ['angular_velocity.z']
    """
    found: dict[str, npt.NDArray[np.float64]] = {}
    for name, field in _VECTORS.items():
        values = getattr(samples, field)
        if values is not None:
            found |= {f'{name}.{axis}': values[:, place] for place, axis in enumerate(AXES)}
    # an axis is there in every sample or in none
    found = {name: column for name, column in found.items() if not np.isnan(column[:1]).any()}
    if samples.temperature is not None:
        found['temperature_degC'] = samples.temperature
    if samples.orientation is not None and turns:
        places = enumerate((*AXES, 'w'))
        found |= {f'orientation.{axis}': samples.orientation[:, place] for place, axis in places}
    return found


def rows(stamps: npt.NDArray[np.int64], table: npt.NDArray[np.float64]) -> str:
    r"""
    Return rows of text from which the same bits come back.

    Parameters
    ----------
    stamps : ndarray of int64, shape (n,)
        In ns.
    table : ndarray of float64, shape (n, columns)

    Examples
    --------
    >>> rows(np.array([-1, 1_700_000_000_000_000_001]), np.array([[0.1, 2.0], [1e-9, 1 / 3]]))
    '-0.000000001,0.1,2.0\n1700000000.000000001,1e-09,0.3333333333333333\n'
    """
    lines = []
    for stamp, values in zip(stamps.tolist(), table.tolist(), strict=True):
        sec, nanosec = divmod(abs(stamp), _NANO)
        sign = '-' if stamp < 0 else ''
        # a list writes the shortest digits that give the same float again
        lines.append(f'{sign}{sec}.{nanosec:09d},{repr(values)[1:-1]}\n')
    return ''.join(lines).replace(', ', ',')
