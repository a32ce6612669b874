# SPDX-License-Identifier: Apache-2.0
"""
Reading sqlite3 storage files of rosbag2, all schema versions, never modifying them.

Topics are asked of SQLite, messages are read from the pages.  Source:
rosbag2_storage_sqlite3; tables ``topics`` and ``messages`` exist since the first
release, the others came later and are optional here.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import closing
from functools import cached_property
from pathlib import Path
import re
import shutil
import sqlite3
from tempfile import mkdtemp
from typing import Any, BinaryIO
import weakref

from imu_bench.bags.block import Block, Channel, join, printable
from imu_bench.bags.buffers import Ints
from imu_bench.bags.compression import MAX_MESSAGE
from imu_bench.bags.problems import Problems
from imu_bench.bags.sqlite_pages import COLUMNS, Pages, RowBatch
from imu_bench.errors import RecordingError
import numpy as np

MAGIC = b'SQLite format 3\x00'
_LEFTOVERS = ('-wal', '-journal')
_TABLE = re.compile(r'\s*create\s+table\b(?!.*\bwithout\s+rowid)', re.IGNORECASE | re.DOTALL)

_MOST_TEXT, _ROW = 1 << 25, 100
"""Characters of all names and definitions; what a row takes beside them."""


class SqliteFile:
    """
    One sqlite3 file of a bag.

    The file is opened as immutable, so that nothing is written beside it.  If a
    recorder left a journal behind, file and journal are copied and rolled
    forward or back there.
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
                tables = _tables(connection)
                self._numbers = _channels(connection, tables)
                root = _message_root(connection, tables)
        except sqlite3.Error as problem:
            reason = ' '.join(str(problem).split())
            raise RecordingError(f'{path}: cannot be read as a bag: {reason}') from problem
        # as in ``Storage``
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
        bad = stored = 0
        self._pages.begin()
        with self._database.open('rb') as file:
            for rows in self._pages.rows(self._leaves):
                bad += rows.bad
                stored += rows.topics.size
                for number in numbers:
                    mine = np.flatnonzero(rows.topics == number)
                    bad += mine.size
                    for block in self._blocks(file, self._numbers[number], rows, mine):
                        bad -= len(block)
                        yield block
        if bad:
            self._problems.add(f'{bad} damaged places were skipped')
        if stored < self.message_count:
            self._problems.add(
                f'by their numbers there were {self.message_count} messages, {stored} are found'
            )

    def _blocks(
        self, file: BinaryIO, channel: Channel, rows: RowBatch, mine: Ints
    ) -> Iterator[Block]:
        """Yield messages of one channel, of large ones some megabytes at a time."""
        if mine.size and not rows.overflow[mine].any():
            sizes, offsets = rows.sizes[mine], rows.offsets[mine]
            yield Block(channel, rows.stamps[mine], rows.buffer, offsets, sizes)
            return
        blobs: list[bytes] = []
        kept: list[int] = []
        room = MAX_MESSAGE
        for index in mine.tolist():
            start, size = int(rows.offsets[index]), int(rows.sizes[index])
            data = rows.buffer[start : start + int(rows.local[index])]
            blob = self._pages.continued(file, data, size, int(rows.overflow[index]))
            if blob is None:
                continue
            blobs.append(blob)
            kept.append(index)
            room -= size
            if room <= 0:
                yield join(channel, rows.stamps[kept], blobs)
                blobs, kept, room = [], [], MAX_MESSAGE
        if kept:
            yield join(channel, rows.stamps[kept], blobs)

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


def _tables(connection: sqlite3.Connection) -> dict[str, int]:
    """Return the plain tables that a bag has and their first pages."""
    # What is anything else, such as a view, could compute whatever it likes without end.
    query = 'SELECT name, type, rootpage, sql FROM sqlite_master'
    tables: dict[str, int] = {}
    for name, kind, page, sql in connection.execute(query):
        if name not in ('topics', 'messages', 'message_definitions'):
            continue
        if kind != 'table' or not isinstance(page, int) or not _TABLE.match(str(sql)):
            raise sqlite3.DatabaseError(
                f'"{name}" in it is no plain table; a bag of rosbag2 has nothing else: '
                'it was not made by a recorder'
            )
        if any(row[6] for row in connection.execute(f'PRAGMA table_xinfo({name})')):
            raise sqlite3.DatabaseError(f'"{name}" in it has computed columns')
        tables[name] = page
    if not {'topics', 'messages'} <= tables.keys():
        raise sqlite3.DatabaseError('it has no tables "topics" and "messages"')
    return tables


def _channels(connection: sqlite3.Connection, tables: Collection[str]) -> dict[int, Channel]:
    definitions: dict[str, tuple[str, str]] = {}
    if 'message_definitions' in tables:
        query = 'SELECT topic_type, encoding, encoded_message_definition FROM message_definitions'
        definitions = {
            kind: (encoding, text) for kind, encoding, text in _texts(connection, query)
        }
    query = 'SELECT id, name, type, serialization_format FROM topics ORDER BY id'
    return {
        number: Channel(name, kind, serialization, *definitions.get(kind, ('', '')))
        for number, name, kind, serialization in _texts(connection, query)
    }


def _texts(connection: sqlite3.Connection, query: str) -> Iterator[tuple[Any, ...]]:
    """Yield rows of text, and maybe a number before it."""
    room = _MOST_TEXT
    for row in connection.execute(query):
        texts = [value for value in row if isinstance(value, str)]
        if len(texts) < len(row) - isinstance(row[0], int):
            raise sqlite3.DatabaseError('a name or type in it is no text')
        room -= sum(map(len, texts)) + _ROW
        if room < 0:
            raise sqlite3.DatabaseError(
                f'its topics have more than {_MOST_TEXT} characters of names and definitions'
            )
        yield row


def _message_root(connection: sqlite3.Connection, tables: Mapping[str, int]) -> int:
    """Return the page at the root of the messages table."""
    columns = tuple(row[1] for row in connection.execute('PRAGMA table_info(messages)'))
    if columns != COLUMNS:
        found = printable(', '.join(columns))
        raise sqlite3.DatabaseError(
            f'the columns of its messages are {found}, not {", ".join(COLUMNS)}'
        )
    return tables['messages']


def _connect(path: Path) -> sqlite3.Connection:
    connection = sqlite3.connect(f'{path.resolve().as_uri()}?immutable=1', uri=True)
    connection.text_factory = lambda text: text.decode('utf-8', 'replace')
    # a file that was cut off is opened all the same: sqlite.org/pragma.html, writable_schema
    connection.execute('PRAGMA writable_schema = ON')
    if hasattr(connection, 'setlimit'):  # from Python 3.11
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _MOST_TEXT)
    return connection
