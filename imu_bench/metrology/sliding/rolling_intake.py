# SPDX-License-Identifier: Apache-2.0
"""The entrance of the rolling analysis: what is measured, what is kept, where samples miss."""

from __future__ import annotations

from dataclasses import dataclass

from imu_bench.errors import DataError
from imu_bench.metrology.stamps.continuity import Continuity
from imu_bench.metrology.stamps.stamp_line import straight_line
from imu_bench.metrology.stamps.stamp_rule import Rule
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

PENDING = 4096
"""Samples that wait at most until it is clear whether some are missing before them."""


@dataclass(frozen=True, eq=False)
class Piece:
    """Successive samples whose stamps have been judged."""

    stamps: Integers
    values: Floats  # zero for an axis that is not measured
    breaks: list[int]  # indices of samples before which some are missing
    steps: list[float]  # time in ns across each of these gaps; -1 where the clock was set back

    @classmethod
    def of(cls, stamps: Integers, rows: Floats, keep: Mask, step: Floats) -> Piece:
        """Return the samples that were kept; `step` as `Continuity.settle` gives it."""
        if not keep.all():
            stamps, rows, step = stamps[keep], rows[keep], step[keep]
        breaks = np.flatnonzero(step)
        return cls(stamps, np.ascontiguousarray(rows.T), breaks.tolist(), step[breaks].tolist())


class Intake:
    """Judges blocks of samples as they come."""

    def __init__(self, axes: int, period: float, patience: int) -> None:
        # grows when the set of measured axes changes; everything before is void then
        self.epoch = 0
        self.measured = np.zeros(axes, dtype=np.bool_)
        self.left_out = 0  # rows with a value that is not finite on a measured axis
        self._nominal = period
        self._patience = patience
        self._unusable = 0
        self._faults = np.zeros(2, dtype=np.int64)
        self._stream: Continuity | None = None
        self._clear()

    def _clear(self) -> None:
        if self._stream is not None:
            self._faults += self._stream.duplicates, self._stream.order_faults
        self._stream = None
        self._stamps = np.empty(0, dtype=np.int64)
        self._rows = np.empty((0, self.measured.size))

    @property
    def faults(self) -> tuple[int, int]:
        """Duplicates and order faults dropped so far."""
        duplicates, order = self._faults.tolist()
        if self._stream is not None:
            duplicates += self._stream.duplicates
            order += self._stream.order_faults
        return duplicates, order

    def feed(self, stamps: Integers, rows: Floats) -> Piece:
        """Take a block of samples; return those that are settled."""
        stamps, rows = self._usable(stamps, rows)
        if self._stream is None:
            self._stream = Continuity(self._rule(stamps), PENDING)
        if self._stamps.size:
            rows = np.concatenate([self._rows, rows])
        keep, step = self._stream.settle(stamps)
        if self._stamps.size:
            stamps = np.concatenate([self._stamps, stamps])
        done = keep.size
        self._stamps, self._rows = stamps[done:].copy(), rows[done:].copy()
        return Piece.of(stamps[:done], rows[:done], keep, step)

    def tail(self) -> Piece:
        """Return the samples that are not settled, judged as if nothing followed."""
        if self._stream is None or self._stamps.size == 0:
            return Piece.of(self._stamps, self._rows, np.empty(0, np.bool_), np.empty(0))
        return Piece.of(self._stamps, self._rows, *self._stream.preview())

    def review(self, stamps: Integers, breaks: Integers, steps: Floats) -> None:
        """Measure the sample period anew from the samples of the window."""
        if self._stream is None:
            return
        known = self._stream.rule.period
        line = straight_line(stamps, breaks, steps, known)
        if 0.5 * known < line.period < 2.0 * known:
            self._stream.rule = Rule.of(stamps, line.period)

    def _rule(self, stamps: Integers) -> Rule:
        try:
            return Rule.of(stamps)
        except DataError:  # one stamp, or all equal: nothing to measure yet
            return Rule(self._nominal)

    def _usable(self, stamps: Integers, rows: Floats) -> tuple[Integers, Floats]:
        """Return the rows whose measured axes are all finite, the other axes zero."""
        finite = np.isfinite(rows)
        if self.measured.all() and finite.all():
            self._unusable = 0
            return stamps, rows
        seen = np.asarray(finite.any(axis=0), np.bool_)
        if np.any(seen & ~self.measured) or self._unusable > self._patience:
            # with and without an axis are two different windows
            self.epoch += 1
            self.measured = seen
            self._unusable = 0
            self._clear()
        good = finite[:, self.measured].all(axis=1) & bool(self.measured.any())
        self.left_out += int(np.count_nonzero(~good))
        self._unusable = 0 if good.any() else self._unusable + stamps.size
        return stamps[good], np.where(self.measured, rows, 0.0)[good]
