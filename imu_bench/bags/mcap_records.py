# SPDX-License-Identifier: Apache-2.0
"""
The records of an mcap file: bytes to values, no file access.

Source: MCAP format specification version 0, https://mcap.dev/spec, section "Records".
All integers are little-endian; a string is its length (uint32) and UTF-8.
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field
import struct
from typing import NamedTuple

from imu_bench.bags.block import Channel
from imu_bench.bags.buffers import Buffer, table
from imu_bench.errors import RecordingError
import numpy as np
import numpy.typing as npt

MAGIC = b'\x89MCAP0\r\n'

HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
STATISTICS, METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = range(0x0B, 0x10)
_LAST_OPCODE = DATA_END
_FIRST_PRIVATE = 0x80

RECORD = struct.Struct('<BQ')
"""Opcode and length of the content before every record."""

_MOST_TEXT = 1 << 24
"""Characters of all schemas of a file; those of the largest message types have 100 000."""

_INDEX_HEAD = struct.Struct('<HI')

MESSAGE_HEADER = 22
"""Bytes of channel id, sequence, log time and publish time before the data of a message."""

FOOTER_SIZE = RECORD.size + 20 + len(MAGIC)


_NUMBER = np.dtype('<u2')
"""Of a schema or channel: the first field of its record."""

_FEWEST_ALIKE, _MOST_ALIKE = 16, 1 << 16
"""Records that are compared at once: twice as many whenever all of them were alike."""


class Records(NamedTuple):
    """Where the records of a buffer lie; ``end`` is where the last complete one ends."""

    opcodes: npt.NDArray[np.uint8]
    offsets: npt.NDArray[np.int64]
    sizes: npt.NDArray[np.int64]
    end: int


def walk(buffer: Buffer, start: int = 0, until: frozenset[int] = frozenset()) -> Records:
    """Find the records of a buffer, up to the first one that is incomplete or no record."""
    # not lists: a chunk may hold millions of records without content
    opcodes, offsets, sizes = array('B'), array('q'), array('q')
    unpack, head, stop = RECORD.unpack_from, RECORD.size, len(buffer)
    position, before, looked_at = start, (0, 0), _FEWEST_ALIKE
    while position + head <= stop:
        opcode, size = unpack(buffer, position)
        after = position + head + size
        if after > stop or not valid_opcode(opcode) or opcode in until:
            break
        if before == (opcode, size):
            # messages of one topic are alike, and millions of records without content
            alike = _alike(buffer, position, head + size, looked_at)
            opcodes.extend(array('B', [opcode]) * alike)
            sizes.extend(array('q', [size]) * alike)
            places = position + head + (head + size) * np.arange(alike, dtype=np.int64)
            offsets.frombytes(places.tobytes())
            position += alike * (head + size)
            if alike == looked_at:
                looked_at = min(2 * looked_at, _MOST_ALIKE)
            else:
                looked_at, before = _FEWEST_ALIKE, (0, 0)
            continue
        opcodes.append(opcode)
        offsets.append(position + head)
        sizes.append(size)
        position, before = after, (opcode, size)
    return Records(
        np.asarray(opcodes, np.uint8),
        np.asarray(offsets, np.int64),
        np.asarray(sizes, np.int64),
        position,
    )


def _alike(buffer: Buffer, position: int, length: int, most: int) -> int:
    """Return how many records from a place on have the head of the first."""
    count = min(most, (len(buffer) - position) // length)
    rows = np.frombuffer(buffer, np.uint8, count * length, position).reshape(count, length)
    other = (rows[:, : RECORD.size] != rows[0, : RECORD.size]).any(axis=1)
    return int(other.argmax()) if other.any() else count


def valid_opcode(opcode: int) -> bool:
    """Return whether a byte can begin a record (section "Opcodes")."""
    return 0 < opcode <= _LAST_OPCODE or opcode >= _FIRST_PRIVATE


class _Cursor:
    """Reads the fields of one record, one after the other."""

    def __init__(self, content: Buffer) -> None:
        self.content = content
        self.position = 0

    def take(self, layout: str) -> tuple[int, ...]:
        values = struct.unpack_from('<' + layout, self.content, self.position)
        self.position += struct.calcsize('<' + layout)
        return values

    def bytes(self, size: int) -> Buffer:
        part = self.content[self.position : self.position + size]
        if len(part) < size:
            raise struct.error('field beyond the end of its record')
        self.position += size
        return part

    def string(self) -> str:
        return bytes(self.bytes(*self.take('I'))).decode('utf-8', 'replace')

    def pairs(self, layout: str) -> list[tuple[int, ...]]:
        """Return a map or array that is preceded by its length in bytes."""
        return list(struct.iter_unpack('<' + layout, self.bytes(*self.take('I'))))


@dataclass
class Catalogue:
    """Schemas and channels met so far."""

    schemas: dict[int, tuple[str, str, str]] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    _text: int = 0

    def add(self, opcode: int, content: Buffer) -> None:
        """Take in the content of a schema or channel record; others are ignored."""
        cursor = _Cursor(content)
        if opcode == SCHEMA:
            (number,) = cursor.take('H')
            schema = (cursor.string(), cursor.string(), cursor.string())
            known = self.schemas.get(number, ())
            self._text += sum(map(len, schema)) - sum(map(len, known))
            if self._text > _MOST_TEXT:
                raise struct.error(f'all schemas have more than {_MOST_TEXT} characters')
            self.schemas[number] = schema
        elif opcode == CHANNEL:
            number, of = cursor.take('HH')
            topic, serialization = cursor.string(), cursor.string()
            name, encoding, definition = self.schemas.get(of, ('', '', ''))
            self.channels[number] = Channel(topic, name, serialization, encoding, definition)

    def add_all(self, buffer: Buffer, records: Records) -> None:
        """Take in every schema and channel record of a buffer, of equal numbers the last."""
        described = (records.opcodes == SCHEMA) | (records.opcodes == CHANNEL)
        # one without a number is damaged, which `add` says
        numbered = np.flatnonzero(described & (records.sizes >= _NUMBER.itemsize))
        numbers = table(buffer, _NUMBER, records.offsets[numbered])
        # a chunk may hold millions of records, but no more than 65 536 numbers
        keys = records.opcodes[numbered].astype(np.int64) << 16 | numbers
        _, last = np.unique(keys[::-1], return_index=True)
        damaged = np.flatnonzero(described & (records.sizes < _NUMBER.itemsize))[:1]
        wanted = np.sort(np.concatenate([numbered[len(keys) - 1 - last], damaged]))
        for index in wanted.tolist():
            start, size = int(records.offsets[index]), int(records.sizes[index])
            self.add(int(records.opcodes[index]), memoryview(buffer)[start : start + size])


class PackedChunk(NamedTuple):
    """Content of a chunk record (section "Chunk")."""

    size: int
    crc: int
    compression: str
    records: Buffer
    complete: bool


CHUNK_START = RECORD.size + 24
"""Bytes of a chunk record up to its expanded size."""


def chunk_size(start: bytes) -> int:
    """Return the expanded size of a chunk from the first bytes of its record; 0 if it is none."""
    if len(start) < CHUNK_START or start[0] != CHUNK:
        return 0
    (size,) = struct.unpack_from('<Q', start, RECORD.size + 16)
    return int(size)


def parse_chunk(content: Buffer) -> PackedChunk:
    """Return the fields of a chunk record, which may be cut off."""
    cursor = _Cursor(content)
    _, _, size, crc = cursor.take('QQQI')
    compression = cursor.string()
    (length,) = cursor.take('Q')
    records = content[cursor.position : cursor.position + length]
    return PackedChunk(size, crc, compression, records, len(records) == length)


def parse_message_index(content: Buffer) -> tuple[int, npt.NDArray[np.int64]]:
    """Return a channel id and the offsets of its messages in the chunk, as they are listed."""
    channel, length = _INDEX_HEAD.unpack_from(content)
    entries = np.frombuffer(content, '<i8', length // 8, _INDEX_HEAD.size)
    return channel, entries.reshape(-1, 2)[:, 1]


class ChunkPlace(NamedTuple):
    """Where a chunk record and the message indexes after it lie in the file."""

    start: int
    length: int
    index_length: int


@dataclass
class Summary:
    """What the end of a closed file says about the rest of it."""

    catalogue: Catalogue
    chunks: list[ChunkPlace]
    counts: dict[int, int]
    chunk_count: int
    start: int


def parse_summary(section: Buffer, start: int) -> Summary | None:
    """
    Return the content of a summary section, or None if statistics or channels are not in it.

    It begins at byte `start` of the file.
    """
    records = walk(section, until=frozenset((FOOTER,)))
    catalogue, chunks = Catalogue(), []
    counts: dict[int, int] | None = None
    chunk_count = 0
    try:
        catalogue.add_all(section, records)
        for opcode, begin, size in zip(*(column.tolist() for column in records[:3]), strict=True):
            cursor = _Cursor(memoryview(section)[begin : begin + size])
            if opcode == CHUNK_INDEX:
                _, _, place, length = cursor.take('QQQQ')
                cursor.pairs('HQ')
                chunks.append(ChunkPlace(place, length, *cursor.take('Q')))
            elif opcode == STATISTICS:
                _, _, _, _, _, chunk_count = cursor.take('QHIIII')
                cursor.take('QQ')
                counts = {int(channel): count for channel, count in cursor.pairs('HQ')}
    except struct.error as problem:
        raise RecordingError(f'summary damaged: {problem}') from problem
    if counts is None or not counts.keys() <= catalogue.channels.keys():
        return None
    chunks.sort()
    return Summary(catalogue, chunks, counts, chunk_count, start)


def parse_footer(tail: Buffer) -> tuple[int, int] | None:
    """Return start and CRC of the summary from the last bytes of a file, None if not closed."""
    if len(tail) < FOOTER_SIZE or bytes(tail[-len(MAGIC) :]) != MAGIC:
        return None
    opcode, size, start, _, crc = struct.unpack_from('<BQQQI', tail, len(tail) - FOOTER_SIZE)
    return (start, crc) if (opcode, size) == (FOOTER, 20) else None
