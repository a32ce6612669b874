# SPDX-License-Identifier: Apache-2.0
"""
A clock and the wires of a sensor, with everything that passes written down.

A thread of its own compresses and writes it: a disk never holds up a bus.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import datetime, timezone
from functools import partial
from itertools import count
import os
from pathlib import Path
from queue import SimpleQueue
import threading
import time
from typing import Any, BinaryIO
import zlib

from imu_bench.bus.interface import Clock
from imu_bench.bus.recording.events import CLOCK, FAILED, Kind, packed_error, REQUEST
from imu_bench.bus.recording.file import BLOCK_BYTES, block_of, Head
from imu_bench.bus.recording.wires import described, KINDS
from imu_bench.errors import BenchError, os_error_text, RecordingError
from imu_bench.version import __version__

MOST_WAITING = 256
"""Blocks that may wait for the disk, 16 MiB: minutes of any sensor."""

SYNC_S = 1.0
"""So often what is written is forced onto the disk."""

_LEVEL = 1


class BlockWriter:
    """A new file, block by block."""

    def __init__(self, path: str | Path, head: bytes) -> None:
        self.problem = ''  # why it ended early; empty while all is well
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


BLOCK_NS = 1_000_000_000
"""A block is handed over after so long, full or not: a power cut costs no more than two."""

_TIME = int(Kind.TIME)


class Recorder:
    """
    Writes what passes between a sensor and its driver.

    It is the Clock for driver and acquisition.  A recording of which no request was answered
    is not kept.

    Parameters
    ----------
    path : str or Path
        New file; it gets a number if there is one of that name.
    buses : mapping of part name to bus
        What is recorded.
    settings : mapping
        All of the driver's own.
    label : str
        What stands behind the sensor.

    Raises
    ------
    RecordingError
        If the file cannot be made.

    Examples
    --------
    >>> from tempfile import mkdtemp
    >>> from imu_bench.bus.clock import SystemClock
    >>> from imu_bench.bus.scripted import ScriptedRegisters
    >>> chip = {'': ScriptedRegisters([(('read', 0x75, 1), bytes([0x71]))])}
    >>> path = f'{mkdtemp()}/a.wire'
    >>> recorder = Recorder(path, chip, SystemClock(), 'mpu9250', {}, 'hardware mpu9250')
    >>> recorder.wires[''].read(0x75, 1).hex()
    '71'
    >>> recorder.finish()
    """

    def __init__(
        self,
        path: str | Path,
        buses: Mapping[str, Any],
        clock: Clock,
        driver: str,
        settings: Mapping[str, Any],
        label: str,
    ) -> None:
        self._clock = clock
        heads = tuple(described(part, bus) for part, bus in buses.items())
        now_ns = clock.now_ns()
        begun = datetime.fromtimestamp(now_ns // 10**9, timezone.utc).isoformat()
        head = Head(driver, dict(settings), label, __version__, begun, heads)
        self._writer = BlockWriter(path, head.as_bytes())
        self._block = bytearray()
        self._due_ns = now_ns + BLOCK_NS
        self._going_on, self._finished, self._answered = True, False, False
        # for the driver, in the place of `buses`
        self.wires: Mapping[str, Any] = {
            wire.part: KINDS[wire.kind](wire, partial(self._exchange, number), buses[wire.part])
            for number, wire in enumerate(heads)
        }

    @property
    def problem(self) -> str:
        """Why the recording ended early; empty while all is well."""
        return self._writer.problem

    @property
    def said(self) -> str:
        """What it does, for people."""
        doing = 'recording to' if self._going_on else 'recorded to'
        return f'{doing} {self._writer.path}, {self._writer.size / 1e6:.3f} MB'

    def now_ns(self) -> int:
        """Return the time, and write it down."""
        now_ns = self._clock.now_ns()
        if self._going_on:
            self._block += CLOCK.pack(_TIME, now_ns)
            if now_ns >= self._due_ns or len(self._block) >= BLOCK_BYTES:
                self._due_ns = now_ns + BLOCK_NS
                self._hand_over()
        return now_ns

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at `deadline_ns`, or at once when that has passed."""
        self._clock.sleep_until(deadline_ns)

    def sleep(self, seconds: float) -> None:
        """Let `seconds` pass."""
        self._clock.sleep(seconds)

    def begin(self) -> None:
        """Do nothing: it records from the first transfer on."""

    def finish(self) -> None:
        """End the recording; what happens afterwards passes unrecorded.  Idempotent."""
        if self._finished:
            return
        if self._going_on:
            self._hand_over()
        self._going_on, self._finished = False, True
        self._writer.close()
        if not self._answered:
            self._writer.path.unlink(missing_ok=True)

    def _exchange(self, part: int, kind: int, request: bytes, live: Callable[[], bytes]) -> bytes:
        try:
            answer = bytes(live())
        except BenchError as error:
            self._note(part, kind | FAILED, request, packed_error(error))
            raise
        self._answered = True
        self._note(part, kind, request, answer)
        return answer

    def _note(self, part: int, kind: int, request: bytes, answer: bytes) -> None:
        if self._going_on:
            self._block += REQUEST.pack(kind, part, len(request), len(answer)) + request + answer

    def _hand_over(self) -> None:
        if self._block:
            self._going_on = self._writer.put(bytes(self._block))
            self._block.clear()
