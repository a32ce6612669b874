# SPDX-License-Identifier: Apache-2.0
"""
The processes of a bench: started with their logs, watched, and stopped in order.

What killed ones have left of Fast DDS in shared memory is removed.  A segment ``fastrtps_<16 hex
digits>`` has a lock file ``..._el``, and a port ``fastrtps_port<n>`` one that ends in ``_el`` or
``_sl``; with Fast DDS 3, that of Kilted, they begin with ``fastdds_``.  Who owns one holds a lock
(flock) on its lock file for as long as he lives: exclusively, or shared by all who listen to a
port (Fast DDS, ``RobustExclusiveLock`` and ``RobustSharedLock`` of its shared memory transport).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
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


FOLDER = Path('/dev/shm')

_LOCK = re.compile(r'(?P<owned>fast(?:rtps|dds)_(?P<port>port[0-9]+|[0-9a-f]{16}))_[es]l')

YOUNG_S = 5.0
"""A lock file is there a moment before it is locked: one that is younger is left alone."""


def remove_leftovers(folder: Path = FOLDER) -> list[str]:
    """
    Remove segments and ports whose owners no longer live; return their names.

    Whatever is locked or belongs to somebody else stays, and a port that somebody has mapped.
    """
    import fcntl  # here: processes are started where it is not, too

    if not folder.is_dir():  # not Linux
        return []
    used: str | None = None
    removed = []
    for lock in sorted(folder.glob('fast*_*_[es]l')):
        match = _LOCK.fullmatch(lock.name)
        if match is None:
            continue
        with suppress(OSError), lock.open('ab') as file:  # in use, somebody else's, or gone
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if time.time() - lock.stat().st_mtime < YOUNG_S:
                continue
            name = match['owned']
            if match['port']:  # who sends to a port has it mapped, without a lock
                used = _mapped() if used is None else used
                if str(folder / name) in used:
                    continue
            for each in (folder / name, folder / f'sem.{name}_mutex', lock):
                each.unlink(missing_ok=True)
            removed.append(name)
    return removed


def _mapped() -> str:
    """Return the lines of /proc that say which shared memory our processes have mapped."""
    lines = []
    for maps in Path('/proc').glob('[0-9]*/maps'):
        try:
            text = maps.read_text(encoding='utf-8', errors='replace')
        except OSError:  # it has ended, or is of another user
            continue
        lines += [line for line in text.splitlines() if 'fastrtps_' in line or 'fastdds_' in line]
    return '\n'.join(lines)
