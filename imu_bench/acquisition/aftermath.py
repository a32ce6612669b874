# SPDX-License-Identifier: Apache-2.0
"""What the scripted faults of an emulated sensor do to its acquisition, fault by fault."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from imu_bench.acquisition.stats import AcquisitionStats
from imu_bench.config.faults import Fault

WATCHED_S = 3.0
"""What is lost or counted so long after the recovery still belongs to the fault."""

_COUNTS = ('failures', 'recoveries')


@dataclass
class Aftermath:
    """One fault, and what came of it."""

    fault: Fault
    state: str = 'planned'  # 'planned', 'active', 'over' (no data yet) or 'recovered'
    error: str = ''  # the latest error that it led to, with its name; empty when there was none
    errors: Mapping[str, int] = field(default_factory=dict)  # how many there were, by name
    lost: int = 0  # samples that were lost, and counted
    # what the counters of acquisition and driver have grown by
    counted: Mapping[str, int] = field(default_factory=dict)
    # from its end until a sample arrived that was measured after it
    recovery_s: float | None = None


class FaultWatch:
    """
    Holds the statistics of an acquisition against the script of its faults.

    Parameters
    ----------
    faults : iterable of Fault
        In the order in which they begin.
    switched_on_ns : int
        From when on they count.

    Examples
    --------
    >>> from imu_bench.config.faults import script
    >>> watch = FaultWatch(script(['unplugged 10 2']), switched_on_ns=0)
    >>> [aftermath.state for aftermath in watch.aftermaths]
    ['planned']
    """

    def __init__(self, faults: Iterable[Fault], switched_on_ns: int) -> None:
        self.aftermaths = [Aftermath(fault) for fault in faults]
        self._start_ns = switched_on_ns
        self._before: list[AcquisitionStats | None] = [None] * len(self.aftermaths)

    def look(self, now_ns: int, stats: AcquisitionStats, newest_ns: int) -> list[Aftermath]:
        """
        Take note of how it goes; return the faults whose state has changed.

        Parameters
        ----------
        stats : AcquisitionStats
            Of now.
        newest_ns : int
            Stamp of the newest sample that has arrived.
        """
        changed = []
        for place, aftermath in enumerate(self.aftermaths):
            state = aftermath.state
            if now_ns < self._ns(aftermath.fault.at_s):
                self._before[place] = stats
                continue
            self._follow(aftermath, self._before[place], now_ns, stats, newest_ns)
            if aftermath.state != state:
                changed.append(aftermath)
        return changed

    def _ns(self, elapsed_s: float) -> int:
        return self._start_ns + round(elapsed_s * 1e9)

    def _follow(
        self,
        aftermath: Aftermath,
        before: AcquisitionStats | None,
        now_ns: int,
        stats: AcquisitionStats,
        newest_ns: int,
    ) -> None:
        end_ns = self._ns(aftermath.fault.over_s)
        well = stats.state == 'running' and not stats.error and newest_ns > end_ns
        if aftermath.state != 'recovered':
            aftermath.state = 'active' if now_ns < end_ns else 'over'
            if well and now_ns >= end_ns:
                aftermath.state = 'recovered'
                aftermath.recovery_s = (now_ns - end_ns) * 1e-9
        elif now_ns > end_ns + round((aftermath.recovery_s or 0.0) * 1e9 + WATCHED_S * 1e9):
            return
        aftermath.errors = _grown(stats.errors, {} if before is None else before.errors)
        if aftermath.errors:
            aftermath.error = stats.last_error
        aftermath.lost = stats.lost - (0 if before is None else before.lost)
        aftermath.counted = _grown(_counts(stats), {} if before is None else _counts(before))


def _counts(stats: AcquisitionStats) -> dict[str, int]:
    return {**{name: getattr(stats, name) for name in _COUNTS}, **stats.counters}


def _grown(after: Mapping[str, int], before: Mapping[str, int]) -> dict[str, int]:
    """Return by how much counts have grown, of those that have."""
    grown = {name: count - before.get(name, 0) for name, count in after.items()}
    return {name: count for name, count in grown.items() if count > 0}
