# SPDX-License-Identifier: Apache-2.0
"""A recording on the terminal, and what ends it: time, Ctrl-C, a full disk, a lost recorder."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from datetime import timedelta
import time
from typing import TYPE_CHECKING

from imu_bench.cli import record_room as room
from imu_bench.cli.live import ended, Showing
from imu_bench.cli.record_rows import Row, SensorRow, SILENT_S, TopicRow
from imu_bench.errors import NotReady
from imu_bench.nodes.bench_nodes import RECORDER
from imu_bench.offline.notation import duration
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from imu_bench.cli.interruption import Interruption
    from imu_bench.cli.record_place import Place
    from imu_bench.nodes.bench_monitor import RecorderView
    from imu_bench.nodes.processes import BenchProcesses

GROWN_S = 10.0
"""From then on the growth of a bag says what it will take."""


class RecordShowing(Showing):
    """
    What is recorded, row by row; goes on with the others when a node dies.

    Parameters
    ----------
    rows : sequence of Row
    processes : BenchProcesses
    recorder : RecorderView
    place : Place
    stop : Interruption
    settled : callable
        Called when everything is up.

    Attributes
    ----------
    begun_s, ran_s : float or None
        When everything was up, on the clock of `time.monotonic`, and for how long.
    failure : str
        Why it ended before its time; empty if it did not, or somebody wished it.
    """

    def __init__(
        self,
        rows: Sequence[Row],
        processes: BenchProcesses,
        recorder: RecorderView,
        place: Place,
        stop: Interruption,
        settled: Callable[[], None],
    ) -> None:
        self.rows = tuple(rows)
        self.duration_s = place.duration_s
        self.begun_s: float | None = None
        self.ran_s = 0.0
        self.failure = ''
        self._processes, self._recorder, self._stop = processes, recorder, stop
        self._bag, self._settled = place.bag, settled
        self._free, self._stored, self._stored_before = room.free_bytes(place.bag), 0, 0
        self._told: dict[str, str] = {}

    def ready(self) -> bool:
        """Return whether everything gives data."""
        return all(row.publishing for row in self.rows)

    def begin(self) -> float:
        """Count from now on."""
        self._settled()
        self.begun_s = time.monotonic()
        self._stored_before = self._stored
        for row in self.rows:
            row.begin()
        return self.begun_s

    def missing(self) -> str:
        """Name what gives no data."""
        return ', '.join(row.name for row in self.rows if not row.publishing)

    def over(self, ran_s: float | None) -> bool:
        """Return whether the time is over, somebody wishes it, or nothing can be recorded."""
        self.ran_s = ran_s or 0.0
        wished = bool(self._stop.asked or self.failure) or not self._going_on()
        return wished or super().over(ran_s)

    def _going_on(self) -> bool:
        """Return whether anything is left to record."""
        return not all(row.died or row.over for row in self.rows)

    # --- news --------------------------------------------------------------------------

    def look(self) -> Iterable[str]:
        """
        Return what has happened to nodes, sensors and disk.

        Raises
        ------
        NotReady
            If a process fails before everything is up.
        """
        for row in self.rows:
            if isinstance(row, TopicRow):
                row.hear()
        codes = self._processes.ended()
        ends = list(self._ends(codes))
        if self.begun_s is None:
            over = {row.name for row in self.rows if row.over}
            for name in codes.keys() - over:
                raise NotReady(ended(self._processes, name, codes[name]))
            return ends
        news = [*ends, *self._deaths(codes), *self._troubles(), *self._disk()]
        return [f'{_clock(self._age())} {line}' for line in news]

    def _ends(self, codes: dict[str, int]) -> Iterable[str]:
        """Yield which recordings have been played."""
        for row in self.rows:
            if row.plays and not row.over and codes.get(row.name) == 0:
                row.over = True
                yield self._processes.last_words(row.name)

    def _deaths(self, codes: dict[str, int]) -> Iterable[str]:
        for name, code in codes.items():
            if name == RECORDER:
                said = self._recorder.message if self._recorder.failed else ''
                self.failure = said or ended(self._processes, name, code)
                continue
            row = next(row for row in self.rows if row.name == name)
            if row.died or row.over:
                continue
            row.died = f'ended after {duration(round(self._age()))} (exit code {code})'
            others = '; the others go on' if self._going_on() else ''
            yield f'WARNING: {ended(self._processes, name, code)}{others}'
        if not self._going_on() and all(row.died for row in self.rows):
            self.failure = 'no sensor is left'

    def _troubles(self) -> Iterable[str]:
        """Yield what is wrong with a row since the last look, and that it is over."""
        for row in self.rows:
            now = ''
            if isinstance(row, SensorRow):
                now = row.trouble
            if row.silent_s > SILENT_S:
                now = f'nothing heard for {SILENT_S:g} s'
            if row.died or row.over or bool(now) == bool(self._told.get(row.name)):
                continue
            self._told[row.name] = now
            yield f'WARNING: {row.name}: {now}' if now else f'{row.name} is back'

    def _disk(self) -> Iterable[str]:
        """Look how much room there is; end in time to finish the bag."""
        self._free, self._stored = room.free_bytes(self._bag), room.stored_bytes(self._bag)
        if self._free < room.reserve(self._stored, self._growth()):
            self.failure = f'the disk is full: {room.size(self._free)} are free'
        elif self.duration_s and self._age() > GROWN_S and not self._told.get('disk'):
            needed = self._growth() * (self.duration_s - self._age())
            if needed + room.reserve(self._stored + needed, self._growth()) > self._free:
                self._told['disk'] = 'small'
                yield f'WARNING: the disk will be full in about {duration(self._lasts_s())}'

    def _age(self) -> float:
        return 0.0 if self.begun_s is None else time.monotonic() - self.begun_s

    def _growth(self) -> float:
        """Return bytes per second."""
        age = self._age()
        return (self._stored - self._stored_before) / age if age > 1.0 else 0.0

    def _lasts_s(self) -> float:
        return self._free / ((1.0 + room.RESERVE_SHARE) * self._growth())

    # --- picture -----------------------------------------------------------------------

    def heading(self, ran_s: float | None) -> str:
        """Return how long it has run, how long it will, and the room on the disk."""
        if ran_s is None:
            return 'starting'
        free = f'{room.size(self._free)} free'
        if self.duration_s is not None:
            left = _clock(self.left(ran_s))
            return f'{_clock(ran_s)} of {_clock(self.duration_s)}, {left} left; {free}'
        if ran_s > GROWN_S and self._growth():
            free += f', room for {duration(round(self._lasts_s()))}'
        return f'{_clock(ran_s)}, Ctrl-C ends it; {free}'

    def table(self, heading: str) -> RenderableType:
        """Return a row per sensor or topic."""
        table = Table(expand=False)
        table.add_column('recorded', overflow='fold')
        for name in ('rate Hz', 'of', 'lost'):
            table.add_column(name, justify='right', no_wrap=True)
        for row in self.rows:
            style = 'bold red' if row.died or self._told.get(row.name) else ''
            table.add_row(row.name, *row.shown(), style=style)
        return Group(Text(heading), table)

    def line(self, heading: str) -> str:
        """Return all of them in a line."""
        parts = []
        for row in self.rows:
            rate, nominal, lost = row.shown()
            parts.append(
                f'{row.name} {rate or "-"}/{nominal or "-"} Hz'
                + (f', lost {lost}' if lost else '')
            )
        return f'{heading}: ' + '; '.join(parts)


def _clock(seconds: float) -> str:
    """
    Return a length of time as a clock shows it.

    Examples
    --------
    >>> _clock(50400.0), _clock(12.7)
    ('14:00:00', '0:00:12')
    """
    return str(timedelta(seconds=int(max(0.0, seconds))))
