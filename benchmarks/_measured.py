# SPDX-License-Identifier: Apache-2.0
"""Programs watched: seconds, processor time, and the most memory of one and its children."""

from __future__ import annotations

from collections.abc import Sequence
import os
from pathlib import Path
import subprocess
import threading
import time
from typing import Any, NamedTuple

_WATCH_S = 0.05


def gigabytes(folder: Path) -> float:
    """Return GB in a folder."""
    return sum(file.stat().st_size for file in folder.rglob('*') if file.is_file()) / 1e9


class Measured(NamedTuple):
    """Seconds of a run, and its peak memory in bytes."""

    seconds: float
    peak: int


def run(command: Sequence[str], *, watched: bool = True, **options: Any) -> Measured:
    """
    Run a program; raise if it fails.

    The memory is the proportional set size of all its processes together: what they share
    counts once.  Whoever is watched is a little slower; the memory is 0 for others.
    """
    start = time.perf_counter()
    process = subprocess.Popen(command, **options)
    peak = 0
    done = threading.Event()

    def watch() -> None:
        nonlocal peak
        while not done.wait(_WATCH_S):
            peak = max(peak, sum(map(proportional_set, family(process.pid))))

    watcher = threading.Thread(target=watch)
    if watched:
        watcher.start()
    try:
        code = process.wait()
    finally:
        done.set()
        if watched:
            watcher.join()
    seconds = time.perf_counter() - start
    if code:
        raise subprocess.CalledProcessError(code, command)
    return Measured(seconds, peak)


def family(root: int) -> list[int]:
    """Return a process and all that descend from it."""
    parents: dict[int, list[int]] = {}
    for status in Path('/proc').glob('[0-9]*/stat'):
        try:
            fields = status.read_text().rpartition(')')[2].split()
        except OSError:
            continue
        parents.setdefault(int(fields[1]), []).append(int(status.parent.name))
    found = [root]
    for pid in found:
        found += parents.get(pid, [])
    return found


def proportional_set(pid: int) -> int:
    try:
        lines = Path(f'/proc/{pid}/smaps_rollup').read_text().splitlines()
    except OSError:
        return 0
    return sum(int(line.split()[1]) for line in lines if line.startswith('Pss:')) * 1024


def cpu_seconds(pid: int) -> float:
    """Return what a process and all below it have used so far: utime and stime of proc(5)."""
    ticks = 0
    for process in family(pid):
        fields = Path(f'/proc/{process}/stat').read_text().rpartition(')')[2].split()
        ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf('SC_CLK_TCK')
