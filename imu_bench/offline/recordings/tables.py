# SPDX-License-Identifier: Apache-2.0
"""From rows and columns with known meaning to samples, whatever the table they come from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from imu_bench.errors import RecordingError
from imu_bench.offline.recordings.columns import Assigned
from imu_bench.offline.recordings.source import Chunk
from imu_bench.samples import Samples
from msg_conversions.quantities import BY_NAME
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

DECIMALS = {'s': 9, 'ms': 6, 'µs': 3, 'ns': 0}
"""Power of ten that makes nanoseconds of a unit."""

_SECOND = 1_000_000_000
_MAX_SECONDS = 9.2e9


def chunk_of(columns: Sequence[Assigned], values: Floats, stamps: Integers) -> Chunk:
    """Return samples."""
    fields: dict[str, Any] = {}
    for place, column in enumerate(columns):
        quantity = BY_NAME[column.quantity]
        if not quantity.components:
            fields[quantity.field] = values[:, place]
            continue
        table = fields.setdefault(quantity.field, np.full((stamps.size, *quantity.shape), np.nan))
        table[:, quantity.columns.index(column.target)] = values[:, place]
    return Chunk(Samples(stamps, **fields))


def in_nanoseconds(seconds: Floats) -> Integers:
    """Return times in ns."""
    if not (np.abs(seconds) < _MAX_SECONDS).all():
        raise RecordingError('a time is not finite or does not fit 64 bits of nanoseconds')
    return np.rint(seconds * _SECOND).astype(np.int64)


_MAX_SPREAD = 0.5
"""Rows of one sample lie closer together than this share of the sample period."""


class Merger:
    """Joins rows into samples: a sample ends where a column is filled for the second time."""

    def __init__(self, inertial: npt.NDArray[np.bool_]) -> None:
        self._inertial = inertial
        self._values = np.empty((0, inertial.size))
        self._stamps = np.empty(0, np.int64)
        self._spread: float | None = None
        # rows, samples: rows taken in, samples given out
        self.rows = 0
        self.samples = 0

    def add(self, values: Floats, stamps: Integers) -> tuple[Floats, Integers]:
        """Take in rows; return the samples that are complete."""
        self.rows += len(values)
        values = np.concatenate((self._values, values))
        stamps = np.concatenate((self._stamps, stamps))
        filled = ~np.isnan(values)
        kept = (filled & self._inertial).any(axis=1)
        values, stamps, filled = values[kept], stamps[kept], filled[kept]
        if self._spread is None:
            self._spread = _MAX_SPREAD * _period(filled[:, self._inertial], stamps)
        group = self._groups(filled & self._inertial, stamps)
        if not group.size:
            self._values, self._stamps = values, stamps
            return values[:0], stamps[:0]
        last = group == group[-1]
        self._values, self._stamps = values[last], stamps[last]
        return self._joined(values[~last], stamps[~last], group[~last])

    def rest(self) -> tuple[Floats, Integers]:
        """Return the last sample."""
        return self._joined(self._values, self._stamps, np.zeros(len(self._stamps), np.int64))

    def _groups(self, filled: npt.NDArray[np.bool_], stamps: Integers) -> npt.NDArray[np.int64]:
        """Return for each row the number of its sample, ascending."""
        spread = self._spread or 0.0
        masks = (filled * (1 << np.arange(filled.shape[1]))).sum(axis=1).tolist()
        group, seen, start = -1, -1, 0
        groups = []
        for mask, stamp in zip(masks, stamps.tolist(), strict=True):
            if mask & seen or stamp - start > spread:
                group, seen, start = group + 1, 0, stamp
            seen |= mask
            groups.append(group)
        return np.array(groups, np.int64)

    def _joined(
        self, values: Floats, stamps: Integers, group: npt.NDArray[np.int64]
    ) -> tuple[Floats, Integers]:
        if not group.size:
            return values, stamps
        first = np.flatnonzero(np.diff(group, prepend=group[0] - 1))
        joined = np.full((first.size, values.shape[1]), np.nan)
        row, column = np.nonzero(~np.isnan(values))
        joined[group[row] - group[0], column] = values[row, column]
        self.samples += first.size
        return joined, stamps[first]


def _period(filled: npt.NDArray[np.bool_], stamps: Integers) -> float:
    """Return the sample period: the median step between fillings of the fullest column."""
    fullest = int(np.argmax(filled.sum(axis=0)))
    steps = np.diff(stamps[filled[:, fullest]])
    return float(np.median(steps)) if steps.size else float('inf')
