# SPDX-License-Identifier: Apache-2.0
"""
What killed processes have left of Fast DDS in shared memory.

A segment ``fastrtps_<16 hex digits>`` has a lock file ``..._el``, and a port ``fastrtps_port<n>``
one that ends in ``_el`` or ``_sl``.  Who owns one holds a lock (flock) on its lock file for as
long as he lives: exclusively, or shared by all who listen to a port (Fast DDS,
``RobustExclusiveLock`` and ``RobustSharedLock`` of its shared memory transport).
"""

from __future__ import annotations

from contextlib import suppress
import fcntl
from pathlib import Path
import re
import time

FOLDER = Path('/dev/shm')

_LOCK = re.compile(r'(?P<owned>fastrtps_(?P<port>port[0-9]+|[0-9a-f]{16}))_[es]l')

YOUNG_S = 5.0
"""A lock file is there a moment before it is locked: one that is younger is left alone."""


def remove_leftovers(folder: Path = FOLDER) -> list[str]:
    """
    Remove segments and ports whose owners no longer live; return their names.

    Whatever is locked or belongs to somebody else stays, and a port that somebody has mapped.
    """
    if not folder.is_dir():  # not Linux
        return []
    used: str | None = None
    removed = []
    for lock in sorted(folder.glob('fastrtps_*_[es]l')):
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
        lines += [line for line in text.splitlines() if 'fastrtps_' in line]
    return '\n'.join(lines)
