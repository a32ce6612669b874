# SPDX-License-Identifier: Apache-2.0
"""
Reading bags of ROS 1: whole chunks at a time, closed or not, damaged or not.

Source: "Bags/Format/2.0", https://wiki.ros.org/Bags/Format/2.0.  A record is a header
(length, then ``name=value`` fields with their lengths) and data (length, then bytes);
all integers are little-endian.
"""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Collection, Iterator
from functools import cached_property
from pathlib import Path
import struct
from typing import BinaryIO, NamedTuple

from imu_bench.bags.block import Block, Channel
from imu_bench.bags.buffers import Buffer, gather, Ints
from imu_bench.bags.compression import expand, expand_part, MAX_EXPANDED
from imu_bench.bags.problems import Problems
from imu_bench.errors import RecordingError
import numpy as np

MAGIC = b'#ROSBAG V2.0\n'
ANY_VERSION = b'#ROSBAG V'

_MESSAGE, _BAG_HEADER, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = range(2, 8)
_LENGTH = struct.Struct('<I')
_MAX_HEADER = 1 << 16
_MOST_TEXT = 1 << 24
"""Bytes of all connections; those of the largest message types have 100 000."""

_COMPRESSIONS = {b'none': '', b'bz2': 'bz2', b'lz4': 'lz4'}
_INDEX_ENTRY = np.dtype([('sec', '<u4'), ('nanosec', '<u4'), ('offset', '<u4')])
_DAMAGE = (struct.error, KeyError, IndexError, ValueError, RecordingError)


class _Record(NamedTuple):
    """Fields of a record's header, and where its data lies."""

    fields: dict[bytes, bytes]
    start: int
    size: int

    @property
    def opcode(self) -> int:
        return self.fields[b'op'][0]

    def number(self, name: bytes) -> int:
        return int.from_bytes(self.fields[name], 'little')


class _Place(NamedTuple):
    """A chunk record in the file, and the index records behind it."""

    record: _Record
    indexes: list[_Record]


class _Found(NamedTuple):
    """Messages of one connection in a chunk: their records begin at starts, data at offsets."""

    receive_ns: Ints
    starts: Ints
    offsets: Ints
    sizes: Ints


class Ros1File:
    """
    One bag of ROS 1, never modified.

    Attributes
    ----------
    channels, counts, problems
        As in ``Storage``; messages are serialized as 'ros1'.

    Raises
    ------
    RecordingError
        If it is not a bag of ROS 1, or of a version before 2.0.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._problems = Problems(path.name)
        self._size = path.stat().st_size
        self._connections: dict[int, Channel] = {}
        self._counts: Counter[int] = Counter()
        self._text = _MOST_TEXT
        with path.open('rb') as file:
            magic = file.readline(32)
            if magic != MAGIC:
                version = magic.decode('ascii', 'replace').strip()
                raise RecordingError(f'{path}: not a bag of ROS 1 version 2.0 but {version!r}')
            self._places = self._scan(file)
            self._count(file)
        self.channels: tuple[Channel, ...] = tuple(dict.fromkeys(self._connections.values()))

    @cached_property
    def counts(self) -> dict[str, int]:
        """Messages stored by topic."""
        counts = {channel.topic: 0 for channel in self.channels}
        for number, count in self._counts.items():
            counts[self._connections[number].topic] += count
        return counts

    @property
    def message_count(self) -> int:
        """Messages stored."""
        return sum(self.counts.values())

    def blocks(self, topics: Collection[str]) -> Iterator[Block]:
        """
        Yield the messages of some topics, one block per channel and chunk.

        Damaged chunks are skipped and reported in ``problems``.
        """
        groups: dict[Channel, list[int]] = {}
        for number, channel in self._connections.items():
            if channel.topic in topics:
                groups.setdefault(channel, []).append(number)
        with self.path.open('rb') as file:
            for place in self._places:
                loaded = self._load(file, place)
                if loaded is None:
                    continue
                buffer, messages = loaded
                for channel, numbers in groups.items():
                    found = [messages[number] for number in numbers if number in messages]
                    if found:
                        yield _block(channel, buffer, found)

    @property
    def problems(self) -> list[str]:
        """What is wrong with the file, as far as it has been read."""
        return self._problems.lines

    def close(self) -> None:
        """Do nothing: the file is open only while it is read."""

    # --- the records of the file --------------------------------------------------------

    def _scan(self, file: BinaryIO) -> list[_Place]:
        """Find the chunks of the file and the connections behind them."""
        places: list[_Place] = []
        position, index_start = len(MAGIC), 0
        while position < self._size:
            record = self._record_at(file, position)
            if record is None:
                self._problems.add(f'cut off or damaged at byte {position}', 'damaged places')
                position = self._next_chunk(file, index_start, position)
                continue
            position = record.start + record.size
            if record.opcode == _BAG_HEADER:
                index_start = int.from_bytes(record.fields.get(b'index_pos', b''), 'little')
            elif record.opcode == _CHUNK:
                places.append(_Place(record, []))
            elif record.opcode == _INDEX and places:
                places[-1].indexes.append(record)
            elif record.opcode == _CONNECTION:
                self._add_connection(record, self._read(file, record))
        if not index_start:
            self._problems.add('not closed by its recorder: no index')
        elif position > self._size:
            self._problems.add('cut off in its last record')
        return places

    def _next_chunk(self, file: BinaryIO, index_start: int, after: int) -> int:
        """Return where the next chunk begins according to the index at the end of the file."""
        position, found = index_start or self._size, self._size
        while (record := self._record_at(file, position)) is not None:
            if record.opcode == _CHUNK_INFO:
                place = int.from_bytes(record.fields.get(b'chunk_pos', b''), 'little')
                found = min(found, place) if place > after else found
            position = record.start + record.size
        # behind the last chunk there are connections still
        return index_start if found == self._size and index_start > after else found

    def _record_at(self, file: BinaryIO, position: int) -> _Record | None:
        """Return the record that begins at a byte, None if none does."""
        if position >= self._size:
            return None
        file.seek(position)
        try:
            (length,) = _LENGTH.unpack(file.read(_LENGTH.size))
            header = file.read(min(length, _MAX_HEADER) + _LENGTH.size)
            (size,) = _LENGTH.unpack_from(header, length)
            fields = _fields(header[:length])
            record = _Record(fields, position + length + 2 * _LENGTH.size, size)
            return record if record.opcode <= _CONNECTION and size <= MAX_EXPANDED else None
        except _DAMAGE:
            return None

    def _read(self, file: BinaryIO, record: _Record) -> bytes:
        file.seek(record.start)
        return file.read(record.size)

    def _add_connection(self, record: _Record, data: Buffer) -> None:
        try:
            details = _fields(bytes(data))
            topic = record.fields[b'topic'].decode('utf-8', 'replace')
            kind = details[b'type'].decode('utf-8', 'replace')
            definition = details.get(b'message_definition', b'').decode('utf-8', 'replace')
            number = record.number(b'conn')
        except _DAMAGE as problem:
            self._problems.add(f'a damaged connection was skipped: {problem}', 'connections')
            return
        if number in self._connections:
            return
        self._text -= len(data)
        if self._text < 0:
            line = f'connections described in more than {_MOST_TEXT} bytes were skipped'
            self._problems.add(line, 'connections')
            return
        self._connections[number] = Channel(topic, kind, 'ros1', 'ros1msg', definition)

    def _count(self, file: BinaryIO) -> None:
        """Count messages, by the indexes where they can be believed."""
        for place in self._places:
            try:
                counts = {r.number(b'conn'): r.number(b'count') for r in place.indexes}
            except _DAMAGE:
                counts = {}
            # where the file ends too early, an index may be missing
            cut = bool(self.problems) and place is self._places[-1]
            if cut or not counts or not counts.keys() <= self._connections.keys():
                loaded = self._load(file, place)
                messages = {} if loaded is None else loaded[1]
                counts = {number: found.offsets.size for number, found in messages.items()}
            self._counts.update(counts)

    # --- the records of a chunk ---------------------------------------------------------

    def _load(self, file: BinaryIO, place: _Place) -> tuple[Buffer, dict[int, _Found]] | None:
        """Return the data of a chunk and its messages by connection; None if it is damaged."""
        record = place.record
        try:
            data = self._read(file, record)
            compression = _COMPRESSIONS[record.fields[b'compression']]
            if len(data) < record.size:
                self._problems.add(f'cut off in the chunk at byte {record.start}')
                buffer = expand_part(data, compression)
                return buffer, self._walk(buffer, record.start)
            buffer = expand(data, compression, record.number(b'size'))
        except _DAMAGE as problem:
            line = f'damaged chunk at byte {record.start} skipped ({problem})'
            self._problems.add(line, 'damaged chunks')
            return None
        return buffer, self._indexed(file, place, buffer) or self._walk(buffer, record.start)

    def _indexed(self, file: BinaryIO, place: _Place, buffer: Buffer) -> dict[int, _Found] | None:
        """Return the messages that the indexes name, None if those are not all there are."""
        try:
            messages = {
                index.number(b'conn'): _named_messages(self._read(file, index), buffer, index)
                for index in place.indexes
            }
        except _DAMAGE:
            line = f'damaged index of the chunk at byte {place.record.start}: not used'
            self._problems.add(line, 'damaged indexes')
            return None
        known = bool(messages) and messages.keys() <= self._connections.keys()
        return messages if known and self._covers(messages, buffer) else None

    def _covers(self, messages: dict[int, _Found], buffer: Buffer) -> bool:
        """Return whether a chunk holds no other messages than these."""
        starts = np.concatenate([found.starts for found in messages.values()])
        ends = np.concatenate([found.offsets + found.sizes for found in messages.values()])
        order = np.argsort(starts)
        starts = np.append(starts[order], len(buffer))
        ends = np.concatenate(([0], ends[order]))
        return not any(
            starts[gap] < ends[gap]
            or self._walk(memoryview(buffer)[int(ends[gap]) : int(starts[gap])], 0)
            for gap in np.flatnonzero(starts != ends).tolist()
        )

    def _walk(self, buffer: Buffer, start: int) -> dict[int, _Found]:
        """Find the messages of a chunk, and connections not met so far, record by record."""
        view = memoryview(buffer)
        found: dict[int, array[int]] = {}  # not lists: there may be millions
        position = 0
        try:
            while position < len(view):
                (length,) = _LENGTH.unpack_from(view, position)
                fields = _fields(bytes(view[position + 4 : position + 4 + length]))
                (size,) = _LENGTH.unpack_from(view, position + 4 + length)
                record = _Record(fields, position + 8 + length, size)
                position = record.start + size
                if position > len(view):
                    break
                if record.opcode == _MESSAGE:
                    sec, nanosec = struct.unpack('<II', fields[b'time'])
                    stamp = sec * 1_000_000_000 + nanosec
                    entry = (stamp, position - size - 8 - length, record.start, size)
                    found.setdefault(record.number(b'conn'), array('q')).extend(entry)
                elif record.opcode == _CONNECTION:
                    self._add_connection(record, view[record.start : position])
        except _DAMAGE:
            line = f'cut off or damaged in the chunk at byte {start}'
            self._problems.add(line, 'damaged chunks')
        lost = sum(len(found[number]) // 4 for number in found.keys() - self._connections.keys())
        if lost:
            line = f'{lost} messages in the chunk at byte {start} belong to no connection'
            self._problems.add(line, 'chunks with such messages')
        return {
            number: _Found(*np.array(entries, np.int64).reshape(-1, 4).T)
            for number, entries in found.items()
            if number in self._connections
        }


def _fields(header: bytes) -> dict[bytes, bytes]:
    """Return the fields of a header."""
    fields = {}
    position = 0
    while position < len(header):
        (length,) = _LENGTH.unpack_from(header, position)
        position += _LENGTH.size + length
        if position > len(header):
            raise RecordingError('a field is longer than its header')
        name, equals, value = header[position - length : position].partition(b'=')
        if not equals:
            raise RecordingError('a field has no name')
        fields[name] = value
    return fields


def _named_messages(index: bytes, buffer: Buffer, record: _Record) -> _Found:
    """Return the messages of a chunk that an index record names."""
    entries = np.frombuffer(index, _INDEX_ENTRY)
    starts = np.sort(entries['offset'].astype(np.int64))
    order = np.argsort(entries['offset'], kind='stable')
    stamps = entries['sec'].astype(np.int64) * 1_000_000_000 + entries['nanosec']
    room = len(buffer) - 8
    if entries.size != record.number(b'count') or (starts > room).any():
        raise RecordingError('an index points beyond its chunk')
    lengths = gather(buffer, '<u4', starts)
    if (lengths > room - starts).any():
        raise RecordingError('an index points to no record')
    sizes = gather(buffer, '<u4', starts + 4 + lengths)
    offsets = starts + 8 + lengths
    if (sizes > len(buffer) - offsets).any() or not _are_messages(buffer, starts, lengths, record):
        raise RecordingError('an index points to no message')
    return _Found(stamps[order], starts, offsets, sizes)


def _are_messages(buffer: Buffer, starts: Ints, lengths: Ints, index: _Record) -> bool:
    """Return whether the headers at some places are those of messages of one connection."""
    if not starts.size:
        return True
    length = int(lengths[0])
    if (lengths != length).any():
        return False
    first = bytes(memoryview(buffer)[int(starts[0]) + 4 :][:length])
    fields = _fields(first)
    if fields[b'op'] != bytes([_MESSAGE]) or fields[b'conn'] != index.fields[b'conn']:
        return False
    rows = np.ndarray((len(buffer) - length + 1, length), np.uint8, buffer, 0, (1, 1))[starts + 4]
    # everything but the time is the same in the header of every message
    time = first.index(b'time=') + len(b'time=')
    same = np.ones(length, bool)
    same[time : time + 8] = False
    return bool((rows[:, same] == rows[0, same]).all())


def _block(channel: Channel, buffer: Buffer, found: list[_Found]) -> Block:
    stamps, _, offsets, sizes = (np.concatenate(column) for column in zip(*found, strict=True))
    order = np.argsort(offsets, kind='stable')
    return Block(channel, stamps[order], buffer, offsets[order], sizes[order])
