# SPDX-License-Identifier: Apache-2.0
"""The progress of a running bench on the terminal: rates, losses, noise so far."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable
import math
import os
import sys
import time
from typing import TYPE_CHECKING

from imu_bench.errors import NotReady
from imu_bench.samples import ANGULAR_VELOCITY, LINEAR_ACCELERATION
from imu_bench.units import convert
from rich.console import Console, RenderableType
from rich.live import Live
from rich.table import Table

if TYPE_CHECKING:
    from imu_bench.nodes.bench_monitor import BenchMonitor, SensorView
    from imu_bench.nodes.processes import BenchProcesses

REFRESH_S = 0.5
LINE_EVERY_S = float(os.environ.get('IMU_BENCH_LINE_EVERY_S', '10'))
"""Where there is no terminal a line of text this often has to do."""


class Showing(ABC):
    """
    A running bench as the terminal shows it.

    Attributes
    ----------
    duration_s : float or None
        How long it runs once everything is up; None for as long as nobody ends it.
    """

    duration_s: float | None

    @abstractmethod
    def look(self) -> Iterable[str]:
        """Return what there is to tell, line by line, each once; raise what ends it."""

    @abstractmethod
    def ready(self) -> bool:
        """Return whether everything is up."""

    @abstractmethod
    def missing(self) -> str:
        """Say what is not up."""

    @abstractmethod
    def heading(self, ran_s: float | None) -> str:
        """Return the line above; None is before everything was up."""

    @abstractmethod
    def table(self, heading: str) -> RenderableType:
        """Return what a terminal shows."""

    @abstractmethod
    def line(self, heading: str) -> str:
        """Return what is printed where there is no terminal."""

    def begin(self) -> float:
        """Return from when on the duration counts, on the clock of `time.monotonic`."""
        return time.monotonic()

    def over(self, ran_s: float | None) -> bool:
        """Return whether it is to end now."""
        return None not in (ran_s, self.duration_s) and self.left(ran_s) <= 0.0

    def left(self, ran_s: float | None) -> float:
        """Return how long it still runs, s."""
        if ran_s is None or self.duration_s is None:
            return math.inf
        return self.duration_s - ran_s


def show(showing: Showing, up_within_s: float) -> None:
    """
    Show a bench until it is over.

    Raises
    ------
    NotReady
        If something is not up within `up_within_s`; and whatever `Showing.look` raises.
    """
    console = Console(stderr=True)
    began = said = time.monotonic()
    up: float | None = None
    with Live(console=console, refresh_per_second=4, transient=False) as live:
        while True:
            for line in showing.look():
                live.console.print(line, soft_wrap=True, markup=False, highlight=False)
            if up is None and showing.ready():
                up = showing.begin()
            now = time.monotonic()
            ran = None if up is None else now - up
            if showing.over(ran):
                break
            if up is None and now - began > up_within_s:
                raise NotReady(f'no data after {up_within_s:g} s from: {showing.missing()}')
            heading = showing.heading(ran)
            if console.is_terminal:
                live.update(showing.table(heading))
            elif now - said > LINE_EVERY_S:
                said = now
                console.print(showing.line(heading), soft_wrap=True)
            # the pace of the display, nothing waits for it
            time.sleep(min(REFRESH_S, max(0.0, showing.left(ran))))


class BenchShowing(Showing):
    """
    Sensors with their rates, losses and noise so far; ended by a process that ends.

    Parameters
    ----------
    monitor : BenchMonitor
    processes : BenchProcesses
    duration_s : float
    news : callable, optional
        Returns lines to print, each once.
    begin : callable, optional
        Called when the last sensor has come up; returns from when on the duration counts, on
        the clock of `time.monotonic`.
    played : collection of str
        Sensors that play a wire recording: they end by themselves, and the others go on.
    """

    def __init__(
        self,
        monitor: BenchMonitor,
        processes: BenchProcesses,
        duration_s: float,
        news: Callable[[], Iterable[str]] = tuple,
        begin: Callable[[], float] = time.monotonic,
        played: Collection[str] = (),
    ) -> None:
        self.duration_s = self._of_s = duration_s
        self._monitor, self._processes = monitor, processes
        self._news, self._begin = news, begin
        self._played = played
        self._over: set[str] = set()

    def look(self) -> Iterable[str]:
        """
        Return the news.

        Raises
        ------
        NotReady
            If a process has ended by itself, but for one that plays a recording.
        """
        lines = []
        for name, code in self._processes.ended().items():
            if code or name not in self._played:
                raise NotReady(ended(self._processes, name, code))
            if name not in self._over:
                self._over.add(name)
                lines.append(self._processes.last_words(name))
        return [*lines, *self._news()]

    def over(self, ran_s: float | None) -> bool:
        """Return whether the time is over, or all that was played."""
        return self._over == set(self._monitor.sensors) or super().over(ran_s)

    def ready(self) -> bool:
        """Return whether every sensor gives data."""
        return all(view.publishing for view in self._monitor.sensors.values())

    def begin(self) -> float:
        """Let the scenario begin, if there is one."""
        return self._begin()

    def missing(self) -> str:
        """Name the sensors without data, with their logs."""
        return silent(self._monitor, self._processes)

    def heading(self, ran_s: float | None) -> str:
        """Return how long it has run."""
        if ran_s is None:
            return 'starting the nodes'
        return f'{max(0.0, ran_s):.0f} of {self._of_s:g} s'

    def table(self, heading: str) -> Table:
        """Return a row per sensor."""
        return _table(self._monitor, heading)

    def line(self, heading: str) -> str:
        """Return all of them in a line."""
        return _line(self._monitor, heading)


def ended(processes: BenchProcesses, name: str, code: int) -> str:
    """Say that a process has ended by itself, and what it said last."""
    return (
        f'{name} ended with exit code {code}: {processes.last_words(name)} '
        f'(its log: {processes.log(name)})'
    )


def silent(monitor: BenchMonitor, processes: BenchProcesses) -> str:
    """Name the sensors that give no data, with their logs."""
    views = [view for view in monitor.sensors.values() if not view.publishing]
    return ', '.join(f'{view.name} {view.message} ({processes.log(view.name)})' for view in views)


def stop(processes: BenchProcesses, names: Iterable[str]) -> None:
    """Stop processes; say of which that took force."""
    for name in processes.stop(names):
        print(f'{name} did not stop and was killed: {processes.log(name)}', file=sys.stderr)


def _table(monitor: BenchMonitor, heading: str) -> Table:
    table = Table(title=heading, title_justify='left', expand=False)
    table.add_column('sensor')
    for name in ('rate Hz', 'of', 'lost', 'accel µg/√Hz', 'gyro m°/s/√Hz'):
        table.add_column(name, justify='right')
    for view in monitor.sensors.values():
        table.add_row(view.name, *_cells(view))
    return table


def _cells(view: SensorView) -> tuple[str, ...]:
    return (
        digits(view.number('delivered_hz'), '.1f'),
        digits(view.number('nominal_hz'), '.0f'),
        view.values.get('lost', ''),
        digits(_noise(view, LINEAR_ACCELERATION.name, 'm/s²/√Hz', 'µg/√Hz'), '.0f'),
        digits(_noise(view, ANGULAR_VELOCITY.name, 'rad/s/√Hz', 'm°/s/√Hz'), '.1f'),
    )


def _line(monitor: BenchMonitor, heading: str) -> str:
    parts = []
    for view in monitor.sensors.values():
        rate, nominal, lost, acceleration, turning = _cells(view)
        noise = ''.join(
            f', {value} {unit}'
            for value, unit in ((acceleration, 'µg/√Hz'), (turning, 'm°/s/√Hz'))
            if value
        )
        parts.append(f'{view.name} {rate or "-"}/{nominal or "-"} Hz, lost {lost or "-"}{noise}')
    return f'{heading}: ' + '; '.join(parts)


def _noise(view: SensorView, quantity: str, unit: str, shown: str) -> float:
    value = view.noise.get(quantity, math.nan)
    return value if math.isnan(value) else convert(value, unit, shown)


def digits(value: float, form: str) -> str:
    """Return a number in a format, nothing where there is none."""
    return '' if math.isnan(value) else format(value, form)
