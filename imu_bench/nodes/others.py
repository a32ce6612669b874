# SPDX-License-Identifier: Apache-2.0
"""How much others may add to the bag of a bench, and who else records it."""

from __future__ import annotations

from collections.abc import Iterable
import time

from imu_bench.nodes.diagnostics import fresh
from msg_conversions import diagnostics
import numpy as np
import numpy.typing as npt

MOST_BESIDE = 50
"""Topics of others that are recorded beside a bench, so that nobody makes it grow at will."""

BESIDE_BYTES = 2**20
"""What others publish may take this, and besides no more than the bench's own topics have."""

SAID_BYTES = 2**20
"""What the bench's own nodes may say at once on /diagnostics."""

SAID_BYTES_PER_S = 2**14
"""
And in the mean, for each of its sensors, recorder and analysis.  Those of `machine_vibration`, six
sensors, say 45 kB a second together; this is 2.8 times as much.
"""

SAID_AT_ONCE = 2**18
"""A message of the bench's nodes is smaller; the largest, of its analysis, has 3.3 kB a sensor."""

_RECORDING, _NODES = ': recording', ('recorder', 'analysis_node')


class Others:
    """
    Decides what of others goes into the bag of a bench.

    Parameters
    ----------
    sensors : iterable of str
        Namespaces of the bench's sensors; without any everything is asked for, and goes in.
    bag : str
        The recorder's own, as it says it on /diagnostics.
    """

    def __init__(self, sensors: Iterable[str], bag: str) -> None:
        self.beside: dict[str, int] = {}  # messages left out, by topic of others
        self.turned_away: set[str] = set()  # topics of others that are too many
        self.left_out = 0  # messages on /diagnostics that are too much
        self.bag = ''  # of another recorder that was heard
        names = {space.rpartition('/')[2] for space in sensors}
        self._bounded, self._own_bag = bool(names), bag
        self._names = names.union(_NODES)
        self._room = BESIDE_BYTES
        self._said, self._said_s = float(SAID_BYTES), time.monotonic()

    def lets_in(self, topic: str) -> bool:
        """Return whether one more topic of others is recorded."""
        if len(self.beside) < MOST_BESIDE:
            return True
        self.turned_away.add(topic)
        return False

    def note_own(self, size: int) -> None:
        """Take note of what the bench has measured, in bytes: others may have as much."""
        self._room += size

    def fitting(self, topic: str, rows: npt.NDArray[np.uint8]) -> int:
        """Return how many of the messages of a topic of others are recorded, shape (n, bytes)."""
        size = int(rows.shape[1])
        fitting = min(len(rows), max(0, self._room) // max(1, size))
        self.beside[topic] += len(rows) - fitting
        self._room -= fitting * size
        return fitting

    def said(self, rows: npt.NDArray[np.uint8]) -> npt.NDArray[np.bool_]:
        """
        Return which messages of /diagnostics are recorded.

        Those of the bench's nodes have room of their own: a crowd does not use it up.  Who speaks
        in their names shares that with them.
        """
        size = int(rows.shape[1])
        now = time.monotonic()
        rate = SAID_BYTES_PER_S * len(self._names)
        self._said = min(SAID_BYTES, self._said + rate * (now - self._said_s))
        self._said_s = now
        kept = np.ones(len(rows), bool)
        for index, row in enumerate(rows):
            own = size <= SAID_AT_ONCE and self._own(row.tobytes())
            if not self._bounded:
                continue
            room = self._said if own else self._room
            kept[index] = size <= room
            if own:
                self._said -= size if kept[index] else 0
            else:
                self._room -= size if kept[index] else 0
        self.left_out += int(np.count_nonzero(~kept))
        return kept

    def _own(self, message: bytes) -> bool:
        """Return whether a node of the bench says this, by its own account."""
        try:
            first = diagnostics.first(message)
        except ValueError:
            return False
        if first.name.endswith(_RECORDING) and first.hardware_id != self._own_bag:
            if fresh(first.stamp_ns):  # else it is played from a bag
                self.bag = first.hardware_id
            return False
        return first.name.partition(':')[0].rpartition('/')[2] in self._names
