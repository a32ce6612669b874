# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C and its kin as a wish: what runs is brought to an end, and nothing is broken off."""

from __future__ import annotations

import signal
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C, the end of a service or of the machine, a terminal that was closed."""


class Interruption:
    """
    Collects signals while it is used as a context manager; a second one changes nothing.

    SIGHUP stays ignored where it is, below nohup.  SIGINT does not, although a shell makes its
    background jobs ignore it: who sends it means it.
    """

    def __init__(self) -> None:
        self.asked = ''  # name of the first signal; empty as long as there was none
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Interruption:
        for number in SIGNALS:
            before = signal.getsignal(number)
            if not (number == signal.SIGHUP and before == signal.SIG_IGN):
                self._before[number] = before
                signal.signal(number, self._ask)
        return self

    def __exit__(self, *_: object) -> None:
        for number, before in self._before.items():
            signal.signal(number, before)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self.asked = self.asked or signal.Signals(number).name
