# SPDX-License-Identifier: Apache-2.0
"""Recordings with damage of every kind: a result or one clear line, and nothing touched."""

from __future__ import annotations

from pathlib import Path
import random
import shutil

from imu_bench.bags.bag import Bag
from imu_bench.errors import RecordingError
from imu_bench.offline.recordings import load_all, open_source
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

IMU = 'sensor_msgs/msg/Imu'
START = 1_700_000_000_000_000_000
ROUNDS = 25


def mutated(data: bytes, rng: random.Random) -> bytes:
    """Return data cut off, with flipped bits, wrong numbers, zeros, holes or insertions."""
    content = bytearray(data)
    place, length = rng.randrange(len(content)), rng.randrange(1, 3000)
    kind = rng.randrange(6)
    if kind == 0:
        return bytes(content[:place])
    if kind == 1:
        for _ in range(rng.choice((1, 10, 100))):
            content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
    elif kind == 2:
        for _ in range(rng.choice((1, 5, 20))):
            at, size = rng.randrange(len(content)), rng.choice((1, 2, 4, 8))
            content[at : at + size] = rng.choice((b'\xff', b'\0', b'\x7f')) * size
    elif kind == 3:
        content[place : place + length] = bytes(len(content[place : place + length]))
    elif kind == 4:
        del content[place : place + length]
    else:
        content[place:place] = content[length : 2 * length]
    return bytes(content)


@pytest.fixture
def blobs(serialize):
    return [serialize(START + 10_000_000 * i, (i, 0, 9.8), (0, 0, 0.1)) for i in range(300)]


@pytest.fixture(params=['mcap', 'sqlite3', 'file', 'message', 'plain', 'lz4', 'ros1', 'csv'])
def recording(request, tmp_path, blobs, serialize, imu_bag):
    """Return a sound recording of one format."""
    kind, path = request.param, tmp_path / 'sound'
    if kind in ('mcap', 'sqlite3'):
        numbers = np.random.default_rng(1).normal(size=(300, 3))
        return imu_bag(numbers, numbers, storage=kind)
    if kind in ('file', 'message'):
        return _compressed(path, CompressionMode[kind.upper()], blobs)
    if kind in ('plain', 'lz4'):
        return _foreign(path.with_suffix('.mcap'), kind, blobs)
    if kind == 'ros1':
        return _ros1(path.with_suffix('.bag'), serialize)
    lines = [f'{i / 100},{i % 7},0.5,9.8' for i in range(300)]
    text = 'stamp_s,linear_acceleration.x,angular_velocity.y,linear_acceleration.z\n'
    path.with_suffix('.csv').write_text(text + '\n'.join(lines))
    return path.with_suffix('.csv')


def _compressed(path: Path, mode: CompressionMode, blobs) -> Path:
    writer = Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        topic = writer.add_connection('/imu', IMU, msgdef='', rihs01='RIHS01_0')
        for index, blob in enumerate(blobs):
            writer.write(topic, index, blob)
    return path


def _foreign(path: Path, kind: str, blobs) -> Path:
    options = {
        'plain': {'use_chunking': False},
        'lz4': {'compression': CompressionType.LZ4, 'index_types': IndexType.NONE},
    }
    writer = McapWriter(str(path), chunk_size=8192, **options[kind])
    writer.start('ros2')
    schema = writer.register_schema(IMU, 'ros2msg', b'')
    channel = writer.register_channel('/imu', 'cdr', schema)
    for index, blob in enumerate(blobs):
        writer.add_message(channel, index, blob, index)
    writer.finish()
    return path


def _ros1(path: Path, serialize) -> Path:
    writer = Ros1Writer(path)
    writer.chunk_threshold = 8192
    with writer:
        topic = writer.add_connection('/imu', IMU, msgdef='', md5sum='0' * 32)
        for index in range(300):
            writer.write(topic, index, serialize(START + index, (1, 2, 3), (4, 5, 6), ros=1))
    return path


def _snapshot(path: Path) -> dict[str, bytes]:
    files = path.rglob('*') if path.is_dir() else [path]
    return {str(file): file.read_bytes() for file in files}


def test_damage_gives_a_result_or_one_line(recording, tmp_path):
    rng = random.Random(recording.name)
    with open_source(recording) as source:
        assert len(load_all(source, source.select())[0]) == 300
    results = 0
    for attempt in range(ROUNDS):
        damaged = tmp_path / f'damaged_{attempt}' / recording.name
        damaged.parent.mkdir()
        if recording.is_dir():
            shutil.copytree(recording, damaged)
            file = rng.choice(sorted(damaged.iterdir()))
        else:
            shutil.copyfile(recording, damaged)
            file = damaged
        file.write_bytes(mutated(file.read_bytes(), rng))
        before = _snapshot(damaged)
        try:
            with open_source(damaged) as source:
                loaded = load_all(source, source.select())
            assert all(len(one) for one in loaded)
            assert all(np.isfinite(one.samples.acceleration).any() for one in loaded)
            results += 1
        except RecordingError as problem:
            assert '\n' not in str(problem)
            assert len(str(problem)) < 2000
        assert _snapshot(damaged) == before
    assert results


def test_memory_is_not_given_away_to_a_wrong_length(tmp_path, blobs, monkeypatch):
    """Every length in a chunk header replaced by huge ones: nothing that large is read."""
    path = _foreign(tmp_path / 'a.mcap', 'lz4', blobs)
    whole = path.read_bytes()
    chunk = whole.index(b'\x06', 30)
    for offset in (1, 25, 37 + 3 + 4):
        for value in (1 << 62, (1 << 63) + 5, (1 << 64) - 1, 1 << 40):
            data = bytearray(whole)
            data[chunk + offset : chunk + offset + 8] = value.to_bytes(8, 'little')
            path.write_bytes(data)
            bag = Bag(path)
            assert sum(len(block) for block in bag.blocks(['/imu'])) <= 300
            assert bag.problems
