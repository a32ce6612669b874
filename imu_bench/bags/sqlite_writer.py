# SPDX-License-Identifier: Apache-2.0
"""
Writing sqlite3 storage files as rosbag2 Jazzy does (schema version 4).

Source: rosbag2_storage_sqlite3, sqlite_storage.cpp, ``initialize``.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
import sqlite3

from imu_bench.bags.topic_info import NEVER, TopicInfo
import numpy as np
import numpy.typing as npt

_SCHEMA = """
CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
CREATE TABLE metadata(
  id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, metadata TEXT NOT NULL);
CREATE TABLE topics(
  id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
  serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL,
  type_description_hash TEXT NOT NULL);
CREATE TABLE message_definitions(
  id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, encoding TEXT NOT NULL,
  encoded_message_definition TEXT NOT NULL, type_description_hash TEXT NOT NULL);
CREATE TABLE messages(
  id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,
  data BLOB NOT NULL);
CREATE INDEX timestamp_idx ON messages (timestamp ASC);
"""
_SCHEMA_VERSION = 4
_INSERT = 'INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)'


class SqliteWriter:
    """
    Writes one sqlite3 storage file.

    Messages between two calls of ``flush`` are one transaction, so that a file
    whose writer was killed needs no repair.

    Parameters
    ----------
    path : Path
        Must not exist.
    distro : str
        Name of the ROS distribution.

    Raises
    ------
    sqlite3.Error, OSError
        From any method; what was flushed is in the file.
    """

    suffix = '.db3'

    def __init__(self, path: Path, distro: str) -> None:
        path.touch(exist_ok=False)
        self.path = path
        self._topics: dict[str, int] = {}
        self._types: set[str] = set()
        self.stored: Counter[str] = Counter()  # messages on disk by topic
        # first_ns, last_ns: earliest and latest receive time on disk
        self.first_ns, self.last_ns = NEVER, 0
        self._pending: Counter[str] = Counter()
        self._first, self._last = NEVER, 0
        # one thread at a time writes, not always the one that opened the bag
        self._base = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
        # nothing reaches the file before its transaction is complete
        self._base.execute('PRAGMA cache_spill = OFF')
        self._base.execute('PRAGMA synchronous = NORMAL')
        self._base.execute('BEGIN')
        for statement in _SCHEMA.split(';'):
            self._base.execute(statement)
        self._base.execute('INSERT INTO schema VALUES (?, ?)', (_SCHEMA_VERSION, distro))
        self.flush()

    @property
    def size(self) -> int:
        """Bytes on disk."""
        return self.path.stat().st_size

    def add_topic(self, topic: TopicInfo) -> None:
        """Add a topic, and the definition of its type if that is new."""
        if topic.type not in self._types:
            self._types.add(topic.type)
            self._base.execute(
                'INSERT INTO message_definitions (topic_type, encoding, '
                'encoded_message_definition, type_description_hash) VALUES (?, ?, ?, ?)',
                (topic.type, 'ros2msg', topic.definition, topic.type_hash),
            )
        number = len(self._topics) + 1
        self._topics[topic.name] = number
        self.stored[topic.name] = 0
        self._base.execute(
            'INSERT INTO topics VALUES (?, ?, ?, ?, ?, ?)',
            (number, topic.name, topic.type, 'cdr', topic.qos_text(), topic.type_hash),
        )

    def write(self, topic: str, receive_ns: int, data: bytes) -> None:
        """Add a message."""
        self._base.execute(_INSERT, (self._topics[topic], receive_ns, data))
        self._note(topic, 1, receive_ns, receive_ns)

    def write_many(
        self, topic: str, receive_ns: npt.NDArray[np.int64], blobs: npt.NDArray[np.uint8]
    ) -> None:
        """Add messages of one length, shape (n, bytes)."""
        number = self._topics[topic]
        self._base.executemany(
            _INSERT,
            (
                (number, stamp, blob.tobytes())
                for stamp, blob in zip(receive_ns.tolist(), blobs, strict=True)
            ),
        )
        if len(blobs):
            self._note(topic, len(blobs), int(receive_ns.min()), int(receive_ns.max()))

    def flush(self) -> None:
        """Complete the transaction and begin the next one."""
        self._base.execute('COMMIT')
        self._base.execute('BEGIN')
        self.stored.update(self._pending)
        self._pending.clear()
        self.first_ns, self.last_ns = self._first, self._last

    def sync(self) -> None:
        """Do nothing: a completed transaction is on the disk."""

    def close(self, metadata: str) -> None:
        """Store rosbag2's metadata and close the file."""
        try:
            self.flush()
            self._base.execute(
                'INSERT INTO metadata (metadata_version, metadata) VALUES (?, ?)',
                (_SCHEMA_VERSION, metadata),
            )
            self._base.execute('COMMIT')
        finally:
            self._base.close()

    def abandon(self, metadata: str) -> None:
        """Close the file without what has not been flushed."""
        self._pending.clear()
        try:
            if self._base.in_transaction:
                self._base.execute('ROLLBACK')
            self._base.execute('BEGIN')
        except sqlite3.Error:
            self._base.close()
            raise
        self.close(metadata)

    def _note(self, topic: str, count: int, first: int, last: int) -> None:
        self._pending[topic] += count
        self._first, self._last = min(self._first, first), max(self._last, last)
