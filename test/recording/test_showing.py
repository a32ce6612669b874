# SPDX-License-Identifier: Apache-2.0
"""What is shown of a recording, what ends it, and what is started again; without any process."""

from io import StringIO
from types import SimpleNamespace

from imu_bench.errors import NotReady
from imu_bench.recording.showing import say
import pytest
from rich.console import Console

pytestmark = pytest.mark.ros


class Running:
    """A recording of one sensor whose processes a test lets end."""

    def __init__(self, sensor, recorder, folder, duration_s, begun=True):
        from imu_bench.recording.showing import Showing

        self.codes = {}
        self.stop = SimpleNamespace(asked='')
        processes = SimpleNamespace(
            ended=lambda: dict(self.codes), last_words=lambda name: 'oh', log=lambda name: 'x.log'
        )
        self.started = []
        self.showing = Showing(
            [sensor.row],
            processes,
            recorder,
            folder,
            duration_s,
            self.stop,
            hosts={'process': ['tilt']},
            start_again=self.start_again,
        )
        if begun:
            self.showing.begin()

    def start_again(self, name):
        """Take note, and let the process run."""
        self.started.append(name)
        del self.codes[name]


@pytest.fixture
def running(sensor, recorder, tmp_path):
    return Running(sensor, recorder, tmp_path, 3600.0)


def test_it_ends_when_the_time_is_over(running, now):
    assert list(running.showing.look()) == []
    assert not running.showing.over(3599.9)
    assert running.showing.over(3600.0)


def test_a_line_says_how_long_it_ran_what_is_left_and_the_rates(running, now, monkeypatch):
    monkeypatch.setattr('imu_bench.recording.place.free_bytes', lambda bag: 40_000_000)
    now.s += 20.0
    assert running.showing.line(running.showing.heading(None)).startswith('starting: tilt ')
    assert list(running.showing.look()) == ['0:00:20 WARNING: tilt: nothing heard for 5 s']
    said = running.showing.line(running.showing.heading(20.0))
    assert said.startswith('0:00:20 of 1:00:00, 0:59:40 left; 40.0 MB free: tilt ')
    assert '/200' in said


def test_it_ends_when_somebody_wishes_it(running):
    running.stop.asked = 'SIGTERM'
    assert running.showing.over(1.0)
    assert running.showing.failure == ''


def test_a_disk_that_runs_full_ends_it_in_time(running, now, tmp_path, monkeypatch):
    (tmp_path / 'bag_0.mcap').write_bytes(bytes(10_000_000))
    free = 40_000_000
    monkeypatch.setattr('imu_bench.recording.place.free_bytes', lambda bag: free)
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


def test_a_process_that_dies_is_started_again_at_once_and_that_is_said(running, now):
    for times in range(1, 6):
        now.s += 1.0
        running.codes['process'] = -9
        (line,) = running.showing.look()
        assert line == (
            f'0:00:0{times} WARNING: process ended with exit code -9: oh (its log: x.log); '
            f'started again ({times} of 5)'
        )
    assert running.started == ['process'] * 5
    assert running.showing.restarts == {'process': 5}
    assert not running.showing.over(5.0)


def test_one_that_always_dies_ends_the_recording_when_it_was_the_last(running, now):
    running.showing.restarts['process'] = 5
    now.s += 3.0
    running.codes['process'] = -9
    assert list(running.showing.look()) == [
        '0:00:03 WARNING: process ended with exit code -9: oh (its log: x.log)'
    ]
    assert list(running.showing.look()) == []
    assert running.started == []
    assert running.showing.over(3.0)
    assert running.showing.failure == 'no sensor is left'


def test_a_process_that_runs_no_sensor_is_started_again_too(running):
    running.codes['analysis'] = 1
    assert 'analysis ended with exit code 1' in next(iter(running.showing.look()))
    assert running.started == ['analysis']


def test_a_node_that_somebody_stopped_stays_so_and_did_not_keep_its_rate(running, sensor, now):
    now.s += 3.0
    sensor.say(800)
    running.codes['process'] = 0
    assert list(running.showing.look()) == [
        '0:00:03 WARNING: process ended with exit code 0: oh (its log: x.log)'
    ]
    assert running.started == []
    assert running.showing.failure == 'no sensor is left'
    assert sensor.row.shown().rate == 'ENDED'
    now.s += 60.0
    assert sensor.verdict(800).faults == ['tilt ended after 3.00 s (exit code 0)']


def test_what_ends_before_all_is_up_is_a_failure(sensor, recorder, tmp_path):
    running = Running(sensor, recorder, tmp_path, 3600.0, begun=False)
    running.codes['process'] = 1
    with pytest.raises(NotReady, match='process ended with exit code 1: oh'):
        running.showing.look()


def test_a_recording_that_is_over_before_others_are_up_is_no_failure(
    played, recorder, tmp_path, now
):
    running = Running(played, recorder, tmp_path, 3600.0, begun=False)
    running.codes['process'] = 0
    assert list(running.showing.look()) == ['oh']
    assert list(running.showing.look()) == []


def test_what_plays_a_recording_ends_by_itself(running, played, now):
    sensor = played
    now.s += 3.0
    sensor.say(800)
    running.codes['process'] = 0
    assert list(running.showing.look()) == ['0:00:03 oh']
    assert list(running.showing.look()) == []
    assert running.showing.over(3.0)
    assert running.showing.failure == ''
    assert sensor.row.shown().rate == 'over'
    now.s += 60.0
    assert sensor.verdict(800).faults == []


def test_a_recorder_that_dies_ends_it_with_its_last_words(running, recorder):
    running.codes['recorder'] = 1
    recorder.message, recorder.failed = '/bag: the disk is full; recording ended', True
    running.showing.look()
    assert running.showing.over(1.0)
    assert running.showing.failure == '/bag: the disk is full; recording ended'
    assert running.showing.recorder_ended


def test_noise_so_far_is_shown_where_there_is_an_analysis(sensor, recorder, tmp_path):
    sensor.view.noise['linear_acceleration'] = 60e-6 * 9.80665
    running = Running(sensor, recorder, tmp_path, 3600.0)
    assert running.showing.line('now') == 'now: tilt 200.0/200 Hz, lost 0'
    running.showing._noise = True
    assert running.showing.line('now') == 'now: tilt 200.0/200 Hz, lost 0, 60 µg/√Hz'


def test_what_is_played_beside_others_is_over_when_its_node_says_so(running, played, now):
    now.s += 3.0
    played.say(800, message='over after 12.9 s', state='stopped')
    assert list(running.showing.look()) == ['0:00:03 tilt: over after 12.9 s']
    assert list(running.showing.look()) == []
    assert played.row.shown().rate == 'over'
    running.codes['process'] = 0
    assert list(running.showing.look()) == []
    assert running.showing.failure == ''


def test_who_else_records_and_a_flood_are_told_once(running, recorder):
    recorder.values['recorders'] = '/recorder, /recorder'
    assert list(running.showing.look()) == ['0:00:00 several record this: /recorder, /recorder']
    recorder.values |= {'second_bag': '/night', 'left_out./diagnostics': '12'}
    assert list(running.showing.look()) == [
        '0:00:00 WARNING: several record this: /recorder, /recorder, another into /night',
        '0:00:00 WARNING: /diagnostics: flooded, 12 messages left out of the bag',
    ]
    recorder.values['left_out./diagnostics'] = '24'
    assert list(running.showing.look()) == []


EVIL = '\x1b]0;owned\x07\x1b[2J'


def test_what_others_say_steers_no_terminal(running, sensor, recorder, tmp_path):
    recorder.values |= {f'several./{EVIL}': EVIL, f'beside./{EVIL}': '0', 'recorders': EVIL}
    sensor.say(400, level=2, message=EVIL)
    output = StringIO()
    console = Console(file=output, force_terminal=True, width=200)
    for line in running.showing.look():
        say(line, console)
    console.print(running.showing.table(running.showing.heading(1.0)))
    say(running.showing.line('0:00:01'), console)
    told = output.getvalue()
    assert told.count('\\x1b]0;owned') >= 4
    assert '\x1b]' not in told
    assert '\x1b[2J' not in told
    assert '\x07' not in told
