# SPDX-License-Identifier: Apache-2.0
"""
The threads that read chips go before others, where the operating system permits it.

A FIFO holds some 20 to 40 ms of samples; on a busy machine a thread like any other may wait
longer than that for its turn, and what runs over is lost.

What runs before everything else can also take a machine down.  So this priority belongs to single
threads and is never inherited, nobody holds it for long without a pause (`limit`), and a process
whose threads need too much of the machine at this priority gives it back (`watch_budget`).
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import threading
import time
from types import FrameType

PRIORITY = 10
"""Of 1 to 99: before everything ordinary, behind the interrupt threads of the kernel (50)."""

NICE = -10

PAUSE_S = 1.0
KILLED_S = 3.0
"""
A thread that computes for so long without ever waiting spins (RLIMIT_RTTIME, setrlimit(2)): after
the first of them all threads give their priority back, after the second the kernel ends the
process.  The longest step of a chip, to design the filter of an emulated one, takes 0.2 s.
"""

BUDGET = 0.6
"""
Share of the usable cores that a process may take while it goes before others; the rest is
for those that publish and record what it reads.  Six emulated sensors take about 0.3 of a core.
"""

BUDGET_OVER_S = 5.0
"""The share is that of so much time: bringing chips up takes more, and is over soon."""

_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
"""linux/mman.h."""

_lock = threading.Lock()
_raised: set[int] = set()
_lowered = ''
_since = 0.0, 0.0


def raise_priority() -> str:
    """
    Raise the priority of the calling thread as far as it may; return what came of it.

    What this thread starts, thread or process, has ordinary priority (sched(7)).
    """
    if _lowered:
        return f'ordinary: {_lowered}'
    with _lock:
        _raised.add(threading.get_native_id())
    try:
        policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        os.sched_setscheduler(0, policy, os.sched_param(PRIORITY))
        return f'real time, priority {PRIORITY}'
    except (OSError, AttributeError):
        pass
    # on Linux the nice value is that of the thread: nice(2), setpriority(2)
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICE)
        return f'nice {NICE}'
    return 'ordinary: this user may not raise it'


def lock_memory() -> bool:
    """
    Keep in memory what this process has used, as far as it may; return whether it may.

    Systems that are short of memory, or save it, take from libraries what was not used for a
    while, and read it from the disk again in the midst of a reading.  What a process forks has to
    ask for itself (mlockall(2)).
    """
    import resource  # here: Windows simulates without it

    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_ONFAULT):
        return False
    limit, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    # where there is a limit, what is allocated beyond it would fail
    if limit == resource.RLIM_INFINITY or os.geteuid() == 0:
        libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT)
    return True


def lower(reason: str) -> None:
    """Let all threads of this process wait for their turn like any other, from now on."""
    global _lowered
    _lowered = reason
    with _lock:
        threads, before = set(_raised), 0
        _raised.clear()
    for thread in threads:
        with contextlib.suppress(OSError):  # it has ended
            os.sched_setscheduler(thread, os.SCHED_OTHER, os.sched_param(before))
            os.setpriority(os.PRIO_PROCESS, thread, before)


def still(given: str) -> str:
    """Return what a thread has now of what `raise_priority` gave it; empty if it never ran."""
    return f'ordinary: {_lowered}' if _lowered and given else given


def limit() -> None:
    """Let no thread of this process spin at a raised priority; call from the main thread."""
    import resource

    signal.signal(signal.SIGXCPU, _spins)
    soft, hard = (round(seconds * 1e6) for seconds in (PAUSE_S, KILLED_S))
    _, most = resource.getrlimit(resource.RLIMIT_RTTIME)
    if most != resource.RLIM_INFINITY:
        soft, hard = min(soft, most), min(hard, most)
    resource.setrlimit(resource.RLIMIT_RTTIME, (soft, hard))


def _spins(number: int, frame: FrameType | None) -> None:
    lower(f'a thread computed for {PAUSE_S:g} s without a pause')


def watch_budget() -> None:
    """Give the priority back if this process takes too much of the machine; call now and then."""
    global _since
    now, used = time.monotonic(), time.process_time()
    began, before = _since
    if now - began < BUDGET_OVER_S:
        return
    _since = now, used
    share = (used - before) / (now - began) / len(os.sched_getaffinity(0))
    # the first look has nothing to compare with
    if began and share > BUDGET and _raised:
        lower(f'reading took {share:.0%} of this machine, {BUDGET:.0%} are left to it')


def permitted() -> str:
    """
    Return what `raise_priority` gives to this user, tried in a thread that ends at once.

    Examples
    --------
    >>> permitted().partition(' ')[0].rstrip(':') in ('real', 'nice', 'ordinary')
    True
    """
    found: list[str] = []
    thread = threading.Thread(target=lambda: found.append(raise_priority()))
    thread.start()
    thread.join()
    return found[0]
