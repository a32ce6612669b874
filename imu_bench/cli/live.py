# SPDX-License-Identifier: Apache-2.0
"""The progress of a running bench on the terminal: rates, losses, noise so far."""

from __future__ import annotations

from collections.abc import Callable, Iterable
import math
import os
import time
from typing import TYPE_CHECKING

from imu_bench.errors import NotReady
from imu_bench.samples import ANGULAR_VELOCITY, LINEAR_ACCELERATION
from imu_bench.units import convert
from rich.console import Console
from rich.live import Live
from rich.table import Table

if TYPE_CHECKING:
    from imu_bench.nodes.bench_monitor import BenchMonitor, SensorView
    from imu_bench.nodes.processes import BenchProcesses

REFRESH_S = 0.5
LINE_EVERY_S = float(os.environ.get('IMU_BENCH_LINE_EVERY_S', '10'))
"""Where there is no terminal a line of text this often has to do."""


def show(
    monitor: BenchMonitor,
    processes: BenchProcesses,
    up_within_s: float,
    duration_s: float,
    news: Callable[[], Iterable[str]] = tuple,
    begin: Callable[[], float] = time.monotonic,
) -> None:
    """
    Show the bench until it has run for `duration_s` since the last sensor came up.

    Parameters
    ----------
    monitor : BenchMonitor
    processes : BenchProcesses
    up_within_s, duration_s : float
    news : callable, optional
        Returns lines to print, each once.
    begin : callable, optional
        Called when the last sensor has come up; returns from when on the duration counts, on
        the clock of `time.monotonic`.

    Raises
    ------
    NotReady
        If a process ends by itself, or a sensor gives no data within `up_within_s`.
    """
    console = Console(stderr=True)
    began = time.monotonic()
    up: float | None = None
    said = began
    with Live(console=console, refresh_per_second=4, transient=False) as live:
        while up is None or time.monotonic() - up < duration_s:
            _look_after(processes)
            for line in news():
                live.console.print(line, soft_wrap=True, markup=False, highlight=False)
            now = time.monotonic()
            if up is None and all(view.publishing for view in monitor.sensors.values()):
                up = begin()
            if up is None and now - began > up_within_s:
                raise NotReady(_missing(monitor, processes, up_within_s))
            heading = _heading(up, now, duration_s)
            if console.is_terminal:
                live.update(_table(monitor, heading))
            elif now - said > LINE_EVERY_S:
                said = now
                console.print(_line(monitor, heading), soft_wrap=True)
            # the pace of the display, nothing waits for it
            time.sleep(
                REFRESH_S if up is None else min(REFRESH_S, max(0.0, up + duration_s - now))
            )


def _heading(up: float | None, now: float, duration_s: float) -> str:
    return 'starting the nodes' if up is None else f'{max(0.0, now - up):.0f} of {duration_s:g} s'


def _look_after(processes: BenchProcesses) -> None:
    for name, code in processes.ended().items():
        raise NotReady(
            f'{name} ended with exit code {code}: {processes.last_words(name)} '
            f'(its log: {processes.log(name)})'
        )


def _missing(monitor: BenchMonitor, processes: BenchProcesses, up_within_s: float) -> str:
    silent = [view for view in monitor.sensors.values() if not view.publishing]
    logs = ', '.join(f'{view.name} {view.message} ({processes.log(view.name)})' for view in silent)
    return f'no data after {up_within_s:g} s from: {logs}'


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
        _digits(view.number('delivered_hz'), '.1f'),
        _digits(view.number('nominal_hz'), '.0f'),
        view.values.get('lost', ''),
        _digits(_noise(view, LINEAR_ACCELERATION.name, 'm/s²/√Hz', 'µg/√Hz'), '.0f'),
        _digits(_noise(view, ANGULAR_VELOCITY.name, 'rad/s/√Hz', 'm°/s/√Hz'), '.1f'),
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


def _digits(value: float, form: str) -> str:
    return '' if math.isnan(value) else format(value, form)
