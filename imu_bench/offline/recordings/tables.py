# SPDX-License-Identifier: Apache-2.0
"""From columns with known meaning to samples, whatever the table they come from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from imu_bench.errors import RecordingError
from imu_bench.offline.recordings.columns import Column
from imu_bench.offline.recordings.source import Chunk
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

DECIMALS = {'s': 9, 'ms': 6, 'µs': 3, 'ns': 0}
"""Power of ten that makes nanoseconds of a unit."""

_FIELDS = {
    'linear_acceleration': 'acceleration',
    'angular_velocity': 'angular_velocity',
    'magnetic_field': 'magnetic_field',
    'temperature': 'temperature',
}
_SECOND = 1_000_000_000
_MAX_SECONDS = 9.2e9


def chunk_of(columns: Sequence[Column], values: Floats, stamps: Integers) -> Chunk:
    """
    Return samples.

    Parameters
    ----------
    columns : sequence of Column
        What each column of the values is.
    values : ndarray, shape (n, columns)
        In SI.
    stamps : ndarray of int64, shape (n,)
        In ns.
    """
    fields: dict[str, Any] = {}
    for place, column in enumerate(columns):
        name = _FIELDS[column.quantity]
        if column.quantity == 'temperature':
            fields[name] = values[:, place]
            continue
        table = fields.setdefault(name, np.full((stamps.size, 3), np.nan))
        table[:, 'xyz'.index(column.target[-1])] = values[:, place]
    return Chunk(stamps=stamps, **fields)


def in_nanoseconds(seconds: Floats) -> Integers:
    """
    Return times in ns.

    Raises
    ------
    RecordingError
        If a time is not finite or beyond what 64 bits hold.

    Examples
    --------
    >>> in_nanoseconds(np.array([0.5])).tolist()
    [500000000]
    """
    if not (np.abs(seconds) < _MAX_SECONDS).all():
        raise RecordingError('a time is not finite or does not fit 64 bits of nanoseconds')
    return np.rint(seconds * _SECOND).astype(np.int64)
