# SPDX-License-Identifier: Apache-2.0
"""A progress bar on stderr for what takes longer than a second; nothing where nobody watches."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

from imu_bench.counting import Silence

# imported late: whoever is quick, or works where nobody watches, needs no bar
if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

PATIENCE_S = 1.0


class Bar:
    """
    One bar after the other, for the phases of a task.

    Parameters
    ----------
    patience_s : float
        Seconds before a bar appears at all.

    Examples
    --------
    >>> with Bar() as bar:
    ...     step = bar.phase('reading')
    ...     step(1, 10)
    """

    def __init__(self, patience_s: float = PATIENCE_S) -> None:
        self._visible = sys.stderr.isatty() and not isinstance(sys.stdout, Silence)
        self._patience_s = patience_s
        self._begun = time.monotonic()
        self._title = ''
        self._progress: Progress | None = None
        self._task: TaskID | None = None

    def phase(self, title: str) -> Step:
        """Begin a phase and return the function that reports its progress."""
        if self._progress is not None and self._task is not None:
            self._progress.remove_task(self._task)
        self._title, self._task = title, None
        return Step(self)

    def update(self, done: int, total: int) -> None:
        """Show how much is done."""
        if not self._visible:
            return
        if self._progress is None:
            if time.monotonic() - self._begun < self._patience_s:
                return
            self._progress = _started()
        if self._task is None:
            from rich.text import Text

            # the title holds a file name, which must not be read as markup
            self._task = self._progress.add_task(Text(self._title).markup, total=None)
        self._progress.update(self._task, completed=done, total=max(total, done, 1))

    def __enter__(self) -> Bar:
        return self

    def __exit__(self, *_: object) -> None:
        if self._progress is not None:
            self._progress.stop()


class Step:
    """Reports progress of one phase: call it with what is done and the total."""

    def __init__(self, bar: Bar) -> None:
        self._bar = bar

    def __call__(self, done: int, total: int) -> None:
        """Report."""
        self._bar.update(done, total)


def _started() -> Progress:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    progress = Progress(
        TextColumn('{task.description}'),
        BarColumn(),
        TextColumn('{task.percentage:>3.0f} %'),
        TimeRemainingColumn(compact=True),
        console=Console(stderr=True),
        transient=True,
    )
    progress.start()
    return progress
