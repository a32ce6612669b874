# SPDX-License-Identifier: Apache-2.0
"""Reading sqlite3 storage files: every schema, journals left behind, damage."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
import shutil
import sqlite3

from imu_bench.bags.sqlite import SqliteFile
from imu_bench.errors import RecordingError
import pytest


def read(file: SqliteFile, topics=('/imu0', '/imu1')) -> list[tuple[str, int, bytes]]:
    found = []
    for block in file.blocks(topics):
        found += [
            (block.channel.topic, stamp, blob)
            for stamp, blob in zip(block.receive_ns.tolist(), block.blobs(), strict=True)
        ]
    return sorted(found, key=lambda message: message[1])


def storage(bag: Path) -> Path:
    return bag / f'{bag.name}_0.db3'


def test_reads_what_was_written(write_bag, messages):
    expected = messages(200)
    file = SqliteFile(storage(write_bag(expected, 'sqlite3')))
    assert read(file) == expected
    assert read(file, ['/imu1']) == [m for m in expected if m[0] == '/imu1']
    assert file.counts == {'/imu0': 100, '/imu1': 100}
    assert file.problems == []
    assert file.channels[0].definition.startswith('std_msgs/Header header')


def test_the_first_schema_without_definitions_is_read(tmp_path):
    path = tmp_path / 'old.db3'
    with closing(sqlite3.connect(path)) as base:
        base.executescript(
            'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, '
            'serialization_format TEXT);'
            'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, '
            'data BLOB);'
            "INSERT INTO topics VALUES (3, '/imu0', 'sensor_msgs/Imu', 'cdr');"
            "INSERT INTO messages VALUES (1, 3, 17, x'0102');"
        )
    file = SqliteFile(path)
    assert read(file) == [('/imu0', 17, b'\x01\x02')]
    assert file.channels[0].encoding == ''


def test_a_write_ahead_log_left_behind_is_applied_to_a_copy(tmp_path, write_bag, messages):
    expected = messages(200)
    finished = storage(write_bag(expected, 'sqlite3'))
    folder = tmp_path / 'killed'
    folder.mkdir()
    with closing(sqlite3.connect(finished, isolation_level=None)) as base:
        base.execute('PRAGMA journal_mode = WAL')
        base.execute("INSERT INTO messages VALUES (1000, 1, 2000000000000000000, x'07')")
        for file in finished.parent.glob(finished.name + '*'):
            shutil.copyfile(file, folder / file.name)
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    file = SqliteFile(folder / finished.name)
    assert read(file) == [*expected, ('/imu0', 2000000000000000000, b'\x07')]
    assert 'not closed by its recorder' in file.problems[0]
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before


def test_a_hot_journal_is_rolled_back_on_a_copy(tmp_path, write_bag, messages):
    expected = messages(200)
    finished = storage(write_bag(expected, 'sqlite3'))
    folder = tmp_path / 'killed'
    folder.mkdir()
    with closing(sqlite3.connect(finished, isolation_level=None)) as base:
        base.execute('PRAGMA cache_size = 2')  # so that the transaction spills into the file
        base.execute('BEGIN')
        base.execute('DELETE FROM messages WHERE id > 20')
        for file in finished.parent.glob(finished.name + '*'):
            shutil.copyfile(file, folder / file.name)
    assert (folder / (finished.name + '-journal')).stat().st_size > 0
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    file = SqliteFile(folder / finished.name)
    assert read(file) == expected
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before


def test_copies_are_given_back(tmp_path, write_bag, messages, monkeypatch):
    finished = storage(write_bag(messages(10), 'sqlite3'))
    finished.with_name(finished.name + '-journal').write_bytes(b'no journal')
    scratch = tmp_path / 'scratch'
    scratch.mkdir()
    monkeypatch.setattr('tempfile.tempdir', str(scratch))
    file = SqliteFile(finished)
    assert len(list(scratch.iterdir())) == 1
    file.close()
    assert list(scratch.iterdir()) == []


def test_nothing_is_written_beside_the_file(write_bag, messages):
    bag = write_bag(messages(20), 'sqlite3')
    before = {file.name: file.stat().st_mtime_ns for file in bag.iterdir()}
    read(SqliteFile(storage(bag)))
    assert {file.name: file.stat().st_mtime_ns for file in bag.iterdir()} == before


def test_a_truncated_file_is_read_up_to_the_cut(write_bag, messages):
    expected = messages(2000)
    path = storage(write_bag(expected, 'sqlite3'))
    whole = path.read_bytes()
    counts = []
    for share in (0.3, 0.6, 0.9):
        path.write_bytes(whole[: int(len(whole) * share)])
        file = SqliteFile(path)
        found = read(file)
        assert found == expected[: len(found)]
        assert 'damaged' in file.problems[0]
        counts.append(len(found))
    assert counts == sorted(counts)
    assert counts[0] > 100


def test_an_overwritten_page_costs_its_messages_only(write_bag, messages):
    expected = messages(2000)
    path = storage(write_bag(expected, 'sqlite3'))
    whole = bytearray(path.read_bytes())
    page = whole.index(expected[1000][2]) // 4096
    whole[page * 4096 : (page + 1) * 4096] = bytes(4096)
    path.write_bytes(whole)
    file = SqliteFile(path)
    found = read(file)
    assert file.problems
    assert found == [message for message in expected if message in found]
    assert len(found) >= 900


@pytest.mark.parametrize(
    ('content', 'text'),
    [
        (b'hello', 'not an sqlite3 file'),
        (b'SQLite format 3\x00' + bytes(2000), 'cannot be read as a bag'),
    ],
)
def test_what_is_no_bag_is_refused(tmp_path, content, text):
    path = tmp_path / 'a.db3'
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=text):
        SqliteFile(path)


def test_a_database_without_messages_is_refused(tmp_path):
    path = tmp_path / 'a.db3'
    with closing(sqlite3.connect(path)) as base:
        base.execute('CREATE TABLE contacts(name TEXT)')
    with pytest.raises(RecordingError, match='no tables "topics" and "messages"'):
        SqliteFile(path)
