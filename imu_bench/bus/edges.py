# SPDX-License-Identifier: Apache-2.0
"""Which sample an edge of a data-ready line belongs to."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

from imu_bench.bus.interface import EdgeLine

ALONE = 0.9
"""
Part of a nominal period within which the last edge before a reading is that of the newest sample:
no oscillator runs faster by more than a tenth, and an edge that was missed is a period older.
"""

VOTES = 8
"""So many readings have to agree on the level at which a watermark line rises."""


class Edge(NamedTuple):
    """When a sample was measured, by an edge."""

    back: int  # so many samples before the newest one; negative for one that comes later
    t_ns: int


class Edges:
    """
    The host's side of a data-ready line: edges, each told apart from its neighbours.

    An edge that came while the level was read may belong to the newest sample or to the one
    after it, and is not used.

    Parameters
    ----------
    counters : Counter
        Receives 'edges' that were used, and 'edges_unused' readings without one.
    """

    def __init__(self, line: EdgeLine, counters: Counter[str]) -> None:
        self._line = line
        self._counters = counters
        counters.update(edges=0, edges_unused=0)
        self._waiting: list[int] = []
        self._drained_ns = 0
        self._votes: Counter[int] = Counter()

    def begin(self) -> None:
        """Forget what came before the stream began."""
        self._line.edges()
        self._waiting = []

    def newest(self, before_ns: int, after_ns: int, period_ns: float) -> Edge | None:
        """Return the edge of the newest sample, where each has one, of a level read then."""
        known = self._known(before_ns, after_ns)
        if known and before_ns - known[-1] < ALONE * period_ns:
            return self._used(Edge(0, known[-1]))
        return self._used(None)

    def reached(self, level: int, before_ns: int, after_ns: int, period_ns: float) -> Edge | None:
        """
        Return the edge at which the FIFO reached its watermark, of a level read then.

        Documents differ on whether that is at the watermark or above it: the time that has
        passed since tells how many samples came after, and most readings agree on the level.
        """
        known = [t for t in self._known(before_ns, after_ns) if t > self._drained_ns]
        if len(known) != 1:
            return self._used(None)
        passed = ((before_ns + after_ns) / 2 - known[0]) / period_ns
        self._votes[level - int(passed)] += 1
        ((risen, votes),) = self._votes.most_common(1)
        return self._used(Edge(level - risen, known[0]) if votes >= VOTES else None)

    def drained(self, now_ns: int) -> None:
        """Take note that the FIFO has been emptied: the level meanwhile is not known."""
        self._drained_ns = now_ns

    def close(self) -> None:
        """Release the line."""
        self._line.close()

    def _known(self, before_ns: int, after_ns: int) -> list[int]:
        """Return the edges before a reading, none if one came during it."""
        edges = self._waiting + self._line.edges()
        self._waiting = [t for t in edges if t > after_ns]
        if any(before_ns < t <= after_ns for t in edges):
            return []
        return [t for t in edges if t <= before_ns]

    def _used(self, edge: Edge | None) -> Edge | None:
        self._counters['edges' if edge else 'edges_unused'] += 1
        return edge
