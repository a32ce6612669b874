# SPDX-License-Identifier: Apache-2.0
"""Tables whose rows hold a part of a sample each, as phone loggers write them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Values = npt.NDArray[np.float64]
Stamps = npt.NDArray[np.int64]

_MAX_SPREAD = 0.5
"""Rows of one sample lie closer together than this share of the sample period."""


class Merger:
    """
    Joins rows into samples: a sample ends where a column is filled for the second time.

    Parameters
    ----------
    inertial : ndarray of bool, shape (columns,)
        Columns that make a sample; the others are taken along.

    Attributes
    ----------
    rows, samples : int
        Rows taken in, samples given out.

    Examples
    --------
    >>> nan = np.nan
    >>> merger = Merger(np.array([True, True]))
    >>> rows = np.array([[1, nan], [nan, 2], [3, 4.0]])
    >>> values, stamps = merger.add(rows, np.array([0, 1, 20]))
    >>> values.tolist(), merger.rest()[0].tolist()
    ([[1.0, 2.0]], [[3.0, 4.0]])
    """

    def __init__(self, inertial: npt.NDArray[np.bool_]) -> None:
        self._inertial = inertial
        self._values = np.empty((0, inertial.size))
        self._stamps = np.empty(0, np.int64)
        self._spread: float | None = None
        self.rows = 0
        self.samples = 0

    def add(self, values: Values, stamps: Stamps) -> tuple[Values, Stamps]:
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

    def rest(self) -> tuple[Values, Stamps]:
        """Return the last sample."""
        return self._joined(self._values, self._stamps, np.zeros(len(self._stamps), np.int64))

    def _groups(self, filled: npt.NDArray[np.bool_], stamps: Stamps) -> npt.NDArray[np.int64]:
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
        self, values: Values, stamps: Stamps, group: npt.NDArray[np.int64]
    ) -> tuple[Values, Stamps]:
        if not group.size:
            return values, stamps
        first = np.flatnonzero(np.diff(group, prepend=group[0] - 1))
        joined = np.full((first.size, values.shape[1]), np.nan)
        row, column = np.nonzero(~np.isnan(values))
        joined[group[row] - group[0], column] = values[row, column]
        self.samples += first.size
        return joined, stamps[first]


def _period(filled: npt.NDArray[np.bool_], stamps: Stamps) -> float:
    """Return the sample period: the median step between fillings of the fullest column."""
    fullest = int(np.argmax(filled.sum(axis=0)))
    steps = np.diff(stamps[filled[:, fullest]])
    return float(np.median(steps)) if steps.size else float('inf')
