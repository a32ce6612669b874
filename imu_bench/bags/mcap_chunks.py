# SPDX-License-Identifier: Apache-2.0
"""
Chunks of an mcap file: decompressed, checked, and where the messages in them lie.

Several chunks are put together, so that numpy has long arrays to work on.
Source: MCAP format specification version 0, https://mcap.dev/spec, section "Chunk".
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
import struct
from typing import BinaryIO, NamedTuple

from imu_bench.bags import mcap_records as rec
from imu_bench.bags.buffers import Buffer, Ints, table
from imu_bench.bags.compression import crc32, expand, expand_part, MAX_EXPANDED
from imu_bench.errors import RecordingError
import numpy as np

_GROUP_CHUNKS, _GROUP_BYTES = 8, 1 << 23

_BEYOND = 1 << 62
"""No file has such a byte, and the system none beyond twice that."""

_HEAD = np.dtype(
    [('opcode', 'u1'), ('size', '<i8'), ('channel', '<u2'), ('sequence', '<u4'), ('time', '<i8')]
)
"""What a message record begins with (sections "Records" and "Message")."""


class Found(NamedTuple):
    """
    Messages of one channel, in the order stored.

    Where the contents of their records begin, how many bytes these have, and their log times.
    """

    offsets: Ints
    sizes: Ints
    times: Ints


class Messages(NamedTuple):
    """A buffer, and the messages in it by channel id."""

    buffer: Buffer
    by_channel: dict[int, Found]


class Chunk(NamedTuple):
    """The records of a chunk, and what its message indexes say; empty without any."""

    place: rec.ChunkPlace
    buffer: Buffer
    indexes: dict[int, Ints]


@dataclass
class Loaded:
    """The messages of a few chunks, and what was wrong with them."""

    messages: list[Messages] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)


def grouped(
    file: BinaryIO, places: Iterable[rec.ChunkPlace | Buffer]
) -> Iterator[tuple[list[rec.ChunkPlace] | Buffer, int]]:
    """Yield chunks that are to be loaded together, whatever else as it comes, and their bytes."""
    group: list[rec.ChunkPlace] = []
    size = 0
    for place in places:
        chunk = isinstance(place, rec.ChunkPlace)
        expanded = _claimed(file, place) if isinstance(place, rec.ChunkPlace) else len(place)
        full = size + expanded > _GROUP_BYTES or len(group) >= _GROUP_CHUNKS
        if group and (full or not chunk):
            yield group, size
            group, size = [], 0
        if isinstance(place, rec.ChunkPlace):
            group.append(place)
            size += expanded
        else:
            yield place, expanded
    if group:
        yield group, size


def _claimed(file: BinaryIO, place: rec.ChunkPlace) -> int:
    """Return the bytes that a chunk will take, as it says itself."""
    if place.start >= _BEYOND:
        return 0
    file.seek(place.start)
    claimed = rec.chunk_size(file.read(rec.CHUNK_START))
    return min(max(claimed, place.length), MAX_EXPANDED)


def load(path: Path, size: int, places: Sequence[rec.ChunkPlace]) -> Loaded:
    """
    Return the messages of some chunks of a file of so many bytes.

    Damaged chunks are left out and told in the problems.
    """
    found = Loaded()
    with path.open('rb') as file:
        chunks = [load_chunk(file, size, place, found.problems) for place in places]
    whole = [chunk for chunk in chunks if chunk is not None]
    joined = _join(whole) if len(whole) > 1 and all(chunk.indexes for chunk in whole) else None
    if joined is not None:
        found.messages.append(joined)
    else:
        found.messages += [messages_of(chunk, found.problems) for chunk in whole]
    return found


def load_chunk(
    file: BinaryIO, size: int, place: rec.ChunkPlace, problems: list[str]
) -> Chunk | None:
    """Return a chunk of a file of so many bytes; None if it is damaged."""
    index: dict[int, Ints] = {}
    try:
        length = min(place.length + place.index_length, size - place.start)
        if not 0 < length <= MAX_EXPANDED:
            raise RecordingError('its place or length is not possible')
        file.seek(place.start)
        data = memoryview(file.read(length))
        opcode, content = rec.RECORD.unpack_from(data)
        if opcode != rec.CHUNK or rec.RECORD.size + content != place.length:
            raise RecordingError('no chunk here')
        chunk = rec.parse_chunk(data[rec.RECORD.size : place.length])
        if not chunk.complete:
            problems.append(f'cut off or damaged in the chunk at byte {place.start}')
            return Chunk(place, expand_part(chunk.records, chunk.compression), index)
        index = _message_indexes(data, place.length)
        buffer = expand(chunk.records, chunk.compression, chunk.size)
        if chunk.crc and crc32(buffer) != chunk.crc:
            raise RecordingError('its checksum does not match')
    except (RecordingError, struct.error, ValueError) as problem:
        lost = sum(offsets.size for offsets in index.values())
        problems.append(
            f'damaged chunk at byte {place.start} skipped ({problem}); '
            f'{lost if index else "an unknown number of"} messages lost'
        )
        return None
    return Chunk(place, buffer, index)


def messages_of(chunk: Chunk, problems: list[str]) -> Messages:
    """Return the messages of one chunk, by its indexes or, if they do not fit, by its records."""
    if chunk.indexes and (found := _indexed(chunk.buffer, chunk.indexes)) is not None:
        return Messages(chunk.buffer, found)
    records = rec.walk(chunk.buffer)
    if records.end < len(chunk.buffer):
        problems.append(f'cut off or damaged in the chunk at byte {chunk.place.start}')
    return walked(chunk.buffer, records)


def walked(buffer: Buffer, records: rec.Records | None = None) -> Messages:
    """Return the messages among the records of a buffer."""
    records = rec.walk(buffer) if records is None else records
    whole = (records.opcodes == rec.MESSAGE) & (records.sizes >= rec.MESSAGE_HEADER)
    offsets, sizes = records.offsets[whole], records.sizes[whole]
    heads = table(buffer, _HEAD, offsets - rec.RECORD.size)
    numbers, times = heads['channel'], heads['time'].astype(np.int64)
    found = {}
    for number in np.unique(numbers):
        mine = numbers == number
        found[int(number)] = Found(offsets[mine], sizes[mine], times[mine])
    return Messages(buffer, found)


def _join(chunks: Sequence[Chunk]) -> Messages | None:
    """Return the messages of several chunks in one buffer; None if an index does not fit."""
    sizes = [len(chunk.buffer) for chunk in chunks]
    whole = np.empty(sum(sizes), np.uint8)
    parts: dict[int, list[Ints]] = {}
    start = 0
    for chunk, size in zip(chunks, sizes, strict=True):
        whole[start : start + size] = np.frombuffer(chunk.buffer, np.uint8)
        for number, offsets in chunk.indexes.items():
            if offsets.min() < 0 or offsets.max() > size:
                return None
            parts.setdefault(number, []).append(offsets + start)
        start += size
    buffer = whole.data
    index = {number: np.concatenate(offsets) for number, offsets in parts.items()}
    found = _indexed(buffer, index)
    return None if found is None else Messages(buffer, found)


def _message_indexes(data: memoryview, start: int) -> dict[int, Ints]:
    """Return the offsets of the contents of messages by channel, from the index records."""
    records = rec.walk(data, start)
    index = {}
    for offset, size in zip(records.offsets.tolist(), records.sizes.tolist(), strict=True):
        number, offsets = rec.parse_message_index(data[offset : offset + size])
        if offsets.size:
            index[number] = offsets + rec.RECORD.size
    return index


def _indexed(buffer: Buffer, index: dict[int, Ints]) -> dict[int, Found] | None:
    """Return message indexes in the order of the records if they name all of them, else None."""
    offsets = np.concatenate(list(index.values()))
    if offsets.min() < rec.RECORD.size or offsets.max() + rec.MESSAGE_HEADER > len(buffer):
        return None
    counts = [mine.size for mine in index.values()]
    heads = table(buffer, _HEAD, offsets - rec.RECORD.size)
    sizes = heads['size'].astype(np.int64)
    fits = (
        (heads['opcode'] == rec.MESSAGE)
        & (heads['channel'] == np.repeat(list(index), counts))
        & (sizes >= rec.MESSAGE_HEADER)
        & (sizes <= len(buffer) - offsets)
    )
    if not fits.all():
        return None
    # stable: that is fast for what is a few ordered runs
    order = np.argsort(offsets, kind='stable')
    starts = np.append(offsets[order] - rec.RECORD.size, len(buffer))
    ends = np.concatenate(([0], (offsets + sizes)[order]))
    if (starts < ends).any():
        return None
    for gap in np.flatnonzero(starts != ends).tolist():
        between = memoryview(buffer)[int(ends[gap]) : int(starts[gap])]
        records = rec.walk(between)
        if records.end < starts[gap] - ends[gap] or (records.opcodes == rec.MESSAGE).any():
            return None
    times = heads['time'].astype(np.int64)
    edges = np.cumsum(counts)[:-1]
    parts = (np.split(array, edges) for array in (offsets, sizes, times))
    return {number: ordered([Found(*mine)]) for number, *mine in zip(index, *parts, strict=True)}


def ordered(found: Sequence[Found]) -> Found:
    """Return messages of several channels, or listed in any order, in the order stored."""
    offsets, sizes, times = (
        parts[0] if len(parts) == 1 else np.concatenate(parts)
        for parts in zip(*found, strict=True)
    )
    if (offsets[1:] > offsets[:-1]).all():
        return Found(offsets, sizes, times)
    order = np.argsort(offsets, kind='stable')
    return Found(offsets[order], sizes[order], times[order])
