# SPDX-License-Identifier: Apache-2.0
"""
Reading sqlite3 storage files of rosbag2, all schema versions, never modifying them.

Topics are asked of SQLite, messages are read from the pages.  Source:
rosbag2_storage_sqlite3; tables ``topics`` and ``messages`` exist since the first
release, the others came later and are optional here.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import closing
from functools import cached_property
from pathlib import Path
import shutil
import sqlite3
from tempfile import mkdtemp
from typing import BinaryIO
import weakref

from imu_bench.bags.block import Block, Channel, join
from imu_bench.bags.buffers import Ints
from imu_bench.bags.problems import Problems
from imu_bench.bags.sqlite_pages import COLUMNS, Pages, RowBatch
from imu_bench.errors import RecordingError
import numpy as np

MAGIC = b'SQLite format 3\x00'
_LEFTOVERS = ('-wal', '-journal')


class SqliteFile:
    """
    One sqlite3 file of a bag.

    The file is opened as immutable, so that nothing is written beside it.  If a
    recorder left a journal behind, file and journal are copied and rolled
    forward or back there.

    Parameters
    ----------
    path : Path

    Attributes
    ----------
    channels, counts, problems
        As in ``Storage``.

    Raises
    ------
    RecordingError
        If it is not a bag, or too damaged to list its topics.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._problems = Problems(path.name)
        self._cleaning: weakref.finalize[..., SqliteFile] | None = None
        with path.open('rb') as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise RecordingError(f'{path}: not an sqlite3 file')
        self._database = self._without_leftovers()
        try:
            with closing(_connect(self._database)) as connection:
                self._numbers = _channels(connection)
                root = _message_root(connection)
        except sqlite3.Error as problem:
            reason = ' '.join(str(problem).split())
            raise RecordingError(f'{path}: cannot be read as a bag: {reason}') from problem
        self.channels: tuple[Channel, ...] = tuple(dict.fromkeys(self._numbers.values()))
        self._pages = Pages(self._database)
        self._leaves, whole = self._pages.leaves(root)
        if not whole:
            self._problems.add('damaged or cut off: every page that can be found is read')

    @cached_property
    def message_count(self) -> int:
        """Messages stored, by the numbers of the first and the last if those can be asked for."""
        query = 'SELECT (SELECT max(id) FROM messages) - (SELECT min(id) FROM messages) + 1'
        try:
            with closing(_connect(self._database)) as connection:
                return connection.execute(query).fetchone()[0] or 0
        except sqlite3.Error:
            return sum(self.counts.values())

    @cached_property
    def counts(self) -> dict[str, int]:
        """Messages stored by topic, which takes a pass over the file."""
        found: Counter[int] = Counter()
        for rows in self._pages.rows(self._leaves):
            found.update(dict(zip(*np.unique(rows.topics, return_counts=True), strict=True)))
        counts = dict.fromkeys((channel.topic for channel in self.channels), 0)
        for number, count in found.items():
            if number in self._numbers:
                counts[self._numbers[number].topic] += int(count)
            else:
                self._problems.add(f'{count} messages belong to no topic')
        return counts

    def blocks(self, topics: Collection[str]) -> Iterator[Block]:
        """
        Yield the messages of some topics in the order of recording.

        Damaged messages are left out and reported in ``problems``.
        """
        numbers = [number for number, c in self._numbers.items() if c.topic in topics]
        bad = 0
        with self._database.open('rb') as file:
            for rows in self._pages.rows(self._leaves):
                bad += rows.bad
                for number in numbers:
                    mine = np.flatnonzero(rows.topics == number)
                    if mine.size:
                        block = self._block(file, self._numbers[number], rows, mine)
                        bad += mine.size - len(block)
                        yield block
        if bad:
            self._problems.add(f'{bad} damaged places were skipped')

    def _block(self, file: BinaryIO, channel: Channel, rows: RowBatch, mine: Ints) -> Block:
        if not rows.overflow[mine].any():
            sizes, offsets = rows.sizes[mine], rows.offsets[mine]
            return Block(channel, rows.stamps[mine], rows.buffer, offsets, sizes)
        blobs, stamps = [], []
        for index in mine.tolist():
            start, size = int(rows.offsets[index]), int(rows.sizes[index])
            data = rows.buffer[start : start + int(rows.local[index])]
            blob = self._pages.continued(file, data, size, int(rows.overflow[index]))
            if blob is not None:
                blobs.append(blob)
                stamps.append(int(rows.stamps[index]))
        return join(channel, np.array(stamps, np.int64), blobs)

    @property
    def problems(self) -> list[str]:
        """What is wrong with the file, as far as it has been read."""
        return self._problems.lines

    def close(self) -> None:
        """Give the copy back, if one had to be made."""
        if self._cleaning is not None:
            self._cleaning()

    def _without_leftovers(self) -> Path:
        """Return a file without journal: this one, or a copy with its journal applied."""
        left = [
            beside
            for suffix in _LEFTOVERS
            if (beside := self.path.with_name(self.path.name + suffix)).is_file()
            and beside.stat().st_size
        ]
        if not left:
            return self.path
        folder = Path(mkdtemp(prefix='imu_bench_'))
        self._cleaning = weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        try:
            for file in (self.path, *left):
                shutil.copyfile(file, folder / file.name)
        except OSError as problem:
            raise RecordingError(
                f'{self.path}: has a journal and cannot be copied into {folder} to apply it: '
                f'{problem.strerror}; set TMPDIR to a folder with more room'
            ) from problem
        copy = folder / self.path.name
        self._problems.add(
            'not closed by its recorder: '
            + ' and '.join(file.name for file in left)
            + ' was applied to a copy'
        )
        try:
            with closing(sqlite3.connect(copy)) as connection:
                connection.execute('PRAGMA journal_mode = DELETE').fetchall()
                connection.execute('SELECT count(*) FROM sqlite_master').fetchall()
        except sqlite3.Error as problem:
            self._problems.add(f'the journal could not be applied ({problem})')
        return copy


def _channels(connection: sqlite3.Connection) -> dict[int, Channel]:
    tables = {name for (name,) in connection.execute('SELECT name FROM sqlite_master')}
    if not {'topics', 'messages'} <= tables:
        raise sqlite3.DatabaseError('it has no tables "topics" and "messages"')
    definitions: dict[str, tuple[str, str]] = {}
    if 'message_definitions' in tables:
        query = 'SELECT topic_type, encoding, encoded_message_definition FROM message_definitions'
        definitions = {
            kind: (encoding, text) for kind, encoding, text in connection.execute(query)
        }
    query = 'SELECT id, name, type, serialization_format FROM topics ORDER BY id'
    return {
        number: Channel(name, kind, serialization, *definitions.get(kind, ('', '')))
        for number, name, kind, serialization in connection.execute(query)
    }


def _message_root(connection: sqlite3.Connection) -> int:
    """Return the page at the root of the messages table."""
    columns = tuple(row[1] for row in connection.execute('PRAGMA table_info(messages)'))
    if columns != COLUMNS:
        raise sqlite3.DatabaseError(
            f'the columns of its messages are {", ".join(columns)}, not {", ".join(COLUMNS)}'
        )
    query = "SELECT rootpage FROM sqlite_master WHERE type = 'table' AND name = 'messages'"
    root: int = connection.execute(query).fetchone()[0]
    return root


def _connect(path: Path) -> sqlite3.Connection:
    connection = sqlite3.connect(f'{path.resolve().as_uri()}?immutable=1', uri=True)
    connection.text_factory = lambda text: text.decode('utf-8', 'replace')
    # a file that was cut off is opened all the same: sqlite.org/pragma.html, writable_schema
    connection.execute('PRAGMA writable_schema = ON')
    return connection
