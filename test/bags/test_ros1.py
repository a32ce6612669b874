# SPDX-License-Identifier: Apache-2.0
"""Reading bags of ROS 1, against rosbags, and when they are not whole."""

from __future__ import annotations

from pathlib import Path

from imu_bench.bags.ros1 import Ros1File
from imu_bench.errors import RecordingError
import pytest
from rosbags.rosbag1 import Reader, Writer

TOPICS = ('/imu0', '/imu1')
IMU = 'sensor_msgs/msg/Imu'


def read(path: Path, topics=TOPICS) -> list[tuple[str, int, bytes]]:
    found = []
    for block in Ros1File(path).blocks(topics):
        found += [
            (block.channel.topic, stamp, blob)
            for stamp, blob in zip(block.receive_ns.tolist(), block.blobs(), strict=True)
        ]
    return sorted(found, key=lambda message: message[1])


@pytest.fixture(params=[None, Writer.CompressionFormat.BZ2, Writer.CompressionFormat.LZ4])
def ros1_bag(request, tmp_path, messages):
    """Return a bag written by rosbags, of several chunks, and what is in it."""
    expected = messages(400)
    path = tmp_path / 'a.bag'
    writer = Writer(path)
    writer.set_compression(request.param) if request.param else None
    writer.chunk_threshold = 8192
    with writer:
        connections = {
            topic: writer.add_connection(topic, IMU, msgdef='Header header', md5sum='0' * 32)
            for topic in TOPICS
        }
        for topic, stamp, data in expected:
            writer.write(connections[topic], stamp, data)
    return path, expected


def test_everything_is_read(ros1_bag):
    path, expected = ros1_bag
    file = Ros1File(path)
    assert read(path) == expected
    assert file.problems == []
    assert file.counts == {'/imu0': 200, '/imu1': 200}
    described = {(c.type, c.serialization, c.definition.strip()) for c in file.channels}
    assert described == {('sensor_msgs/Imu', 'ros1', 'Header header')}


def test_one_topic_is_read(ros1_bag):
    path, expected = ros1_bag
    assert read(path, ['/imu1']) == [message for message in expected if message[0] == '/imu1']


@pytest.mark.slow
def test_every_truncation_gives_what_is_complete(ros1_bag, tmp_path):
    path, expected = ros1_bag
    whole = path.read_bytes()
    cut = tmp_path / 'cut.bag'
    counts = []
    for size in range(14, len(whole) - 1, 977):
        cut.write_bytes(whole[:size])
        found = read(cut)
        assert found == expected[: len(found)]
        assert Ros1File(cut).problems
        assert sum(Ros1File(cut).counts.values()) == len(found)
        counts.append(len(found))
    assert counts == sorted(counts)
    assert len(set(counts)) > 4
    assert counts[-1] == 400


def test_a_bag_that_was_not_closed_is_read(ros1_bag):
    """As rosbag leaves it when it is killed: no index, and the header says so."""
    path, expected = ros1_bag
    whole = bytearray(path.read_bytes())
    place = whole.index(b'index_pos=') + len('index_pos=')
    index_start = int.from_bytes(whole[place : place + 8], 'little')
    whole[place : place + 8] = bytes(8)
    path.write_bytes(whole[:index_start])
    assert read(path) == expected
    assert Ros1File(path).problems == ['a.bag: not closed by its recorder: no index']


def test_a_damaged_chunk_costs_its_messages_only(ros1_bag):
    path, expected = ros1_bag
    whole = bytearray(path.read_bytes())
    place = len(whole) // 2
    whole[place : place + 200] = bytes(200)
    path.write_bytes(whole)
    file = Ros1File(path)
    found = read(path)
    list(file.blocks(TOPICS))
    same = [message for message in found if message in expected]
    # without a checksum in the format, a value changed in an uncompressed chunk goes unnoticed
    assert len(found) - len(same) <= 3
    assert len(same) > 250


def test_a_damaged_record_between_chunks_is_jumped_over(ros1_bag):
    path, expected = ros1_bag
    whole = bytearray(path.read_bytes())
    second = whole.index(b'compression=', whole.index(b'compression=') + 1)
    whole[second - 8 : second] = b'\xff' * 8
    path.write_bytes(whole)
    file = Ros1File(path)
    found = read(path)
    assert found == [message for message in expected if message in found]
    assert 250 < len(found) < 400
    assert any('damaged at byte' in problem for problem in file.problems)


def test_an_index_that_lies_is_not_believed(ros1_bag):
    path, expected = ros1_bag
    whole = bytearray(path.read_bytes())
    for index in Ros1File(path)._places[1].indexes:
        whole[index.start + 8 : index.start + 12] = b'\xff\xff\xff\x7f'
    path.write_bytes(whole)
    file = Ros1File(path)
    assert read(path) == expected
    list(file.blocks(TOPICS))
    assert 'damaged index of the chunk' in file.problems[0]


def test_an_index_that_names_not_all_is_not_believed(ros1_bag):
    path, expected = ros1_bag
    whole = bytearray(path.read_bytes())
    first, second = Ros1File(path)._places[1].indexes
    # the records of one connection are named by no index any more
    place = whole.rindex(b'op=\x04', first.start, second.start)
    whole[place : place + 4] = b'op=\x63'
    path.write_bytes(whole)
    assert read(path) == expected


@pytest.mark.slow
@pytest.mark.data
def test_it_is_what_rosbags_reads(shared_data):
    for path in sorted(shared_data.glob('rosbag1_*/**/*.bag')):
        if not path.stat().st_size:
            continue
        file = Ros1File(path)
        topics = [channel.topic for channel in file.channels]
        with Reader(path) as bag:
            expected = sorted(
                (connection.topic, stamp, bytes(data))
                for connection, stamp, data in bag.messages()
            )
        assert sorted(read(path, topics)) == expected
        assert file.problems == []


@pytest.mark.parametrize('content', [b'#ROSBAG V1.2\n', b'hello', b''])
def test_what_is_no_bag_is_refused(tmp_path, content):
    path = tmp_path / 'a.bag'
    path.write_bytes(content)
    with pytest.raises(RecordingError, match='not a bag of ROS 1 version'):
        Ros1File(path)
