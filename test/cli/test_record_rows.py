# SPDX-License-Identifier: Apache-2.0
"""What a recording says of its sensors and topics, and what ends it, without any process."""

from types import SimpleNamespace

import pytest

pytestmark = pytest.mark.ros

TOPIC = '/bench/tilt/imu/data_raw'


@pytest.fixture
def now(monkeypatch):
    """Return the monotonic clock, which stands still until a test sets it."""
    clock = SimpleNamespace(s=1000.0)
    monkeypatch.setattr('time.monotonic', lambda: clock.s)
    return clock


@pytest.fixture
def recorder():
    from imu_bench.nodes.bench_monitor import RecorderView

    return RecorderView('/bag', values={f'stored.{TOPIC}': '200'}, heard_s=1000.0)


class Sensor:
    """A sensor of 200 Hz as its node would speak of it."""

    def __init__(self, recorder, clock):
        from imu_bench.cli.record_rows import SensorRow
        from imu_bench.nodes.bench_monitor import SensorView

        self.clock, self.view = clock, SensorView('tilt', level=0)
        self.row = SensorRow(self.view, recorder, TOPIC)
        self.say(200)
        self.row.begin()

    def say(self, samples, lost=0, **values):
        """Say at this moment how many samples there were."""
        own = {'nominal_hz': '200', 'delivered_hz': '200.0', 'rate_hz': '200.02'}
        counts = {'samples': samples, 'lost': lost, 'published.imu/data_raw': samples}
        self.view.values = {
            name: str(value) for name, value in {**own, **counts, **values}.items()
        }
        self.view.heard_s = self.clock.s


@pytest.fixture
def played(sensor):
    """Return the sensor as one that plays a recording."""
    sensor.row.plays = True
    return sensor


@pytest.fixture
def sensor(recorder, now):
    return Sensor(recorder, now)


def test_a_sensor_that_kept_its_rate(sensor, now):
    now.s += 3600.0
    sensor.say(720_200)
    line, fault = sensor.row.verdict(720_180, now.s)
    assert line.replace('\u202f', ' ') == (
        'tilt: 720 180 messages, kept its rate (200.0 of 200 Hz), nothing lost'
    )
    assert fault == ''


def test_what_was_lost_before_it_began_does_not_show_in_a_rate_that_was_kept(sensor, now):
    now.s += 4.0
    sensor.say(1000, lost=80, delivered_hz='180.0')  # of the last ten seconds
    line, fault = sensor.row.verdict(1000, now.s)
    assert line.endswith('kept its rate (200.0 of 200 Hz), 80 lost')
    assert fault == ''


def test_a_few_lost_samples_are_said_and_no_fault(sensor, now):
    now.s += 3600.0
    sensor.say(720_150, lost=50)
    line, fault = sensor.row.verdict(720_150, now.s)
    assert line.endswith('kept its rate (200.0 of 200 Hz), 50 lost')
    assert fault == ''


def test_an_hour_without_data_is_a_fault_although_the_end_is_well(sensor, now):
    now.s += 14 * 3600.0
    sensor.say(200 * 13 * 3600, lost=200 * 3600)
    line, fault = sensor.row.verdict(200 * 13 * 3600, now.s)
    assert 'did NOT keep its rate (185.7 of 200 Hz), 720\u202f000 lost' in line
    assert fault == 'tilt did not keep its rate'


def test_what_the_recorder_missed_is_said(sensor, now):
    now.s += 3600.0
    sensor.say(720_200)
    line, fault = sensor.row.verdict(719_000, now.s)
    assert line.endswith('nothing lost, 1\u202f200 more did not reach the recorder')
    assert fault == ''
    assert sensor.row.verdict(700_000, now.s).fault == 'tilt did not keep its rate'


def test_before_the_recorder_finds_a_sensor_nothing_is_missed(sensor, now):
    now.s += 3600.0
    sensor.say(720_200)
    assert 'recorder' not in sensor.row.verdict(720_050, now.s).line


def test_a_node_that_has_ended(sensor, now):
    now.s += 3600.0
    sensor.say(720_200)
    now.s += 3600.0
    sensor.row.died = 'ended after 1 h (exit code -9)'
    line, fault = sensor.row.verdict(720_150, now.s)
    assert 'did NOT keep its rate (100.0 of 200 Hz), 0 lost; ended after 1 h (exit' in line
    assert fault == 'tilt ended after 1 h (exit code -9)'
    assert sensor.row.shown()[0] == 'ENDED'


def test_a_node_that_says_nothing_any_more(sensor, now):
    now.s += 10.0
    assert sensor.row.shown()[0] == 'silent 10 s'
    assert sensor.row.verdict(200, now.s).fault == 'tilt had said nothing for 10.0 s'


def test_a_sensor_that_is_gone_in_the_end(sensor, now):
    now.s += 3600.0
    sensor.say(720_200)
    sensor.view.level, sensor.view.message = 2, 'recovering: NoAnswer: nothing answers'
    assert sensor.row.verdict(720_200, now.s).fault == (
        'tilt gave nothing in the end: recovering: NoAnswer: nothing answers'
    )


def test_a_bag_that_was_not_finished_has_a_last_count(sensor, now):
    now.s += 60.0
    sensor.say(12_200)
    line, fault = sensor.row.verdict(None, now.s)
    assert line.startswith('tilt: 200 messages at the last count, kept its rate')
    assert fault == ''


class Topic:
    """A topic that somebody publishes at 100 Hz, as the recorder counts it."""

    def __init__(self, recorder, clock):
        from imu_bench.cli.record_rows import TopicRow

        self.recorder, self.clock = recorder, clock
        self.row = TopicRow(recorder, TOPIC)
        self.row.hear()
        self.row.begin()

    def go_on(self, seconds, rate):
        """Store messages for a while."""
        for _ in range(seconds):
            self.clock.s += 1.0
            stored = self.recorder.stored(TOPIC) + rate
            self.recorder.values[f'stored.{TOPIC}'] = str(stored)
            self.recorder.heard_s = self.clock.s
            self.row.hear()


@pytest.fixture
def topic(recorder, now):
    return Topic(recorder, now)


def test_a_topic_that_came_evenly(topic, now):
    topic.go_on(60, 100)
    assert topic.row.cells() == ('100.0', '100.0', '')
    line, fault = topic.row.verdict(6200, now.s)
    assert line == f'{TOPIC}: 6\u202f200 messages, kept its rate (100.0 Hz, typically 100.0)'
    assert fault == ''


def test_a_topic_with_a_hole(topic, now):
    topic.go_on(60, 100)
    topic.go_on(4, 0)
    topic.go_on(60, 100)
    line, fault = topic.row.verdict(12_200, now.s)
    assert line.endswith('did NOT keep its rate (96.8 Hz, typically 100.0)')
    assert fault == f'{TOPIC}: did not keep its rate'


def test_a_topic_that_ended(topic, now):
    topic.go_on(20, 100)
    topic.go_on(40, 0)
    assert topic.row.verdict(2200, now.s).fault == f'{TOPIC}: nothing came in the last 40.0 s'


# --- what ends a recording -----------------------------------------------------------------


class Running:
    """A recording of one sensor whose processes a test lets end."""

    def __init__(self, sensor, recorder, folder, duration_s, begun=True):
        from imu_bench.cli.record_place import Place
        from imu_bench.cli.record_showing import RecordShowing

        self.codes = {}
        self.stop = SimpleNamespace(asked='')
        processes = SimpleNamespace(
            ended=lambda: self.codes, last_words=lambda name: 'oh', log=lambda name: 'x.log'
        )
        place = Place(folder, duration_s, '')
        self.showing = RecordShowing(
            [sensor.row], processes, recorder, place, self.stop, lambda: None
        )
        if begun:
            self.showing.begin()


@pytest.fixture
def running(sensor, recorder, tmp_path):
    return Running(sensor, recorder, tmp_path, 3600.0)


def test_it_ends_when_the_time_is_over(running, now):
    assert list(running.showing.look()) == []
    assert not running.showing.over(3599.9)
    assert running.showing.over(3600.0)


def test_it_ends_when_somebody_wishes_it(running):
    running.stop.asked = 'SIGTERM'
    assert running.showing.over(1.0)
    assert running.showing.failure == ''


def test_a_disk_that_runs_full_ends_it_in_time(running, now, tmp_path, monkeypatch):
    (tmp_path / 'bag_0.mcap').write_bytes(bytes(10_000_000))
    free = 40_000_000
    monkeypatch.setattr('imu_bench.cli.record_room.free_bytes', lambda bag: free)
    now.s += 20.0  # half a megabyte a second
    assert list(running.showing.look()) == [
        '0:00:20 WARNING: tilt: nothing heard for 5 s',
        '0:00:20 WARNING: the disk will be full in about 79.2 s',
    ]
    assert list(running.showing.look()) == []
    assert not running.showing.over(20.0)
    free = 3_000_000  # less than a megabyte, a hundredth of the bag and five seconds take
    assert list(running.showing.look()) == []
    assert running.showing.over(20.0)
    assert running.showing.failure == 'the disk is full: 3.0 MB are free'


def test_the_last_node_that_dies_ends_it(running, now):
    now.s += 3.0
    running.codes['tilt'] = -9
    assert list(running.showing.look()) == [
        '0:00:03 WARNING: tilt ended with exit code -9: oh (its log: x.log)'
    ]
    assert running.showing.over(3.0)
    assert running.showing.failure == 'no sensor is left'


def test_a_node_that_somebody_stopped_did_not_keep_its_rate(running, sensor, now):
    now.s += 3.0
    sensor.say(800)
    running.codes['tilt'] = 0
    assert list(running.showing.look()) == [
        '0:00:03 WARNING: tilt ended with exit code 0: oh (its log: x.log)'
    ]
    assert running.showing.failure == 'no sensor is left'
    assert sensor.row.shown()[0] == 'ENDED'
    fault = sensor.row.verdict(780, now.s + 60.0).fault
    assert fault == 'tilt ended after 3.00 s (exit code 0)'


def test_a_recording_that_is_over_before_others_are_up_is_no_failure(
    played, recorder, tmp_path, now
):
    running = Running(played, recorder, tmp_path, 3600.0, begun=False)
    running.codes['tilt'] = 0
    assert list(running.showing.look()) == ['oh']
    assert list(running.showing.look()) == []


def test_what_plays_a_recording_ends_by_itself(running, played, now):
    sensor = played
    now.s += 3.0
    sensor.say(800)
    running.codes['tilt'] = 0
    assert list(running.showing.look()) == ['0:00:03 oh']
    assert list(running.showing.look()) == []
    assert running.showing.over(3.0)
    assert running.showing.failure == ''
    assert sensor.row.shown()[0] == 'over'
    assert sensor.row.verdict(780, now.s + 60.0).fault == ''


def test_a_recorder_that_dies_ends_it_with_its_last_words(running, recorder):
    running.codes['recorder'] = 1
    recorder.message, recorder.failed = '/bag: the disk is full; recording ended', True
    running.showing.look()
    assert running.showing.over(1.0)
    assert running.showing.failure == '/bag: the disk is full; recording ended'
