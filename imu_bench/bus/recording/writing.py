# SPDX-License-Identifier: Apache-2.0
"""Blocks that are compressed and written by a thread of their own: a disk never holds up a bus."""

from __future__ import annotations

from itertools import count
import os
from pathlib import Path
from queue import SimpleQueue
import threading
import time
from typing import BinaryIO
import zlib

from imu_bench.bus.recording.file import block_of
from imu_bench.errors import os_error_text, RecordingError

MOST_WAITING = 256
"""Blocks that may wait for the disk, 16 MiB: minutes of any sensor."""

SYNC_S = 1.0
"""So often what is written is forced onto the disk."""

_LEVEL = 1


class BlockWriter:
    """
    A new file, block by block.

    Parameters
    ----------
    path : str or Path
        If there is such a file, the name gets a number: nothing is ever overwritten.
    head : bytes

    Raises
    ------
    RecordingError
        If the file cannot be made.

    Attributes
    ----------
    path : Path
    size : int
        Bytes written.
    problem : str
        Why it ended early; empty while all is well.

    Examples
    --------
    >>> from tempfile import mkdtemp
    >>> first = BlockWriter(f'{mkdtemp()}/a.wire', b'head')
    >>> second = BlockWriter(first.path, b'head')
    >>> first.close(), second.close()
    (None, None)
    >>> first.path.name, second.path.name, second.path.read_bytes()[:4]
    ('a.wire', 'a-2.wire', b'head')
    """

    def __init__(self, path: str | Path, head: bytes) -> None:
        self.problem = ''
        self._file, self.path = _new_file(Path(path))
        self.size, self._crc = len(head), zlib.crc32(head)
        self._blocks: SimpleQueue[bytes | None] = SimpleQueue()
        self._synced = time.monotonic()
        self._file.write(head)
        self._thread = threading.Thread(target=self._run, name='wire writer', daemon=True)
        self._thread.start()

    def put(self, block: bytes) -> bool:
        """Hand over whole events; return whether they will be written."""
        if not self.problem and self._blocks.qsize() >= MOST_WAITING:
            self.problem = f'{self.path}: ends early, the disk does not keep up'
        if self.problem:
            return False
        self._blocks.put(block)
        return True

    def close(self) -> None:
        """Write what waits, and the end."""
        self._blocks.put(None)
        self._thread.join()

    def _run(self) -> None:
        try:
            with self._file as file:
                while (block := self._blocks.get()) is not None:
                    self._write(file, zlib.compress(block, _LEVEL))
                if not self.problem:
                    self._write(file, b'')
                os.fsync(file.fileno())
        except OSError as error:
            self.problem = f'{self.path}: ends early, {os_error_text(error)}'

    def _write(self, file: BinaryIO, data: bytes) -> None:
        block, self._crc = block_of(data, self._crc)
        file.write(block)
        file.flush()
        self.size += len(block)
        if time.monotonic() - self._synced >= SYNC_S:
            os.fsync(file.fileno())
            self._synced = time.monotonic()


def _new_file(path: Path) -> tuple[BinaryIO, Path]:
    """Make a file that was not there, with a number if need be."""
    made, numbers = path, count(2)
    try:
        while (file := _opened_new(made)) is None:
            made = path.with_name(f'{path.stem}-{next(numbers)}{path.suffix}')
        return file, made
    except OSError as error:
        raise RecordingError(
            f'wire_recording: {os_error_text(error)}; name a file in a folder that may be written'
        ) from error


def _opened_new(path: Path) -> BinaryIO | None:
    """Make a file; None if there is one, even one that somebody else has made just now."""
    try:
        return path.open('xb')
    except FileExistsError:
        return None
