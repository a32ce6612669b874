# SPDX-License-Identifier: Apache-2.0
"""What is cut, glued or of another kind is never read short without a word."""

from __future__ import annotations

from imu_bench.bags.block import Block, Channel
from imu_bench.bags.problems import code_of, INCOMPLETE
from imu_bench.errors import RecordingError
from imu_bench.offline.recordings import find_recordings, load_all, open_source, ReadOptions
from imu_bench.offline.recordings.decoding import decode
from mcap.writer import Writer
from msg_conversions import cdr, covariance
from msg_conversions.encoding import ImuTemplate
import numpy as np
import pytest

UNITS = 'linear_acceleration=m/s^2,angular_velocity=rad/s'
ROW = '{} 0.1 0.2 9.8 0.01 0.02 0.03\n'


def read(path, **options):
    with open_source(path, ReadOptions(**options)) as source:
        [recording] = load_all(source, source.select())
        return recording, source.problems


def log(tmp_path, change):
    """Write a log of counts and blanks, such as SmartMotion does, and change its text."""
    path = tmp_path / 'log.txt'
    text = 'index ax ay az gx gy gz\n' + ''.join(ROW.format(n) for n in range(200))
    path.write_text(change(text))
    return read(path, units=UNITS, rate_hz=100.0)


def test_a_whole_log_is_read_without_a_word(tmp_path):
    recording, problems = log(tmp_path, lambda text: text)
    assert len(recording) == 200
    assert problems == []


@pytest.mark.parametrize('cut', [2, 4, 8, 15, 25])
def test_a_log_cut_within_a_line_says_so(tmp_path, cut):
    recording, problems = log(tmp_path, lambda text: text[:-cut])
    assert len(recording) in (199, 200)
    assert any('no line end' in problem for problem in problems)


def test_two_lines_of_a_log_glued_together_are_no_row(tmp_path):
    row, following = ROW.format(100), ROW.format(101)
    recording, problems = log(
        tmp_path, lambda text: text.replace(row + following, row[:-9] + following[4:])
    )
    assert len(recording) == 198
    assert [code_of(problem) for problem in problems] == [INCOMPLETE]


def test_a_line_with_one_cell_more_and_one_with_one_less_are_no_rows(tmp_path):
    path = tmp_path / 'log.csv'
    rows = [f'{n},0.1,0.2,9.8,0.01,0.02,0.03' for n in range(200)]
    rows[50], rows[51] = rows[50] + ',7', rows[51][:-5]
    path.write_text('index,ax,ay,az,gx,gy,gz\n' + '\n'.join(rows) + '\n')
    recording, problems = read(path, units=UNITS, rate_hz=100.0)
    assert len(recording) == 198
    assert '2 lines of the table are no rows' in problems[0]


def test_a_damaged_part_of_a_numbered_log_is_not_passed_over(tmp_path):
    rows = 'index ax ay az gx gy gz\n' + ''.join(ROW.format(n) for n in range(200))
    for number in (1, 2, 3):
        (tmp_path / f'log_{number}.txt').write_text(rows)
    (tmp_path / 'log_2.txt').write_text('damaged\n' * 200)
    (tmp_path / 'notes.txt').write_text('of the day\n')
    found = find_recordings(tmp_path)
    assert [path.name for path in found] == ['log_1.txt', 'log_2.txt', 'log_3.txt']
    with pytest.raises(RecordingError, match='not a recording'):
        read(tmp_path / 'log_2.txt')


def mcap(path, encodings, topics):
    template = ImuTemplate(
        'imu_link',
        acceleration_covariance=covariance.UNKNOWN,
        angular_velocity_covariance=covariance.UNKNOWN,
    )
    stamps = 1_700_000_000_000_000_000 + 10_000_000 * np.arange(100)
    blobs = template.encode_imu(stamps, np.ones((100, 3)), np.ones((100, 3)))
    writer = Writer(str(path))
    writer.start('ros2')
    schema = writer.register_schema('sensor_msgs/msg/Imu', 'ros2msg', b'')
    channels = [
        writer.register_channel(topic, encoding, schema)
        for topic, encoding in zip(topics, encodings, strict=True)
    ]
    for index, (stamp, blob) in enumerate(zip(stamps.tolist(), blobs, strict=True)):
        writer.add_message(channels[index % len(channels)], stamp, bytes(blob), stamp)
    writer.finish()
    return path


@pytest.mark.parametrize('topics', [('/imu', '/imu'), ('/imu', '/other')])
def test_messages_of_another_encoding_are_left_out_and_said(tmp_path, topics):
    path = mcap(tmp_path / 'a.mcap', ('cdr', 'json'), topics)
    recording, problems = read(path)
    assert len(recording) == 50
    assert f'{topics[1]}: messages serialized as json are left out' in problems


@pytest.mark.parametrize('size', [0, 9, 290])
def test_millions_of_messages_too_short_are_not_tried_one_by_one(size, monkeypatch):
    count = 200_000
    offsets, sizes = np.zeros(count, np.int64), np.full(count, size)
    block = Block(Channel('/imu', 'sensor_msgs/msg/Imu'), offsets, bytes(400), offsets, sizes)
    tried = 0

    def decode_at(buffer, offsets, sizes, full):
        nonlocal tried
        tried += 1
        return decode_imu_at(buffer, offsets, sizes, full=full)

    decode_imu_at = cdr.decode_imu_at
    monkeypatch.setattr(cdr, 'decode_imu_at', decode_at)
    assert decode(block).undecodable == count
    assert tried < 10


def test_messages_all_of_another_encoding_are_refused(tmp_path):
    with pytest.raises(RecordingError, match='serialized as json'):
        read(mcap(tmp_path / 'a.mcap', ('json',), ('/imu',)))
