# SPDX-License-Identifier: Apache-2.0
"""Files made to make their reader fail: tables that compute, pages in circles, bombs, lies."""

from __future__ import annotations

from contextlib import closing
import itertools
from pathlib import Path
import sqlite3
import struct
import subprocess
import sys
import zlib

from backports import zstd
from imu_bench.bags import compression
from imu_bench.bags.bag import Bag
from imu_bench.bags.mcap import McapFile
from imu_bench.bags.sqlite import SqliteFile
from imu_bench.errors import RecordingError
import lz4.frame
from mcap.writer import CompressionType, Writer
import numpy as np
import pytest

MEGABYTES = 500
"""Of a process that reads any of these, its libraries included."""

READ = """
import sys
from pathlib import Path
from imu_bench.bags.bag import Bag
from imu_bench.bags.ros1 import Ros1File
path = Path(sys.argv[1])
bag = Ros1File(path) if path.suffix == '.bag' else Bag(path)
count = sum(len(block) for block in bag.blocks({'/imu0', '/imu1'}))
# of this program alone: ru_maxrss begins with what its parent holds (getrusage(2), fork(2))
status = Path('/proc/self/status').read_text()
print(count, int(status.partition('VmHWM:')[2].split()[0]) >> 10)
print(*bag.problems, sep='\\n')
"""


def read_apart(path: Path) -> tuple[int, int, str]:
    """Read a bag in a process of its own: messages, megabytes, problems."""
    done = subprocess.run(
        [sys.executable, '-c', READ, str(path)], capture_output=True, text=True, check=True
    )
    first, _, problems = done.stdout.partition('\n')
    count, megabytes = map(int, first.split())
    return count, megabytes, problems


def storage(bag: Path) -> Path:
    return bag / f'{bag.name}_0.db3'


# --- sqlite3: the schema ------------------------------------------------------------------------

ENDLESS = 'WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)'
TOPIC_COLUMNS = 'type TEXT, serialization_format TEXT'

SCHEMAS = {
    'messages are a view': """
        ALTER TABLE messages RENAME TO m;
        CREATE VIEW messages AS SELECT * FROM m;""",
    'messages without end': f"""
        DROP TABLE messages;
        CREATE VIEW messages AS
        {ENDLESS} SELECT i AS id, 1 AS topic_id, i AS timestamp, x'00' AS data FROM n;""",
    'topics without end': f"""
        DROP TABLE topics;
        CREATE VIEW topics AS {ENDLESS}
        SELECT i AS id, '/imu' || i AS name, 'a' AS type, 'cdr' AS serialization_format FROM n;""",
    'definitions without end': f"""
        DROP TABLE message_definitions;
        CREATE VIEW message_definitions AS {ENDLESS}
        SELECT i AS topic_type, '' AS encoding, '' AS encoded_message_definition FROM n;""",
    'no row numbers': """
        DROP TABLE messages;
        CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,
        data BLOB) WITHOUT ROWID;""",
    'a computed name': f"""
        DROP TABLE topics;
        CREATE TABLE topics(id INTEGER, name TEXT AS (hex(zeroblob(20000000))), {TOPIC_COLUMNS});
        INSERT INTO topics VALUES(1, 'a', 'cdr');""",
    'a name of bytes': "UPDATE topics SET name = x'00';",
    'no type': f"""
        DROP TABLE topics;
        CREATE TABLE topics(id INTEGER, name TEXT, {TOPIC_COLUMNS});
        INSERT INTO topics VALUES(1, '/imu', NULL, 'cdr');""",
    'a definition of bytes': """
        UPDATE message_definitions SET encoded_message_definition = x'00';""",
    'a long name by default': f"""
        DROP TABLE topics;
        CREATE TABLE topics(id INTEGER, {TOPIC_COLUMNS});
        {ENDLESS} INSERT INTO topics SELECT i, '', '' FROM n LIMIT 1000;
        ALTER TABLE topics ADD COLUMN name TEXT DEFAULT '{'x' * 100_000}';""",
}


@pytest.mark.parametrize('script', SCHEMAS.values(), ids=SCHEMAS)
def test_a_schema_of_another_kind_is_refused_in_one_line(write_bag, messages, script):
    path = storage(write_bag(messages(20), 'sqlite3'))
    with closing(sqlite3.connect(path)) as base:
        base.executescript(script)
    with pytest.raises(RecordingError, match='cannot be read as a bag') as caught:
        SqliteFile(path)
    assert '\n' not in str(caught.value)


# --- sqlite3: the pages -------------------------------------------------------------------------


def changed(path: Path, page: int, place: int, layout: str, *values: int) -> None:
    size = struct.unpack_from('>H', path.read_bytes(), 16)[0]
    content = bytearray(path.read_bytes())
    struct.pack_into(layout, content, (page - 1) * size + place, *values)
    path.write_bytes(content)


def root(path: Path) -> int:
    with closing(sqlite3.connect(path)) as base:
        query = "SELECT rootpage FROM sqlite_master WHERE name = 'messages'"
        return base.execute(query).fetchone()[0]


@pytest.mark.slow
def test_a_tree_of_pages_that_contains_itself_is_not_climbed(write_bag, messages):
    expected = messages(4000)
    path = storage(write_bag(expected, 'sqlite3'))
    top = root(path)
    content = path.read_bytes()
    size = struct.unpack_from('>H', content, 16)[0]
    head = (top - 1) * size
    cells = struct.unpack_from('>H', content, head + 3)[0]
    assert content[head] == 0x05  # an interior page
    for cell in range(cells):
        place = struct.unpack_from('>H', content, head + 12 + 2 * cell)[0]
        changed(path, top, place, '>I', top)
    count, megabytes, problems = read_apart(path)
    assert count == 4000
    assert 'every page that can be found is read' in problems
    assert megabytes < MEGABYTES


def test_messages_on_pages_of_others_are_damaged(write_bag):
    large = [('/imu0', 1000 + n, bytes([n]) * 20_000) for n in range(20)]
    path = storage(write_bag(large, 'sqlite3'))
    content = bytearray(path.read_bytes())
    size = struct.unpack_from('>H', content, 16)[0]
    # every chain of overflow pages goes back to its own second page
    firsts = [content.find(bytes([n]) * (size - 4)) - 4 for n in range(20)]
    for first in firsts:
        (second,) = struct.unpack_from('>I', content, first)
        struct.pack_into('>I', content, (second - 1) * size, second)
    path.write_bytes(content)
    file = SqliteFile(path)
    assert not list(file.blocks(['/imu0']))
    assert '20 damaged places were skipped' in ' '.join(file.problems)


def test_rows_that_a_page_no_longer_counts_are_missed(write_bag, messages):
    path = storage(write_bag(messages(400), 'sqlite3'))
    path.parent.joinpath('metadata.yaml').unlink()
    content = path.read_bytes()
    size = struct.unpack_from('>H', content, 16)[0]
    leaf = next(n for n in range(2, 40) if content[(n - 1) * size] == 0x0D and n != root(path)
                and struct.unpack_from('>H', content, (n - 1) * size + 3)[0] > 4)  # fmt: skip
    rows = struct.unpack_from('>H', content, (leaf - 1) * size + 3)[0]
    changed(path, leaf, 3, '>H', rows - 3)
    bag = Bag(path)
    assert sum(map(len, bag.blocks({'/imu0', '/imu1'}))) == 397
    assert 'there were 400 messages, 397 are found' in ' '.join(bag.problems)


# --- compressed ---------------------------------------------------------------------------------


def bomb(size: int, record: bytes = bytes(1 << 20)) -> bytes:
    """Compress that many bytes without holding them."""
    packer = zstd.ZstdCompressor(level=1)
    parts = [packer.compress(record) for _ in range(size // len(record))]
    return b''.join([*parts, packer.flush()])


def mcap_of(path: Path, chunks: list[bytes]) -> Path:
    """Write a file of these chunk records without any summary."""
    with path.open('wb') as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start('ros2')
        schema = writer.register_schema('sensor_msgs/msg/Imu', 'ros2msg', b'')
        writer.register_channel('/imu0', 'cdr', schema)
        writer.finish()
    whole = path.read_bytes()
    head = 8 + 9 + struct.unpack_from('<Q', whole, 9)[0]
    path.write_bytes(whole[:head] + b''.join(chunks))
    return path


def chunk(packed: bytes, size: int, kind: bytes = b'zstd') -> bytes:
    content = struct.pack('<QQQI', 0, 0, size, 0) + struct.pack('<I', len(kind)) + kind
    content += struct.pack('<Q', len(packed)) + packed
    return struct.pack('<BQ', 6, len(content)) + content


@pytest.mark.slow
@pytest.mark.parametrize(
    ('record', 'size'),
    [
        (bytes(1 << 20), 1 << 30),
        (struct.pack('<BQ', 0x80, 0) * 100_000, 12 << 20),
        (struct.pack('<BQHIQQ', 5, 22, 1, 0, 0, 0) * 100_000, 15 << 20),
        (b''.join(struct.pack('<BQHHIII', 4, 16, n, 0, 0, 0, 0) for n in range(65536)), 10 << 20),
        (
            b''.join(
                struct.pack('<BQHIII', 3, 14 + (1 << 20), n, 0, 0, 1 << 20) + bytes(1 << 20)
                for n in range(64)
            ),
            65 << 20,
        ),
    ],
    ids=['one', 'records', 'messages', 'channels', 'schemas'],
)
def test_chunks_that_burst_stay_small(tmp_path, record, size):
    packed = bomb(size, record)
    expanded = size // len(record) * len(record)
    path = mcap_of(tmp_path / 'a.mcap', [chunk(packed, expanded)])
    assert path.stat().st_size < expanded // 10
    _, megabytes, problems = read_apart(path)
    assert problems.strip()
    assert megabytes < MEGABYTES


def test_what_expands_more_than_any_recording_is_refused():
    packed = zstd.compress(bytes(1 << 26))
    with pytest.raises(RecordingError, match='more than'):
        compression.expand(packed, 'zstd', 1 << 26)
    plain = np.random.default_rng(1).bytes(1 << 21) * 12  # larger than what is small
    assert len(compression.expand(zstd.compress(plain), 'zstd', len(plain))) == len(plain)
    assert len(compression.expand_part(packed, 'zstd')) <= 1 << 25


@pytest.mark.slow
def test_messages_that_burst_are_left_out_and_said(write_bag, messages):
    packed = zstd.compress(bytes(40))
    small = [('/imu0', 1000 + n, packed) for n in range(30)]
    large = bomb(1 << 28)
    expected = [*small, *(('/imu0', 2000 + n, large) for n in range(12))]
    count, megabytes, problems = read_apart(write_bag(expected, 'sqlite3'))
    assert count == 30
    assert 'damaged or too large, were skipped' in problems
    assert megabytes < MEGABYTES


def test_a_first_message_that_is_damaged_hides_no_others(write_bag):
    packed = zstd.compress(bytes(40))
    path = write_bag([('/imu0', 1000, b'damaged'), ('/imu0', 1001, packed)], 'sqlite3')
    bag = Bag(path)
    [block] = bag.blocks({'/imu0'})
    assert block.blobs() == [bytes(40)]
    assert 'were skipped' in ' '.join(bag.problems)


@pytest.mark.slow
def test_a_file_that_bursts_is_read_up_to_a_bound(tmp_path, write_bag, messages, monkeypatch):
    monkeypatch.setattr(compression, '_SMALL_FILE', 1 << 20)
    path = storage(write_bag(messages(100), 'sqlite3'))
    packed = tmp_path / 'alone' / 'a.db3.zstd'
    packed.parent.mkdir()
    packed.write_bytes(zstd.compress(path.read_bytes()) + bomb(1 << 27))
    bag = Bag(packed)
    plain = bag.storages[0].path
    assert plain.stat().st_size < 1000 * packed.stat().st_size + (1 << 20)
    assert 'times as large as it is compressed' in ' '.join(bag.problems)


@pytest.mark.slow
@pytest.mark.parametrize('kind', ['lz4', 'bz2'])
def test_a_ros_1_chunk_that_bursts_is_left_out(tmp_path, kind):
    if kind == 'lz4':
        with lz4.frame.LZ4FrameCompressor() as packer:
            parts = [packer.begin(), *(packer.compress(bytes(1 << 20)) for _ in range(1024))]
            packed = b''.join([*parts, packer.flush()])
    else:
        import bz2

        packer = bz2.BZ2Compressor()
        parts = [packer.compress(bytes(1 << 20)) for _ in range(256)]
        packed = b''.join([*parts, packer.flush()])

    def record(data: bytes, **fields: bytes) -> bytes:
        pairs = [name.encode() + b'=' + value for name, value in fields.items()]
        head = b''.join(struct.pack('<I', len(pair)) + pair for pair in pairs)
        return struct.pack('<I', len(head)) + head + struct.pack('<I', len(data)) + data

    size = struct.pack('<I', 1 << 30)
    chunk = record(packed, op=b'\x05', compression=kind.encode(), size=size)
    path = tmp_path / 'a.bag'
    path.write_bytes(b'#ROSBAG V2.0\n' + chunk * 3)
    count, megabytes, problems = read_apart(path)
    assert count == 0
    assert 'damaged chunk' in problems
    assert megabytes < MEGABYTES


# --- mcap: a summary that lies ------------------------------------------------------------------


def test_a_summary_that_leaves_out_a_chunk_is_not_believed(tmp_path, messages):
    path = tmp_path / 'a.mcap'
    with path.open('wb') as file:
        writer = Writer(file, chunk_size=4096)
        writer.start('ros2')
        schema = writer.register_schema('sensor_msgs/msg/Imu', 'ros2msg', b'')
        channels = {t: writer.register_channel(t, 'cdr', schema) for t in ('/imu0', '/imu1')}
        for topic, stamp, data in messages(300):
            writer.add_message(channels[topic], stamp, data, stamp)
        writer.finish()
    content = path.read_bytes()
    start, _, _ = struct.unpack_from('<QQI', content, len(content) - 28)
    kept, counts, position = [], [0, 0], start
    lost = None
    while content[position] != 0x02:
        (size,) = struct.unpack_from('<Q', content, position + 1)
        record = content[position : position + 9 + size]
        position += 9 + size
        if record[0] == 0x08 and lost is None:
            lost = record
        elif record[0] == 0x0B:  # statistics that agree with what is left
            body = bytearray(record)
            chunks = struct.unpack_from('<I', body, 9 + 20)[0]
            struct.pack_into('<I', body, 9 + 20, chunks - 1)
            kept.append(bytes(body))
        elif record[0] != 0x0E:
            kept.append(record)
    assert lost is not None
    assert counts == [0, 0]
    section = b''.join(kept)
    footer = struct.pack('<BQQQ', 2, 20, start, 0)
    path.write_bytes(
        content[:start] + section + footer
        + struct.pack('<I', zlib.crc32(section + footer)) + content[-8:]
    )  # fmt: skip
    file = McapFile(path)
    assert sum(map(len, file.blocks(['/imu0', '/imu1']))) == 300
    assert 'does not list all chunks' in ' '.join(file.problems)


def test_messages_of_no_channel_are_said(tmp_path):
    path = tmp_path / 'a.mcap'
    message = b''.join(
        struct.pack('<BQHIQQ', 5, 26, number, 0, 7, 7) + b'abcd' for number in (1, 1, 9)
    )
    mcap_of(path, [])
    channel = struct.pack('<BQ', 4, 24) + struct.pack(
        '<HHI5sI3sI', 1, 0, 5, b'/imu0', 3, b'cdr', 0
    )
    path.write_bytes(path.read_bytes() + channel + message)
    file = McapFile(path)
    assert sum(map(len, file.blocks(['/imu0']))) == 2
    assert '1 messages belong to no channel' in ' '.join(file.problems)


def test_jobs_ahead_stay_within_their_room():
    from imu_bench.bags.mcap import ahead

    open_now, most = 0, 0

    def work(size: int) -> int:
        nonlocal open_now, most
        open_now += size
        most = max(most, open_now)
        return size

    sizes = [1 << 20, 1 << 27, 1 << 27, 1 << 20, 1 << 20, 1 << 26, 1 << 25, 1 << 25]
    for size, expected in zip(ahead(work, ((s, s) for s in sizes)), sizes, strict=True):
        assert size == expected
        open_now -= size
    assert most <= (1 << 27)
    assert list(itertools.islice(ahead(work, []), 1)) == []
