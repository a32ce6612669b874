# SPDX-License-Identifier: Apache-2.0
"""The processes of a bench: started with their logs, watched, and stopped in order."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
import ctypes
from pathlib import Path
import re
import signal
import subprocess
import sys
import time

PR_SET_PDEATHSIG = 1
"""linux/prctl.h."""


class BenchProcesses:
    """
    The nodes of a bench, one process each.

    Parameters
    ----------
    logs : Path
        Folder that gets one log per process.
    environment : mapping
        The whole environment of the processes: part of it would break ROS 2 wheels, which
        remember in one variable that another is set.
    """

    def __init__(self, logs: Path, environment: Mapping[str, str]) -> None:
        self._logs = logs
        self._environment = dict(environment)
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, name: str, module: str, arguments: Sequence[str]) -> None:
        """Start ``python -m module arguments`` under a name; its output is added to its log."""
        with self.log(name).open('ab') as log:
            self._running[name] = subprocess.Popen(
                [sys.executable, '-m', module, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=self._environment,
                # Ctrl-C in the terminal is for the caller, who stops the nodes in order
                start_new_session=True,
                preexec_fn=_follow_the_parent if sys.platform == 'linux' else None,
            )

    def log(self, name: str) -> Path:
        """Return the path of a process's log."""
        return self._logs / f'{name}.log'

    def move_logs(self, folder: Path) -> None:
        """Move the folder of the logs; processes that run go on writing into them."""
        self._logs.rename(folder)
        self._logs = folder

    def number(self, name: str) -> int:
        """Return the process id of a running process."""
        return self._running[name].pid

    def ended(self) -> dict[str, int]:
        """Return the processes that ended by themselves, with their exit codes."""
        codes = {name: process.poll() for name, process in self._running.items()}
        return {name: code for name, code in codes.items() if code is not None}

    def stop(self, names: Iterable[str] | None = None, *, timeout_s: float = 60.0) -> list[str]:
        """
        Interrupt processes, wait for them, kill what does not end; forget them.

        Returns
        -------
        list of str
            Names of those that had to be killed.
        """
        chosen = list(self._running if names is None else names)
        processes = {name: self._running.pop(name) for name in chosen if name in self._running}
        for process in processes.values():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        deadline = time.monotonic() + timeout_s
        return [name for name, process in processes.items() if _had_to_kill(process, deadline)]

    def last_words(self, name: str) -> str:
        """Return the last line of a process's log that is not empty, as a sentence."""
        text = self.log(name).read_text(encoding='utf-8', errors='replace')
        lines = (line.strip() for line in reversed(text.splitlines()))
        return _sentence(next(filter(None, lines), ''))


def _sentence(line: str) -> str:
    """Return a line of a log without level, time and name of the logger."""
    return re.sub(r'^\[[A-Z]+\] \[[0-9.]+\] \[[^\]]*\]: ', '', line)


def _had_to_kill(process: subprocess.Popen[bytes], deadline: float) -> bool:
    try:
        process.wait(max(0.1, deadline - time.monotonic()))
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        return True
    return False


def _follow_the_parent() -> None:
    """Ask Linux to interrupt this process when its parent dies, however it dies."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGINT)
