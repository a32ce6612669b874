# SPDX-License-Identifier: Apache-2.0
"""A running bench on the terminal: a table that changes, or lines where there is no terminal."""

from __future__ import annotations

import os
import sys
import time
from typing import TYPE_CHECKING

from imu_bench.counting import clean, Silence
from imu_bench.errors import NotReady
from rich.console import Console
from rich.live import Live

if TYPE_CHECKING:
    from imu_bench.recording.showing import Showing

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
