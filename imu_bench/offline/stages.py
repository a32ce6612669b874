# SPDX-License-Identifier: Apache-2.0
"""
Where the time of an analysis goes: processor seconds and memory by stage, of all processes.

What no stage has spent is the start: the interpreter, imports, and handing work around.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import os
import sys
import time
from typing import TypeVar

Answer = TypeVar('Answer')

STAGES = ('start', 'read', 'health', 'statistics', 'deviations', 'fits', 'spectra', 'page')

_MAXRSS = 1 if sys.platform == 'darwin' else 1024  # bytes in ru_maxrss: getrusage(2)


class Account:
    """What processes have spent."""

    def __init__(self, preloaded: float = 0.0) -> None:
        self.seconds = dict.fromkeys(STAGES, 0.0)
        self.peak = dict.fromkeys(STAGES, 0)  # bytes
        self.samples = 0
        self.preloaded = preloaded  # seconds of the process from which others were forked

    def add(self, other: Account) -> None:
        """Add what others have spent; they share what they were forked from."""
        for name in STAGES:
            self.seconds[name] += other.seconds[name]
            self.peak[name] = max(self.peak[name], other.peak[name])
        self.samples += other.samples
        self.preloaded = max(self.preloaded, other.preloaded)


_OWN, _OTHERS = Account(), Account()
_CLOSED_AT = 0.0  # processor seconds of this process when its account was closed last


def _before_fork() -> None:
    _OWN.preloaded = time.process_time()


def _after_fork() -> None:
    """Begin an account in a new process, whose clock is at zero."""
    global _OWN, _CLOSED_AT
    _OWN, _CLOSED_AT = Account(_OWN.preloaded), 0.0


if hasattr(os, 'register_at_fork'):
    os.register_at_fork(before=_before_fork, after_in_child=_after_fork)


@contextmanager
def stage(name: str) -> Iterator[None]:
    """Book the time of a block, but not that of stages inside it; also decorates a function."""
    begun, booked = time.process_time(), sum(_OWN.seconds.values())
    try:
        yield
    finally:
        inside = sum(_OWN.seconds.values()) - booked
        _OWN.seconds[name] += time.process_time() - begun - inside
        _OWN.peak[name] = _peak()


def count(samples: int) -> None:
    """Book samples that were read."""
    _OWN.samples += samples


def accounted(function: Callable[..., Answer], *arguments: object) -> tuple[Answer, Account]:
    """Do a piece of work; return with its answer what this process has spent, all in all."""
    answer = function(*arguments)
    return answer, _closed()


def book(other: Account) -> None:
    """Book what another process has spent."""
    _OTHERS.add(other)


def _closed() -> Account:
    """Return what this process has spent since the last time."""
    global _OWN, _CLOSED_AT
    now = time.process_time()
    closed, _OWN = _OWN, Account()
    closed.seconds['start'] += now - _CLOSED_AT - sum(closed.seconds.values())
    closed.peak['start'] = closed.peak['start'] or _peak()
    _CLOSED_AT = now
    return closed


def _peak() -> int:
    try:
        import resource
    except ModuleNotFoundError:  # Windows does not have it
        return 0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _MAXRSS


def table() -> str:
    """Return what all processes have spent since the last time, a stage a line."""
    global _OTHERS
    spent = _closed()
    spent.add(_OTHERS)
    _OTHERS = Account()
    spent.seconds['start'] += spent.preloaded
    millions = spent.samples / 1e6
    lines = [f'{"stage":12}{"processor s":>12}{"s per million samples":>24}{"peak MiB":>10}']
    rows = [(name, spent.seconds[name], spent.peak[name]) for name in STAGES]
    rows.append(('all', sum(spent.seconds.values()), max(spent.peak.values())))
    for name, seconds, peak in rows:
        rate = f'{seconds / millions:.4f}' if millions else '-'
        lines.append(f'{name:12}{seconds:12.3f}{rate:>24}{peak >> 20:10}')
    return '\n'.join(lines)
