# SPDX-License-Identifier: Apache-2.0
"""Recordings made to make their reader fail: schemas that compute, bombs, headers that lie."""

from __future__ import annotations

import bz2
from collections.abc import Callable
from contextlib import closing, suppress
from functools import cache
import io
from pathlib import Path
import random
import sqlite3
import struct
import sys
from typing import Any
import zipfile
import zlib

from imu_bench.bags.topic_info import TopicInfo
from imu_bench.bags.writer import BagWriter
import lz4.frame
import numpy as np

from benchmarks._fuzz_content import Content
from benchmarks._fuzz_formats import COLUMNS, Format, FORMATS, UNITS

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

_IMU = 'sensor_msgs/msg/Imu'
_ENDLESS = 'WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)'
_MEGABYTE = 1 << 20
_WRITABLE = 'PRAGMA writable_schema = ON'

# --- sqlite3 -------------------------------------------------------------------------------------

_TABLES = ('topics', 'messages', 'message_definitions')
_EXPRESSIONS = (
    'NULL', '0', '-1', '1e999', '9223372036854775807', "''", "x''", "x'00ff'", "'cdr'", "'/imu'",
    "hex(zeroblob(1000000))", "zeroblob(50000000)", "'sensor_msgs/msg/Imu'", 'randomblob(100)',
    "char(10, 27, 0)", "replace(hex(zeroblob(1000)), '0', 'sensor_msgs Imu ')",
)  # fmt: skip


def _schema(path: Path, rng: random.Random) -> None:
    """Change the tables of a bag by SQL: views, rows without end, other types, other columns."""
    table = rng.choice(_TABLES)
    with closing(sqlite3.connect(path)) as base:
        columns = [row[1] for row in base.execute(f'PRAGMA table_info({table})')] or ['id']
        column, value = rng.choice(columns), rng.choice(_EXPRESSIONS)
        shown = ', '.join(f'{value} AS {c}' if c == column else f'i AS {c}' for c in columns)
        plain = ', '.join(columns)
        root, text = rng.choice((0, 1, 2, 3, 9999)), 'UPDATE sqlite_master SET'
        ways = (
            [f'ALTER TABLE {table} RENAME TO t', f'CREATE VIEW {table} AS SELECT * FROM t'],
            [f'DROP TABLE {table}', f'CREATE VIEW {table} AS {_ENDLESS} SELECT {shown} FROM n'],
            [f'DROP TABLE {table}'],
            [f'CREATE TABLE t AS SELECT * FROM {table}', f'DROP TABLE {table}',
             f'ALTER TABLE t RENAME TO {table}'],
            [f'CREATE TABLE t({plain}, PRIMARY KEY({column})) WITHOUT ROWID',
             f'INSERT OR IGNORE INTO t SELECT {plain} FROM {table}', f'DROP TABLE {table}',
             f'ALTER TABLE t RENAME TO {table}'],
            [f'UPDATE OR IGNORE {table} SET {column} = {value}'],
            [f'UPDATE OR IGNORE {table} SET {column} = {value} WHERE rowid % 7 = 1'],
            [f'ALTER TABLE {table} ADD COLUMN more DEFAULT {rng.choice(_EXPRESSIONS[:6])}'],
            [f'ALTER TABLE {table} ADD COLUMN more AS ({value})'],
            [f'ALTER TABLE {table} RENAME COLUMN {column} TO other'],
            [f'DELETE FROM {table} WHERE rowid % {rng.choice((1, 2, 50))} = 0'],
            [f'CREATE INDEX i ON {table}({column})', f'ANALYZE {table}'],
            [_WRITABLE, f"{text} rootpage = {root} WHERE name = '{table}'"],
            [_WRITABLE, f"{text} type = 'view' WHERE name = '{table}'"],
            [_WRITABLE, f"{text} sql = 'CREATE VIEW' || substr(sql, 13) WHERE name = '{table}'"],
        )  # fmt: skip
        with suppress(sqlite3.Error):  # not possible with this column: less harm is done
            for statement in rng.choice(ways):
                base.execute(statement)
        base.commit()


def _write_schema(folder: Path, content: Content) -> Path:
    return FORMATS['sqlite3'].write(folder, content)


def _harm_schema(files: list[Path], rng: random.Random) -> None:
    _schema(next(file for file in files if file.suffix == '.db3'), rng)
    if rng.random() < 0.5:
        next(file for file in files if file.name == 'metadata.yaml').unlink()


# --- bombs ---------------------------------------------------------------------------------------


@cache
def _burst(kind: str, megabytes: int, record: bytes = bytes(_MEGABYTE)) -> bytes:
    """Compress that many megabytes, without holding them."""
    times = megabytes * _MEGABYTE // len(record)
    if kind == 'lz4':
        with lz4.frame.LZ4FrameCompressor() as packer:
            parts = [packer.begin(), *(packer.compress(record) for _ in range(times))]
            return b''.join([*parts, packer.flush()])
    packers: dict[str, Any] = {
        'zstd': zstd.ZstdCompressor,
        'bz2': bz2.BZ2Compressor,
        'zlib': zlib.compressobj,
    }
    made = packers[kind](level=1) if kind == 'zstd' else packers[kind]()
    return b''.join([*(made.compress(record) for _ in range(times)), made.flush()])


def _mcap_record(opcode: int, content: bytes) -> bytes:
    return struct.pack('<BQ', opcode, len(content)) + content


def _text(words: bytes) -> bytes:
    return struct.pack('<I', len(words)) + words


def _mcap_bomb(folder: Path, rng: random.Random) -> None:
    """Write chunks that burst: of nothing, of empty records, messages, schemas or channels."""
    kind = rng.choice(('zstd', 'lz4'))
    megabytes = rng.choice((20, 100, 1000))
    record = rng.choice((
        bytes(_MEGABYTE),
        _mcap_record(0x80, b'') * 100_000,
        _mcap_record(5, struct.pack('<HIQQ', 1, 0, 0, 0)) * 50_000,
        b''.join(_mcap_record(3, struct.pack('<H', n) + _text(b'a') + _text(b'') + _text(
            bytes(60_000))) for n in range(16)),
        b''.join(_mcap_record(4, struct.pack('<HH', n, 1) + _text(b'/%d' % n) + _text(b'cdr')
            + _text(b'')) for n in range(20_000)),
    ))  # fmt: skip
    if record[0] == 0x80:
        megabytes = min(megabytes, 20)  # each record costs time, not only memory
    packed = _burst(kind, megabytes, record)
    size = rng.choice((megabytes * _MEGABYTE // len(record) * len(record), 1000, 1 << 40))
    head = struct.pack('<QQQI', 0, 0, size, 0) + _text(kind.encode())
    chunk = _mcap_record(6, head + struct.pack('<Q', len(packed)) + packed)
    channel = struct.pack('<HH', 1, 1) + _text(b'/imu') + _text(b'cdr') + _text(b'')
    schema = struct.pack('<H', 1) + _text(_IMU.encode()) + _text(b'ros2msg') + _text(b'')
    start = b'\x89MCAP0\r\n' + _mcap_record(1, _text(b'ros2') + _text(b''))
    records = _mcap_record(3, schema) + _mcap_record(4, channel)
    (folder / 'a.mcap').write_bytes(start + records + chunk * rng.choice((1, 3)))


def _message_bomb(folder: Path, rng: random.Random) -> None:
    packed = _burst('zstd', rng.choice((30, 500)))
    storage = rng.choice(('sqlite3', 'mcap'))
    with BagWriter(folder / 'bag', storage) as bag:
        bag.add_topic(TopicInfo('/imu', _IMU))
        for stamp in range(rng.choice((1, 40))):
            bag.write('/imu', stamp, packed)


def _file_bomb(folder: Path, rng: random.Random) -> None:
    start = rng.choice((b'SQLite format 3\0', b'\x89MCAP0\r\n'))
    name = 'a.mcap.zstd' if start[0] == 0x89 else 'a.db3.zstd'
    (folder / name).write_bytes(zstd.compress(start) + _burst('zstd', 300))


def _ros1_record(data: bytes, **fields: bytes) -> bytes:
    pairs = [name.encode() + b'=' + value for name, value in fields.items()]
    head = b''.join(_text(pair) for pair in pairs)
    return _text(head) + _text(data)


def _ros1_bomb(folder: Path, rng: random.Random) -> None:
    kind = rng.choice(('bz2', 'lz4'))
    message = _ros1_record(b'', op=b'\2', conn=bytes(4), time=bytes(8))
    details = _ros1_record(b'', type=b'sensor_msgs/Imu', message_definition=bytes(10_000))[:-4]
    connections = b''.join(
        _ros1_record(details[4:], op=b'\7', conn=struct.pack('<I', n), topic=b'/%d' % n)
        for n in range(100)
    )
    record = rng.choice((bytes(_MEGABYTE), message * 5000, connections))
    megabytes = 10 if record.startswith(message) else rng.choice((20, 100, 1000))
    megabytes = min(megabytes, 100) if kind == 'bz2' else megabytes
    packed = _burst(kind, megabytes, record)
    size = struct.pack('<I', rng.choice((megabytes << 20, 1000, 0xFFFFFFFF)))
    chunk = _ros1_record(packed, op=b'\5', compression=kind.encode(), size=size)
    (folder / 'a.bag').write_bytes(b'#ROSBAG V2.0\n' + chunk * rng.choice((1, 3)))


def _npz_bomb(folder: Path, rng: random.Random) -> None:
    rows = rng.choice((1000, 2_000_000, 1 << 40))
    file = io.BytesIO()
    header = {'descr': '<f8', 'fortran_order': False, 'shape': (rows, 3)}
    np.lib.format.write_array_header_1_0(file, header)
    with zipfile.ZipFile(folder / 'a.npz', 'w', zipfile.ZIP_DEFLATED) as archive:
        for name in ('accel', 'gyro', *'abcdefgh'[: rng.choice((0, 0, 8))]):
            with archive.open(f'{name}.npy', 'w') as member:
                member.write(file.getvalue())
                for _ in range(rng.choice((1, 46))):
                    member.write(bytes(_MEGABYTE))


def _matlab_bomb(folder: Path, rng: random.Random) -> None:
    """Write cells within cells, cells side by side, or an array of zeros, compressed."""

    def element(kind: int, data: bytes) -> bytes:
        return struct.pack('<II', kind, len(data)) + data + bytes(-len(data) % 8)

    def head(kind: int, rows: int, name: bytes) -> bytes:
        flags = element(6, struct.pack('<II', kind, 0))
        return flags + element(5, struct.pack('<ii', rows, 1)) + element(1, name)

    rows = rng.choice((10, 3000, 100_000))
    empty = element(14, head(6, 0, b''))
    way = rng.randrange(3)
    if way == 0:
        parts, inside = [empty], len(empty)
        for level in range(rows):
            part = head(1, 1, b'a' if level == rows - 1 else b'')
            parts.append(struct.pack('<II', 14, len(part) + inside) + part)
            inside += len(parts[-1])
        content = b''.join(reversed(parts))
    elif way == 1:
        content = element(14, head(1, rows, b'a') + empty * rows)
    else:
        count = rng.choice((1, 40)) << 20
        content = element(14, head(6, count, b'ax') + element(2, bytes(count)))
    packed = zlib.compress(content)
    whole = rng.choice((content, struct.pack('<II', 15, len(packed)) + packed))
    (folder / 'a.mat').write_bytes(b'MATLAB 5.0 MAT-file'.ljust(124) + b'\0\1IM' + whole)


_BOMBS: tuple[Callable[[Path, random.Random], None], ...] = (
    _mcap_bomb, _mcap_bomb, _message_bomb, _file_bomb, _ros1_bomb, _npz_bomb, _matlab_bomb,
)  # fmt: skip


def _write_bomb(folder: Path, content: Content) -> Path:
    # what is made is chosen by the numbers of the case, as everything is
    rng = random.Random(content.values.tobytes())
    rng.choice(_BOMBS)(folder, rng)
    [made] = folder.iterdir()
    return made


def _leave(files: list[Path], rng: random.Random) -> None:
    """Do no more harm."""


# --- headers of NumPy ----------------------------------------------------------------------------

_KINDS = ('<f8', '>f4', '<i8', '|O', '|S9', '<U3', '<c16', '<M8[ns]', '|V7', '<f16', '|b1')


def _kind(rng: random.Random, depth: int = 0) -> object:
    """Return a type of array elements: a number, columns, columns within columns."""
    way = rng.random()
    if depth > 3 or way < 0.4:
        return rng.choice(_KINDS)
    if way < 0.6:  # deep
        kind: object = rng.choice(_KINDS)
        for _ in range(rng.choice((3, 50, 400))):
            kind = [('ax', kind)]
        return kind
    names = rng.sample(('ax', 'ay', 'az', 'gx', 'gy', 'gz', 't_ns', '', 'f0'), rng.randint(1, 7))
    return [(name, _kind(rng, depth + 1), rng.choice(((), (3,), (2, 2), (0,)))) for name in names]


def _write_header(folder: Path, content: Content) -> Path:
    rng = random.Random(content.values.tobytes())
    shape = rng.choice(((300, 6), (300,), (6, 300), (0,), (), (1 << 62, 8), (2, 3, 50), (-1,)))
    descr, order = _kind(rng), rng.choice((False, True, 2))
    header = f"{{'descr': {descr!r}, 'fortran_order': {order!r}, 'shape': {shape!r}, }}"
    if rng.random() < 0.2:
        header = rng.choice(('(' * 5000, '[' * 90 + ']' * 90, header * 2, 'X' * 60_000, '{}'))
    text = header.encode('latin-1') + b'\n'
    path = folder / 'a.npy'
    path.write_bytes(
        b'\x93NUMPY\2\0' + _text(text) + content.values.tobytes() * rng.choice((0, 1, 3))
    )
    return path


HOSTILE: dict[str, Format] = {
    'sqlite3 schema': Format(_write_schema, harm=_harm_schema),
    'bombs': Format(_write_bomb, ('--columns', 'ax,ay,az,gx,gy,gz', *UNITS), harm=_leave,
                    counted=False),
    'npy headers': Format(_write_header, (*COLUMNS, *UNITS), harm=_leave, counted=False),
}  # fmt: skip
