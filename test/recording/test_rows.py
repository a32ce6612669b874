# SPDX-License-Identifier: Apache-2.0
"""The verdict on each sensor and topic, without any process."""

from imu_bench.account import CHIP, TRANSPORT
import pytest

pytestmark = pytest.mark.ros

SPACE = '/bench/tilt'
TOPIC = f'{SPACE}/imu/data_raw'


def test_a_sensor_that_kept_its_rate(sensor, now):
    now.s += 3600.0
    sensor.say(720_200)
    line, faults, _ = sensor.verdict(720_200)
    assert line.replace('\u202f', ' ') == (
        'tilt: 720 200 messages, kept its rate (200.0 of 200 Hz), nothing lost'
    )
    assert faults == []


def test_what_was_lost_before_it_began_does_not_show_in_a_rate_that_was_kept(make_sensor, now):
    sensor = make_sensor(lost=80)
    now.s += 4.0
    sensor.say(1000, lost=80, delivered_hz='180.0')  # of the last ten seconds
    line, faults, _ = sensor.verdict(1000)
    assert line.endswith('kept its rate (200.0 of 200 Hz), 80 lost in the sensor')
    assert faults == []


def test_a_few_lost_samples_are_said_and_no_fault(sensor, now):
    now.s += 3600.0
    sensor.say(720_150, lost=50)
    line, faults, _ = sensor.verdict(720_150)
    assert line.endswith('kept its rate (200.0 of 200 Hz), 50 lost in the sensor')
    assert faults == []


def test_a_sensor_that_is_faster_than_it_should_be_is_said_to_be_and_no_fault(sensor, now):
    now.s += 3600.0
    sensor.say(728_000, lost=1000, rate_hz='202.5', delivered_hz='202.2')
    line, faults, _ = sensor.verdict(728_000)
    assert 'is faster than its rate (202.2 of 200 Hz), 1\u202f000 lost in the sensor' in line
    assert faults == []


def test_what_it_loses_is_a_fault_all_the_same_when_it_is_much(sensor, now):
    now.s += 3600.0
    sensor.say(720_200, lost=30_000, rate_hz='208.3')
    line, faults, _ = sensor.verdict(720_200)
    assert 'kept its rate (200.0 of 200 Hz), 30\u202f000 lost in the sensor' in line
    assert faults == ['tilt lost 30\u202f000 in the sensor']


def test_a_sensor_that_was_not_read_for_a_while_in_the_end_has_not_lost_nothing(sensor, now):
    now.s += 60.0
    sensor.say(11_000)
    line, faults, _ = sensor.verdict(11_000)
    assert line.endswith('did NOT keep its rate (180.0 of 200 Hz), no loss counted')
    assert faults == ['tilt did not keep its rate']


def test_an_hour_without_data_is_a_fault_although_the_end_is_well(sensor, now):
    now.s += 14 * 3600.0
    sensor.say(200 * 13 * 3600, lost=200 * 3600)
    line, faults, _ = sensor.verdict(200 * 13 * 3600)
    assert 'did NOT keep its rate (185.7 of 200 Hz), 720\u202f000 lost in the sensor' in line
    assert faults == ['tilt did not keep its rate']


@pytest.mark.parametrize('missing', [1, 1200, 20_000])
def test_nothing_that_is_missing_from_the_bag_is_called_nothing_lost(sensor, now, missing):
    now.s += 3600.0
    sensor.say(720_200)
    line, faults, _ = sensor.verdict(720_200 - missing)
    lost = f'{missing:,} lost on the way to the recorder'.replace(',', '\u202f')
    assert line.endswith(f'kept its rate (200.0 of 200 Hz), {lost}')
    assert faults == [f'tilt lost {lost.replace(" lost", "", 1)}']


def test_what_was_published_before_the_recorder_heard_it_is_said_and_not_lost(
    sensor, recorder, now
):
    now.s += 3600.0
    sensor.say(720_200)
    recorder.values[f'first_sequence.{TOPIC}'] = '150'
    line, faults, _ = sensor.verdict(720_050)
    assert line.endswith('nothing lost, 150 published before the recorder heard of it')
    assert faults == []


def test_what_is_missing_from_another_topic_of_the_sensor_counts(sensor, now):
    now.s += 60.0
    sensor.say(12_200, **{'published.temperature': 60})
    bag = {TOPIC: 12_200, f'{SPACE}/temperature': 57}
    _, faults, account = sensor.row.verdict(bag, sensor.row.account(bag), now.s)
    assert faults == ['tilt lost 3 on the way to the recorder']
    assert {topic.name: topic.lost for topic in account.topics} == {
        TOPIC: 0,
        f'{SPACE}/temperature': 3,
    }


def test_losses_show_in_the_table_as_they_happen_with_their_border(sensor, recorder, now):
    assert sensor.row.cells().lost == '0'
    recorder.values[f'missed.{TOPIC}'] = '12'
    sensor.say(400, lost=5, dropped=2)
    assert sensor.row.cells().lost == '3 sensor, 2 queue, 12 way'


def test_a_sensor_that_was_started_again_has_one_account(sensor, now):
    now.s += 3600.0
    sensor.say(720_200, lost=3)
    now.s += 3600.0
    sensor.say(719_000)
    line, faults, account = sensor.verdict(720_200 + 719_000 - 7)
    assert (account.lost[CHIP], account.lost[TRANSPORT]) == (3, 7)
    assert 'kept its rate (200.0 of 200 Hz), 10 lost: 3 in the sensor, 7 on the way' in line
    assert faults == ['tilt lost 7 on the way to the recorder']


def test_a_node_that_has_ended(sensor, now):
    now.s += 3600.0
    sensor.say(720_200)
    now.s += 3600.0
    sensor.row.died = 'ended after 1 h (exit code -9)'
    line, faults, _ = sensor.verdict(720_200)
    assert (
        'did NOT keep its rate (100.0 of 200 Hz), no loss counted; ended after 1 h (exit' in line
    )
    assert faults == ['tilt ended after 1 h (exit code -9)']
    assert sensor.row.shown().rate == 'ENDED'


def test_a_node_that_says_nothing_any_more(sensor, now):
    now.s += 10.0
    assert sensor.row.shown().rate == 'silent 10 s'
    assert sensor.verdict(200).faults == ['tilt had said nothing for 10.0 s']


def test_a_sensor_that_is_gone_in_the_end(sensor, now):
    now.s += 3600.0
    sensor.say(720_200, level=2, message='recovering: NoAnswer: nothing answers')
    assert sensor.verdict(720_200).faults == [
        'tilt gave nothing in the end: recovering: NoAnswer: nothing answers'
    ]


def test_a_bag_that_was_not_finished_has_a_last_count(sensor, now):
    now.s += 60.0
    sensor.say(12_200)
    line, faults, _ = sensor.verdict(None)
    assert line.startswith('tilt: 200 messages at the last count, kept its rate')
    assert faults == []


# --- scripted faults -----------------------------------------------------------------------


def with_faults(sensor, *lost, states=None, total=None, **values):
    """Let the sensor say that each fault has cost so many samples."""
    states = states or ['recovered'] * len(lost)
    for number, (state, cost) in enumerate(zip(states, lost, strict=True)):
        sensor.view.hear_of_faults({f'{number}.state': state, f'{number}.lost': str(cost)})
    total = sum(lost) if total is None else total
    sensor.say(17_000, lost=total, **{'delivered_hz': '200.0', **values})
    return sensor.verdict(17_000)


def test_what_faults_took_is_no_broken_rate(sensor):
    line, faults, _ = with_faults(sensor, 430, 915)
    assert line.replace('\u202f', '').endswith(
        'keeps its rate since its last fault (200.0 of 200 Hz), '
        '1345 samples lost to the scripted faults, none otherwise'
    )
    assert faults == []


def test_what_was_lost_beside_the_faults_is_said(sensor):
    line, _, _ = with_faults(sensor, 915, total=1345)
    assert line.endswith('915 samples lost to the scripted faults, 430 lost in the sensor')


def test_a_rate_that_has_the_last_fault_in_it_is_no_verdict_yet(sensor, now):
    # what counts is when the rate was told, not when the verdict is asked for
    now.s += 10.0
    line, faults, _ = with_faults(sensor, 345, delivered_hz='157.1')
    assert 'its rate of the last 10 s has its last fault in it (157.1 of 200 Hz)' in line
    assert faults == []
    now.s += 11.5
    line, faults, _ = with_faults(sensor, 345, delivered_hz='157.1')
    assert 'does NOT keep its rate since its last fault (157.1 of 200 Hz)' in line
    assert faults == ['tilt did not keep its rate']


def test_a_fault_that_goes_on_is_said_and_one_to_come_is_none(sensor):
    line, faults, _ = with_faults(sensor, 430, 915, states=['recovered', 'over'])
    assert 'has NOT recovered (200.0 of 200 Hz)' in line
    assert faults == ['tilt has not recovered']


def test_a_fault_that_has_not_begun_is_no_news(sensor, now):
    now.s += 84.0
    line, _, _ = with_faults(sensor, 0, states=['planned'])
    assert 'kept its rate (200.0 of 200 Hz), nothing lost' in line


class Topic:
    """A topic that somebody publishes at 100 Hz, as the recorder counts it."""

    def __init__(self, recorder, clock):
        from imu_bench.recording.rows import TopicRow

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


def judged(topic, stored):
    """Judge a bag with so many messages of the topic."""
    bag = {TOPIC: stored}
    return topic.row.verdict(bag, topic.row.account(bag), topic.clock.s)


def test_a_topic_that_came_evenly(topic):
    topic.go_on(60, 100)
    assert topic.row.cells()[:3] == ('100.0', '100.0', '')  # nobody says what was missed
    line, faults, _ = judged(topic, 6200)
    assert line == f'{TOPIC}: 6\u202f200 messages, kept its rate (100.0 Hz, typically 100.0)'
    assert faults == []


def test_what_was_missed_of_a_topic_of_others(topic, recorder):
    recorder.values[f'missed.{TOPIC}'] = '0'
    topic.go_on(60, 100)
    assert topic.row.cells().lost == '0'
    recorder.values[f'missed.{TOPIC}'] = '7'
    assert topic.row.cells().lost == '7 way'
    line, faults, _ = judged(topic, 6200)
    assert line.endswith('typically 100.0), 7 lost on the way to the recorder')
    assert faults == [f'{TOPIC}: lost 7 on the way to the recorder']


def test_a_topic_with_a_hole(topic):
    topic.go_on(60, 100)
    topic.go_on(4, 0)
    topic.go_on(60, 100)
    line, faults, _ = judged(topic, 12_200)
    assert line.endswith('did NOT keep its rate (96.8 Hz, typically 100.0)')
    assert faults == [f'{TOPIC}: did not keep its rate']


def test_a_topic_that_ended(topic):
    topic.go_on(20, 100)
    topic.go_on(40, 0)
    assert judged(topic, 2200).faults == [f'{TOPIC}: nothing came in the last 40.0 s']


def test_the_rate_is_that_of_the_stamps_where_the_sensor_says_them(make_sensor, now):
    until = 'published_until_ns.imu/data_raw'
    sensor = make_sensor(**{until: 7_000_000_000})
    now.s += 60.0
    # its last word comes once more, long after it was stopped
    sensor.say(10_200, **{until: 57_000_000_000})
    now.s += 20.0
    sensor.say(10_200, state='stopped', **{until: 57_000_000_000})
    line, faults, _ = sensor.verdict(10_200)
    assert 'kept its rate (200.0 of 200 Hz)' in line
    assert not faults
    sensor = make_sensor(**{until: 7_000_000_000})
    sensor.say(9_000, **{until: 57_000_000_000})
    assert 'did NOT keep its rate (176.0 of 200 Hz)' in sensor.verdict(9_000).line
