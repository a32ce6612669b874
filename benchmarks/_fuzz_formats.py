# SPDX-License-Identifier: Apache-2.0
"""Every format that is read, written by whatever program its users have."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
import random
from typing import Any

from imu_bench.bags.topic_info import TopicInfo
from imu_bench.bags.writer import BagWriter
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
import numpy as np
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import get_types_from_msg, get_typestore, Stores
from scipy.io import savemat

from benchmarks._fuzz_content import Content
from benchmarks._fuzz_damage import damaged

_IMU = 'sensor_msgs/msg/Imu'
_STATE = 'my_msgs/msg/State'
_STATE_TEXT = 'uint64 count\nsensor_msgs/Imu imu\n'
_COUNT = b'\0\1\0\0\7' + bytes(7)
_G = 9.80665
UNITS = ('--units', 'linear_acceleration=m/s^2,angular_velocity=rad/s')
COLUMNS = ('--columns', 'ax,ay,az,gx,gy,gz', '--rate', '100')
_AXES = tuple(f'{q}.{a}' for q in ('linear_acceleration', 'angular_velocity') for a in 'xyz')


Harm = Callable[[list[Path], random.Random], None]
Command = Callable[[Path, Path, random.Random], list[str]]


def harm_bytes(files: list[Path], rng: random.Random) -> None:
    """Damage one or two files as bytes; now and then one is gone."""
    for _ in range(rng.choice((1, 1, 2))):
        file = rng.choice(files)
        file.write_bytes(damaged(file.read_bytes(), rng))
    if len(files) > 1 and rng.random() < 0.1:
        rng.choice(files).unlink()


def analyze(path: Path, out: Path, rng: random.Random) -> list[str]:
    """Return the arguments of an analysis."""
    outputs = [f'--{kind}={out / f"r.{kind}"}' for kind in ('json', 'html')]
    return ['analyze', str(path), '--jobs', '1', *outputs]


@dataclass(frozen=True)
class Format:
    """
    One kind of input.

    Attributes
    ----------
    write : callable
        Writes it into a folder and returns the path that is given to the command.
    options : tuple of str
        What the user has to say beside that.
    recordings : int
        How many recordings it can fall into, each with its error line.
    harm : callable
        Damages the files.
    command : callable
        Returns the arguments of `imu-bench`, given the path and a folder for outputs.
    counted : bool
        Whether the samples of the content must be found, or said to be missing.
    text : str
        What `_fuzz_witness.owed` has to know.
    """

    write: Callable[[Path, Content], Path]
    options: tuple[str, ...] = ()
    recordings: int = 1
    harm: Harm = harm_bytes
    command: Command = analyze
    counted: bool = True
    text: str = ''


def _mcap(**options: Any) -> Callable[[Path, Content], Path]:
    def write(folder: Path, content: Content) -> Path:
        path = folder / 'a.mcap'
        writer: Any = McapWriter(str(path), chunk_size=16384, **options)
        writer.start('ros2')
        schema = writer.register_schema(_IMU, 'ros2msg', b'')
        channel = writer.register_channel('/imu', 'cdr', schema)
        for received, blob in zip(content.received.tolist(), content.blobs, strict=True):
            stamp = received & (2**64 - 1)
            writer.add_message(channel, stamp, blob, stamp)
        writer.finish()
        return path

    return write


def _own(storage: str, nested: bool = False) -> Callable[[Path, Content], Path]:
    def write(folder: Path, content: Content) -> Path:
        path = folder / 'bag'
        with BagWriter(path, storage) as bag:
            bag.add_topic(_nested() if nested else TopicInfo('/imu', _IMU))
            for received, blob in zip(content.received.tolist(), content.blobs, strict=True):
                whole = _COUNT + blob[4:] if nested else blob
                bag.write('/imu', max(received, 0), whole)
        return path

    return write


def _rosbag2(mode: str) -> Callable[[Path, Content], Path]:
    def write(folder: Path, content: Content) -> Path:
        path = folder / 'bag'
        writer = Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3)
        writer.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
        with writer:
            topic = writer.add_connection('/imu', _IMU, msgdef='', rihs01='RIHS01_0')
            for received, blob in zip(content.received.tolist(), content.blobs, strict=True):
                writer.write(topic, received, blob)
        return path

    return write


def _rosbag1(compression: str) -> Callable[[Path, Content], Path]:
    def write(folder: Path, content: Content) -> Path:
        path = folder / 'a.bag'
        writer = Ros1Writer(path)
        writer.chunk_threshold = 16384
        if compression:
            writer.set_compression(Ros1Writer.CompressionFormat[compression])
        with writer:
            topic = writer.add_connection('/imu', _IMU, msgdef='', md5sum='0' * 32)
            for received, blob in zip(content.received.tolist(), content.blobs, strict=True):
                # stamp and name without padding: offsets 4 to 25 of the CDR message
                start = b'\0\0\0\0' + blob[4:12] + b'\x08\0\0\0' + blob[16:24]
                writer.write(topic, max(received, 0) % (2**32 * 10**9), start + blob[28:])
        return path

    return write


@cache
def _nested() -> TopicInfo:
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(_STATE_TEXT, _STATE))
    definition, _ = store.generate_msgdef(_STATE, ros_version=2)
    return TopicInfo('/imu', _STATE, definition, 'RIHS01_0')


def _native(folder: Path, content: Content) -> Path:
    path = folder / 'a.csv'
    rows = (
        ','.join([f'{stamp / 1e9:.9f}', *map(repr, row)])
        for stamp, row in zip(content.stamps.tolist(), content.values.tolist(), strict=True)
    )
    path.write_text('\n'.join([','.join(('stamp_s', *_AXES)), *rows, '']))
    return path


def _foreign(folder: Path, content: Content) -> Path:
    """Write what a spreadsheet makes of a log: semicolons, decimal commas, a column of words."""
    path = folder / 'a.csv'
    lines = ['Fs;100', 'ax;ay;az;gx;gy;gz;label']
    lines += [
        ';'.join(f'{value:.6g}'.replace('.', ',') for value in row) + ';still'
        for row in content.values.tolist()
    ]
    path.write_bytes('\r\n'.join(lines).encode())
    return path


def _murata(folder: Path, content: Content) -> Path:
    time = (content.stamps - content.stamps[0]) / 1e9
    xyz = content.values[:, :3] / _G
    others = np.hypot(xyz[:, [1, 2, 0]], xyz[:, [2, 0, 1]])
    angles = np.degrees(np.arctan2(xyz, others))
    table = np.column_stack([time, 0 * time, xyz[:, ::-1], angles[:, ::-1], 0 * time + 24])
    half = len(table) // 2
    for number, part in enumerate((table[:half], table[half:]), 1):
        np.savetxt(folder / f'log_{number}.txt', part, fmt='%.9g', delimiter='\t')
    return folder


def _smart_motion(folder: Path, content: Content) -> Path:
    path = folder / 'log.txt'
    counts = np.nan_to_num(content.values).clip(-30, 30) * 1000
    table = np.column_stack([np.arange(len(counts)), counts])
    np.savetxt(path, table, fmt='%d', delimiter=' ', header='index ax ay az gx gy gz', comments='')
    return path


def _npy(folder: Path, content: Content) -> Path:
    np.save(folder / 'a.npy', content.values)
    return folder / 'a.npy'


def _npz(folder: Path, content: Content) -> Path:
    path, values = folder / 'a.npz', content.values
    np.savez_compressed(path, t_ns=content.stamps, accel=values[:, :3], gyro=values[:, 3:])
    return path


def _npy_folder(folder: Path, content: Content) -> Path:
    np.save(folder / 'stamps.npy', content.stamps)
    np.save(folder / 'acceleration.npy', content.values[:, :3].T)
    np.save(folder / 'angular_velocity.npy', content.values[:, 3:].T)
    return folder


def _matlab(folder: Path, content: Content) -> Path:
    path, values = folder / 'a.mat', content.values
    log = {'t_s': content.stamps / 1e9, 'accel': values[:, :3], 'gyro': values[:, 3:]}
    savemat(path, {'log': log, 'unit': 'seven'}, do_compression=bool(values[0, 0] > 0))
    return path


FORMATS: dict[str, Format] = {
    'mcap zstd': Format(_own('mcap')),
    'mcap lz4, no index': Format(
        _mcap(compression=CompressionType.LZ4, index_types=IndexType.NONE)
    ),
    'mcap without chunks': Format(_mcap(use_chunking=False)),
    'mcap, nested Imu': Format(_own('mcap', nested=True)),
    'sqlite3': Format(_own('sqlite3')),
    'sqlite3, nested Imu': Format(_own('sqlite3', nested=True)),
    'sqlite3, zstd by file': Format(_rosbag2('FILE')),
    'sqlite3, zstd by message': Format(_rosbag2('MESSAGE')),
    'ROS 1': Format(_rosbag1('')),
    'ROS 1 bz2': Format(_rosbag1('BZ2')),
    'ROS 1 lz4': Format(_rosbag1('LZ4')),
    'native CSV': Format(_native, text='stamps'),
    'spreadsheet CSV': Format(_foreign, ('--rate', '100', *UNITS), text='lines'),
    'Murata MEMS Demo': Format(_murata, recordings=2, text='stamps'),
    'SmartMotion': Format(_smart_motion, ('--rate', '100', *UNITS), text='stamps'),
    'npy': Format(_npy, (*COLUMNS, *UNITS)),
    'npz': Format(_npz, UNITS),
    'folder of npy': Format(_npy_folder, recordings=2),
    'MATLAB': Format(_matlab, UNITS),
}
