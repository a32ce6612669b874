# SPDX-License-Identifier: Apache-2.0
"""How a process that reads sensors is started, watched and ended."""

from __future__ import annotations

from contextlib import suppress
import os
import selectors
import signal
import subprocess
import sys


def started(line: int, *, real_time: bool) -> subprocess.Popen[bytes]:
    """
    Start a process that takes commands from a socket of this one.

    Parameters
    ----------
    line : int
        File descriptor of the socket.
    real_time : bool
        Whether its threads that read may go before others.
    """
    kind = 'real-time' if real_time else 'ordinary'
    return subprocess.Popen(
        [sys.executable, '-m', 'imu_bench.live.reading_child', str(line), kind],
        stdin=subprocess.DEVNULL, pass_fds=[line],
        # one thread of numpy: those that read share the cores
        env={**os.environ, 'OMP_NUM_THREADS': '1', 'OPENBLAS_NUM_THREADS': '1'},
    )  # fmt: skip


def how_it_ended(process: subprocess.Popen[bytes] | Forked) -> str:
    """Return what is known of the end of a process that does not answer."""
    with suppress(subprocess.TimeoutExpired):
        code = process.wait(1.0)
        how = f' (exit code {code})' if code > 0 else ''
        how = f' ({signal.Signals(-code).name})' if code < 0 else how
        return f'the process that reads sensors has ended{how}'
    return 'the process that reads sensors does not answer any more'


class Forked:
    """
    A process that a child of this one forked, used as a `subprocess.Popen`.

    How it ended only the one that forked it could know.

    Parameters
    ----------
    pid : int
        Its process id.
    """

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self._gone = False
        self._handle = -1
        try:
            self._handle = os.pidfd_open(pid)
        except ProcessLookupError:
            self._gone = True

    def poll(self) -> int | None:
        """Return None while it runs."""
        with suppress(subprocess.TimeoutExpired):
            return self.wait(0.0)
        return None

    def wait(self, timeout: float | None = None) -> int:
        """
        Wait for its end; return 0, which says nothing.

        Raises
        ------
        subprocess.TimeoutExpired
            If it still runs.
        """
        if not self._gone:
            with selectors.DefaultSelector() as end:
                end.register(self._handle, selectors.EVENT_READ)
                if not end.select(timeout):
                    raise subprocess.TimeoutExpired(str(self.pid), timeout or 0.0)
            self._gone = True
            os.close(self._handle)
        return 0

    def kill(self) -> None:
        """End it."""
        if not self._gone:
            with suppress(ProcessLookupError):
                signal.pidfd_send_signal(self._handle, signal.SIGKILL)
