# SPDX-License-Identifier: Apache-2.0
"""From a bag to a recording: values bit by bit, stamps, values that are none, counts."""

from __future__ import annotations

import re

from imu_bench.bags.problems import code_of
from imu_bench.errors import RecordingError
from imu_bench.offline.health.check import check
from imu_bench.offline.recordings import (
    cache,
    load,
    load_all,
    open_source,
    ReadOptions,
)
import numpy as np
import pytest
from rosbags.highlevel import AnyReader

START = 1_700_000_000_000_000_000


@pytest.fixture
def signals():
    rng = np.random.default_rng(11)
    return rng.normal(0, 1, (500, 3)), rng.normal(0, 0.1, (500, 3))


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_values_are_those_of_rosbags_bit_by_bit(imu_bag, signals, storage):
    path = imu_bag(*signals, storage=storage)
    with open_source(path) as source:
        recording = load(source, 'imu/data_raw')
    with AnyReader([path]) as bag:
        wanted = [c for c in bag.connections if c.topic == '/imu/data_raw']
        received, decoded = [], []
        for connection, stamp, data in bag.messages(wanted):
            received.append(stamp)
            decoded.append(bag.deserialize(data, connection.msgtype))
    vectors = [(m.linear_acceleration, m.angular_velocity) for m in decoded]
    assert recording.samples.acceleration.tolist() == [[a.x, a.y, a.z] for a, _ in vectors]
    assert recording.samples.angular_velocity.tolist() == [[w.x, w.y, w.z] for _, w in vectors]
    assert recording.samples.stamps.tolist() == [
        m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in decoded
    ]
    assert recording.receive_ns.tolist() == received
    assert (recording.announced, recording.stored, recording.left_out) == (500, 500, 0)
    assert (recording.frame_id, recording.notes) == ('imu', ())
    assert (recording.source, recording.topic) == (str(path), '/imu/data_raw')
    assert recording.samples.magnetic_field is None


def test_progress_counts_messages(imu_bag, signals):
    seen = []
    with open_source(imu_bag(*signals)) as source:
        load(source, '/imu/data_raw', lambda *numbers: seen.append(numbers))
    assert seen[-1] == (500, 500)
    assert seen == sorted(seen)


def test_frames_of_several_lengths_are_read_and_said(tmp_path, serialize):
    from imu_bench.bags.topic_info import describe
    from imu_bench.bags.writer import BagWriter

    frames = ['a', 'a_much_longer_name', 'a', 'bcd']
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic(describe('/imu', 'sensor_msgs/msg/Imu'))
        for index, frame in enumerate(frames):
            bag.write('/imu', index, serialize(START + index, (index, 1, 2), (3, 4, 5), frame))
    with open_source(tmp_path / 'bag') as source:
        recording = load(source, '/imu')
    assert recording.samples.acceleration[:, 0].tolist() == [0, 1, 2, 3]
    assert recording.frame_id == 'a'
    words = (
        "several frame_ids on one topic, which belongs to one sensor: 'a', 'a_much_longer_name', "
    )
    assert recording.notes == (f"{words}'bcd'",)
    (finding,) = [each for each in check(recording).findings if each.text == f"{words}'bcd'."]
    assert finding.severity == 'severe'


def test_a_message_that_is_no_imu_is_left_out_and_counted(tmp_path, serialize):
    from imu_bench.bags.topic_info import describe
    from imu_bench.bags.writer import BagWriter

    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic(describe('/imu', 'sensor_msgs/msg/Imu'))
        for index in range(10):
            blob = serialize(START + index, (index, 1, 2), (3, 4, 5))
            bag.write('/imu', index, blob[:100] if index == 4 else blob)
    with open_source(tmp_path / 'bag') as source:
        recording = load(source, '/imu')
        assert source.problems == ['/imu: 1 messages are no complete Imu and were left out']
    assert recording.samples.acceleration[:, 0].tolist() == [0, 1, 2, 3, 5, 6, 7, 8, 9]
    assert recording.receive_ns.tolist() == [0, 1, 2, 3, 5, 6, 7, 8, 9]


@pytest.mark.parametrize('order', ['>', '<'])
def test_both_byte_orders_are_read(tmp_path, serialize, order):
    from imu_bench.bags.topic_info import describe
    from imu_bench.bags.writer import BagWriter

    little = serialize(START, (1.5, -2.5, 9.8), (0.1, 0.2, 0.3), 'xyz')
    blob = little
    if order == '>':
        head = [np.frombuffer(little[4:16], '<u4').astype('>u4').tobytes(), little[16:20]]
        numbers = np.frombuffer(little[20:], '<f8').astype('>f8').tobytes()
        blob = b'\0\0\0\0' + b''.join(head) + numbers
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic(describe('/imu', 'sensor_msgs/msg/Imu'))
        bag.write('/imu', 1, blob)
    with open_source(tmp_path / 'bag') as source:
        recording = load(source, '/imu')
    assert recording.samples.stamps.tolist() == [START]
    assert recording.samples.acceleration.tolist() == [[1.5, -2.5, 9.8]]
    assert recording.frame_id == 'xyz'


def test_ros1_messages_in_an_mcap_file_are_read(tmp_path, serialize):
    from mcap.writer import Writer

    path = tmp_path / 'converted.mcap'
    writer = Writer(str(path))
    writer.start('ros1')
    schema = writer.register_schema('sensor_msgs/Imu', 'ros1msg', b'')
    channel = writer.register_channel('/imu', 'ros1', schema)
    for index, frame in enumerate(['imu', 'imu', 'other']):
        blob = serialize(START + index, (index, 1, 2), (3, 4, 5), frame, ros=1)
        writer.add_message(channel, index, blob, index)
    writer.finish()
    with open_source(path) as source:
        recording = load(source, '/imu')
    assert recording.samples.acceleration.tolist() == [[0, 1, 2], [1, 1, 2], [2, 1, 2]]
    assert recording.samples.angular_velocity.tolist() == [[3, 4, 5]] * 3
    assert recording.samples.stamps.tolist() == [START, START + 1, START + 2]


class TestNumbersThatAreNone:
    def test_are_left_out_counted_and_become_gaps(self, imu_bag, signals):
        acceleration, angular_velocity = signals
        acceleration[10, 0] = np.nan
        acceleration[11, 0] = np.inf
        angular_velocity[[11, 20], 2] = -np.inf
        with open_source(imu_bag(acceleration, angular_velocity)) as source:
            recording = load(source, '/imu/data_raw')
        assert recording.notes == (
            'linear_acceleration.x: 1 NaN and 1 infinite values left out',
            'angular_velocity.z: 0 NaN and 2 infinite values left out',
        )
        assert (recording.stored, recording.left_out, len(recording)) == (500, 3, 497)
        kept = np.delete(np.arange(500), [10, 11, 20])
        assert recording.samples.acceleration.tolist() == acceleration[kept].tolist()
        assert recording.samples.stamps.tolist() == (START + 10_000_000 * kept).tolist()
        assert recording.receive_ns.size == 497

    def test_an_axis_that_never_has_a_number_is_absent(self, imu_bag, signals):
        acceleration, angular_velocity = signals
        acceleration[:, 1] = np.nan
        with open_source(imu_bag(acceleration, angular_velocity)) as source:
            recording = load(source, '/imu/data_raw')
        assert len(recording) == 500
        assert np.isnan(recording.samples.acceleration[:, 1]).all()
        assert np.isfinite(recording.samples.acceleration[:, 0]).all()

    def test_a_quantity_that_never_has_a_number_is_absent(self, imu_bag, signals):
        acceleration, angular_velocity = signals
        acceleration[:] = np.nan
        with open_source(imu_bag(acceleration, angular_velocity)) as source:
            recording = load(source, '/imu/data_raw')
        assert recording.samples.acceleration is None
        assert len(recording) == 500

    @pytest.mark.parametrize('everywhere', [True, False])
    def test_a_recording_of_nothing_else_is_refused(self, imu_bag, everywhere):
        numbers = np.full((10, 3), np.nan)
        if not everywhere:
            numbers[::2, 0] = 1.0
            numbers[1::2, 1] = 1.0
        path = imu_bag(numbers, numbers)
        message = r'not a single finite value|every sample has a NaN'
        with open_source(path) as source, pytest.raises(RecordingError, match=message):
            load(source, '/imu/data_raw')


class TestNotReported:
    def test_a_quantity_with_covariance_minus_one_is_absent(self, imu_bag, signals):
        with open_source(imu_bag(signals[0], np.zeros((500, 3)), covariances=(0, -1))) as source:
            recording = load(source, '/imu/data_raw')
            assert source.problems == []
        assert recording.samples.angular_velocity is None
        assert len(recording) == 500

    def test_values_that_are_there_all_the_same_are_used_and_said(self, imu_bag, signals):
        with open_source(imu_bag(*signals, covariances=(0, -1))) as source:
            recording = load(source, '/imu/data_raw')
            (problem,) = source.problems
        assert 'declared as not reported (covariance -1) but has values: used' in problem
        assert recording.samples.angular_velocity.tolist() == signals[1].tolist()


class TestStamps:
    @pytest.mark.parametrize(
        ('stamps', 'reason'),
        [
            (np.zeros(100, int), 'every header stamp is zero'),
            (np.full(100, START), 'every header stamp is the same'),
            (START + np.arange(100) % 2, '49% of the header stamps step back in time'),
            (START + np.arange(100) // 10, '91% of the header stamps repeat the one before'),
        ],
    )
    def test_headers_that_are_no_time_give_way_to_the_time_of_arrival(
        self, imu_bag, signals, stamps, reason
    ):
        path = imu_bag(signals[0][:100], signals[1][:100], stamps)
        with open_source(path) as source:
            recording = load(source, '/imu/data_raw')
        assert (recording.stamp_source, recording.stamp_reason) == ('receive', reason)
        assert recording.notes == (f'stamps are the receive time: {reason}',)
        expected = START + 500_000 + 10_000_000 * np.arange(100)
        assert recording.samples.stamps.tolist() == expected.tolist()

    def test_a_few_faults_are_left_for_the_health_check(self, imu_bag, signals):
        stamps = START + 10_000_000 * np.arange(500)
        stamps[[100, 200, 300]] -= 30_000_000
        with open_source(imu_bag(*signals, stamps)) as source:
            recording = load(source, '/imu/data_raw')
        assert recording.stamp_source == 'header'
        assert recording.samples.stamps.tolist() == stamps.tolist()


class TestWrongTopic:
    def test_an_unknown_topic_lists_those_there_are(self, imu_bag, signals):
        path = imu_bag(*signals)
        with open_source(path) as source, pytest.raises(RecordingError) as caught:
            load(source, '/imu')
        assert str(caught.value) == (
            f"{path}: no topic '/imu' (did you mean '/imu/data_raw'?); it holds "
            '/imu/data_raw (sensor_msgs/msg/Imu, 500), /text (std_msgs/msg/String, 1)'
        )

    @pytest.mark.parametrize('name', ['imu', 'data_raw', 'imu/data_raw', '/imu/data_raw'])
    def test_a_part_of_the_name_is_enough_where_it_is_of_one_topic(self, imu_bag, signals, name):
        with open_source(imu_bag(*signals)) as source:
            assert [topic.name for topic in source.select((name,))] == ['/imu/data_raw']

    def test_a_part_of_several_names_is_refused_with_all_of_them(self, tmp_path, serialize):
        from imu_bench.bags.topic_info import describe
        from imu_bench.bags.writer import BagWriter

        names = ['/b/chip/imu/data_raw', '/b/chip/imu/data', '/b/other/imu/data_raw']
        with BagWriter(tmp_path / 'bag') as bag:
            for name in names:
                bag.add_topic(describe(name, 'sensor_msgs/msg/Imu'))
                bag.write(name, START, serialize(START, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0)))
        with open_source(tmp_path / 'bag') as source:
            assert [topic.name for topic in source.select(('chip',))] == [names[0]]
            assert [topic.name for topic in source.select(('chip/imu/data',))] == [names[1]]
            for short in ('b', 'imu', 'data_raw'):
                several = f"'{short}' names several topics: {names[0]}, {names[2]}"
                with pytest.raises(RecordingError, match=several):
                    source.select((short,))
            for nothing in ('chi', '/chip', 'chip/data_raw'):
                with pytest.raises(RecordingError, match=f"no topic '{nothing}'"):
                    source.select((nothing,))

    def test_a_topic_of_another_type_is_refused(self, imu_bag, signals):
        path = imu_bag(*signals)
        message = 'holds std_msgs/msg/String, not Imu'
        with open_source(path) as source, pytest.raises(RecordingError, match=message):
            source.select(('/text',))

    def test_a_topic_without_messages_is_refused(self, tmp_path):
        from imu_bench.bags.topic_info import describe
        from imu_bench.bags.writer import BagWriter

        with BagWriter(tmp_path / 'bag') as bag:
            bag.add_topic(describe('/imu', 'sensor_msgs/msg/Imu'))
        message = 'no Imu message stored'
        with open_source(tmp_path / 'bag') as source, pytest.raises(RecordingError, match=message):
            source.select()


def test_all_topics_are_read_in_one_pass(tmp_path, serialize, monkeypatch):
    from imu_bench.bags.mcap import McapFile
    from imu_bench.bags.topic_info import describe
    from imu_bench.bags.writer import BagWriter

    with BagWriter(tmp_path / 'bag') as bag:
        for topic in ('/a', '/b'):
            bag.add_topic(describe(topic, 'sensor_msgs/msg/Imu'))
        for index in range(200):
            for value, topic in enumerate(('/a', '/b')):
                blob = serialize(START + index, (index, value, 2), (3, 4, 5))
                bag.write(topic, index, blob)
    passes = []
    blocks = McapFile.blocks
    monkeypatch.setattr(
        McapFile, 'blocks', lambda self, topics: passes.append(topics) or blocks(self, topics)
    )
    with open_source(tmp_path / 'bag') as source:
        recordings = load_all(source, source.select())
    assert [recording.topic for recording in recordings] == ['/a', '/b']
    assert [recording.samples.acceleration[-1].tolist() for recording in recordings] == [
        [199, 0, 2],
        [199, 1, 2],
    ]
    assert len(passes) == 1


def test_a_cut_off_bag_is_read_up_to_the_cut_and_reported(imu_bag, signals):
    path = imu_bag(*signals)
    file = path / 'imu_bag_0.mcap'
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with open_source(path) as source:
        recording = load(source, '/imu/data_raw')
        problems = source.problems
    assert 0 < len(recording) < 500
    assert recording.announced == 500
    assert recording.notes == (
        f'the metadata announces 500 messages on /imu/data_raw, {len(recording)} were read',
    )
    assert any('cut off' in problem for problem in problems)


@pytest.mark.parametrize(
    ('name', 'content', 'text'),
    [
        ('missing', None, 'no such file or folder'),
        ('empty.bag', b'', 'the file is empty'),
        ('picture.png', b'\x89PNG\r\n\x1a\n\0\0\0\rIHDR', 'not a recording'),
        ('cut.bag', b'#ROSBAG V2.0\n' + bytes(50), 'the recording is empty: no topic is stored'),
        (
            'old.bag',
            b'#ROSBAG V1.2\n' + bytes(50),
            "not a bag of ROS 1 version 2.0 but '#ROSBAG V1.2'",
        ),
        ('letter.txt', b'Dear reader,\nthis is no table.\n', 'not a recording'),
        ('a.mcap', b'\x89MCAP0\r\n', 'the recording is empty: no topic is stored'),
    ],
)
def test_what_is_no_recording_is_refused_in_one_line(tmp_path, name, content, text):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(RecordingError, match=re.escape(text)) as caught:
        open_source(path).select()
    assert '\n' not in str(caught.value)
    assert name in str(caught.value)


def test_a_folder_that_is_no_bag_names_what_is_in_it(tmp_path):
    with pytest.raises(RecordingError, match='this folder is no bag; it holds no bag, CSV or'):
        open_source(tmp_path)
    (tmp_path / 'a.csv').write_text('ax,ay,az\n1,2,3\n4,5,6\n')
    with pytest.raises(RecordingError, match=r'name one of the 1 recordings in it: a\.csv'):
        open_source(tmp_path)


@pytest.mark.parametrize('rate', [0.0, -1.0, float('nan'), float('inf'), 1e9])
def test_an_impossible_rate_is_refused(rate):
    with pytest.raises(RecordingError, match='the sample rate must be above 0'):
        ReadOptions(rate_hz=rate)


def test_what_kind_of_problem_it_is_survives_the_cache(imu_bag, tmp_path, monkeypatch):
    numbers = np.random.default_rng(1).normal(size=(300, 3))
    numbers[7, 1] = np.nan
    path = imu_bag(numbers, numbers)
    [storage] = path.glob('*.mcap')
    storage.write_bytes(storage.read_bytes()[:-30])
    monkeypatch.setattr(cache, 'LARGE', 1)
    kinds = []
    for _ in range(2):
        with cache.columns(path, ReadOptions(), keep=tmp_path / 'kept') as read:
            kinds.append(
                [[code_of(words) for words in read.problems]]
                + [[code_of(words) for words in one.notes] for one in read.recordings]
            )
    assert kinds[0] == kinds[1]
    assert kinds[0][0][0] == 'incomplete'
    assert kinds[0][1] == ['not_a_number'] * 2


def test_the_same_samples_with_an_orientation_are_left_out_and_it_is_said(tmp_path, serialize):
    from imu_bench.bags.topic_info import describe
    from imu_bench.bags.writer import BagWriter

    with BagWriter(tmp_path / 'bag') as bag:
        for topic in ('/a/imu/data', '/a/imu/data_raw', '/b/imu/data'):
            bag.add_topic(describe(topic, 'sensor_msgs/msg/Imu'))
            bag.write(topic, START, serialize(START, (0, 1, 2), (3, 4, 5)))
    with open_source(tmp_path / 'bag') as source:
        chosen = [topic.name for topic in source.select()]
        assert chosen == ['/a/imu/data_raw', '/b/imu/data']
        [said] = [words for words in source.problems if 'left out' in words]
        assert said.startswith('/a/imu/data is left out')
        assert [topic.name for topic in source.select(('/a/imu/data',))] == ['/a/imu/data']
