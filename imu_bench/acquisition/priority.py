# SPDX-License-Identifier: Apache-2.0
"""
The thread that reads a chip goes before others, where the operating system permits it.

A FIFO holds some 20 to 40 ms of samples; on a busy machine a thread like any other may wait
longer than that for its turn, and what runs over is lost.
"""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import os
import threading

PRIORITY = 10
"""Of 1 to 99: before everything ordinary, behind the interrupt threads of the kernel (50)."""

NICE = -10


def raise_priority(*, heirs: bool = False) -> str:
    """
    Raise the priority of the calling thread as far as it may; return what came of it.

    Parameters
    ----------
    heirs : bool
        Threads and processes that this one starts from now on have it, too.

    Returns
    -------
    str
        'real time, priority 10', 'nice -10', or 'ordinary' with the reason.
    """
    try:
        policy = os.SCHED_FIFO | (0 if heirs else os.SCHED_RESET_ON_FORK)  # sched(7)
        os.sched_setscheduler(0, policy, os.sched_param(PRIORITY))
        return f'real time, priority {PRIORITY}'
    except (OSError, AttributeError):
        pass
    # on Linux the nice value is that of the thread: nice(2), setpriority(2)
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICE)
        return f'nice {NICE}'
    return 'ordinary: this user may not raise it'


@contextlib.contextmanager
def ordinary_priority() -> Iterator[None]:
    """
    Let the calling thread wait for its turn like any other, and give it back what it had.

    What takes long and is not urgent, as an import, must not keep the cores from threads of
    other processes that read: at the same real-time priority nobody is interrupted.
    """
    had = os.sched_getscheduler(0), os.sched_getparam(0)
    if had[0] in (os.SCHED_OTHER, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK):
        yield
        return
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    try:
        yield
    finally:
        os.sched_setscheduler(0, *had)


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
