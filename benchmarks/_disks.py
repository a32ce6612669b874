# SPDX-License-Identifier: Apache-2.0
"""Disks that are small or slow, made of what Linux has; for root."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
import os
from pathlib import Path
import shutil
import subprocess
import time

BALLAST = 'ballast'

_GROUPS = Path('/sys/fs/cgroup')


class NotPossibleHereError(Exception):
    """What a row needs is not to be had on this machine, or not by this user."""


@contextmanager
def small_disk(folder: Path, megabytes: int) -> Iterator[Path]:
    """Mount a disk in memory on a folder of its own."""
    place = folder / 'small'
    place.mkdir()
    command = ['mount', '-t', 'tmpfs', '-o', f'size={megabytes}m', 'tmpfs', str(place)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise NotPossibleHereError(f'a disk in memory: {done.stderr.strip()}')
    try:
        yield place
    finally:
        subprocess.run(['umount', '-l', str(place)], check=True)


def fill(disk: Path) -> None:
    """Leave no room on a disk, in whatever moment."""
    with (disk / BALLAST).open('wb') as ballast, suppress(OSError):
        while True:  # others take and leave room meanwhile
            os.posix_fallocate(ballast.fileno(), ballast.tell(), 4096)
            ballast.seek(4096, os.SEEK_CUR)
            if shutil.disk_usage(disk).free > 2**20:
                rest = shutil.disk_usage(disk).free - 2**20
                os.posix_fallocate(ballast.fileno(), ballast.tell(), rest)
                ballast.seek(rest, os.SEEK_CUR)


@contextmanager
def slow_disk(folder: Path, bytes_per_s: int, processes: Iterable[int]) -> Iterator[None]:
    """
    Let some processes write no faster than this to the disk that holds a folder.

    What they write without waiting for the disk goes into memory as ever: what is slow is fsync.
    """
    number = os.stat(folder).st_dev
    device = f'{os.major(number)}:{os.minor(number)}'
    old = _GROUPS / 'blkio'
    parent = old if old.is_dir() else _GROUPS
    name, rule = 'io.max', f'{device} wbps={bytes_per_s}'
    if old.is_dir():
        name, rule = 'blkio.throttle.write_bps_device', f'{device} {bytes_per_s}'
    group = parent / f'imu_bench_{os.getpid()}_{time.monotonic_ns()}'
    moved = [pid for pid in processes if Path(f'/proc/{pid}').exists()]
    try:
        group.mkdir()
        (group / name).write_text(rule)
        for pid in moved:
            (group / 'cgroup.procs').write_text(str(pid))
    except OSError as error:
        with suppress(OSError):
            group.rmdir()
        raise NotPossibleHereError(f'a disk of {bytes_per_s} B/s: {error}') from error
    try:
        yield
    finally:
        for pid in moved:
            with suppress(OSError):  # it has ended
                (parent / 'cgroup.procs').write_text(str(pid))
        group.rmdir()
