# SPDX-License-Identifier: Apache-2.0
"""The members of the Allan family: what each sums, and how the sum becomes a variance."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import NamedTuple

from imu_bench.metrology import blockwise
from imu_bench.metrology.blockwise import Run, square_sum
from imu_bench.metrology.deviations.allan_kernels import (
    modified_sums,
    second_difference_sums,
    third_difference_sums,
)
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Sums = tuple[Floats, Integers]


class Member(NamedTuple):
    """One member of the family."""

    # (phase, m, runs, run) to the sum of squared differences and their number
    sums: Callable[[Floats, Integers, Integers, Run], Sums]
    differences: int  # differences taken: 2 for the Allan members, 3 for the Hadamard members
    span: int  # averaging times that one difference spans

    def deviation(self, sums: Floats, terms: Integers, m: Integers, period: float) -> Floats:
        """
        Return the deviation; sums and terms are those of the phase in unit times second.

        The expected square of a difference of white noise is 2 or 6 variances: NIST SP 1065
        (2008), equations (11) and (18).
        """
        scale = math.factorial(self.differences)
        return np.asarray(np.sqrt(sums / (scale * terms)) / (m * period), np.float64)


def _apart(order: int) -> Callable[[Floats, Integers, Integers, Run], Sums]:
    """Return the sums of differences of every m-th point: the members without overlap."""

    def sums(phase: Floats, m: Integers, runs: Integers, run: Run) -> Sums:
        total = np.zeros(m.size)
        terms = np.zeros(m.size, np.int64)
        for index, factor in enumerate(m.tolist()):
            for first, last in runs[runs[:, 1] - runs[:, 0] > order * factor].tolist():
                steps = np.diff(phase[first:last:factor], n=order)
                total[index] += square_sum(steps)
                terms[index] += steps.size
        return total, terms

    return sums


def _modified(phase: Floats, m: Integers, runs: Integers, run: Run) -> Sums:
    return modified_sums(phase, m, runs)


def _total(phase: Floats, m: Integers, runs: Integers, run: Run) -> Sums:
    """Return the sums over each run extended at both ends by its own odd reflection."""
    total = np.zeros(m.size)
    terms = np.zeros(m.size, np.int64)
    for first, last in runs.tolist():
        points = phase[first:last]
        for index, factor in enumerate(m[m < points.size - 1].tolist()):
            for start in range(1, points.size - 1, blockwise.BLOCK):
                stop = min(start + blockwise.BLOCK, points.size - 1)
                steps = _reflected(points, start - factor, stop - factor)
                steps += _reflected(points, start + factor, stop + factor)
                steps -= 2.0 * points[start:stop]
                total[index] += square_sum(steps)
            terms[index] += points.size - 2
    return total, terms


def _reflected(points: Floats, start: int, stop: int) -> Floats:
    """Return a copy of points start to stop of a run that both its ends reflect."""
    index = np.arange(start, stop)
    last = points.size - 1
    part: Floats = points[last - np.abs(last - np.abs(index))]
    before, after = index < 0, index > last
    part[before] = 2.0 * points[0] - part[before]
    part[after] = 2.0 * points[last] - part[after]
    return part


MEMBERS = {
    'adev': Member(_apart(2), 2, 2),
    'oadev': Member(second_difference_sums, 2, 2),
    'mdev': Member(_modified, 2, 3),
    'tdev': Member(_modified, 2, 3),
    'hdev': Member(_apart(3), 3, 3),
    'ohdev': Member(third_difference_sums, 3, 3),
    'totdev': Member(_total, 2, 1),
}
"""NIST SP 1065 (2008), section 5.2; totdev after its equation (25), doubly reflected."""
