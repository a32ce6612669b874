# SPDX-License-Identifier: Apache-2.0
"""The samples of one topic, put together as they come, in memory or in files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from imu_bench.offline.recordings.source import Chunk, Covariance
from msg_conversions.quantities import BY_FIELD
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

PIECE = 1 << 20
"""Samples looked at together where a whole column would be too many."""

_GROWTH = 2


def agreed(first: Sequence[Covariance], second: Sequence[Covariance]) -> tuple[Covariance, ...]:
    """Return what two runs of messages have in common."""
    return tuple(
        one if one is not None and repr(one) == repr(other) else None  # NaN equals itself, too
        for one, other in zip(first, second, strict=True)
    )


class Allocate(Protocol):
    """Returns a new array; its content does not matter."""

    def __call__(self, shape: Sequence[int], dtype: npt.DTypeLike) -> npt.NDArray[Any]: ...


class Gathered:
    """
    Columns that grow chunk by chunk.

    Each column lies in one piece, so that an axis is read without the others.
    """

    def __init__(self, expected: int, allocate: Allocate = np.empty) -> None:
        self.size = 0  # samples so far
        self._allocate = allocate
        self._room = max(1, expected)
        self._times: dict[str, Integers] = {}
        self._columns: dict[str, Floats] = {}
        self._without: set[str] = set()
        self._frame_ids: dict[str, None] = {}
        self.covariances: tuple[Covariance, ...] = ()  # what the chunks agree on

    def add(self, chunk: Chunk) -> None:
        """Append a chunk; quantities that it does not have become NaN."""
        start, end = self.size, self.size + len(chunk)
        if end > self._room:
            self._grow(max(end, _GROWTH * self._room))
        self._time('stamps')[start:end] = chunk.samples.stamps
        for name, times in (('receive', chunk.receive_ns), ('outer', chunk.outer_ns)):
            if times is None:
                self._without.add(name)
            elif name not in self._without:
                self._time(name)[start:end] = times
        found = chunk.samples.columns
        for name, values in found.items():
            self._column(name)[:, start:end] = values.reshape(end - start, -1).T
        for name in self._columns.keys() - found.keys():
            self._columns[name][:, start:end] = np.nan
        self._frame_ids.update(dict.fromkeys(chunk.frame_ids))
        self.covariances = (
            agreed(self.covariances, chunk.covariances) if start else chunk.covariances
        )
        self.size = end

    @property
    def frame_ids(self) -> tuple[str, ...]:
        """Each frame_id that occurs, in the order found."""
        return tuple(self._frame_ids)

    @property
    def stamps(self) -> Integers:
        """Stamps of the measurement, shape (n,)."""
        return self._time('stamps')[: self.size]

    @property
    def receive_ns(self) -> Integers | None:
        """Times of arrival, shape (n,); None unless every chunk had them."""
        return None if 'receive' in self._without else self._time('receive')[: self.size]

    @property
    def outer_ns(self) -> Integers | None:
        """Stamps of the headers around the messages; None unless every chunk had them."""
        return None if 'outer' in self._without else self._time('outer')[: self.size]

    def column(self, name: str) -> Floats | None:
        """Return one quantity, shape (n, 3) or (n,); None if no chunk had it."""
        if name not in self._columns:
            return None
        rows = self._columns[name][:, : self.size]
        return rows.T if BY_FIELD[name].components else rows[0]

    def keep(self, good: npt.NDArray[np.bool_]) -> None:
        """Leave out the samples that are not good."""
        size = 0
        every = [*self._times.values(), *(row for rows in self._columns.values() for row in rows)]
        for start in range(0, self.size, PIECE):
            part = slice(start, min(start + PIECE, self.size))
            chosen = good[part]
            count = int(np.count_nonzero(chosen))
            for array in every:
                array[size : size + count] = array[part][chosen]
            size += count
        self.size = size

    def _time(self, name: str) -> Integers:
        if name not in self._times:
            self._times[name] = self._allocate((self._room,), np.int64)
        return self._times[name]

    def _column(self, name: str) -> Floats:
        if name not in self._columns:
            rows = self._allocate((len(BY_FIELD[name].columns), self._room), np.float64)
            rows[:, : self.size] = np.nan
            self._columns[name] = rows
        return self._columns[name]

    def _grow(self, room: int) -> None:
        self._room = room
        for name, array in self._times.items():
            self._times[name] = self._grown(array, (room,))
        for name, rows in self._columns.items():
            self._columns[name] = self._grown(rows, (len(rows), room))

    def _grown(self, array: npt.NDArray[Any], shape: tuple[int, ...]) -> npt.NDArray[Any]:
        larger = self._allocate(shape, array.dtype)
        for start in range(0, self.size, PIECE):
            part = slice(start, min(start + PIECE, self.size))
            larger[..., part] = array[..., part]
        return larger
