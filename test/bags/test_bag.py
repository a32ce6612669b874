# SPDX-License-Identifier: Apache-2.0
"""Bags as folders: metadata that is missing, wrong or damaged, and every kind of compression."""

from __future__ import annotations

from pathlib import Path
import shutil

from backports import zstd
from imu_bench.bags.bag import Bag, is_bag_folder, kind
from imu_bench.bags.topic_info import describe
from imu_bench.bags.writer import BagWriter
from imu_bench.errors import RecordingError
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

IMU = 'sensor_msgs/msg/Imu'
TOPICS = ('/imu0', '/imu1')
STORAGES = ('mcap', 'sqlite3')


def read(path: Path) -> list[tuple[str, int, bytes]]:
    found = []
    for block in Bag(path).blocks(TOPICS):
        found += [
            (block.channel.topic, stamp, blob)
            for stamp, blob in zip(block.receive_ns.tolist(), block.blobs(), strict=True)
        ]
    return sorted(found, key=lambda message: message[1])


@pytest.fixture(params=STORAGES)
def split_bag(request, write_bag, messages):
    """Return a bag of several files and what is in it."""
    expected = messages(300)
    return write_bag(expected, request.param, max_bytes=20_000), expected


@pytest.mark.parametrize(
    ('mode', 'storage'),
    [
        (CompressionMode.FILE, 'mcap'),
        (CompressionMode.FILE, 'sqlite3'),
        (CompressionMode.MESSAGE, 'mcap'),
        (CompressionMode.MESSAGE, 'sqlite3'),
        (CompressionMode.STORAGE, 'mcap'),
    ],
)
def test_what_rosbags_compresses_is_read(tmp_path, messages, mode, storage):
    expected = messages(300)
    info = describe('/imu0', IMU)
    writer = Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin[storage.upper()])
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {
            topic: writer.add_connection(topic, IMU, msgdef=info.definition, rihs01=info.type_hash)
            for topic in TOPICS
        }
        for topic, stamp, data in expected:
            writer.write(connections[topic], stamp, data)
    bag = Bag(tmp_path / 'bag')
    assert read(tmp_path / 'bag') == expected
    assert bag.problems == []
    assert bag.counts == {'/imu0': 150, '/imu1': 150}


def test_a_bag_without_metadata_is_scanned(split_bag):
    path, expected = split_bag
    (path / 'metadata.yaml').unlink()
    assert read(path) == expected
    assert Bag(path).problems == [
        'no metadata.yaml: the recorder did not close the bag; the files are scanned'
    ]
    assert Bag(path).counts == {'/imu0': 150, '/imu1': 150}


def test_ten_files_are_read_in_the_order_of_their_numbers(write_bag, messages):
    expected = messages(1200)
    path = write_bag(expected, 'mcap', max_bytes=1)
    (path / 'metadata.yaml').unlink()
    numbers = [int(file.stem.rpartition('_')[2]) for file in Bag(path).files]
    assert numbers == list(range(len(numbers)))
    assert len(numbers) > 10


def test_a_single_file_is_a_bag(split_bag):
    path, expected = split_bag
    found = read(sorted(path.glob('bag_of*_0.*'))[0])
    assert found == expected[: len(found)]
    assert found


LINES = [f'a{n}: &a{n} [{", ".join([f"*a{n - 1}"] * 10)}]' for n in range(1, 8)]
BOMB = '\n'.join(['a0: &a0 [x, x, x, x, x, x, x, x, x, x]', *LINES])
"""Half a KiB that stands for a hundred million entries."""


@pytest.mark.parametrize('text', ['rosbag2_bagfile_information: [', BOMB], ids=['cut', 'grows'])
def test_damaged_metadata_is_said_and_the_files_are_scanned(split_bag, text):
    path, expected = split_bag
    (path / 'metadata.yaml').write_text(text)
    assert read(path) == expected
    assert 'damaged' in Bag(path).problems[0]
    assert 'the files are scanned' in Bag(path).problems[0]


def test_files_that_were_renamed_are_found(split_bag):
    path, expected = split_bag
    for file in path.glob('bag_of*'):
        file.rename(file.with_name('other' + file.name[6:]))
    assert read(path) == expected
    assert Bag(path).problems[0].startswith('files named in metadata.yaml are missing: bag_of')


def test_a_missing_part_is_said(split_bag):
    path, expected = split_bag
    gone = sorted(path.glob('bag_of*_1.*'))[0]
    gone.unlink()
    found = read(path)
    assert 0 < len(found) < 300
    problems = Bag(path).problems
    assert problems[0] == f'files named in metadata.yaml are missing: {gone.name}'
    assert problems[1].startswith('metadata.yaml announces 150 messages on /imu0, ')
    assert found == [message for message in expected if message in found]


def test_a_file_that_is_named_thousands_of_times_is_opened_once(split_bag):
    path, expected = split_bag
    metadata = path / 'metadata.yaml'
    name = sorted(path.glob('bag_of*_0.*'))[0].name
    text = metadata.read_text()
    metadata.write_text(text.replace(f'  - {name}\n', f'  - {name}\n' * 5000, 1))
    bag = Bag(path)
    assert len(bag.storages) == len(set(path.glob('bag_of*')))
    assert 'metadata.yaml names a file more than once: it is read once' in map(str, bag.problems)
    assert read(path) == expected


def test_parts_that_the_metadata_does_not_name_yet_are_read(split_bag):
    path, expected = split_bag
    text = (path / 'metadata.yaml').read_text()
    last = sorted(path.glob('bag_of*'))[-1].name
    lines = [line for line in text.splitlines() if last not in line or 'path' in line]
    (path / 'metadata.yaml').write_text('\n'.join(lines))
    assert read(path) == expected
    assert f'which are read all the same: {last}' in Bag(path).problems[0]


def test_other_files_beside_the_named_ones_are_left_alone(write_bag, messages):
    expected = messages(100)
    path = write_bag(expected, 'mcap')
    file = path / 'bag_of_mcap_0.mcap'
    shutil.copyfile(file, path / 'copy.mcap')
    assert read(path) == expected


def test_counts_that_disagree_are_said(write_bag, messages):
    path = write_bag(messages(100), 'mcap')
    text = (path / 'metadata.yaml').read_text()
    text = text.replace('message_count: 50', 'message_count: 70', 1)
    (path / 'metadata.yaml').write_text(text.replace('name: /imu1', 'name: /gone'))
    bag = Bag(path)
    assert bag.counts == {'/imu0': 50, '/imu1': 50}
    assert bag.problems == [
        'metadata.yaml announces 70 messages on /imu0, 50 are stored',
        'metadata.yaml announces 50 messages on /gone, 0 are stored',
        'metadata.yaml does not name /imu1, on which 50 messages are stored',
    ]


def test_one_unreadable_file_of_several_is_left_out_and_said(split_bag):
    path, _ = split_bag
    broken = sorted(path.glob('bag_of*_1.*'))[0]
    magic = broken.read_bytes()[:16]
    broken.write_bytes(magic if magic.startswith(b'SQLite') else b'nothing')
    found = read(path)
    assert 0 < len(found) < 300
    assert any(str(broken) in problem or broken.name in problem for problem in Bag(path).problems)


def test_a_cut_off_compressed_file_gives_what_is_left(tmp_path, write_bag, messages):
    expected = messages(2000)
    path = write_bag(expected, 'sqlite3')
    file = path / 'bag_of_sqlite3_0.db3'
    packed = zstd.compress(file.read_bytes())
    cut = tmp_path / 'cut.db3.zstd'
    cut.write_bytes(packed[: len(packed) * 2 // 3])
    bag = Bag(cut)
    found = sum(len(block) for block in bag.blocks(TOPICS))
    assert 200 < found < 2000
    assert bag.problems[0] == 'cut.db3.zstd: damaged or cut off: read up to the damage'


def test_temporary_files_are_given_back(tmp_path, write_bag, messages, monkeypatch):
    path = write_bag(messages(10), 'mcap')
    packed = tmp_path / 'a.mcap.zstd'
    packed.write_bytes(zstd.compress((path / 'bag_of_mcap_0.mcap').read_bytes()))
    scratch = tmp_path / 'scratch'
    scratch.mkdir()
    monkeypatch.setattr('tempfile.tempdir', str(scratch))
    bag = Bag(packed)
    assert len(list(scratch.iterdir())) == 1
    bag.close()
    assert list(scratch.iterdir()) == []
    forgotten = Bag(packed)
    del forgotten
    assert list(scratch.iterdir()) == []


def test_several_recordings_in_a_folder_are_not_mixed(tmp_path, write_bag, messages):
    path = write_bag(messages(10), 'mcap')
    folder = tmp_path / 'folder'
    folder.mkdir()
    for name in ('a_0.mcap', 'b_0.mcap'):
        shutil.copyfile(path / 'bag_of_mcap_0.mcap', folder / name)
    with pytest.raises(RecordingError, match=r'several recordings .*\(a_0.mcap, b_0.mcap\)'):
        Bag(folder)


def test_kinds_go_by_content(tmp_path):
    (tmp_path / 'a.db3').write_bytes(b'\x89MCAP0\r\n')
    (tmp_path / 'b.mcap').write_bytes(b'SQLite format 3\x00')
    (tmp_path / 'c.mcap.zstd').write_bytes(b'\x28\xb5\x2f\xfd')
    (tmp_path / 'd.zstd').write_bytes(b'\x28\xb5\x2f\xfd')
    assert [kind(tmp_path / name) for name in ('a.db3', 'b.mcap', 'c.mcap.zstd', 'd.zstd')] == [
        'mcap',
        'sqlite3',
        'mcap',
        '',
    ]
    assert is_bag_folder(tmp_path)
    (tmp_path / 'empty').mkdir()
    assert not is_bag_folder(tmp_path / 'empty')


def test_a_folder_that_is_no_bag_is_refused(tmp_path):
    with pytest.raises(RecordingError, match='no bag in this folder'):
        Bag(tmp_path)


def test_the_same_topic_in_two_types_stays_two_channels(tmp_path):
    for index, name in enumerate(('sensor_msgs/msg/Imu', 'std_msgs/msg/String')):
        with BagWriter(tmp_path / f'part_{index}') as bag:
            bag.add_topic(describe('/imu0', name))
            bag.write('/imu0', index, b'x')
    folder = tmp_path / 'both'
    folder.mkdir()
    for index in range(2):
        shutil.copyfile(
            tmp_path / f'part_{index}' / f'part_{index}_0.mcap', folder / f'both_{index}.mcap'
        )
    bag = Bag(folder)
    assert [channel.type for channel in bag.channels] == [
        'sensor_msgs/msg/Imu',
        'std_msgs/msg/String',
    ]
    assert bag.counts == {'/imu0': 2}
