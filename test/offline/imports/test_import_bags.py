# SPDX-License-Identifier: Apache-2.0
"""Bags that are imported: what goes along, what is left out, and what others read of it."""

from __future__ import annotations

from collections import Counter
import sqlite3

from imu_bench.bags.topic_info import describe
from imu_bench.bags.writer import BagWriter
from imu_bench.offline.imports import import_recordings, outputs, tracks
from imu_bench.offline.recordings import load_all, open_source, ReadOptions
from mcap.reader import make_reader
from msg_conversions import cdr, covariance
from msg_conversions.encoding import ImuTemplate, Template
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import get_typestore, Stores
import yaml

START = 1_700_000_000_000_000_000
N = 300
STAMPS = START + 10_000_000 * np.arange(N)
IMU, MAG, TEMPERATURE = '/chip/imu/data', '/chip/imu/mag', '/chip/temperature'
TURNS = np.tile([0.0, 0.0, 0.6, 0.8], (N, 1))
SPREAD = covariance.diagonal(0.25)


def numbers(seed=1):
    rng = np.random.default_rng(seed)
    return rng.normal([0.0, 0.0, 9.80665], 0.02, (N, 3)), rng.normal(0.0, 1e-3, (N, 3))


def imu_blobs(stamps=STAMPS, **constant):
    acceleration, rates = numbers()
    given = {
        'acceleration_covariance': covariance.UNKNOWN,
        'angular_velocity_covariance': SPREAD,
        'orientation_covariance': SPREAD,
    }
    template = ImuTemplate('chip_link', **{**given, **constant})
    return template.encode_imu(stamps, acceleration, rates, TURNS)


@pytest.fixture
def bag(tmp_path):
    """Return a function that writes a bag as a sensor with a fusion of its own has it."""

    def write(blobs=None, storage='mcap', name='bag', custom=None):
        field = Template('chip_link', (0.0, 0.0, 0.0, *SPREAD))
        warmth = Template('chip_link', (0.0, 0.5))
        slow = STAMPS[::10]
        messages = [
            (IMU, 'sensor_msgs/msg/Imu', STAMPS, blobs or imu_blobs()),
            (MAG, 'sensor_msgs/msg/MagneticField', slow,
             field.encode(slow, (cdr.MAGNETIC_FIELD_VECTOR, numbers(2)[1][::10]))),
            (TEMPERATURE, 'sensor_msgs/msg/Temperature', slow,
             warmth.encode(slow, (cdr.TEMPERATURE_VALUE, 20.0 + np.arange(N // 10)[:, None]))),
            ('/chatter', 'std_msgs/msg/String', STAMPS[:3], [b'\0\1\0\0\2\0\0\0a\0'] * 3),
        ]  # fmt: skip
        path = tmp_path / name
        with BagWriter(path, storage, custom=custom) as writer:
            for topic, kind, stamps, data in messages:
                writer.add_topic(describe(topic, kind))
                for stamp, blob in zip(stamps.tolist(), data, strict=True):
                    writer.write(topic, stamp + 500_000, blob)
        return path

    return write


def imported(path, output, form='mcap', **options):
    return import_recordings([path], ReadOptions(**options), output, form)


def stored(path):
    """Return arrival and bytes of every message by topic, as rosbags finds them."""
    found = {}
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, received, data in reader.messages():
            found.setdefault(connection.topic, []).append((received, bytes(data)))
    return found


def old(blob):
    """Return a serialized Imu as ROS 1 has it."""
    return bytes(get_typestore(Stores.ROS2_JAZZY).cdr_to_ros1(blob, 'sensor_msgs/msg/Imu'))


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_every_byte_of_a_sensor_comes_out_again(bag, tmp_path, storage):
    path = bag()
    done = imported(path, tmp_path / 'out', storage)
    before, after = stored(path), stored(tmp_path / 'out')
    assert before.pop('/chatter')
    assert after == before
    assert done.notes == [f'{path}: not taken over: /chatter (3)']
    assert str(done.entries[0]) == (
        '/chip/imu/data: 300 samples, 2.99 s at 100.0 Hz; nothing left out; '
        'kept: receive times, frame_id, covariances, orientation'
    )


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_metadata_agrees_with_what_is_stored(bag, tmp_path, storage):
    path, output = bag(custom={'simulated_by': 'somebody'}), tmp_path / 'out'
    imported(path, output, storage)
    document = yaml.safe_load((output / 'metadata.yaml').read_text())
    information = document['rosbag2_bagfile_information']
    announced = {
        entry['topic_metadata']['name']: entry['message_count']
        for entry in information['topics_with_message_count']
    }
    assert announced == {name: len(messages) for name, messages in stored(output).items()}
    assert information['message_count'] == sum(announced.values()) == N + 2 * N // 10
    # who simulated it stays known
    assert information['custom_data']['simulated_by'] == 'somebody'
    assert information['custom_data']['imported_from'] == 'bag'


def test_mcap_by_its_own_reader(bag, tmp_path):
    imported(bag(storage='sqlite3'), tmp_path / 'out')
    with (tmp_path / 'out' / 'out_0.mcap').open('rb') as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        counts = Counter(channel.topic for _, channel, _ in reader.iter_messages())
    assert summary.statistics.message_count == counts.total() == N + 2 * N // 10
    assert counts[IMU] == N
    assert {schema.encoding for schema in summary.schemas.values()} == {'ros2msg'}


@pytest.mark.slow
def test_ros_1_becomes_ros_2(tmp_path):
    acceleration, _ = numbers()
    store, path = get_typestore(Stores.ROS1_NOETIC), tmp_path / 'old.bag'
    types, blobs = store.types, imu_blobs()
    with Ros1Writer(path) as writer:
        imu = writer.add_connection('/imu', 'sensor_msgs/msg/Imu', typestore=store)
        warm = writer.add_connection(
            '/temperature', 'sensor_msgs/msg/Temperature', typestore=store
        )
        for k, stamp in enumerate(STAMPS.tolist()):
            writer.write(imu, stamp + 7, old(blobs[k]))
            time = types['builtin_interfaces/msg/Time'](*divmod(stamp, 10**9))
            header = types['std_msgs/msg/Header'](k, time, 'base')
            warmth = types['sensor_msgs/msg/Temperature'](header, 20.0 + k, 0.25)
            blob = store.serialize_ros1(warmth, 'sensor_msgs/msg/Temperature')
            writer.write(warm, stamp + 7, blob)
    imported(path, tmp_path / 'out')
    jazzy = get_typestore(Stores.ROS2_JAZZY)
    found = stored(tmp_path / 'out')
    assert [received for received, _ in found['/imu']] == (STAMPS + 7).tolist()
    for k, (_, blob) in enumerate(found['/imu']):
        message = jazzy.deserialize_cdr(blob, 'sensor_msgs/msg/Imu')
        assert message.linear_acceleration.z == acceleration[k, 2]
        assert tuple(message.angular_velocity_covariance) == SPREAD
        assert message.orientation.w == TURNS[k, 3]
        assert message.header.frame_id == 'chip_link'
        assert message.header.stamp.nanosec == STAMPS[k] % 10**9
    last = jazzy.deserialize_cdr(found['/temperature'][-1][1], 'sensor_msgs/msg/Temperature')
    assert (last.temperature, last.variance) == (20.0 + N - 1, 0.25)


def test_a_covariance_that_changes_is_said_and_unknown(bag, tmp_path):
    blobs = imu_blobs()
    blobs[7] = imu_blobs(orientation_covariance=covariance.diagonal(9.0))[7]
    done = imported(bag(blobs), tmp_path / 'out')
    assert str(done.entries[0]).endswith(
        'not kept: covariance of orientation, which changes: now 0'
    )
    _, blob = stored(tmp_path / 'out')[IMU][0]
    values = cdr.decode_stamped([blob], cdr.IMU).values[0]
    assert tuple(values[cdr.IMU_ORIENTATION_COVARIANCE]) == covariance.UNKNOWN
    assert tuple(values[cdr.IMU_ANGULAR_VELOCITY_COVARIANCE]) == SPREAD
    assert values[cdr.IMU_ORIENTATION].tolist() == TURNS[0].tolist()


def test_what_is_not_measured_is_declared_so(tmp_path):
    log = tmp_path / '2 axes.csv'
    lines = [f'{k * 0.01:.2f},{k}.5,9.8' for k in range(20)]
    log.write_text('stamp_s,linear_acceleration.x,linear_acceleration.z\n' + '\n'.join(lines))
    done = imported(log, tmp_path / 'out')
    assert (
        'linear_acceleration.y not measured: NaN; angular_velocity not measured: covariance -1'
    ) in str(done.entries[0])
    assert 'stamps are those of a clock of its own, not dates' in str(done.entries[0])
    [(topic, messages)] = stored(tmp_path / 'out').items()
    assert topic == '/imu_2_axes/imu/data_raw'
    values = cdr.decode_stamped([blob for _, blob in messages], cdr.IMU).values
    assert np.isnan(values[:, cdr.IMU_LINEAR_ACCELERATION.start + 1]).all()
    assert (values[:, cdr.IMU_ANGULAR_VELOCITY_COVARIANCE.start] == -1.0).all()
    assert (values[:, cdr.IMU_ORIENTATION_COVARIANCE.start] == -1.0).all()
    assert not values[:, cdr.IMU_ANGULAR_VELOCITY].any()


def test_what_a_table_has_besides_becomes_topics(tmp_path):
    log = tmp_path / 'log.csv'
    head = 'stamp_s,angular_velocity.x,magnetic_field.x,magnetic_field.y,magnetic_field.z'
    lines = [f'17.{k:02d},0.{k},1e-5,2e-5,3e-5,{20 + k}' for k in range(20)]
    log.write_text(f'{head},temperature_degC\n' + '\n'.join(lines))
    done = imported(log, tmp_path / 'out')
    assert str(done.entries[0]).endswith('with /log/imu/mag, /log/temperature')
    found = stored(tmp_path / 'out')
    assert {topic: len(messages) for topic, messages in found.items()} == {
        '/log/imu/data_raw': 20, '/log/imu/mag': 20, '/log/temperature': 20
    }  # fmt: skip
    field = cdr.decode_stamped([found['/log/imu/mag'][3][1]], cdr.MAGNETIC_FIELD)
    assert field.values[0, :3].tolist() == [1e-5, 2e-5, 3e-5]
    assert field.frame_ids == ('log_link',)


def test_a_damaged_bag_becomes_a_whole_one(bag, tmp_path):
    path = bag()
    file = path / 'bag_0.mcap'
    whole = file.read_bytes()
    (path / 'metadata.yaml').unlink()
    # a recorder that was killed: no summary, and values that never were
    file.write_bytes(whole[: whole.rindex(b'rosbag2') - 40])
    imported(path, tmp_path / 'out')
    with open_source(tmp_path / 'out') as source:
        [found] = load_all(source, source.select())
        assert source.problems == []
    np.testing.assert_array_equal(found.samples.stamps, STAMPS)


def test_gaps_remain_and_what_is_no_number_is_counted(bag, tmp_path):
    blobs, at = imu_blobs(), cdr.IMU_LINEAR_ACCELERATION
    acceleration, rates = numbers()
    acceleration[[5, 9]] = np.nan
    template = ImuTemplate('x', acceleration_covariance=SPREAD,
                           angular_velocity_covariance=SPREAD)  # fmt: skip
    late = STAMPS + 3_000_000_000 * (np.arange(N) > 100)
    blobs = template.encode_imu(late, acceleration, rates)
    done = imported(bag(blobs), tmp_path / 'out')
    assert 'left out: 2 samples with values that are no numbers' in str(done.entries[0])
    messages = [blob for _, blob in stored(tmp_path / 'out')[IMU]]
    found = cdr.decode_stamped(messages, cdr.IMU)
    good = np.isfinite(acceleration[:, 0])
    assert found.stamps.tolist() == late[good].tolist()
    np.testing.assert_array_equal(found.values[:, at], acceleration[good])


def test_stamps_of_arrival_stay_those_of_the_samples(bag, tmp_path):
    blobs = imu_blobs(np.zeros(N, np.int64))
    done = imported(bag(blobs), tmp_path / 'out')
    assert f'{IMU}: stamps are the receive time: every header stamp is zero' in done.notes
    messages = [blob for _, blob in stored(tmp_path / 'out')[IMU]]
    assert cdr.decode_stamped(messages, cdr.IMU).stamps.tolist() == (STAMPS + 500_000).tolist()


def test_topics_of_one_name_get_that_of_their_bag(bag, tmp_path):
    paths = [bag(name='monday'), bag(name='friday')]
    import_recordings(paths, ReadOptions(), tmp_path / 'out', 'sqlite3')
    found = stored(tmp_path / 'out')
    names = [IMU, MAG, TEMPERATURE]
    assert set(found) == {*names, *(f'/friday{name}' for name in names)}


def test_a_log_beside_the_bag_that_was_made_of_it(tmp_path):
    log = tmp_path / 'chip.npz'
    np.savez(log, stamp=STAMPS * 1e-9, ax=np.ones(N))
    options = ReadOptions(units='stamp=s,linear_acceleration=m/s^2')
    import_recordings([log], options, tmp_path / 'a', 'mcap')
    for order in ([log, tmp_path / 'a'], [tmp_path / 'a', log]):
        out = tmp_path / f'out_{order[0].name}'
        import_recordings(order, options, out, 'mcap')
        assert [len(messages) for messages in stored(out).values()] == [N, N]


def test_one_topic_takes_along_what_belongs_to_it(bag, tmp_path):
    imported(bag(), tmp_path / 'out', topics=(IMU,))
    assert set(stored(tmp_path / 'out')) == {IMU, MAG, TEMPERATURE}


def test_columns_have_what_belongs_to_them_beside(bag, tmp_path):
    path = bag()
    imported(path, tmp_path / 'out', 'npy')
    folder = tmp_path / 'out' / 'chip_imu_data'
    assert np.load(folder / 'stamps.npy').tolist() == STAMPS.tolist()
    np.testing.assert_array_equal(np.load(folder / 'acceleration.npy'), numbers()[0])
    np.testing.assert_array_equal(np.load(folder / 'magnetic_field.npy'), numbers(2)[1][::10])
    assert np.load(folder / 'temperature_stamps.npy').tolist() == STAMPS[::10].tolist()
    np.testing.assert_array_equal(np.load(folder / 'orientation.npy'), TURNS)


@pytest.mark.parametrize('form', ['csv', 'npy'])
def test_a_topic_longer_than_a_file_name(tmp_path, form):
    path = tmp_path / 'bag'
    with BagWriter(path, 'mcap') as writer:
        for last in 'ab':
            topic = f'/{"long" * 63}/{last}'
            writer.add_topic(describe(topic, 'sensor_msgs/msg/Imu'))
            for stamp, blob in zip(STAMPS.tolist(), imu_blobs(), strict=True):
                writer.write(topic, stamp, blob)
    done = imported(path, tmp_path / 'out', form)
    assert [entry.samples for entry in done.entries] == [N, N]
    assert len(list((tmp_path / 'out').iterdir())) == 2


def test_a_csv_says_what_it_has_no_place_for(bag, tmp_path):
    path = bag()
    done = imported(path, tmp_path / 'a.csv', 'csv')
    assert 'CSV has no place for receive times, frame_id and covariances' in str(done.entries[0])
    assert [note for note in done.notes if MAG in note and 'not in a CSV' in note]
    header, first = (tmp_path / 'a.csv').read_text().splitlines()[:2]
    assert header.startswith('stamp_s,linear_acceleration.x,linear_acceleration.y')
    assert header.endswith('orientation.x,orientation.y,orientation.z,orientation.w')
    assert first.startswith('1700000000.000000000,')
    assert first.endswith(',0.0,0.0,0.6,0.8')


@pytest.mark.slow
def test_damaged_stamps_of_a_bag_are_left_out_and_counted(tmp_path):
    store, path = get_typestore(Stores.ROS1_NOETIC), tmp_path / 'old.bag'
    with Ros1Writer(path) as writer:
        imu = writer.add_connection('/imu', 'sensor_msgs/msg/Imu', typestore=store)
        for k, blob in enumerate(old(blob) for blob in imu_blobs()):
            # unsigned seconds in ROS 1, after the number: beyond 2038 in one message
            seconds = b'\xf0\xff\xff\xff' if k == 50 else blob[4:8]
            writer.write(imu, int(STAMPS[k]), blob[:4] + seconds + blob[8:])
    done = imported(path, tmp_path / 'out')
    assert 'left out: 1 sample with stamps that a message cannot hold' in str(done.entries[0])
    assert len(stored(tmp_path / 'out')['/imu']) == N - 1


def test_the_same_stamps_are_chosen_without_what_was_left_out(bag, tmp_path):
    """Times of arrival that were no time axis may be one once samples with NaN are gone."""
    acceleration, rates = numbers()
    bad = np.arange(N) % 5 > 1
    acceleration[bad] = np.nan
    back = STAMPS.copy()
    back[::20] -= 500_000_000
    template = ImuTemplate('x', acceleration_covariance=SPREAD,
                           angular_velocity_covariance=SPREAD)  # fmt: skip
    blobs = template.encode_imu(back, acceleration, rates)
    path = tmp_path / 'bag'
    with BagWriter(path) as writer:
        writer.add_topic(describe(IMU, 'sensor_msgs/msg/Imu'))
        arrived = np.maximum.accumulate(np.where(bad, 0, STAMPS))
        for stamp, blob in zip(arrived.tolist(), blobs, strict=True):
            writer.write(IMU, stamp, blob)
    found = []
    imported(path, tmp_path / 'out')
    for place in (path, tmp_path / 'out'):
        with open_source(place) as source:
            [recording] = load_all(source, source.select())
        assert recording.stamp_source == 'header'
        found.append(recording.samples.stamps.tolist())
    assert found[0] == found[1] == back[~bad].tolist()


def test_topics_lie_side_by_side_as_they_arrived(bag, tmp_path):
    imported(bag(), tmp_path / 'out', 'sqlite3')
    with sqlite3.connect(tmp_path / 'out' / 'out_0.db3') as base:
        arrived = np.array(base.execute('SELECT timestamp FROM messages ORDER BY id').fetchall())
    base.close()
    late = np.maximum.accumulate(arrived[:, 0]) - arrived[:, 0]
    assert late.max() <= 200_000_000


def test_memory_does_not_grow_with_the_recording(bag, tmp_path, monkeypatch):
    """Messages are made a few at a time, and handed over before they add up."""
    sizes, waiting, write, flush = [], [0], BagWriter.write_many, BagWriter.flush
    monkeypatch.setattr(tracks, 'BLOCK', 50)
    monkeypatch.setattr(outputs, '_FLUSHED', 10_000)

    def written(writer, topic, receive_ns, rows):
        sizes.append(rows.shape[0])
        waiting.append(waiting[-1] + rows.size)
        write(writer, topic, receive_ns, rows)

    def flushed(writer, **how):
        waiting.append(0)
        flush(writer, **how)

    monkeypatch.setattr(BagWriter, 'write_many', written)
    monkeypatch.setattr(BagWriter, 'flush', flushed)
    imported(bag(), tmp_path / 'out')
    assert sum(sizes) == N + 2 * N // 10
    assert max(sizes) <= 50
    assert 10_000 <= max(waiting) < 30_000


def test_stamps_before_1970_of_a_bag_are_kept_whatever_the_times_of_arrival(tmp_path):
    early = STAMPS - START - 1_500_000_000
    path = tmp_path / 'bag'
    with BagWriter(path, 'sqlite3') as writer:
        writer.add_topic(describe(IMU, 'sensor_msgs/msg/Imu'))
        for stamp, blob in zip(early.tolist(), imu_blobs(early), strict=True):
            writer.write(IMU, stamp, blob)
    done = imported(path, tmp_path / 'out')
    assert 'nothing left out' in str(done.entries[0])
    assert 'not kept: receive times, which a bag cannot hold' in str(done.entries[0])
    messages = stored(tmp_path / 'out')[IMU]
    assert [received for received, _ in messages] == np.maximum(early, 0).tolist()
    found = cdr.decode_stamped([blob for _, blob in messages], cdr.IMU)
    assert found.stamps.tolist() == early.tolist()
