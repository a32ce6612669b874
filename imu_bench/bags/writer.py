# SPDX-License-Identifier: Apache-2.0
"""Writing bags as rosbag2 of ROS 2 Jazzy does: a folder with storage files and metadata."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from datetime import datetime, timezone
import errno
from pathlib import Path
import sqlite3
from typing import NoReturn

from imu_bench.bags import metadata
from imu_bench.bags.mcap_writer import McapWriter
from imu_bench.bags.metadata import StoredFile
from imu_bench.bags.sqlite_writer import SqliteWriter
from imu_bench.bags.topic_info import TopicInfo
from imu_bench.errors import RecordingError
import numpy as np
import numpy.typing as npt

STORAGES = ('mcap', 'sqlite3')

_FULL = (errno.ENOSPC, errno.EDQUOT)
_FAILURES = (OSError, sqlite3.Error)


class BagWriter:
    """
    Writes a bag.

    ``flush`` hands everything to the operating system: call it at least once a
    second, and a killed process loses no more than that second.  When the disk is
    full, every method raises; what was flushed stays readable.

    Parameters
    ----------
    path : Path
        Folder of the bag; must not exist.
    storage : {'mcap', 'sqlite3'}
        Format of the storage files.
    compression : str
        Of the chunks of mcap: 'zstd' or '' for none.
    max_bytes : int
        Size above which ``flush`` begins the next file; 0 for one file.
    custom : mapping of str to str
        Custom data of the metadata.

    Attributes
    ----------
    counts : dict of str to int
        Messages on disk by topic.

    Raises
    ------
    RecordingError
        If the folder exists or cannot be made, the storage is unknown, or, from any
        method, if the disk is full or fails.

    Examples
    --------
    >>> from tempfile import mkdtemp
    >>> from imu_bench.bags.topic_info import describe
    >>> with BagWriter(Path(mkdtemp()) / 'bag') as bag:
    ...     bag.add_topic(describe('/text', 'std_msgs/msg/String'))
    ...     bag.write('/text', 1, b'...')
    >>> bag.counts, sorted(file.name for file in bag.path.iterdir())
    ({'/text': 1}, ['bag_0.mcap', 'metadata.yaml'])
    """

    def __init__(
        self,
        path: str | Path,
        storage: str = 'mcap',
        *,
        compression: str = 'zstd',
        max_bytes: int = 0,
        custom: Mapping[str, str] | None = None,
    ) -> None:
        if storage not in STORAGES:
            raise RecordingError(
                f'storage {storage!r} is unknown; known are {", ".join(STORAGES)}'
            )
        self.path = Path(path)
        self.storage = storage
        self._compression = compression
        self._max_bytes = max_bytes
        self._custom = dict(custom or {})
        self._topics: dict[str, TopicInfo] = {}
        self._finished: list[StoredFile] = []
        self._failure: RecordingError | None = None
        self._open = True
        try:
            self.path.mkdir(parents=True)
            self._file = self._next_file()
        except FileExistsError as problem:
            raise RecordingError(
                f'{self.path}: exists already; a bag is never overwritten, choose another name'
            ) from problem
        except _FAILURES as problem:
            raise RecordingError(
                f'{self.path}: cannot be written: {_reason(problem)}'
            ) from problem

    @property
    def counts(self) -> dict[str, int]:
        """Messages on disk by topic."""
        files = self._files()
        return {name: sum(file.counts.get(name, 0) for file in files) for name in self._topics}

    def add_topic(self, topic: TopicInfo) -> None:
        """Add a topic; it can be written to from now on."""
        self._check()
        if topic.name in self._topics:
            raise RecordingError(f'{self.path}: topic {topic.name} was added already')
        try:
            self._file.add_topic(topic)
        except _FAILURES as problem:
            self._fail(problem)
        self._topics[topic.name] = topic

    def write(self, topic: str, receive_ns: int, data: bytes) -> None:
        """Write one serialized message."""
        self._check()
        try:
            self._file.write(topic, receive_ns, data)
        except _FAILURES as problem:
            self._fail(problem)

    def write_many(
        self, topic: str, receive_ns: npt.NDArray[np.int64], blobs: npt.NDArray[np.uint8]
    ) -> None:
        """Write serialized messages of one length, shape (n, bytes)."""
        self._check()
        try:
            self._file.write_many(topic, receive_ns, blobs)
        except _FAILURES as problem:
            self._fail(problem)

    def flush(self, *, sync: bool = False) -> None:
        """
        Hand everything to the operating system; begin a new file if this one is large enough.

        With ``sync``, also wait until the disk has it.
        """
        self._check()
        try:
            self._file.flush()
            if sync:
                self._file.sync()
            if self._max_bytes and self._file.size >= self._max_bytes:
                self._finish()
                self._file = self._next_file()
        except _FAILURES as problem:
            self._fail(problem)

    def close(self) -> None:
        """Finish the bag; does nothing the second time."""
        if not self._open:
            return
        try:
            self._finish()
            self._write_metadata()
        except _FAILURES as problem:
            self._fail(problem)
        self._open = False

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    # --- inside ------------------------------------------------------------------------

    def _next_file(self) -> McapWriter | SqliteWriter:
        name = f'{self.path.name}_{len(self._finished)}'
        if self.storage == 'mcap':
            file: McapWriter | SqliteWriter = McapWriter(
                self.path / (name + McapWriter.suffix), self._compression
            )
        else:
            file = SqliteWriter(self.path / (name + SqliteWriter.suffix), metadata.ros_distro())
        for topic in self._topics.values():
            file.add_topic(topic)
        return file

    def _files(self) -> list[StoredFile]:
        current = self._file
        if any(file.name == current.path.name for file in self._finished):
            return self._finished
        stored = dict(current.stored)
        return [
            *self._finished,
            StoredFile(current.path.name, stored, current.first_ns, current.last_ns),
        ]

    def _document(self) -> dict[str, object]:
        return metadata.document(
            self.storage,
            self._files(),
            tuple(self._topics.values()),
            metadata.ros_distro(),
            self._custom,
        )

    def _finish(self) -> None:
        self._file.flush()
        self._file.close(metadata.text(self._document()))
        self._finished = self._files()

    def _write_metadata(self) -> None:
        metadata.write(self.path / metadata.FILE_NAME, self._document())

    def _check(self) -> None:
        if self._failure is not None:
            raise self._failure
        if not self._open:
            raise RecordingError(f'{self.path}: the bag is closed')

    def _fail(self, problem: Exception) -> NoReturn:
        """Keep what is on the disk, close the file as well as possible, and say so."""
        self._open = False
        total = sum(self.counts.values())
        last = self._file.last_ns
        until = f' up to {_clock(last)}' if total else ''
        self._failure = RecordingError(
            f'{self.path}: {_reason(problem)}; recording ended, '
            f'{total} messages{until} are kept and can be read'
        )
        with suppress(*_FAILURES):
            self._file.abandon(metadata.text(self._document()))
        with suppress(*_FAILURES):
            self._write_metadata()
        raise self._failure from problem


def _reason(problem: Exception) -> str:
    if isinstance(problem, OSError):
        if problem.errno in _FULL:
            return 'the disk is full'
        return problem.strerror or str(problem)
    return 'the disk is full' if 'is full' in str(problem) else str(problem)


def _clock(stamp_ns: int) -> str:
    moment = datetime.fromtimestamp(stamp_ns / 1e9, timezone.utc)
    return moment.strftime('%Y-%m-%d %H:%M:%S UTC')
