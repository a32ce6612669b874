# SPDX-License-Identifier: Apache-2.0
"""
What a bag lacks of what its sensors have published, border by border, to the message.

The bags are written, and messages taken out of them, by rosbags.
"""

from contextlib import closing
import json

from imu_bench.cli.main import main
from imu_bench.offline import health
from imu_bench.offline.analysis import results
from imu_bench.offline.health import Health
from imu_bench.offline.recordings import cache
from imu_bench.offline.recordings.delivery import Heard
from imu_bench.offline.recordings.loading import load
from imu_bench.offline.recordings.opening import open_source
from imu_bench.offline.recordings.source import ReadOptions
from msg_conversions.diagnostics import Status, statuses
import numpy as np
import pytest
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types
RATE, SECONDS = 200, 30
START = 1_700_000_000_000_000_000
SECOND = 1_000_000_000
TOPIC = '/bench/tilt/imu/data_raw'
COUNTED = 'imu/data_raw'


def imu(stamp):
    header = TYPES['std_msgs/msg/Header'](
        stamp=TYPES['builtin_interfaces/msg/Time'](sec=stamp // SECOND, nanosec=stamp % SECOND),
        frame_id='tilt_link',
    )
    vector, unknown = TYPES['geometry_msgs/msg/Vector3'], np.zeros(9)
    noise = np.random.default_rng(stamp % 2**32).normal(0.0, 0.01, 3)
    return TYPES['sensor_msgs/msg/Imu'](
        header=header,
        orientation=TYPES['geometry_msgs/msg/Quaternion'](x=0.0, y=0.0, z=0.0, w=1.0),
        orientation_covariance=np.array([-1.0, *[0.0] * 8]),
        angular_velocity=vector(x=0.0, y=0.0, z=0.0),
        angular_velocity_covariance=np.array([-1.0, *[0.0] * 8]),
        linear_acceleration=vector(x=noise[0], y=noise[1], z=9.8 + noise[2]),
        linear_acceleration_covariance=unknown,
    )


def array(stamp, *said):
    """Return an array of statuses, each as (name, hardware_id, values)."""
    pair = TYPES['diagnostic_msgs/msg/KeyValue']
    return TYPES['diagnostic_msgs/msg/DiagnosticArray'](
        header=TYPES['std_msgs/msg/Header'](
            stamp=TYPES['builtin_interfaces/msg/Time'](
                sec=stamp // SECOND, nanosec=stamp % SECOND
            ),
            frame_id='',
        ),
        status=[
            TYPES['diagnostic_msgs/msg/DiagnosticStatus'](
                level=0, name=name, message='running', hardware_id=hardware,
                values=[pair(key=key, value=str(value)) for key, value in values.items()],
            )
            for name, hardware, values in said
        ],
    )  # fmt: skip


class Recorded:
    """What a recorder has heard: (time, topic, message), in order."""

    def __init__(self):
        self.heard = []

    def sensor(self, begin_s=0, end_s=SECONDS, shift_ns=0, **more):
        """Add a sensor that says every second what it has published, and the last at its end."""
        first = round(begin_s * RATE)
        last = round(end_s * RATE)
        for number in range(first, last):
            stamp = START + number * SECOND // RATE + shift_ns
            self.heard.append((stamp, TOPIC, imu(stamp)))
            published = number + 1 - first
            if published % RATE == RATE // 3 or number == last - 1:
                values = {
                    'samples': published,
                    **{key: value(published) for key, value in more.items()},
                    f'published.{COUNTED}': published,
                    f'published_until_ns.{COUNTED}': stamp,
                }
                said = array(stamp, ('bench/tilt: acquisition', 'emulated', values))
                self.heard.append((stamp + 1, '/diagnostics', said))
        return self

    def recorder(self, bag='bag', first=0, **more):
        """Add what the recorder says in the end."""
        values = {f'first_sequence.{TOPIC}': first, f'missed.{TOPIC}': 0, **more}
        at = self.heard[-1][0] + 1
        said = array(at, ('recorder: recording', f'/home/me/{bag}', values))
        self.heard.append((at, '/diagnostics', said))
        return self

    def messages(self):
        """Return where the messages of the sensor are."""
        return [k for k, (_, topic, _) in enumerate(self.heard) if topic == TOPIC]

    def without(self, places):
        """Return the same without some of it."""
        left, gone = Recorded(), set(places)
        left.heard = [each for k, each in enumerate(self.heard) if k not in gone]
        return left

    def write(self, path, plugin=StoragePlugin.MCAP):
        """Write a bag."""
        kinds = {
            TOPIC: 'sensor_msgs/msg/Imu',
            '/diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
        }
        with Writer(path, version=9, storage_plugin=plugin) as writer:
            connections = {
                topic: writer.add_connection(topic, kind, typestore=STORE)
                for topic, kind in kinds.items()
            }
            for at, topic, message in self.heard:
                data = STORE.serialize_cdr(message, kinds[topic])
                writer.write(connections[topic], at, data)
        return path


def read(path):
    with closing(open_source(path)) as source:
        return load(source, TOPIC)


def losses(recording):
    """Return what the findings say was lost, by code."""
    found = health.check(recording).findings
    return {finding.code: finding.count for finding in found if finding.count is not None}


@pytest.fixture(scope='module')
def whole():
    return Recorded().sensor().recorder()


def test_of_a_bag_that_has_everything_there_is_nothing_to_say(whole, tmp_path):
    recording = read(whole.write(tmp_path / 'bag'))
    assert recording.delivery.published == RATE * SECONDS
    assert losses(recording) == {}


@pytest.mark.parametrize('plugin', list(StoragePlugin))
@pytest.mark.parametrize(('scattered', 'at_end'), [(1, 0), (0, 1), (37, 0), (50, 512), (900, 73)])
def test_what_was_taken_out_is_named_to_the_message(whole, tmp_path, scattered, at_end, plugin):
    messages = whole.messages()
    kept = messages[: len(messages) - at_end - 1]
    chosen = np.random.default_rng(scattered).choice(kept, scattered, replace=False)
    gone = [*chosen.tolist(), *messages[len(messages) - at_end :]]
    path = whole.without(gone).write(tmp_path / 'bag', plugin)
    with Reader(path) as reader:  # the witness has counted, too
        stored = next(c.msgcount for c in reader.connections if c.topic == TOPIC)
    assert stored == len(messages) - scattered - at_end
    recording = read(path)
    assert losses(recording) == {'lost_on_the_way': scattered + at_end}
    assert recording.delivery.at_end == at_end
    (finding,) = [f for f in health.check(recording).findings if f.code == 'lost_on_the_way']
    words = finding.text.replace('\u202f', '')
    assert words.startswith(f'{scattered + at_end} message')
    assert 'of 6000 lost on the way to the recorder' in words
    assert (f'{at_end} behind the last message that is there' in words) == bool(at_end)
    assert 'the recorder was stopped' in finding.action.lower()
    assert finding.border == 'way'
    assert finding.severity == ('severe' if scattered + at_end > 300 else 'warning')


WHOLE = '; the samples themselves are whole: 6000 of 6000 messages are here'


@pytest.mark.parametrize(
    ('gone', 'more', 'words'),
    [
        (0, {}, WHOLE),
        (3, {}, ''),
        (0, {'lost': lambda published: published // 1000}, ''),
        (0, {'dropped': lambda published: published // 1000}, ''),
    ],
    ids=['whole', 'lost on the way', 'lost in the sensor', 'not published'],
)
def test_two_recorders_are_severe_also_where_the_samples_are_whole(tmp_path, gone, more, words):
    second = {'recorders': '/recorder, /recorder', 'second_bag': '/home/ann/night'}
    bag = Recorded().sensor(**more).recorder(**second)
    recording = read(bag.without(bag.messages()[100 : 100 + gone]).write(tmp_path / 'bag'))
    (finding,) = [f for f in health.check(recording).findings if f.code == 'several_recorders']
    line = 'several record this: /recorder, /recorder, another into /home/ann/night'
    assert finding.severity == 'severe'
    assert finding.text.replace('\u202f', '') == f'{line}{words}.'


@pytest.mark.slow
def test_another_recorder_leaves_the_same_traces(tmp_path):
    bag = Recorded().sensor()  # nobody says what the recorder has heard first
    messages = bag.messages()
    gone = np.random.default_rng(3).choice(messages[RATE:-1], 41, replace=False).tolist()
    recording = read(bag.without([*gone, messages[-1]]).write(tmp_path / 'bag'))
    assert losses(recording) == {'lost_on_the_way': 42}


def test_what_was_published_before_the_recording_began_is_not_lost(tmp_path):
    bag = Recorded().sensor(lost=lambda published: 7)
    later = bag.without(range(2 * RATE + RATE // 2))
    recording = read(later.write(tmp_path / 'bag'))
    begun = RATE * SECONDS - len(later.messages())
    assert losses(recording) == {'published_before': begun}
    told = read(later.recorder('told', first=begun).write(tmp_path / 'told'))
    assert losses(told) == {}  # its recorder has said what it did not hear


@pytest.mark.slow
@pytest.mark.parametrize('known', [True, False])
def test_statuses_that_were_heard_before_the_topic_accuse_nobody(tmp_path, known):
    everything = Recorded().sensor()
    late = everything.without(everything.messages()[: 2 * RATE])  # two statuses and a half
    if known:
        late = late.recorder(first=2 * RATE)
    said = {} if known else {'published_before': 2 * RATE}
    assert losses(read(late.write(tmp_path / 'bag'))) == said
    hole = late.without(late.messages()[5 * RATE : 5 * RATE + 7])
    assert losses(read(hole.write(tmp_path / 'hole' / 'bag'))) == {**said, 'lost_on_the_way': 7}


def test_without_diagnostics_there_is_no_such_finding(whole, tmp_path):
    said = [k for k, (_, topic, _) in enumerate(whole.heard) if topic != TOPIC]
    recording = read(whole.without([*said, 500, 501]).write(tmp_path / 'bag'))
    assert recording.delivery is None
    assert losses(recording) == {}


def test_counts_that_begin_again_are_a_restart_and_every_life_counts(tmp_path):
    bag = Recorded().sensor(end_s=10).sensor(begin_s=11).recorder()
    messages = bag.messages()
    gone = [*messages[500:507], *messages[3000:3020]]
    recording = read(bag.without(gone).write(tmp_path / 'bag'))
    assert losses(recording) == {'lost_on_the_way': 27, 'restarted': 1}


def test_a_sensor_that_has_published_nothing_yet_says_nothing(tmp_path):
    nothing = {'samples': 0, f'published.{COUNTED}': 0, f'published_until_ns.{COUNTED}': 0}
    bag = Recorded()
    for begin_s, end_s in ((0, 10), (11, SECONDS)):
        said = array(START, ('tilt: acquisition', '', nothing))
        bag.heard.append((START + begin_s * SECOND, '/diagnostics', said))
        bag.sensor(begin_s, end_s)
    bag.recorder()
    recording = read(bag.without(bag.messages()[3000:3005]).write(tmp_path / 'bag'))
    assert losses(recording) == {'lost_on_the_way': 5, 'restarted': 1}


def test_a_killed_sensor_leaves_messages_that_nobody_has_counted(tmp_path):
    bag = Recorded().sensor(end_s=10)
    bag.heard.pop()  # its last words
    recording = read(bag.sensor(begin_s=11).recorder().write(tmp_path / 'bag'))
    assert losses(recording) == {'restarted': 1}


@pytest.mark.parametrize('shift_s', [-3600, 3600])
def test_a_clock_that_is_set_hides_nothing(tmp_path, shift_s):
    bag = Recorded().sensor(end_s=10)
    for number in range(10 * RATE, 20 * RATE):
        stamp = START + number * SECOND // RATE + shift_s * SECOND
        bag.heard.append((stamp, TOPIC, imu(stamp)))
        if number % RATE == RATE - 1:
            values = {
                'samples': number + 1,
                f'published.{COUNTED}': number + 1,
                f'published_until_ns.{COUNTED}': stamp,
            }
            said = array(stamp, ('tilt: acquisition', '', values))
            bag.heard.append((stamp + 1, '/diagnostics', said))
    bag.recorder()
    messages = bag.messages()
    assert losses(read(bag.write(tmp_path / 'all'))) == {}
    gone = messages[1000:1010] + messages[3500:3503]
    recording = read(bag.without(gone).write(tmp_path / 'bag'))
    assert losses(recording) == {'lost_on_the_way': 13}


def test_what_the_sensor_lost_before_it_published_has_borders_of_its_own(tmp_path):
    bag = Recorded().sensor(lost=lambda n: n // 10, dropped=lambda n: n // 100).recorder()
    recording = read(bag.write(tmp_path / 'bag'))
    assert losses(recording) == {'lost_in_sensor': 540, 'lost_before_publishing': 60}
    by_code = {finding.code: finding for finding in health.check(recording).findings}
    assert by_code['lost_in_sensor'].severity == 'severe'
    assert 'imu-bench doctor' in by_code['lost_in_sensor'].action
    assert by_code['lost_before_publishing'].severity == 'warning'
    assert 'was stopped' in by_code['lost_before_publishing'].action


def test_what_scripted_faults_took_is_told_apart(tmp_path):
    bag = Recorded().sensor(lost=lambda n: n // 10)
    said = array(START, ('tilt: faults', '', {'0.kind': 'stall', '0.lost': 400, '1.lost': 190}))
    bag.heard.append((bag.heard[-1][0], '/diagnostics', said))
    recording = read(bag.recorder().write(tmp_path / 'bag'))
    assert losses(recording) == {'lost_to_faults': 590, 'lost_in_sensor': 10}


@pytest.mark.slow
def test_the_recorder_of_another_bag_is_not_believed(whole, tmp_path):
    bag = whole.without([]).recorder(bag='other', **{f'missed.{TOPIC}': 99})
    assert losses(read(bag.write(tmp_path / 'bag'))) == {}
    alone = Recorded().sensor().recorder(bag='other', **{f'missed.{TOPIC}': 99})
    assert losses(read(alone.write(tmp_path / 'alone'))) == {}
    own = whole.without([]).recorder(**{f'missed.{TOPIC}': 99})
    path = own.write(tmp_path / 'own' / 'bag')
    assert losses(read(path)) == {'lost_on_the_way': 99}
    assert losses(read(path.rename(tmp_path / 'renamed'))) == {'lost_on_the_way': 99}


def test_columns_that_were_kept_still_know(whole, tmp_path, monkeypatch):
    path = whole.without(whole.messages()[70:90]).write(tmp_path / 'bag')
    monkeypatch.setattr(cache, 'LARGE', 0)
    for _ in range(2):
        with cache.columns(path, ReadOptions(), keep=tmp_path / 'kept') as found:
            (recording,) = found.recordings
            assert recording.delivery == read(path).delivery
            assert losses(recording) == {'lost_on_the_way': 20}


def test_results_keep_the_count_and_the_border(whole, tmp_path):
    recording = read(whole.without(whole.messages()[70:90]).write(tmp_path / 'bag'))
    found = health.check(recording)
    assert Health.from_json(json.loads(json.dumps(found.to_json()))).findings == found.findings
    (entry,) = [f for f in found.to_json()['findings'] if 'count' in f]
    assert (entry['count'], entry['border']) == (20, 'way')


# --- diagnostics from their bytes ----------------------------------------------------------


@pytest.mark.parametrize('little', [True, False])
def test_statuses_are_those_that_went_in(little):
    rng = np.random.default_rng(5)
    words = ['', 'a', 'bb', 'µg', 'three', 'delivered_hz', 'x' * 300]
    for _ in range(200):
        said = [
            (*map(str, rng.choice(words, 2)), {f'{k}{w}': w for k, w in enumerate(
                rng.choice(words, rng.integers(0, 6)).tolist())})
            for _ in range(rng.integers(0, 4))
        ]  # fmt: skip
        data = STORE.serialize_cdr(
            array(START, *said), 'diagnostic_msgs/msg/DiagnosticArray', little_endian=little
        )
        assert [tuple(status) for status in statuses(bytes(data))] == said


def test_damage_is_an_error_of_one_kind_or_other_words():
    values = {'samples': 5, 'published.imu/data_raw': 4}
    message = array(START, ('tilt: acquisition', '', values))
    data = bytes(STORE.serialize_cdr(message, 'diagnostic_msgs/msg/DiagnosticArray'))
    for end in range(len(data) - 1):
        with pytest.raises(ValueError, match='not a DiagnosticArray'):
            statuses(data[:end])
    rng = np.random.default_rng(6)
    for _ in range(2000):
        changed = bytearray(data)
        changed[rng.integers(len(data))] = rng.integers(256)
        try:
            statuses(bytes(changed))
        except ValueError as error:
            assert 'not a DiagnosticArray' in str(error)


def test_the_serial_number_that_a_chip_has_told(tmp_path):
    heard = Heard(tmp_path / 'bag')
    for part in ('SCL3300-D01, serial number 123B33', ''):  # stopped: it says nothing more
        heard._note(Status('bench/tilt: acquisition', 'hardware scl3300 spi0.0', {'part': part}))
    assert heard.serial('/bench/tilt/imu/data_raw') == '123B33'
    assert heard.serial('/bench/other/imu/data_raw') == ''


def test_the_serial_number_of_a_converter_is_not_that_of_the_sensor_at_it(tmp_path):
    heard = Heard(tmp_path / 'bag')
    part = 'Monitran MTN/1100, MCC 172, serial number 01ABCDEF, firmware 1.02'
    heard._note(Status('bench/tilt: acquisition', 'hardware mcc172', {'part': part}))
    assert heard.serial(TOPIC) == ''


@pytest.mark.slow
def test_bags_that_tell_one_serial_number_are_one_sensor(tmp_path, capsys):
    """An hour lies between the first two; the third holds the time of the second again."""
    bags = [
        str(
            Recorded()
            .sensor(0, 5, hour * 3600 * SECOND, part=lambda _: 'SCL3300, serial number 123B33')
            .write(tmp_path / f'bag{number}')
        )
        for number, hour in enumerate((0, 1, 1))
    ]
    out = tmp_path / 'out.json'

    def found(*arguments):
        assert main(['analyze', *arguments, '--json', str(out)]) == 0
        recordings = results.read(out).recordings
        return recordings, {f.code: f for one in recordings for f in one.health.findings}

    (sensor,), findings = found(*bags[:2])
    assert [run.source for run in sensor.runs] == bags[:2] and sensor.serial == '123B33'
    assert 'serial number 123B33' in findings['one_sensor'].text
    assert '--no-pool' in findings['one_sensor'].action
    apart, findings = found(*bags[:2], '--no-pool')
    assert len(apart) == 2 and 'one_sensor' not in findings
    apart, findings = found(*bags)
    assert len(apart) == 3 and 'of the same time' in findings['not_pooled'].text
