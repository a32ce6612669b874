# SPDX-License-Identifier: Apache-2.0
"""Every real bag there is, against what it is known to hold."""

from __future__ import annotations

from collections import Counter
import json

from imu_bench.bags.bag import Bag
from imu_bench.errors import RecordingError
from imu_bench.offline.recordings import find_recordings, load, open_source
import numpy as np
import pytest

pytestmark = pytest.mark.data

# both formats of one recording that is announced as serialized in an unknown way
UNREADABLE = {
    'crystal-0.0.7/rosbag2_tests/resources/wrong_rmw_test',
    'dashing-0.1.8/rosbag2_tests/resources/wrong_rmw_test',
    'iron-0.22.7/rosbag2_tests/resources/mcap/wrong_rmw_test',
}
DISAGREEING = {
    'eloquent-0.2.8/rosbag2_tests/resources/wrong_rmw_test',
    'galactic-0.9.2/rosbag2_tests/resources/wrong_rmw_test',
    'iron-0.22.7/rosbag2_tests/resources/sqlite3/wrong_rmw_test',
}


def messages_by_topic(path) -> dict[str, int]:
    bag = Bag(path)
    found: Counter[str] = Counter()
    for block in bag.blocks({channel.topic for channel in bag.channels}):
        assert (block.receive_ns >= 0).all()
        assert all(block.blobs())
        found[block.channel.topic] += len(block)
    return dict(found)


def test_all_33_bags_of_rosbag2_are_read(shared_data):
    """Where rosbags yields nothing, or fails on a service, everything stored is read here."""
    folder = shared_data / 'rosbag2_test_bags'
    index = json.loads((folder / 'index.json').read_text())['bags']
    assert len(index) == 33
    for entry in index:
        path = folder / entry['dir']
        if entry['dir'] in UNREADABLE:
            with pytest.raises(RecordingError, match='serialized as wrong_format; only cdr and'):
                open_source(path)
            continue
        source = open_source(path)
        assert source.format == f'rosbag2 {entry["storage"]}', entry['dir']
        assert sum(topic.count for topic in source.topics) == entry['metadata_count']
        found = messages_by_topic(path)
        assert sum(found.values()) == entry['metadata_count'], entry['dir']
        for topic, (_, count) in entry.get('topics', {}).items():
            assert found.get(topic, 0) == count, entry['dir']
        expected = 7 * [None] if entry['dir'] in DISAGREEING else []
        assert len(source.problems) <= len(expected), entry['dir']
        if entry['dir'] in DISAGREEING:
            assert 'is serialized as wrong_format, the storage says cdr' in source.problems[0]


def test_loose_files_are_read(shared_data):
    folder = shared_data / 'rosbag2_test_bags'
    index = json.loads((folder / 'index.json').read_text())['loose_files']
    read = 0
    for entry in index:
        path = folder / entry['file']
        if path.suffix == '.yaml':
            with pytest.raises(RecordingError, match='not a recording'):
                open_source(path)
            continue
        source = open_source(path)
        counts = {topic.name: topic.count for topic in source.topics}
        if 'topics' in entry:
            assert counts == {name: count for name, (_, count) in entry['topics'].items()}
        else:
            assert sum(counts.values()) > 0  # rosbags cannot open these at all
        read += 1
    assert read == 13


def test_parts_without_metadata_are_one_recording(shared_data):
    for kind in (
        'galactic-0.9.2/rosbag2_py/resources',
        'iron-0.22.7/rosbag2_py/test/resources/mcap',
    ):
        path = shared_data / 'rosbag2_test_bags' / kind / 'reindex_test_bags/multiple_files'
        assert messages_by_topic(path) == {'/chatter': 3177}


def test_a_bag_without_imu_lists_its_topics(shared_data):
    path = shared_data / 'rosbag2_test_bags/iron-0.22.7/rosbag2_py/test/resources/mcap/talker'
    with pytest.raises(RecordingError) as caught:
        open_source(path).select()
    assert str(caught.value) == (
        f'{path}: no Imu topic; it holds /rosout (rcl_interfaces/msg/Log, 10), '
        '/parameter_events (rcl_interfaces/msg/ParameterEvent, 0), '
        '/topic (std_msgs/msg/String, 10)'
    )


def test_an_empty_bag_is_said_to_be_empty(shared_data):
    path = shared_data / 'rosbag2_test_bags/eloquent-0.2.8/ros2bag/test/resources/empty_bag'
    with pytest.raises(RecordingError, match='no Imu topic; it holds /rosout'):
        open_source(path).select()
    with pytest.raises(RecordingError, match='the recording is empty: no topic is stored'):
        open_source(shared_data / 'rosbag1_samples/fixtures/no-messages.bag').select()


def test_compressed_samples_hold_what_they_should(shared_data):
    folder = shared_data / 'rosbag2_zstd_samples'
    for entry in json.loads((folder / 'reference.json').read_text())['bags']:
        path = folder / entry['path'].removeprefix('bag_bagel/')
        source = open_source(path)
        if 'topics' in entry:
            expected = {name: topic['count'] for name, topic in entry['topics'].items()}
            assert {topic.name: topic.count for topic in source.topics} == expected
            if entry['ros2']:
                found = messages_by_topic(path)
                assert found == {name: count for name, count in expected.items() if count}
        else:
            # rosbags does not open single compressed files
            assert sum(topic.count for topic in source.topics) == 6


def test_ros1_samples_hold_what_they_should(shared_data):
    folder = shared_data / 'rosbag1_samples'
    for entry in json.loads((folder / 'reference.json').read_text())['bags']:
        path = folder / entry['path'].removeprefix('bag_foxglove_rosbag/')
        if 'error' in entry:
            with pytest.raises(RecordingError, match=r'the file is empty|not a recording'):
                open_source(path)
            continue
        expected = {name: topic['count'] for name, topic in entry['topics'].items()}
        assert {topic.name: topic.count for topic in open_source(path).topics} == expected


def test_husky_bags_give_the_reference_values(shared_data):
    folder = shared_data / 'rosbag1_husky_imu'
    for entry in json.loads((folder / 'reference.json').read_text())['bags']:
        path = folder / entry['path'].removeprefix('bag_robot_localization/')
        with open_source(path) as source:
            assert [topic.name for topic in source.select()] == ['/imu/data']
            recording = load(source, '/imu/data')
            assert source.problems == []
        expected = entry['imu']['/imu/data']
        assert len(recording) == recording.stored == expected['count']
        assert recording.frame_id == expected['frame_id']
        assert (recording.stamp_source, recording.left_out) == ('header', 0)
        assert recording.notes == ()
        samples = recording.samples
        values = np.hstack([samples.angular_velocity, samples.acceleration])
        np.testing.assert_allclose(values.mean(axis=0), expected['mean'], rtol=1e-12)
        np.testing.assert_allclose(values.std(axis=0, ddof=1), expected['std_ddof1'], rtol=1e-12)
        assert values[0].tolist() == expected['first']
        assert values[-1].tolist() == expected['last']
        for stamps, times in (
            (samples.stamps, expected['header_time']),
            (recording.receive_ns, expected['bag_time']),
        ):
            steps = np.diff(stamps) * 1e-9
            assert steps.mean() == pytest.approx(times['mean_dt'], rel=1e-9)
            assert 1 / steps.mean() == pytest.approx(times['mean_rate_hz'], rel=1e-9)
            assert steps.min() == pytest.approx(times['min_dt'], abs=3e-7)
            assert steps.max() == pytest.approx(times['max_dt'], abs=3e-7)


def test_recordings_are_found_in_folders(shared_data):
    def names(folder):
        return [path.name for path in find_recordings(shared_data / folder)]

    assert names('rosbag1_husky_imu') == ['test1.bag', 'test2.bag']
    assert names('mpu9150_five_units') == [f'imu{unit}.log' for unit in range(5)]
    assert names('rosbag2_zstd_samples') == ['sample.bag', 'db3', 'db3_zstd', 'mcap', 'mcap_zstd']
    assert names('elevator_phone') == ['skyscrapper_up.csv']
    # 33 bags, 2 folders of parts without metadata, 4 loose bags of ROS 2, 3 of ROS 1
    assert len(names('rosbag2_test_bags')) == 42


def test_nothing_in_the_shared_folder_is_touched(shared_data):
    bags = find_recordings(shared_data / 'rosbag2_test_bags')
    before = _listing(shared_data / 'rosbag2_test_bags')
    for path in bags:
        try:
            source = open_source(path)
        except RecordingError:
            continue
        source.close()
    assert _listing(shared_data / 'rosbag2_test_bags') == before


def _listing(folder):
    return {str(p): (p.stat().st_size, p.stat().st_mtime_ns) for p in sorted(folder.rglob('*'))}
