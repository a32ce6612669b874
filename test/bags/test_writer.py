# SPDX-License-Identifier: Apache-2.0
"""Writing bags: read back by programs that nobody of this project wrote, and failing disks."""

from __future__ import annotations

from contextlib import closing
import errno
from functools import cache
from importlib.metadata import distributions
from pathlib import Path
import re
import resource
import signal
import sqlite3
import subprocess
import sys

from imu_bench.bags.bag import Bag
from imu_bench.bags.mcap_writer import McapWriter
from imu_bench.bags.topic_info import describe, OfferedQos
from imu_bench.bags.writer import BagWriter
from imu_bench.errors import RecordingError
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2 import Reader
from rosbags.typesys import get_typestore, Stores
import yaml

IMU = 'sensor_msgs/msg/Imu'
START = 1_700_000_000_000_000_000
STORAGES = ('mcap', 'sqlite3')


@cache
def jazzy():
    return get_typestore(Stores.ROS2_JAZZY)


def imu_blob(index: int) -> bytes:
    """Serialize an Imu with rosbags, independently of this project."""
    store = jazzy()
    types = store.types
    vector = types['geometry_msgs/msg/Vector3']
    message = types[IMU](
        types['std_msgs/msg/Header'](types['builtin_interfaces/msg/Time'](index, 5), 'imu_link'),
        types['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0),
        np.zeros(9),
        vector(0.1, 0.2, 0.3),
        np.zeros(9),
        vector(float(index), 2.0, 9.8),
        np.zeros(9),
    )
    return bytes(store.serialize_cdr(message, IMU))


def stored(bag: Path) -> list[tuple[str, int, bytes]]:
    found = []
    opened = Bag(bag)
    for block in opened.blocks([channel.topic for channel in opened.channels]):
        found += [
            (block.channel.topic, stamp, blob)
            for stamp, blob in zip(block.receive_ns.tolist(), block.blobs(), strict=True)
        ]
    return sorted(found, key=lambda message: message[1])


@pytest.mark.parametrize('storage', STORAGES)
def test_rosbags_reads_back_everything(write_bag, messages, storage):
    expected = messages(200)
    path = write_bag(expected, storage)
    with Reader(path) as bag:
        assert bag.message_count == 200
        assert [(c.topic, stamp, bytes(data)) for c, stamp, data in bag.messages()] == expected
        for connection in bag.connections:
            assert connection.digest == (
                'RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b'
            )
            offered = connection.ext.offered_qos_profiles[0]
            assert offered.reliability == QosReliability.RELIABLE
            assert offered.durability == QosDurability.VOLATILE
            assert (offered.deadline.sec, offered.deadline.nsec) == (9223372036, 854775807)


@pytest.mark.parametrize('storage', STORAGES)
def test_rosbags_decodes_with_the_stored_definition(tmp_path, storage):
    with BagWriter(tmp_path / 'bag', storage) as bag:
        bag.add_topic(describe('/imu', IMU, [OfferedQos()]))
        for index in range(5):
            bag.write('/imu', START + index, imu_blob(index))
    with AnyReader([tmp_path / 'bag']) as bag:
        decoded = [bag.deserialize(data, c.msgtype) for c, _, data in bag.messages()]
    assert [message.linear_acceleration.x for message in decoded] == [0.0, 1.0, 2.0, 3.0, 4.0]


@pytest.mark.parametrize('compression', ['zstd', ''])
def test_the_mcap_package_reads_back_everything(tmp_path, compression):
    with BagWriter(tmp_path / 'bag', 'mcap', compression=compression) as bag:
        bag.add_topic(describe('/imu', IMU, [OfferedQos()]))
        bag.add_topic(describe('/silent', 'std_msgs/msg/String'))
        for index in range(500):
            bag.write('/imu', START + index, imu_blob(index))
            if index % 100 == 99:
                bag.flush()
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        values = [item[3].linear_acceleration.x for item in reader.iter_decoded_messages()]
        summary = reader.get_summary()
        header = reader.get_header()
        attached = next(iter(reader.iter_metadata()))
    assert values == list(range(500))
    assert header.profile == 'ros2'
    assert summary.statistics.message_count == 500
    assert summary.statistics.channel_message_counts == {1: 500, 2: 0}
    assert summary.statistics.message_start_time == START
    assert [index.compression for index in summary.chunk_indexes] == [compression] * 5
    assert {c.topic: c.metadata['topic_type_hash'][:7] for c in summary.channels.values()} == {
        '/imu': 'RIHS01_',
        '/silent': 'RIHS01_',
    }
    assert attached.name == 'rosbag2'
    assert yaml.safe_load(attached.metadata['serialized_metadata'])['message_count'] == 500


def test_the_sqlite_schema_is_that_of_rosbag2(write_bag, messages):
    path = write_bag(messages(10), 'sqlite3')
    with closing(sqlite3.connect(path / f'{path.name}_0.db3')) as base:
        assert base.execute('SELECT schema_version FROM schema').fetchall() == [(4,)]
        assert base.execute('PRAGMA integrity_check').fetchall() == [('ok',)]
        assert base.execute('SELECT count(*) FROM message_definitions').fetchall() == [(1,)]
        tables = base.execute('SELECT name FROM sqlite_master ORDER BY name').fetchall()
    names = 'message_definitions messages metadata schema timestamp_idx topics'
    assert [name for (name,) in tables] == names.split()
    assert sorted(file.name for file in path.iterdir()) == [
        'bag_of_sqlite3_0.db3',
        'metadata.yaml',
    ]


@pytest.mark.parametrize('storage', STORAGES)
def test_metadata_is_that_of_version_9(write_bag, messages, storage):
    path = write_bag(messages(20), storage, custom={'operator': 'me'})
    bag = yaml.safe_load((path / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    assert bag['version'] == 9
    assert bag['storage_identifier'] == storage
    assert bag['starting_time']['nanoseconds_since_epoch'] == START
    assert bag['duration']['nanoseconds'] == 19_000
    assert bag['message_count'] == 20
    assert bag['relative_file_paths'] == [bag['files'][0]['path']]
    assert bag['files'][0]['message_count'] == 20
    assert bag['custom_data'] == {'operator': 'me'}
    topic = bag['topics_with_message_count'][0]
    assert topic['message_count'] == 10
    assert topic['topic_metadata']['offered_qos_profiles'][0]['reliability'] == 'reliable'


@pytest.mark.parametrize('sourced', ['', 'lyrical'])
@pytest.mark.parametrize('storage', STORAGES)
def test_a_bag_names_the_ros_2_that_is_sourced_or_whose_wheels_are_here(
    write_bag, messages, storage, sourced, monkeypatch
):
    monkeypatch.setenv('ROS_DISTRO', sourced)
    path = write_bag(messages(20), storage)
    bag = yaml.safe_load((path / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    names = [each.metadata['Name'] for each in distributions()]
    wheels = [found[1] for name in names if (found := re.match(r'ros-(\w+)-rclpy$', name or ''))]
    assert bag['ros_distro'] == (sourced or next(iter(wheels), 'jazzy'))
    if storage == 'sqlite3':
        with sqlite3.connect(path / bag['relative_file_paths'][0]) as file:
            assert file.execute('select ros_distro from schema').fetchone()[0] == bag['ros_distro']


@pytest.mark.parametrize('storage', STORAGES)
def test_a_bag_is_split_by_size(write_bag, messages, storage):
    expected = messages(400)
    path = write_bag(expected, storage, max_bytes=20_000)
    assert stored(path) == expected
    assert len(list(path.glob('*_*.*'))) > 3
    assert Bag(path).problems == []
    with Reader(path) as bag:
        assert sum(1 for _ in bag.messages()) == 400


@pytest.mark.parametrize('storage', STORAGES)
def test_many_messages_at_once_are_the_same_bytes(tmp_path, storage):
    rng = np.random.default_rng(3)
    blobs = rng.integers(0, 256, (5000, 324)).astype(np.uint8)
    stamps = START + np.arange(5000)
    with BagWriter(tmp_path / 'bag', storage) as bag:
        bag.add_topic(describe('/imu', IMU))
        bag.write('/imu', START - 1, b'first')
        bag.write_many('/imu', stamps, blobs)
        bag.write('/imu', START + 10_000, b'last')
        bag.write_many('/imu', stamps[:0], blobs[:0])
    expected = [
        ('/imu', int(stamp), blob.tobytes()) for stamp, blob in zip(stamps, blobs, strict=True)
    ]
    assert stored(tmp_path / 'bag') == [
        ('/imu', START - 1, b'first'),
        *expected,
        ('/imu', START + 10_000, b'last'),
    ]


@pytest.mark.parametrize('storage', STORAGES)
def test_messages_larger_than_a_page_or_chunk_are_kept(tmp_path, storage):
    rng = np.random.default_rng(5)
    expected = [
        ('/imu', START + i, rng.bytes(size)) for i, size in enumerate((1, 5000, 2_000_000))
    ]
    with BagWriter(tmp_path / 'bag', storage) as bag:
        bag.add_topic(describe('/imu', IMU))
        for message in expected:
            bag.write(*message)
    assert stored(tmp_path / 'bag') == expected


@pytest.mark.parametrize('storage', STORAGES)
def test_an_empty_bag_is_a_bag(tmp_path, storage):
    BagWriter(tmp_path / 'bag', storage).close()
    with Reader(tmp_path / 'bag') as bag:
        assert bag.message_count == 0
    assert Bag(tmp_path / 'bag').counts == {}


@pytest.mark.parametrize('storage', STORAGES)
def test_what_was_flushed_survives_without_close(tmp_path, messages, storage):
    expected = messages(150)
    bag = BagWriter(tmp_path / 'bag', storage)
    for topic in ('/imu0', '/imu1'):
        bag.add_topic(describe(topic, IMU))
    for message in expected[:100]:
        bag.write(*message)
    bag.flush()
    for message in expected[100:]:
        bag.write(*message)
    assert stored(tmp_path / 'bag') == expected[:100]
    assert any('no metadata.yaml' in problem for problem in Bag(tmp_path / 'bag').problems)
    bag.close()
    assert stored(tmp_path / 'bag') == expected


def test_a_bag_is_never_overwritten(tmp_path):
    (tmp_path / 'bag').mkdir()
    with pytest.raises(RecordingError, match='exists already'):
        BagWriter(tmp_path / 'bag')


def test_what_cannot_be_made_is_refused(tmp_path):
    (tmp_path / 'file').touch()
    with pytest.raises(RecordingError, match='cannot be written'):
        BagWriter(tmp_path / 'file' / 'bag')
    with pytest.raises(RecordingError, match="'leveldb' is unknown; known are mcap, sqlite3"):
        BagWriter(tmp_path / 'bag', 'leveldb')


def test_a_topic_is_added_once(tmp_path):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic(describe('/imu', IMU))
        with pytest.raises(RecordingError, match='added already'):
            bag.add_topic(describe('/imu', IMU))


def test_a_closed_bag_takes_nothing(tmp_path):
    bag = BagWriter(tmp_path / 'bag')
    bag.close()
    bag.close()
    with pytest.raises(RecordingError, match='the bag is closed'):
        bag.flush()


def test_a_type_that_is_not_common_has_no_definition():
    info = describe('/own', 'my_msgs/msg/Own', type_hash='RIHS01_00')
    assert (info.definition, info.type_hash) == ('', 'RIHS01_00')


class TestFullDisk:
    """A disk that takes so many bytes and no more."""

    def record(self, bag: BagWriter, count: int = 4000) -> int:
        """Write until the disk is full; return the number of messages flushed before."""
        flushed = 0
        bag.add_topic(describe('/imu', IMU))
        with pytest.raises(RecordingError, match='the disk is full; recording ended, ') as caught:
            for index in range(count):
                bag.write('/imu', START + index, np.random.default_rng(index).bytes(300))
                if index % 100 == 99:
                    bag.flush()
                    flushed = index + 1
        assert f'{flushed} messages up to 2023-11-14 22:13:20 UTC are kept' in str(caught.value)
        with pytest.raises(RecordingError, match='the disk is full'):
            bag.write('/imu', START, b'')
        bag.close()
        return flushed

    def test_mcap_keeps_what_it_has(self, tmp_path, monkeypatch):
        bag = BagWriter(tmp_path / 'bag')
        file = bag._file._file
        monkeypatch.setattr(bag._file, '_file', _SmallDisk(file, 500_000))
        flushed = self.record(bag)
        assert flushed > 1000
        assert len(stored(tmp_path / 'bag')) == flushed
        # a full disk still took the summary, in the place of the chunk that did not fit
        assert Bag(tmp_path / 'bag').problems == []
        with Reader(tmp_path / 'bag') as read:
            assert read.message_count == flushed

    def test_mcap_without_room_for_a_summary_is_salvaged(self, tmp_path, monkeypatch):
        bag = BagWriter(tmp_path / 'bag')
        file = bag._file._file
        monkeypatch.setattr(bag._file, '_file', _SmallDisk(file, 500_000, for_good=True))
        flushed = self.record(bag)
        assert len(stored(tmp_path / 'bag')) == flushed
        assert any('no footer' in problem for problem in Bag(tmp_path / 'bag').problems)

    @pytest.mark.parametrize('storage', STORAGES)
    def test_a_limit_of_the_system_is_met_cleanly(self, tmp_path, storage):
        program = (
            'import sys, numpy as np\n'
            'from imu_bench.bags.writer import BagWriter\n'
            'from imu_bench.bags.topic_info import describe\n'
            'from imu_bench.errors import RecordingError\n'
            'bag = BagWriter(sys.argv[1], sys.argv[2])\n'
            'bag.add_topic(describe("/imu", "sensor_msgs/msg/Imu"))\n'
            'flushed = 0\n'
            'try:\n'
            '    for index in range(5000):\n'
            '        bag.write("/imu", index, np.random.default_rng(index).bytes(300))\n'
            '        if index % 100 == 99:\n'
            '            bag.flush()\n'
            '            flushed = index + 1\n'
            'except RecordingError as problem:\n'
            '    print(flushed, problem)\n'
        )

        def limit() -> None:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (600_000, 600_000))

        done = subprocess.run(
            [sys.executable, '-c', program, str(tmp_path / 'bag'), storage],
            capture_output=True,
            text=True,
            preexec_fn=limit,
            check=False,
            cwd=Path(__file__).parents[2],
        )
        assert done.stderr == ''
        flushed, _, said = done.stdout.partition(' ')
        assert 'recording ended' in said
        assert len(stored(tmp_path / 'bag')) == int(flushed) > 500


class _SmallDisk:
    """A file on a disk with little room; what is truncated away gives room back."""

    def __init__(self, file, room: int, for_good: bool = False) -> None:
        self._file = file
        self._room = room
        self._for_good = for_good
        self._full = False

    def __getattr__(self, name: str):
        return getattr(self._file, name)

    def write(self, data) -> int:
        free = self._room - self._file.tell()
        if (self._full and self._for_good) or free <= 0:
            self._full = True
            raise OSError(errno.ENOSPC, 'No space left on device')
        return self._file.write(data[:free])


def test_a_chunk_is_written_whole_or_not_at_all(tmp_path):
    writer = McapWriter(tmp_path / 'a.mcap', '')
    writer.add_topic(describe('/imu', IMU))
    writer.write('/imu', START, bytes(100))
    writer.flush()
    size = writer.size
    writer._file = _SmallDisk(writer._file, size + 50)
    writer.write('/imu', START + 1, bytes(100))
    with pytest.raises(OSError, match='No space left'):
        writer.flush()
    assert (tmp_path / 'a.mcap').stat().st_size == size
    assert writer.stored == {'/imu': 1}
    writer._file.close()
