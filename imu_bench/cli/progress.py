# SPDX-License-Identifier: Apache-2.0
"""A progress bar on stderr for what takes longer than a second; nothing where nobody watches."""

from __future__ import annotations

import sys
import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn
from rich.text import Text

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
        self._visible = sys.stderr.isatty()
        self._patience_s = patience_s
        self._begun = time.monotonic()
        self._progress = Progress(
            TextColumn('{task.description}'),
            BarColumn(),
            TextColumn('{task.percentage:>3.0f} %'),
            TimeRemainingColumn(compact=True),
            console=Console(stderr=True),
            transient=True,
        )
        self._task: TaskID | None = None
        self._started = False

    def phase(self, title: str) -> Step:
        """Begin a phase and return the function that reports its progress."""
        if self._task is not None:
            self._progress.remove_task(self._task)
        # the title holds a file name, which must not be read as markup
        self._task = self._progress.add_task(Text(title).markup, total=None)
        return Step(self)

    def update(self, done: int, total: int) -> None:
        """Show how much is done."""
        if self._task is None or not self._visible:
            return
        if not self._started and time.monotonic() - self._begun >= self._patience_s:
            self._progress.start()
            self._started = True
        self._progress.update(self._task, completed=done, total=max(total, done, 1))

    def __enter__(self) -> Bar:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._started:
            self._progress.stop()


class Step:
    """Reports progress of one phase: call it with what is done and the total."""

    def __init__(self, bar: Bar) -> None:
        self._bar = bar

    def __call__(self, done: int, total: int) -> None:
        """Report."""
        self._bar.update(done, total)
