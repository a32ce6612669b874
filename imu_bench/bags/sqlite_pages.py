# SPDX-License-Identifier: Apache-2.0
"""
Rows of the messages table straight from the pages of an sqlite3 file, many at a time.

Faster than asking SQLite row by row, and what is left of a damaged file is still
found.  Source: "Database File Format", https://www.sqlite.org/fileformat2.html; the
sections named below are those of that document.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
import struct
from typing import BinaryIO

from imu_bench.bags.buffers import Ints
from imu_bench.bags.compression import MAX_MESSAGE
from imu_bench.errors import RecordingError
import numpy as np
import numpy.typing as npt

Bytes = npt.NDArray[np.uint8]

COLUMNS = ('id', 'topic_id', 'timestamp', 'data')
"""Columns of the messages table in every version of rosbag2."""

_INTERIOR, _LEAF = 0x05, 0x0D
_LEAF_HEADER = 8
_INTERIOR_HEADER = 12
_BATCH_BYTES = 1 << 22
_LEAST_CELL = 11
"""Bytes of the smallest row: a place in the list of cells, sizes, header and two numbers."""
_MAX_DEPTH = 20
_MARGIN = 64
# bytes of an integer by serial type; types 8 and 9 stand for 0 and 1 (section 2.1)
_INTEGER_SIZES = np.array([0, 1, 2, 3, 4, 6, 8, 0, 0, 0])
_FIRST_BLOB = 12


@dataclass(frozen=True, eq=False)
class RowBatch:
    """Rows of the messages table."""

    buffer: bytes  # holds the data of the rows
    # topics, stamps: topic ids and receive times
    topics: Ints
    stamps: Ints
    # offsets, sizes: where in the buffer the data of each row begins, and how long it is
    offsets: Ints
    sizes: Ints
    local: Ints  # how much of it lies there
    overflow: Ints  # page on which the rest lies; 0 if there is none
    bad: int  # cells, and whole pages, that do not belong to the table


class Pages:
    """The pages of an sqlite3 file."""

    def __init__(self, path: Path) -> None:
        with path.open('rb') as file:
            header = file.read(100)
        if len(header) < 100:
            raise RecordingError(f'{path}: cut off in the header')
        (size,) = struct.unpack_from('>H', header, 16)
        self.size = 65536 if size == 1 else size
        self.usable = self.size - header[20]
        if self.size < 512 or self.size & (self.size - 1) or self.usable < 480:
            raise RecordingError(f'{path}: a page size of {self.size} bytes is not possible')
        self.path = path
        self.count = path.stat().st_size // self.size
        self._batch = max(1, _BATCH_BYTES // self.size)
        self.begin()

    def begin(self) -> None:
        """Begin a pass over the rows: each overflow page belongs to one of them."""
        self._taken = np.zeros(self.count + 1, np.bool_)

    def leaves(self, root: int) -> tuple[Ints, bool]:
        """
        Return the leaf pages of a table in the order of its rows, and whether all were found.

        When the tree of pages is broken, every page that looks like a leaf is returned.
        """
        with self.path.open('rb') as file:
            level = np.array([root], np.int64)
            for _ in range(_MAX_DEPTH):
                # all leaves of a tree lie at one depth, so the first page tells for its level
                if not ((level > 1) & (level <= self.count)).all() or _repeats(level):
                    break
                if self._page(file, int(level[0]))[0] == _LEAF:
                    return level, True
                children = [self._children(self._page(file, page)) for page in level.tolist()]
                if any(found is None for found in children):
                    break
                level = np.concatenate([found for found in children if found is not None])
            return self._scan(file), False

    def rows(self, leaves: Ints) -> Iterator[RowBatch]:
        """Yield the rows of some leaf pages, a few megabytes at a time."""
        with self.path.open('rb') as file:
            for buffer, bases in self._batches(file, leaves):
                yield self._parse(buffer, bases)

    def continued(self, file: BinaryIO, data: bytes, size: int, page: int) -> bytes | None:
        """Return data whose rest lies on overflow pages (section 1.6), None if it is damaged."""
        parts, missing = [data], size - len(data)
        if size > MAX_MESSAGE:
            return None
        while missing > 0:
            if not 0 < page <= self.count or self._taken[page]:
                return None
            self._taken[page] = True
            content = self._page(file, page)
            (page,) = struct.unpack_from('>I', content)
            part = content[4 : 4 + min(missing, self.usable - 4)]
            parts.append(part)
            missing -= len(part)
        return b''.join(parts)

    # --- the tree of pages (section 1.6) -------------------------------------------------

    def _page(self, file: BinaryIO, number: int) -> bytes:
        file.seek((number - 1) * self.size)
        return file.read(self.size)

    def _children(self, page: bytes) -> Ints | None:
        """Return the pages below an interior page, None if it is none."""
        cells, _, _, last = struct.unpack_from('>HHBI', page, 3)
        if page[0] != _INTERIOR or _INTERIOR_HEADER + 2 * cells > self.size:
            return None
        data = np.frombuffer(page, np.uint8)
        places = _big_endian(data, _INTERIOR_HEADER + 2 * np.arange(cells), 2)
        if (places > self.size - 4).any():
            return None
        return np.append(_big_endian(data, places, 4), last)

    def _scan(self, file: BinaryIO) -> Ints:
        """Return every page that looks like a leaf of a table, ordered by its first row."""
        found: list[tuple[int, int]] = []
        for start in range(2, self.count + 1, self._batch):
            numbers = np.arange(start, min(start + self._batch, self.count + 1))
            for buffer, bases in self._batches(file, numbers):
                data = np.frombuffer(buffer + bytes(_MARGIN), np.uint8)
                leaf = bases[data[bases] == _LEAF]
                leaf = leaf[_big_endian(data, leaf + 3, 2) > 0]
                first = leaf + _big_endian(data, leaf + _LEAF_HEADER, 2)
                first = np.minimum(first, len(buffer))
                _, after = _varint(data, first)
                rows, _ = _varint(data, after)
                found += zip(rows.tolist(), (start + leaf // self.size).tolist(), strict=True)
        return np.array([number for _, number in sorted(found)], np.int64)

    def _batches(self, file: BinaryIO, leaves: Ints) -> Iterator[tuple[bytes, Ints]]:
        """Yield bytes of the file and where in them some pages begin."""
        for start in range(0, leaves.size, self._batch):
            part = leaves[start : start + self._batch]
            first, last = int(part.min()), int(part.max())
            if last - first < 2 * self._batch:
                file.seek((first - 1) * self.size)
                yield file.read((last - first + 1) * self.size), (part - first) * self.size
            else:
                pages = [self._page(file, number) for number in part.tolist()]
                yield b''.join(pages), np.arange(part.size) * self.size

    # --- the cells of a leaf (sections 1.6 and 2.1) ----------------------------------------

    def _parse(self, buffer: bytes, bases: Ints) -> RowBatch:
        # some bytes more, so that a damaged number can point beyond the end and be found out
        data = np.frombuffer(buffer + bytes(_MARGIN), np.uint8)
        leaf = data[bases] == _LEAF
        broken = int((~leaf).sum())
        bases = bases[leaf]
        counts = np.minimum(_big_endian(data, bases + 3, 2), self.size // _LEAST_CELL)
        base = np.repeat(bases, counts)
        number = np.arange(base.size) - np.repeat(np.cumsum(counts) - counts, counts)
        pointer = base + _LEAF_HEADER + 2 * number
        cell = base + np.minimum(_big_endian(data, pointer, 2), self.size)
        payload, place = _varint(data, cell)
        _, header = _varint(data, place)
        length, place = _varint(data, header)
        types = []
        for _ in COLUMNS:
            kind, place = _varint(data, np.minimum(place, data.size - 32))
            types.append(kind)
        local = self._local(payload)
        good = (
            (types[0] == 0)
            & (types[1] < _INTEGER_SIZES.size)
            & (types[2] < _INTEGER_SIZES.size)
            & (types[3] >= _FIRST_BLOB)
            & (types[3] % 2 == 0)
            & (place - header == length)
            & (header + local + 4 * (local < payload) <= base + self.size)
        )
        for column in (1, 2):
            types[column] = np.where(good, types[column], 0)
        topic = header + length
        stamp = topic + _INTEGER_SIZES[types[1]]
        blob = stamp + _INTEGER_SIZES[types[2]]
        size = (types[3] - _FIRST_BLOB) // 2
        good &= blob - header + size == payload
        limit = data.size - 16
        topics = _integer(data, np.minimum(topic, limit)[good], types[1][good])
        stamps = _integer(data, np.minimum(stamp, limit)[good], types[2][good])
        spilled = (local < payload)[good]
        overflow = np.zeros(topics.size, np.int64)
        overflow[spilled] = _big_endian(data, (header + local)[good][spilled], 4)
        return RowBatch(
            buffer=buffer,
            topics=topics,
            stamps=stamps,
            offsets=blob[good],
            sizes=size[good],
            local=np.minimum(size, header + local - blob)[good],
            overflow=overflow,
            bad=broken + int((~good).sum()),
        )

    def _local(self, payload: Ints) -> Ints:
        """Return how much of a payload lies in its leaf page."""
        most = self.usable - 35
        least = (self.usable - 12) * 32 // 255 - 23
        fitting = least + (payload - least) % (self.usable - 4)
        spilled = np.where(fitting <= most, fitting, least)
        return np.where(payload <= most, payload, spilled)


def _repeats(pages: Ints) -> bool:
    return np.unique(pages).size < pages.size


def _big_endian(data: Bytes, places: Ints, size: int) -> Ints:
    total = np.zeros(places.size, np.int64)
    for offset in range(size):
        total = (total << 8) | data[places + offset]
    return total


def _integer(data: Bytes, places: Ints, types: Ints) -> Ints:
    """Return signed integers of several serial types."""
    values = np.where(types == 9, 1, 0)
    for kind in np.unique(types).tolist():
        size = int(_INTEGER_SIZES[kind])
        if size:
            mine = types == kind
            unsigned = _big_endian(data, places[mine], size)
            sign = 1 << (8 * size - 1) if size < 8 else 0
            values[mine] = (unsigned ^ sign) - sign
    return values


def _varint(data: Bytes, places: Ints) -> tuple[Ints, Ints]:
    """Return variable-length integers and where they end."""
    byte = data[places].astype(np.int64)
    values = byte & 0x7F
    ends = places + 1
    more = np.flatnonzero(byte >= 0x80)
    for index in range(1, 9):
        if not more.size:
            break
        byte = data[np.minimum(ends[more], data.size - 1)].astype(np.int64)
        if index == 8:
            values[more] = (values[more] << 8) | byte
        else:
            values[more] = (values[more] << 7) | (byte & 0x7F)
        ends[more] += 1
        more = more[byte >= 0x80]
    return values, ends
