# SPDX-License-Identifier: Apache-2.0
"""An Imu inside of another message, known by the definition that the bag stores."""

from __future__ import annotations

from contextlib import closing
import sqlite3

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


@pytest.mark.parametrize(('inner', 'outer'), [(True, False), (False, True), (False, False)])
def test_the_better_of_two_headers_is_the_time(tmp_path, values, serialize, inner, outer):
    """A header that was rounded to 25 ms dates samples of 100 Hz no more."""
    store = store_of('ros2')
    rng = np.random.default_rng(2)
    fine = START + 10_000_000 * np.arange(N) + rng.integers(-100_000, 100_000, N)
    coarse = fine // 25_000_000 * 25_000_000
    written = []
    for k in range(N):
        stamps = [int((coarse if rough else fine)[k]) for rough in (inner, outer)]
        imu, around = (
            store.deserialize_cdr(serialize(t, values[0][k], values[1][k]), 'sensor_msgs/msg/Imu')
            for t in stamps
        )
        state = store.types[STATE](around.header, 3.7, imu, [])
        written.append(
            ('/state', STATE, int(fine[k]) + 5_000_000, bytes(store.serialize_cdr(state, STATE)))
        )
    with open_source(_write('mcap', tmp_path, store, written)) as source:
        recording = load(source, '/state.imu')
    np.testing.assert_array_equal(recording.samples.stamps, fine)
    assert recording.stamp_source == ('outer header' if inner else 'header')
    said = [note for note in recording.notes if 'around the Imu' in note]
    assert bool(said) == inner


# --- definitions in files beside the bag ------------------------------------------------------

FILES = {'State.msg': STATE_TEXT, 'Part.msg': PART_TEXT, 'Deep.msg': DEEP_TEXT}


@pytest.fixture(params=['mcap', 'sqlite3', 'sqlite3 before Iron'])
def undefined(request, tmp_path, values, serialize):
    """Return a bag of /state without any definition, in a folder of its own."""
    store = store_of('ros2')
    path = tmp_path / 'set' / 'bag'
    kind = request.param.split()[0]
    with BagWriter(path, kind) as bag:
        bag.add_topic(TopicInfo('/state', STATE, '', 'RIHS01_0'))
        for k in range(N):
            imu = store.deserialize_cdr(
                serialize(START + 10_000_000 * k, values[0][k], values[1][k]),
                'sensor_msgs/msg/Imu',
            )
            state = store.types[STATE](imu.header, 3.7, imu, [])
            bag.write('/state', START + 10_000_000 * k, bytes(store.serialize_cdr(state, STATE)))
    if request.param.endswith('Iron'):
        with closing(sqlite3.connect(next(path.glob('*.db3')))) as file:
            file.execute('DROP TABLE message_definitions')
            file.commit()
    return path


@pytest.mark.parametrize('place', ['.', '..', 'my_msgs/msg', '../my_msgs/msg', '../msg'])
def test_definitions_beside_the_bag(undefined, values, place):
    folder = undefined / place
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in FILES.items():
        (folder / name).write_text(text)
    with open_source(undefined) as source:
        assert [topic.name for topic in source.select()] == ['/state.imu']
        samples = load(source, '/state.imu').samples
        assert source.problems == []
    np.testing.assert_array_equal(samples.acceleration, values[0])
    np.testing.assert_array_equal(samples.angular_velocity, values[1])


def test_definitions_beside_a_single_file(undefined, values):
    for name, text in FILES.items():
        (undefined.parent / name).write_text(text)
    file = next(file for file in undefined.iterdir() if file.suffix in ('.db3', '.mcap'))
    with open_source(file) as source:
        assert len(load(source, '/state.imu')) == N


def test_definitions_that_are_not_there_are_asked_for(undefined):
    asked = (
        r'the bag stores no definition of my_msgs/msg/State: '
        r'if an Imu is inside, put State.msg beside'
    )
    with open_source(undefined) as source:
        with pytest.raises(RecordingError, match=f'no Imu topic; .*{asked}'):
            source.select()
        with pytest.raises(RecordingError, match=asked):
            source.select(['/state'])


@pytest.mark.parametrize(
    ('files', 'words'),
    [
        (('State.msg',), r'State\.msg is made of my_msgs/msg/Part: put Part\.msg beside it'),
        (('State.msg', 'Part.msg'), r'Part\.msg is made of my_msgs/msg/Deep: put Deep\.msg'),
    ],
)
def test_definitions_that_are_not_complete_say_what_they_need(undefined, files, words):
    for name in files:
        (undefined / name).write_text(FILES[name])
    with open_source(undefined) as source, pytest.raises(RecordingError, match=words):
        source.select()


@pytest.mark.parametrize('text', ['', 'float32 )(', '\0', 'x' * 300_000])
def test_definitions_that_are_none(undefined, text):
    (undefined / 'State.msg').write_text(text)
    with (
        open_source(undefined) as source,
        pytest.raises(RecordingError, match=r'State\.msg: no definition of my_msgs/msg/State'),
    ):
        source.select()


def test_a_type_named_like_a_path_reads_no_file(tmp_path, serialize):
    (tmp_path / 'State.msg').write_text(STATE_TEXT)
    with BagWriter(tmp_path / 'a' / 'bag', 'mcap') as bag:
        bag.add_topic(TopicInfo('/state', '../../State', '', 'RIHS01_0'))
        bag.write('/state', START, serialize(START, (1, 2, 3), (4, 5, 6)))
    with open_source(tmp_path / 'a' / 'bag') as source:
        assert [topic.is_imu for topic in source.topics] == [False]
        with pytest.raises(RecordingError, match='no Imu topic'):
            source.select()
