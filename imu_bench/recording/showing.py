# SPDX-License-Identifier: Apache-2.0
"""A recording on the terminal, and what ends it: time, Ctrl-C, a full disk, a lost recorder."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import timedelta
import math
import os
from pathlib import Path
import sys
import time
from typing import TYPE_CHECKING

from imu_bench.account import BESIDE, LEFT_OUT, RECORDERS
from imu_bench.counting import clean, listed, Silence
from imu_bench.errors import NotReady
from imu_bench.nodes.bench_nodes import RECORDER
from imu_bench.offline.notation import duration
from imu_bench.recording import place
from imu_bench.recording.rows import Row, SensorRow, SILENT_S, TopicRow
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from imu_bench.live.views import RecorderView
    from imu_bench.nodes.processes import BenchProcesses
    from imu_bench.recording.interruption import Interruption

GROWN_S = 10.0
"""From then on the growth of a bag says what it will take."""

RESTARTS = 5
"""A process that ends by itself is started again so often; one that always ends is broken."""

LISTED = 4
"""Topics of others that a line names."""

NOISE = {'accel': 'µg/√Hz', 'gyro': 'm°/s/√Hz'}
"""Columns of the noise so far, with their units."""


class Showing:
    """
    What is recorded, row by row; goes on with the others when a process dies.

    Parameters
    ----------
    rows : sequence of Row
        One for each sensor or topic.
    duration_s : float or None
        How long it is recorded once everything is up; None for as long as nobody ends it.
    settled : callable
        Called when everything is up; returns from when on the duration counts, on the clock of
        `time.monotonic`.
    hosts : mapping of str to collection of str
        The processes that are started again if they end, and the rows each of them runs.
    start_again : callable
        Starts one of them.
    news : callable, optional
        Returns more lines to print, each once.
    noise : bool
        Whether noise so far is shown.
    broken : callable
        Returns why nothing can be recorded any more, for who records in this process.
    """

    def __init__(
        self,
        rows: Sequence[Row],
        processes: BenchProcesses,
        recorder: RecorderView,
        bag: Path,
        duration_s: float | None,
        stop: Interruption,
        settled: Callable[[], float] = lambda: time.monotonic(),
        hosts: Mapping[str, Sequence[str]] | None = None,
        start_again: Callable[[str], None] = lambda name: None,
        news: Callable[[], Iterable[str]] = tuple,
        noise: bool = False,
        broken: Callable[[], str] = str,
    ) -> None:
        self.rows = tuple(rows)
        self.duration_s = duration_s
        # when everything was up, on the clock of `time.monotonic`
        self.begun_s: float | None = None
        self.ran_s = 0.0
        # why it ended before its time; empty if it did not, or somebody wished it
        self.failure = ''
        self.restarts: Counter[str] = Counter()  # how often each process was started again
        # whether the recorder has ended by itself: what was published afterwards is in no bag
        self.recorder_ended = False
        self._processes, self._recorder, self._stop = processes, recorder, stop
        self._bag, self._settled, self._news, self._noise = bag, settled, news, noise
        self._hosts, self._start_again, self._broken = hosts or {}, start_again, broken
        self._given_up: set[str] = set()
        self._free, self._stored, self._stored_before = place.free_bytes(bag), 0, 0
        self._told: dict[str, str] = {}

    def ready(self) -> bool:
        """Return whether everything gives data."""
        return all(row.publishing for row in self.rows)

    def begin(self) -> None:
        """Count from now on, or from a moment that is to come."""
        self.begun_s = self._settled()
        self._stored_before = self._stored
        for row in self.rows:
            row.begin()

    def missing(self) -> str:
        """Name what gives no data, with its log."""
        logs = {
            row: f' ({self._processes.log(name)})'
            for name, hosted in self._hosts.items()
            for row in hosted
        }
        silent = [row for row in self.rows if not row.publishing]
        return ', '.join(row.missing + logs.get(row.name, '') for row in silent)

    def over(self, ran_s: float | None) -> bool:
        """Return whether the time is over, somebody wishes it, or nothing can be recorded."""
        self.ran_s = max(0.0, ran_s or 0.0)
        wished = bool(self._stop.asked or self.failure) or not self._going_on()
        return wished or (ran_s is not None and self.left(ran_s) <= 0.0)

    def left(self, ran_s: float | None) -> float:
        """Return how long it still runs, s."""
        if ran_s is None or self.duration_s is None:
            return math.inf
        return self.duration_s - ran_s

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
        self.failure = self.failure or self._broken()
        codes = self._processes.ended()
        ends = list(self._ends(codes))
        if self.begun_s is None:
            for name, code in codes.items():
                if name not in self._given_up:
                    raise NotReady(ended(self._processes, name, code))
            return [*ends, *self._news()]
        others = *self._several(), *self._beside()
        news = [*ends, *self._deaths(codes), *self._troubles(), *others, *self._disk()]
        return [*(f'{_clock(self._age())} {line}' for line in news), *self._news()]

    def _hosted(self, name: str) -> list[Row]:
        """Return the rows that a process runs."""
        return [row for row in self.rows if row.name in self._hosts.get(name, ())]

    def _ends(self, codes: Mapping[str, int]) -> Iterable[str]:
        """Yield which recordings have been played."""
        for row in self.rows:
            if row.played and not row.over:
                row.over = True
                yield f'{row.name}: {row.played}'
        for name, code in codes.items():
            rows = self._hosted(name)
            if code or name in self._given_up or not rows or not all(row.plays for row in rows):
                continue
            self._given_up.add(name)
            if not all(row.over for row in rows):  # it has ended before its last words came
                yield self._processes.last_words(name)
            for row in rows:
                row.over = True

    def _deaths(self, codes: Mapping[str, int]) -> Iterable[str]:
        """Yield which processes have ended by themselves; start them again."""
        for name, code in codes.items():
            if name in self._given_up:
                continue
            said = ended(self._processes, name, code)
            if name == RECORDER:
                self.recorder_ended = True
                self.failure = self._recorder.message if self._recorder.failed else said
            elif self.restarts[name] < RESTARTS and code:
                self.restarts[name] += 1
                self._start_again(name)
                yield f'WARNING: {said}; started again ({self.restarts[name]} of {RESTARTS})'
            else:
                self._given_up.add(name)
                for row in self._hosted(name):
                    row.died = f'ended after {duration(round(self._age()))} (exit code {code})'
                others = '; the others go on' if self._going_on() else ''
                yield f'WARNING: {said}{others}'
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

    def _several(self) -> Iterable[str]:
        """Yield which topics somebody else publishes as well, who else records, a flood, once."""
        others, flooded = self._recorder.others, self._recorder.flooded
        if self._told.get(RECORDERS, '') != others:
            self._told[RECORDERS] = others
            yield f'WARNING: {others}' if self._recorder.two_of_ours else others
        if flooded and LEFT_OUT not in self._told:
            self._told[LEFT_OUT] = flooded
            yield f'WARNING: {flooded}'
        for line in self._recorder.several:
            if line not in self._told:
                self._told[line] = line
                yield f'WARNING: {line}'

    def _beside(self) -> Iterable[str]:
        """Yield which topics of others are recorded as well, each once."""
        new = [name for name in self._recorder.beside if f'{BESIDE}{name}' not in self._told]
        self._told |= {f'{BESIDE}{name}': name for name in new}
        if new:
            yield f'recorded as well, of others: {listed(new, LISTED)}'

    def _disk(self) -> Iterable[str]:
        """Look how much room there is; end in time to finish the bag."""
        self._free, self._stored = place.free_bytes(self._bag), place.stored_bytes(self._bag)
        if self._free < place.reserve(self._stored, self._growth()):
            self.failure = f'the disk is full: {place.size(self._free)} are free'
        elif self.duration_s and self._age() > GROWN_S and not self._told.get('disk'):
            needed = self._growth() * (self.duration_s - self._age())
            if needed + place.reserve(self._stored + needed, self._growth()) > self._free:
                self._told['disk'] = 'small'
                yield f'WARNING: the disk will be full in about {duration(self._lasts_s())}'

    def _age(self) -> float:
        return 0.0 if self.begun_s is None else max(0.0, time.monotonic() - self.begun_s)

    def _growth(self) -> float:
        """Return bytes per second."""
        age = self._age()
        return (self._stored - self._stored_before) / age if age > 1.0 else 0.0

    def _lasts_s(self) -> float:
        return self._free / ((1.0 + place.RESERVE_SHARE) * self._growth())

    # --- picture -----------------------------------------------------------------------

    def heading(self, ran_s: float | None) -> str:
        """Return how long it has run, how long it will, and the room on the disk."""
        if ran_s is None:
            return 'starting'
        free = f'{place.size(self._free)} free'
        if self.duration_s is not None:
            left = _clock(self.left(ran_s))
            return f'{_clock(ran_s)} of {_clock(self.duration_s)}, {left} left; {free}'
        if ran_s > GROWN_S and self._growth():
            free += f', room for {duration(round(self._lasts_s()))}'
        return f'{_clock(ran_s)}, Ctrl-C ends it; {free}'

    def table(self, heading: str) -> RenderableType:
        """Return what a terminal shows: a row per sensor or topic."""
        table = Table(expand=False)
        table.add_column('recorded', overflow='fold')
        noise = [f'{name} {unit}' for name, unit in NOISE.items()] if self._noise else []
        for name in ('rate Hz', 'of', 'lost', *noise):
            table.add_column(name, justify='right', no_wrap=name != 'lost')
        for row in self.rows:
            style = 'bold red' if row.died or self._told.get(row.name) else ''
            cells = row.shown()
            shown = [row.name, *cells[:3], *(cells.noise if self._noise else ())]
            table.add_row(*(Text(clean(cell)) for cell in shown), style=style)
        return Group(Text(heading), table)

    def line(self, heading: str) -> str:
        """Return what is printed where there is no terminal: all of them in a line."""
        parts = []
        for row in self.rows:
            rate, nominal, lost, noise = row.shown()
            shown = zip(noise, NOISE.values(), strict=True) if self._noise else ()
            parts.append(
                f'{row.name} {rate or "-"}/{nominal or "-"} Hz'
                + (f', lost {lost}' if lost else '')
                + ''.join(f', {value} {unit}' for value, unit in shown if value)
            )
        return f'{heading}: ' + '; '.join(parts)


def ended(processes: BenchProcesses, name: str, code: int) -> str:
    """Say that a process has ended by itself, and what it said last."""
    return (
        f'{name} ended with exit code {code}: {processes.last_words(name)} '
        f'(its log: {processes.log(name)})'
    )


def _clock(seconds: float) -> str:
    """Return a length of time as a clock shows it."""
    return str(timedelta(seconds=int(max(0.0, seconds))))


REFRESH_S = 0.5
LINE_EVERY_S = float(os.environ.get('IMU_BENCH_LINE_EVERY_S', '10'))
"""Where there is no terminal a line of text this often has to do."""


def say(line: str, console: Console | None = None) -> None:
    """Print a line, of which nothing steers a terminal, on stderr or wherever a console prints."""
    out = console or Console(stderr=True)
    out.print(clean(line), soft_wrap=True, markup=False, highlight=False)


def show(showing: Showing, up_within_s: float) -> None:
    """Show a recording until it is over."""
    hushed = isinstance(sys.stdout, Silence)
    console = Console(stderr=True)
    shown = Console(stderr=True, quiet=True) if hushed else console
    began = said = time.monotonic()
    with Live(console=shown, refresh_per_second=4, transient=False) as live:
        while True:
            for line in showing.look():
                say(line, console)
            if showing.begun_s is None and showing.ready():
                showing.begin()
            now = time.monotonic()
            ran = None if showing.begun_s is None else now - showing.begun_s
            if showing.over(ran):
                break
            if ran is None and now - began > up_within_s:
                raise NotReady(f'no data after {up_within_s:g} s from: {showing.missing()}')
            heading = showing.heading(ran)
            if console.is_terminal:
                live.update(showing.table(heading))
            elif now - said > LINE_EVERY_S:
                said = now
                say(showing.line(heading), shown)
            # the pace of the display, nothing waits for it
            time.sleep(min(REFRESH_S, max(0.0, showing.left(ran))))
