# SPDX-License-Identifier: Apache-2.0
"""An Imu inside of another message, known by the definition that the bag stores."""

from __future__ import annotations

from imu_bench.bags.topic_info import TopicInfo
from imu_bench.bags.writer import BagWriter
from imu_bench.errors import RecordingError
from imu_bench.offline.recordings import load, load_all, open_source
from mcap.writer import Writer as McapWriter
import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import get_types_from_msg, get_typestore, Stores

START = 1_700_000_000_000_000_000
N = 200
STATE, PART = 'my_msgs/msg/State', 'my_msgs/msg/Part'
STATE_TEXT = 'std_msgs/Header header\nfloat32 battery\nsensor_msgs/Imu imu\nmy_msgs/Part[] parts\n'
PART_TEXT = 'string name\nsensor_msgs/Imu imu\nmy_msgs/Deep deep\n'
DEEP_TEXT = 'uint8 flag\nsensor_msgs/Imu chip\n'


def store_of(kind):
    """Return a type store with the custom types."""
    store = get_typestore(Stores.ROS1_NOETIC if kind == 'ros1' else Stores.ROS2_JAZZY)
    for name, text in ((STATE, STATE_TEXT), (PART, PART_TEXT), ('my_msgs/msg/Deep', DEEP_TEXT)):
        store.register(get_types_from_msg(text, name))
    return store


@pytest.fixture
def values():
    rng = np.random.default_rng(1)
    return rng.normal(size=(N, 3)), rng.normal(size=(N, 3))


@pytest.fixture(params=['mcap', 'sqlite3', 'ros1', 'ros1 in mcap'])
def bag(request, tmp_path, values, serialize):
    """Return a bag with an Imu at /state.imu and two more deeper down, at /part."""
    kind = request.param
    ros = 1 if 'ros1' in kind else 2
    store = store_of('ros1' if ros == 1 else 'ros2')
    decode = store.deserialize_ros1 if ros == 1 else store.deserialize_cdr
    encode = store.serialize_ros1 if ros == 1 else store.serialize_cdr
    types = store.types
    written = []
    for k in range(N):
        imu = decode(serialize(START + 10_000_000 * k, values[0][k], values[1][k], ros=ros),
                     'sensor_msgs/msg/Imu')  # fmt: skip
        deep = types['my_msgs/msg/Deep'](1, imu)
        state = types[STATE](imu.header, 3.7, imu, [])
        part = types[PART]('x' * (k % 5), imu, deep)
        for topic, kind_of, message in (('/state', STATE, state), ('/part', PART, part)):
            written.append(
                (topic, kind_of, START + 10_000_000 * k, bytes(encode(message, kind_of)))
            )
    return _write(kind, tmp_path, store, written)


def _write(kind, folder, store, written):
    path = folder / 'bag'
    names = {topic: name for topic, name, _, _ in written}
    if kind in ('mcap', 'sqlite3'):
        with BagWriter(path, kind) as bag:
            for topic, name in names.items():
                definition = store.generate_msgdef(name, ros_version=2)[0]
                bag.add_topic(TopicInfo(topic, name, definition, 'RIHS01_0'))
            for topic, _, stamp, blob in written:
                bag.write(topic, stamp, blob)
    elif kind == 'ros1':
        path = path.with_suffix('.bag')
        with Ros1Writer(path) as bag:
            topics = {t: bag.add_connection(t, n, typestore=store) for t, n in names.items()}
            for topic, _, stamp, blob in written:
                bag.write(topics[topic], stamp, blob)
    else:
        path = path.with_suffix('.mcap')
        writer = McapWriter(str(path))
        writer.start('ros1')
        channels = {}
        for topic, name in names.items():
            definition = store.generate_msgdef(name, ros_version=1)[0].encode()
            schema = writer.register_schema(name.replace('/msg', ''), 'ros1msg', definition)
            channels[topic] = writer.register_channel(topic, 'ros1', schema)
        for topic, _, stamp, blob in written:
            writer.add_message(channels[topic], stamp, blob, stamp)
        writer.finish()
    return path


def test_found_at_every_depth_and_read(bag, values):
    with open_source(bag) as source:
        chosen = source.select()
        assert [topic.name for topic in chosen] == ['/state.imu', '/part.imu', '/part.deep.chip']
        assert chosen[0].type.startswith('sensor_msgs/msg/Imu in my_msgs/')
        recordings = load_all(source, chosen)
        assert source.problems == []
    for recording in recordings:
        assert recording.samples.stamps.tolist() == [START + 10_000_000 * k for k in range(N)]
        np.testing.assert_array_equal(recording.samples.acceleration, values[0])
        np.testing.assert_array_equal(recording.samples.angular_velocity, values[1])
        assert (recording.frame_id, recording.stored, recording.left_out) == ('imu', N, 0)
        assert recording.receive_ns.tolist() == recording.samples.stamps.tolist()


def test_by_name(bag):
    with open_source(bag) as source:
        assert len(load(source, 'part.imu')) == N
        with pytest.raises(
            RecordingError, match=r"topic '/state' holds my_msgs/(msg/)?State, not"
        ):
            source.select(['/state'])


def test_messages_cut_off_are_counted(tmp_path, serialize):
    store = store_of('ros2')
    imu = store.deserialize_cdr(serialize(START, (1, 2, 3), (4, 5, 6)), 'sensor_msgs/msg/Imu')
    state = store.types[STATE](imu.header, 3.7, imu, [])
    whole = bytes(store.serialize_cdr(state, STATE))
    written = [('/state', STATE, START + k, whole[:90] if k % 4 == 3 else whole) for k in range(8)]
    path = _write('mcap', tmp_path, store, written)
    with open_source(path) as source:
        assert len(load(source, '/state.imu')) == 6
        assert source.problems == ['/state.imu: 2 messages are no complete Imu and were left out']


@pytest.mark.parametrize(
    'definition',
    [
        'sensor_msgs/Imu imu',  # of what the message is made is not all there: still enough
        'sensor_msgs/Imu imu\nother_msgs/Unknown x',
        'sensor_msgs Imu )(',
        'my_msgs/State again\nsensor_msgs/Imu imu',
    ],
)
def test_definitions_that_are_damaged_or_not_complete(tmp_path, serialize, definition):
    path = tmp_path / 'bag'
    with BagWriter(path, 'mcap') as bag:
        bag.add_topic(TopicInfo('/state', STATE, definition, 'RIHS01_0'))
        for k in range(3):
            bag.write('/state', START + k, serialize(START + k, (1, 2, 3), (4, 5, 6)))
    with open_source(path) as source:
        if definition == 'sensor_msgs/Imu imu':
            assert len(load(source, '/state.imu')) == 3
        else:
            with pytest.raises(RecordingError):
                load(source, source.select()[0])
