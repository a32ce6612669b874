# SPDX-License-Identifier: Apache-2.0
"""
Writing mcap files as rosbag2 does: chunks, message indexes, summary.

Source: MCAP format specification version 0, https://mcap.dev/spec; profile "ros2",
https://mcap.dev/spec/registry.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
import os
from pathlib import Path
import struct

from imu_bench.bags import mcap_records as rec
from imu_bench.bags.compression import compress, crc32
from imu_bench.bags.topic_info import NEVER, TopicInfo
import numpy as np
import numpy.typing as npt

CHUNK_SIZE = 768 * 1024
"""Bytes after which a chunk is closed: the default of rosbag2_storage_mcap."""

LIBRARY = 'imu_bench'
_MESSAGE = struct.Struct('<BQHIQQ')
_INDEX_ENTRY = struct.Struct('<QQ')


@dataclass
class _Chunk:
    records: bytearray = field(default_factory=bytearray)
    index: dict[int, bytearray] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    first: int = NEVER
    last: int = 0


class McapWriter:
    """
    Writes one mcap file.

    Nothing that ``flush`` has handed to the operating system is lost when the
    process is killed; without ``close`` the file lacks its summary only.

    Parameters
    ----------
    path : Path
        Must not exist.
    compression : str
        'zstd' or '' for none.

    Raises
    ------
    OSError
        From any method; the file then ends with its last complete chunk.
    """

    suffix = '.mcap'

    def __init__(self, path: Path, compression: str = 'zstd') -> None:
        self.path = path
        self.size = 0  # bytes on disk
        self._compression = compression
        self._channels: dict[str, tuple[int, bytes]] = {}
        self._schemas: dict[str, tuple[int, bytes]] = {}
        self.stored: Counter[str] = Counter()  # messages on disk by topic
        # first_ns, last_ns: earliest and latest receive time on disk
        self.first_ns, self.last_ns = NEVER, 0
        self._chunk = _Chunk()
        self._chunk_indexes: list[bytes] = []
        self._metadata: list[tuple[int, int, str]] = []
        self._file = path.open('xb', buffering=0)
        self._append(rec.MAGIC + _record(rec.HEADER, _string('ros2') + _string(LIBRARY)))

    def add_topic(self, topic: TopicInfo) -> None:
        """Add a channel, and the schema of its type if that is new."""
        if topic.type not in self._schemas:
            number = len(self._schemas) + 1
            encoding = 'ros2msg' if topic.definition else ''
            content = struct.pack('<H', number) + _string(topic.type) + _string(encoding)
            record = _record(rec.SCHEMA, content + _string(topic.definition))
            self._schemas[topic.type] = (number, record)
            self._chunk.records += record
        number = len(self._channels) + 1
        details = _string_map(
            {'offered_qos_profiles': topic.qos_text(), 'topic_type_hash': topic.type_hash}
        )
        content = struct.pack('<HH', number, self._schemas[topic.type][0]) + _string(topic.name)
        record = _record(rec.CHANNEL, content + _string('cdr') + details)
        self._channels[topic.name] = (number, record)
        self.stored[topic.name] = 0
        self._chunk.records += record

    def write(self, topic: str, receive_ns: int, data: bytes) -> None:
        """Add a message."""
        number, chunk = self._channels[topic][0], self._chunk
        index = chunk.index.get(number)
        if index is None:
            index = chunk.index[number] = bytearray()
        index += _INDEX_ENTRY.pack(receive_ns, len(chunk.records))
        length = rec.MESSAGE_HEADER + len(data)
        chunk.records += _MESSAGE.pack(rec.MESSAGE, length, number, 0, receive_ns, receive_ns)
        chunk.records += data
        chunk.first = min(chunk.first, receive_ns)
        chunk.last = max(chunk.last, receive_ns)
        chunk.counts[topic] += 1
        if len(chunk.records) >= CHUNK_SIZE:
            self._close_chunk()

    def write_many(
        self, topic: str, receive_ns: npt.NDArray[np.int64], blobs: npt.NDArray[np.uint8]
    ) -> None:
        """Add messages of one length, shape (n, bytes), much faster than one by one."""
        per_chunk = max(1, CHUNK_SIZE // (_MESSAGE.size + blobs.shape[1]))
        for start in range(0, len(blobs), per_chunk):
            part = slice(start, start + per_chunk)
            self._write_run(topic, receive_ns[part], blobs[part])

    def flush(self) -> None:
        """Hand everything to the operating system."""
        if self._chunk.records:
            self._close_chunk()

    def close(self, metadata: str) -> None:
        """Write the summary with rosbag2's metadata in it, and close the file."""
        try:
            self.flush()
            content = _string('rosbag2') + _string_map({'serialized_metadata': metadata})
            self._metadata.append((self.size, rec.RECORD.size + len(content), 'rosbag2'))
            end = _record(rec.METADATA, content) + _record(rec.DATA_END, struct.pack('<I', 0))
            summary, offsets = self._summary(self.size + len(end))
            start = self.size + len(end)
            tail = summary + offsets
            footer = struct.pack('<BQQQ', rec.FOOTER, 20, start, start + len(summary))
            crc = crc32(tail + footer)
            self._append(end + tail + footer + struct.pack('<I', crc) + rec.MAGIC)
        finally:
            self._file.close()

    def abandon(self, metadata: str) -> None:
        """Close the file without what has not been flushed."""
        self._chunk = _Chunk()
        self.close(metadata)

    def sync(self) -> None:
        """Wait until the disk has what was flushed."""
        os.fsync(self._file.fileno())

    # --- inside ------------------------------------------------------------------------

    def _write_run(
        self, topic: str, receive_ns: npt.NDArray[np.int64], blobs: npt.NDArray[np.uint8]
    ) -> None:
        number, chunk = self._channels[topic][0], self._chunk
        count, length = blobs.shape
        table = np.empty((count, _MESSAGE.size + length), np.uint8)
        head = _MESSAGE.pack(rec.MESSAGE, rec.MESSAGE_HEADER + length, number, 0, 0, 0)
        table[:, : len(head)] = np.frombuffer(head, np.uint8)
        times = np.ascontiguousarray(receive_ns, '<i8').view(np.uint8).reshape(count, 8)
        table[:, len(head) - 16 : len(head) - 8] = times
        table[:, len(head) - 8 : len(head)] = times
        table[:, len(head) :] = blobs
        entries = np.empty((count, 2), '<i8')
        entries[:, 0] = receive_ns
        entries[:, 1] = len(chunk.records) + np.arange(count) * table.shape[1]
        chunk.index.setdefault(number, bytearray()).extend(entries.tobytes())
        chunk.records += table.tobytes()
        chunk.first = min(chunk.first, int(receive_ns.min()))
        chunk.last = max(chunk.last, int(receive_ns.max()))
        chunk.counts[topic] += count
        if len(chunk.records) >= CHUNK_SIZE:
            self._close_chunk()

    def _close_chunk(self) -> None:
        chunk, self._chunk = self._chunk, _Chunk()
        first, last = (chunk.first, chunk.last) if chunk.index else (0, 0)
        plain = bytes(chunk.records)
        packed = compress(plain) if self._compression else plain
        content = struct.pack('<QQQI', first, last, len(plain), crc32(plain))
        content += _string(self._compression) + struct.pack('<Q', len(packed)) + packed
        record = _record(rec.CHUNK, content)
        start = self.size
        indexes, places = bytearray(), bytearray()
        for number, entries in chunk.index.items():
            places += struct.pack('<HQ', number, start + len(record) + len(indexes))
            content = struct.pack('<HI', number, len(entries)) + entries
            indexes += _record(rec.MESSAGE_INDEX, content)
        self._append(record + indexes)
        self._chunk_indexes.append(
            _record(
                rec.CHUNK_INDEX,
                struct.pack('<QQQQI', first, last, start, len(record), len(places))
                + places
                + struct.pack('<Q', len(indexes))
                + _string(self._compression)
                + struct.pack('<QQ', len(packed), len(plain)),
            )
        )
        self.stored.update(chunk.counts)
        if chunk.index:
            self.first_ns, self.last_ns = min(self.first_ns, first), max(self.last_ns, last)

    def _summary(self, start: int) -> tuple[bytes, bytes]:
        """Return the records of the summary and of the offsets to its groups."""
        groups = (
            (rec.SCHEMA, [record for _, record in self._schemas.values()]),
            (rec.CHANNEL, [record for _, record in self._channels.values()]),
            (rec.STATISTICS, [self._statistics()]),
            (rec.CHUNK_INDEX, self._chunk_indexes),
            (
                rec.METADATA_INDEX,
                [
                    _record(rec.METADATA_INDEX, struct.pack('<QQ', place, size) + _string(name))
                    for place, size, name in self._metadata
                ],
            ),
        )
        summary, offsets = bytearray(), bytearray()
        for opcode, records in groups:
            group = b''.join(records)
            if group:
                content = struct.pack('<BQQ', opcode, start + len(summary), len(group))
                offsets += _record(rec.SUMMARY_OFFSET, content)
            summary += group
        return bytes(summary), bytes(offsets)

    def _statistics(self) -> bytes:
        counts = b''.join(
            struct.pack('<HQ', number, self.stored[topic])
            for topic, (number, _) in self._channels.items()
        )
        total = self.stored.total()
        first = self.first_ns if total else 0
        return _record(
            rec.STATISTICS,
            struct.pack(
                '<QHIIIIQQI',
                total,
                len(self._schemas),
                len(self._channels),
                0,  # attachments
                len(self._metadata),
                len(self._chunk_indexes),
                first,
                self.last_ns,
                len(counts),
            )
            + counts,
        )

    def _append(self, data: bytes | bytearray) -> None:
        """Write all of it or, when the disk is full, nothing of it."""
        view = memoryview(data)
        try:
            while view:
                view = view[self._file.write(view) :]
        except OSError:
            self._file.truncate(self.size)
            self._file.seek(self.size)
            raise
        self.size += len(data)


def _record(opcode: int, content: bytes | bytearray) -> bytes:
    return rec.RECORD.pack(opcode, len(content)) + content


def _string(text: str) -> bytes:
    data = text.encode()
    return struct.pack('<I', len(data)) + data


def _string_map(pairs: dict[str, str]) -> bytes:
    data = b''.join(_string(key) + _string(value) for key, value in pairs.items())
    return struct.pack('<I', len(data)) + data
