# SPDX-License-Identifier: Apache-2.0
"""Reading mcap files: every way of writing them, every way of losing a part of them."""

from __future__ import annotations

from pathlib import Path
import shutil

from hypothesis import given
from hypothesis import strategies as st
from imu_bench.bags import mcap_records
from imu_bench.bags.mcap import McapFile
from imu_bench.bags.mcap_writer import McapWriter
from imu_bench.bags.topic_info import describe
from imu_bench.errors import RecordingError
from mcap.writer import CompressionType, IndexType, Writer
import pytest


def read(path: Path, topics=('/imu0', '/imu1')) -> list[tuple[str, int, bytes]]:
    file = McapFile(path)
    found = []
    for block in file.blocks(topics):
        found += [
            (block.channel.topic, stamp, blob)
            for stamp, blob in zip(block.receive_ns.tolist(), block.blobs(), strict=True)
        ]
    return sorted(found, key=lambda message: message[1])


def write_foreign(path: Path, messages, **options) -> Path:
    """Write a file with the mcap package, which nobody of this project wrote."""
    writer = Writer(str(path), chunk_size=8192, **options)
    writer.start('ros2', 'test')
    schema = writer.register_schema('sensor_msgs/msg/Imu', 'ros2msg', b'Header header')
    channels = {
        topic: writer.register_channel(topic, 'cdr', schema) for topic in ('/imu0', '/imu1')
    }
    for topic, stamp, data in messages:
        writer.add_message(channels[topic], stamp, data, stamp)
    writer.finish()
    return path


@pytest.mark.parametrize('compression', list(CompressionType))
@pytest.mark.parametrize('index', [IndexType.ALL, IndexType.NONE, IndexType.CHUNK])
@pytest.mark.parametrize('chunked', [True, False])
def test_reads_what_the_mcap_package_writes(tmp_path, messages, compression, index, chunked):
    expected = messages(300)
    path = write_foreign(
        tmp_path / 'a.mcap',
        expected,
        compression=compression,
        index_types=index,
        use_chunking=chunked,
    )
    file = McapFile(path)
    assert read(path) == expected
    assert file.problems == []
    assert file.counts == {'/imu0': 150, '/imu1': 150}
    assert {(c.topic, c.type, c.encoding, c.definition) for c in file.channels} == {
        (topic, 'sensor_msgs/msg/Imu', 'ros2msg', 'Header header') for topic in ('/imu0', '/imu1')
    }


@pytest.mark.parametrize('option', ['use_statistics', 'repeat_channels', 'use_summary_offsets'])
def test_a_summary_without_one_of_its_parts_is_read(tmp_path, messages, option):
    expected = messages(300)
    path = write_foreign(tmp_path / 'a.mcap', expected, **{option: False})
    assert read(path) == expected
    assert McapFile(path).counts == {'/imu0': 150, '/imu1': 150}


def test_one_topic_of_two_is_read(tmp_path, messages):
    expected = messages(300)
    path = write_foreign(tmp_path / 'a.mcap', expected)
    assert read(path, ['/imu1']) == [m for m in expected if m[0] == '/imu1']
    assert read(path, ['/none']) == []


@pytest.mark.parametrize('chunked', [True, False])
@pytest.mark.parametrize('compression', list(CompressionType))
def test_every_truncation_gives_what_is_complete(tmp_path, messages, chunked, compression):
    expected = messages(200)
    path = write_foreign(
        tmp_path / 'a.mcap', expected, use_chunking=chunked, compression=compression
    )
    whole = path.read_bytes()
    counts = []
    for size in range(9, len(whole), 977):
        cut = tmp_path / 'cut.mcap'
        cut.write_bytes(whole[:size])
        found = read(cut)
        assert found == expected[: len(found)]
        counts.append(len(found))
        assert McapFile(cut).problems
    assert counts == sorted(counts)
    assert counts[-1] == len(expected)
    assert len(set(counts)) > 4


def test_a_channel_is_known_that_comes_a_chunk_before_its_first_message(tmp_path):
    path = tmp_path / 'a.mcap'
    writer = McapWriter(path)
    writer.add_topic(describe('/imu0', 'sensor_msgs/msg/Imu'))
    writer.write('/imu0', 1, b'one')
    writer.flush()
    writer.add_topic(describe('/imu1', 'sensor_msgs/msg/Imu'))
    writer.write('/imu0', 2, b'two')
    writer.flush()
    writer.write('/imu1', 3, b'three')
    writer.flush()
    killed = shutil.copy(path, tmp_path / 'killed.mcap')
    writer.close('')
    assert McapFile(killed).counts == {'/imu0': 2, '/imu1': 1}
    assert read(killed)[-1] == ('/imu1', 3, b'three')


def test_messages_before_a_cut_inside_a_chunk_are_read(tmp_path, messages):
    expected = messages(200)
    path = write_foreign(tmp_path / 'a.mcap', expected, compression=CompressionType.NONE)
    whole = path.read_bytes()
    # in the middle of the data of message 3, which is in the first chunk
    cut = whole.index(expected[3][2]) + 5
    path.write_bytes(whole[:cut])
    assert read(path) == expected[:3]
    assert McapFile(path).problems == [
        'a.mcap: not closed by its recorder: no footer',
        f'a.mcap: cut off or damaged in the chunk at byte {whole.index(b"test") + 4}',
        f'a.mcap: cut off in the record at byte {whole.index(b"test") + 4}',
    ]


def test_a_damaged_chunk_is_skipped_and_counted(tmp_path, messages):
    expected = messages(300)
    path = write_foreign(tmp_path / 'a.mcap', expected, compression=CompressionType.NONE)
    whole = bytearray(path.read_bytes())
    place = whole.index(expected[150][2])
    whole[place] ^= 0xFF
    path.write_bytes(whole)
    found = read(path)
    lost = [message for message in expected if message not in found]
    assert expected[150] in lost
    assert len(lost) < 100
    file = McapFile(path)
    list(file.blocks(['/imu0']))
    assert len(file.problems) == 1
    assert f'checksum does not match); {len(lost)} messages lost' in file.problems[0]


def test_indexes_that_lie_are_not_believed(tmp_path, messages):
    expected = messages(300)
    path = write_foreign(tmp_path / 'a.mcap', expected, compression=CompressionType.NONE)
    whole = bytearray(path.read_bytes())
    stamp = expected[100][1].to_bytes(8, 'little')
    entry = whole.index(stamp, whole.index(expected[101][2]))  # in the index after the chunk
    while whole[entry - 8 : entry] and whole[entry + 8 : entry + 16] == stamp:
        entry = whole.index(stamp, entry + 1)
    whole[entry + 8 : entry + 16] = (11).to_bytes(8, 'little')
    path.write_bytes(whole)
    assert read(path) == expected


def test_garbage_after_the_last_chunk_ends_the_reading(tmp_path, messages):
    expected = messages(100)
    path = write_foreign(tmp_path / 'a.mcap', expected)
    whole = path.read_bytes()
    data_end = whole.rindex(b'\x0f\x04\0\0\0\0\0\0\0')
    path.write_bytes(whole[:data_end] + bytes(5000))
    assert read(path) == expected
    assert any('no record at byte' in problem for problem in McapFile(path).problems)


def test_a_chunk_that_claims_terabytes_is_damaged(tmp_path, messages):
    expected = messages(100)
    path = write_foreign(tmp_path / 'a.mcap', expected, compression=CompressionType.ZSTD)
    whole = bytearray(path.read_bytes())
    chunk = whole.index(b'\x06', 8 + 9)
    whole[chunk + 9 + 16 : chunk + 9 + 24] = (1 << 44).to_bytes(8, 'little')
    path.write_bytes(whole)
    file = McapFile(path)
    read(path)
    list(file.blocks(['/imu0', '/imu1']))
    assert 'claims 17592186044416 bytes' in file.problems[0]


def test_a_file_that_is_no_mcap_is_refused(tmp_path):
    path = tmp_path / 'a.mcap'
    path.write_bytes(b'hello')
    with pytest.raises(RecordingError, match='not an mcap file'):
        McapFile(path)


def one_by_one(buffer, start, until):
    """Return the records of a buffer as a loop over its bytes finds them."""
    found, place = [], start
    while place + 9 <= len(buffer):
        opcode, size = buffer[place], int.from_bytes(buffer[place + 1 : place + 9], 'little')
        known = 0 < opcode <= 0x0F or opcode >= 0x80
        if place + 9 + size > len(buffer) or not known or opcode in until:
            break
        found.append((opcode, place + 9, size))
        place += 9 + size
    return found, place


@pytest.mark.slow
@given(
    st.lists(
        st.tuples(
            st.sampled_from([0x03, 0x05, 0x80, 0x10]), st.integers(0, 3), st.integers(1, 40)
        ),
        max_size=12,
    ),
    st.integers(0, 12),
)
def test_records_that_are_alike_are_found_together(kinds, cut):
    one = [bytes([opcode]) + size.to_bytes(8, 'little') + bytes(size) for opcode, size, _ in kinds]
    whole = b''.join(record * times for record, (_, _, times) in zip(one, kinds, strict=True))
    buffer, until = whole[: len(whole) - cut], frozenset([0x80])
    for ends in (frozenset(), until):
        found = mcap_records.walk(buffer, 0, ends)
        expected, end = one_by_one(buffer, 0, ends)
        rows = zip(found.opcodes, found.offsets, found.sizes, strict=True)
        assert [tuple(map(int, row)) for row in rows] == expected
        assert found.end == end
