# SPDX-License-Identifier: Apache-2.0
"""What several plans need: sensors by name, and times."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

from imu_bench.errors import DataError, RecordingError
from imu_bench.metrology.stamps import time_grid
from imu_bench.offline.comparison import labels, Named
from imu_bench.offline.recordings import Recording
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Sensor = TypeVar('Sensor', bound=Named)

DRAWN = 2000
"""Points of a line in a figure."""


def place(recording: Recording) -> str:
    """
    Return how error texts name a recording.

    A text file is its own only topic.
    """
    return f'{recording.source}, {recording.topic}'


def seconds(recording: Recording, since_ns: int | None = None) -> Floats:
    """Return the stamps of a recording in s since a time, its first sample by default."""
    stamps = recording.samples.stamps
    start = int(stamps[0]) if since_ns is None else since_ns
    return np.asarray((stamps - start) * 1e-9, np.float64)


def rate_of(recording: Recording) -> float:
    """
    Return the true sample rate in Hz.

    Raises
    ------
    RecordingError
        If the stamps do not advance.
    """
    try:
        return 1.0 / time_grid.grid(recording.samples.stamps).period_s
    except DataError as error:
        raise RecordingError(f'{place(recording)}: {error}') from error


def thinned(x: Floats, y: Floats, points: int = DRAWN) -> tuple[Floats, Floats]:
    """
    Return means of equally many samples each, at most so many of them.

    Examples
    --------
    >>> thinned(np.arange(6.0), np.arange(6.0), 3)[1].tolist()
    [0.5, 2.5, 4.5]
    """
    size = -(-x.size // points)
    count = x.size // size
    first, second = (values[: count * size].reshape(count, size).mean(axis=1) for values in (x, y))
    return first, second


def named(measured: Sequence[Sensor], reference: str = '') -> list[tuple[str, Sensor]]:
    """
    Return what was measured with short unique names of the sensors; the reference first.

    Raises
    ------
    RecordingError
        If the reference is not among them.
    """
    names = labels(measured)
    if reference and reference not in names:
        raise RecordingError(f'--reference {reference}: not among the sensors: {", ".join(names)}')
    return sorted(zip(names, measured, strict=True), key=lambda pair: pair[0] != reference)
