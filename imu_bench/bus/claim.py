# SPDX-License-Identifier: Apache-2.0
"""
One program per chip: a lock on the device file that no process can leave behind.

The kernel does not let two programs split one transaction, but a driver reads a count and then
a burst, or selects a bank and then reads it.  Between the two nobody else may talk to the same
chip.  What talks to other chips of the bus does no harm.
"""

from __future__ import annotations

import os
from pathlib import Path
import struct
import time

from imu_bench.errors import BusBusy

PATIENCE_S = 1.0
"""A node that is started again waits so long for the one that is just ending."""


class ChipInUse(BusBusy):
    """Another program has this chip."""


_EVERY_S = 0.02
# fcntl(2): type, whence, start, length and process of struct flock, padded to its alignment
_FLOCK = struct.Struct('@hhqqi0q')
_PROCESSES = Path('/proc')


def claim(fd: int, place: int, where: str, patience_s: float = PATIENCE_S) -> None:
    """
    Take a chip for the open device file, until that is closed or the process dies.

    An open file description lock on one byte of the device file (fcntl(2), F_OFD_SETLK).
    Nothing happens if it is taken already.
    """
    import fcntl  # here: what never opens a bus works where it is not

    request = _FLOCK.pack(fcntl.F_WRLCK, os.SEEK_SET, place, 1, 0)
    deadline = time.monotonic() + patience_s
    while True:
        try:
            fcntl.fcntl(fd, fcntl.F_OFD_SETLK, request)
        except (BlockingIOError, PermissionError) as error:  # EAGAIN or EACCES, fcntl(2)
            if time.monotonic() < deadline:
                time.sleep(_EVERY_S)
                continue
            raise ChipInUse(
                f'{where}: {holder(fd, place) or "another program"} uses this chip; stop it, or '
                'give this sensor another address'
            ) from error
        return


def holder(fd: int, place: int) -> str:
    """Return 'process 4711 (name)' of who has claimed a chip; '' if that cannot be told."""
    lock = f':{os.fstat(fd).st_ino} {place} {place}'
    held = (_process(entry, lock) for entry in _PROCESSES.glob('[0-9]*/fdinfo/*'))
    return next(filter(None, held), '')


def _process(entry: Path, lock: str) -> str:
    """Return the process of an open file, if that has the lock."""
    try:
        text = entry.read_text()
        if any('OFDLCK' in line and line.endswith(lock) for line in text.splitlines()):
            process = entry.parents[1]
            return f'process {process.name} ({(process / "comm").read_text().strip()})'
    except OSError:
        pass  # it has ended, or belongs to somebody else
    return ''
