# SPDX-License-Identifier: Apache-2.0
"""
Reading mcap files: whole chunks, the next ones ahead in threads, and what a damaged file has left.

Source: MCAP format specification version 0, https://mcap.dev/spec.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
import os
from pathlib import Path
import struct
from typing import BinaryIO, TypeVar

from imu_bench.bags import mcap_records as rec
from imu_bench.bags.block import Block, Channel
from imu_bench.bags.buffers import Buffer
from imu_bench.bags.compression import crc32, MAX_EXPANDED
from imu_bench.bags.mcap_chunks import (
    Found,
    grouped,
    load,
    load_chunk,
    Loaded,
    Messages,
    messages_of,
    ordered,
    walked,
)
from imu_bench.bags.problems import Problems
from imu_bench.errors import RecordingError

_WINDOW = 1 << 23
_LOOSE = frozenset((rec.HEADER, rec.SCHEMA, rec.CHANNEL, rec.MESSAGE))
_ENDS_RUN = frozenset(range(256)) - _LOOSE


class McapFile:
    """
    One mcap file, never modified.

    A closed file is read by its summary and message indexes; a file without them
    (recorder killed, power lost, disk full) is scanned and read up to its last
    complete message.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._problems = Problems(path.name)
        self._size = path.stat().st_size
        with path.open('rb') as file:
            if file.read(len(rec.MAGIC)) != rec.MAGIC:
                raise RecordingError(f'{path}: not an mcap file: it does not begin with its magic')
            summary = self._summary(file)
            # whether the file was closed by its writer and its summary is sound
            self.complete = summary is not None
            self._chunks: list[rec.ChunkPlace] | None = None
            by_number: Mapping[int, int]
            if summary is None:
                self._catalogue, by_number = self._scan(file)
            else:
                self._catalogue, by_number = summary.catalogue, summary.counts
                whole = summary.chunk_count and summary.chunk_count == len(summary.chunks)
                if whole and self._lists_all(file, summary):
                    self._chunks = summary.chunks
        found = self._catalogue.channels
        # channels, counts: as in ``Storage``
        self.channels: tuple[Channel, ...] = tuple(dict.fromkeys(found.values()))
        self.counts: dict[str, int] = {channel.topic: 0 for channel in self.channels}
        for number, count in by_number.items():
            if number in found:
                self.counts[found[number].topic] += count
            elif count:
                self._problems.add(f'{count} messages belong to no channel', 'channels')

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
        for number, channel in self._catalogue.channels.items():
            if channel.topic in topics:
                groups.setdefault(channel, []).append(number)
        for buffer, messages in self._runs():
            for channel, numbers in groups.items():
                found = [messages[number] for number in numbers if number in messages]
                if found:
                    yield _block(channel, buffer, found[0] if len(found) == 1 else ordered(found))

    @property
    def problems(self) -> list[str]:
        """What is wrong with the file, as far as it has been read."""
        return self._problems.lines

    def close(self) -> None:
        """Do nothing: the file is open only while it is read."""

    # --- the parts of a file ---------------------------------------------------------

    def _runs(self) -> Iterator[Messages]:
        """Yield all messages of the file, those of a few chunks at a time."""
        with self.path.open('rb') as file:
            places = self._sections(file) if self._chunks is None else self._chunks
            for loaded in ahead(self._load, grouped(file, places)):
                self._tell(loaded.problems)
                messages, loaded.messages = loaded.messages, []
                # not kept while the next are loaded
                while messages:
                    yield messages.pop(0)

    def _load(self, place: list[rec.ChunkPlace] | Buffer) -> Loaded:
        """Return the messages of some chunks, or of a window of loose records."""
        if isinstance(place, list):
            return load(self.path, self._size, place)
        return Loaded([walked(place)])

    def _tell(self, problems: list[str]) -> None:
        for problem in problems:
            self._problems.add(problem, 'damaged chunks')

    def _sections(self, file: BinaryIO) -> Iterator[rec.ChunkPlace | Buffer]:
        """Yield, from the first byte to the last, chunks and windows of loose records."""
        position = len(rec.MAGIC)
        while (head := self._read(file, position, rec.RECORD.size)) and len(
            head
        ) == rec.RECORD.size:
            opcode, size = rec.RECORD.unpack(head)
            after = position + rec.RECORD.size + size
            if opcode in (rec.DATA_END, rec.FOOTER):
                return
            if not rec.valid_opcode(opcode) or (opcode in _LOOSE and size > MAX_EXPANDED):
                self._problems.add(f'no record at byte {position}: the rest is skipped')
                return
            if opcode == rec.CHUNK:
                indexes = self._index_length(file, after)
                yield rec.ChunkPlace(position, after - position, indexes)
                after += indexes
            elif opcode in _LOOSE:
                room = self._size - position
                # messages come in runs; the other records stand alone
                wanted = _WINDOW if opcode == rec.MESSAGE else 0
                window = self._read(file, position, min(max(wanted, after - position), room))
                end = rec.walk(window, until=_ENDS_RUN).end
                if end:
                    yield memoryview(window)[:end]
                    after = position + end
            if after > self._size:
                self._problems.add(f'cut off in the record at byte {position}')
                return
            position = after
        self._problems.add(f'cut off after byte {position}')

    def _index_length(self, file: BinaryIO, position: int) -> int:
        start = position
        while len(head := self._read(file, position, rec.RECORD.size)) == rec.RECORD.size:
            opcode, size = rec.RECORD.unpack(head)
            after = position + rec.RECORD.size + size
            if opcode != rec.MESSAGE_INDEX or after > self._size:
                break
            position = after
        return position - start

    def _read(self, file: BinaryIO, start: int, size: int) -> bytes:
        """Return bytes of the file; less where it ends, or if there is no such place."""
        if start >= self._size:
            return b''
        file.seek(start)
        return file.read(size)

    # --- what is in it -----------------------------------------------------------------

    def _summary(self, file: BinaryIO) -> rec.Summary | None:
        tail = max(0, self._size - rec.FOOTER_SIZE)
        footer = rec.parse_footer(self._read(file, tail, rec.FOOTER_SIZE))
        if footer is None:
            self._problems.add('not closed by its recorder: no footer')
            return None
        start, crc = footer
        if not len(rec.MAGIC) < start <= tail:
            return None
        section = self._read(file, start, self._size - start)
        checked = len(section) - len(rec.MAGIC) - 4
        try:
            if crc and crc32(memoryview(section)[:checked]) != crc:
                raise RecordingError('summary damaged: its checksum does not match')
            return rec.parse_summary(section, start)
        except RecordingError as problem:
            self._problems.add(str(problem))
            return None

    def _lists_all(self, file: BinaryIO, summary: rec.Summary) -> bool:
        """Return whether a summary lists every chunk: there is nothing else between those."""
        position = len(rec.MAGIC)
        for place in (*summary.chunks, rec.ChunkPlace(summary.start, 0, 0)):
            while position < place.start:
                head = self._read(file, position, rec.RECORD.size)
                if len(head) < rec.RECORD.size:
                    break
                opcode, size = rec.RECORD.unpack(head)
                if opcode in (rec.CHUNK, rec.MESSAGE):
                    break
                position += rec.RECORD.size + size
            if position != place.start:
                self._problems.add('its summary does not list all chunks: every byte is looked at')
                return False
            position += place.length + place.index_length
        return True

    def _scan(self, file: BinaryIO) -> tuple[rec.Catalogue, Counter[int]]:
        """Find channels and count messages without the help of a summary."""
        catalogue = rec.Catalogue()
        counts: Counter[int] = Counter()
        for place in self._sections(file):
            problems: list[str] = []
            found: Messages | None = None
            if not isinstance(place, rec.ChunkPlace):
                found = walked(place)
            elif (chunk := load_chunk(file, self._size, place, problems)) is not None:
                found = messages_of(chunk, problems)
            self._tell(problems)
            if found is None:
                continue
            if _has_more(found):
                try:
                    catalogue.add_all(found.buffer, rec.walk(found.buffer))
                except struct.error as problem:
                    self._problems.add(f'a damaged channel or schema was skipped: {problem}')
            sizes = {number: mine.offsets.size for number, mine in found.by_channel.items()}
            counts.update(sizes)
        return catalogue, counts


def _has_more(found: Messages) -> bool:
    """Return whether there is more than messages: a channel may come long before its first."""
    sizes = [mine.sizes for mine in found.by_channel.values()]
    messages = sum(int(mine.sum()) + rec.RECORD.size * mine.size for mine in sizes)
    return messages != len(found.buffer)


def _block(channel: Channel, buffer: Buffer, found: Found) -> Block:
    """Return messages of one channel without the heads of their records."""
    return Block(
        channel=channel,
        receive_ns=found.times,
        buffer=buffer,
        offsets=found.offsets + rec.MESSAGE_HEADER,
        sizes=found.sizes - rec.MESSAGE_HEADER,
    )


Job = TypeVar('Job')
Answer = TypeVar('Answer')

THREADS = 2
"""More do not help: somebody has to use what they bring."""

_ROOM = 1 << 26
"""Bytes of all answers together, that in use included, unless a single one is larger."""


def ahead(work: Callable[[Job], Answer], jobs: Iterable[tuple[Job, int]]) -> Iterator[Answer]:
    """
    Yield the answers to some jobs in their order, a few jobs ahead of who asks.

    Worth it where the work leaves the lock of the interpreter alone: decompression,
    checksums, reading, large copies.
    """
    threads = max(1, min(THREADS, os.cpu_count() or 1))
    coming = iter(jobs)
    following = next(coming, None)
    pool = ThreadPoolExecutor(threads)
    waiting: deque[tuple[Future[Answer], int]] = deque()
    taken = 0

    def submit() -> None:
        nonlocal following, taken
        while following is not None and len(waiting) <= threads:
            job, size = following
            if taken and taken + size > _ROOM:
                break
            waiting.append((pool.submit(work, job), size))
            taken += size
            following = next(coming, None)

    try:
        submit()
        while waiting:
            future, size = waiting.popleft()
            submit()
            yield future.result()
            del future
            taken -= size
            submit()
    finally:
        pool.shutdown(cancel_futures=True)
