# SPDX-License-Identifier: Apache-2.0
"""`imu-bench record` before anything starts: where to, how long, is there room; bad input."""

from importlib import import_module
import os
from pathlib import Path
import shutil
import signal
import sys
from types import SimpleNamespace

from imu_bench import bench
from imu_bench.config.location import named_file
from imu_bench.errors import ConfigError, NotReady, RecordingError
from imu_bench.recording import place
from imu_bench.recording.interruption import Interruption
from imu_bench.recording.place import choose
import pytest


@pytest.fixture(scope='module')
def masts():
    return bench.load_bench(named_file('benches', 'mast_inclination'))


@pytest.fixture(scope='module')
def vehicles():
    return bench.load_bench(named_file('benches', 'vehicle_vibration'))


def options(**given):
    empty = dict.fromkeys(('bench', 'duration', 'output', 'into', 'test', 'run_name'))
    return SimpleNamespace(**{**empty, 'topic': [], **given})


# --- where to and how long -----------------------------------------------------------------


def test_a_test_gives_its_duration_and_its_plan(masts, tmp_path):
    place = choose(options(bench='mast_inclination', output=tmp_path / 'a', test='static'), masts)
    assert place.duration_s == 8 * 3600.0
    assert place.following == (
        f'imu-bench analyze {tmp_path}/a --plan static --html {tmp_path}/a/report.html'
    )


def test_what_is_next_can_be_pasted_into_a_shell(masts, tmp_path):
    place = choose(
        options(bench='mast_inclination', output=tmp_path / 'my run', test='tilt'), masts
    )
    assert f"analyze '{tmp_path}/my run' --plan inclination --set 'step=0.58139 °'" in (
        place.following
    )


def test_a_test_of_somebody_who_acts_ends_when_he_does(masts, tmp_path):
    place = choose(options(output=tmp_path / 'a', test='tilt'), masts)
    assert place.duration_s is None
    assert 'end it with Ctrl-C' in place.remark


def test_a_duration_given_wins(masts, tmp_path):
    place = choose(options(output=tmp_path / 'a', test='static', duration=3600.0), masts)
    assert place.duration_s == 3600.0
    assert place.remark == 'test static (A night at rest): 1 h of its 8 h'


def test_into_a_campaign_goes_where_the_campaign_looks(masts, tmp_path):
    given = options(bench='mast_inclination', into=tmp_path, test='static')
    place = choose(given, masts)
    assert place.bag == tmp_path / 'static/still'
    assert place.following == (
        f'imu-bench campaign mast_inclination --test static --recorded -o {tmp_path}'
    )
    place.bag.mkdir(parents=True)
    with pytest.raises(ConfigError, match='the run is recorded already; remove what'):
        choose(given, masts)


def test_runs_of_a_campaign_are_taken_one_after_the_other(vehicles, tmp_path):
    given = options(bench='vehicle_vibration', into=tmp_path, test='sine_on_random')
    folder = tmp_path / 'sine_on_random'
    names = [run.name for run in vehicles.test('sine_on_random').runs()]
    (folder / names[0]).mkdir(parents=True)
    place = choose(given, vehicles)
    assert place.bag == folder / names[1]
    assert place.remark.startswith(f'run {names[1]}, number 2 of 69; test sine_on_random (')
    assert place.following == (
        f'imu-bench record vehicle_vibration --into {tmp_path} --test sine_on_random'
    )
    given.run_name = names[7]
    assert choose(given, vehicles).bag == folder / names[7]
    for name in names[1:-1]:
        (folder / name).mkdir()
    given.run_name = None
    assert choose(given, vehicles).following.startswith('imu-bench campaign vehicle_vibration ')


@pytest.mark.parametrize(
    ('given', 'text'),
    [
        ({'into': 'c'}, '--into c: which test? Give --test; bench mast_inclination has: static, '),
        (
            {'into': Path('c'), 'test': 'static', 'run_name': 'x'},
            '--run x: test static has: still',
        ),
        ({'run_name': 'still'}, '--run still: give --into CAMPAIGN and --test, too'),
        ({'test': 'nap'}, '--test nap: bench mast_inclination has: static, tilt, tilt_fine, heat'),
        ({'topic': ['/imu']}, '--topic is for what others publish; leave the bench out, '),
    ],
)
def test_options_that_do_not_go_together(masts, given, text):
    with pytest.raises(ConfigError) as caught:
        choose(options(**given), masts)
    assert str(caught.value).startswith(text)


@pytest.mark.parametrize(
    ('arguments', 'text'),
    [
        (('--test', 'static'), '--test is about a test of a bench; name the bench'),
        (('mast_inclinatio',), "no bench 'mast_inclinatio'; did you mean 'mast_inclination'?"),
        (('mast_inclination', '-o', '.'), '.: exists already; name another folder with -o'),
    ],
)
def test_bad_input_is_one_line(imu_bench, arguments, text):
    code, _, err = imu_bench('record', *arguments)
    assert (code, err) == (1, f'imu-bench: error: {text}\n')


def test_a_bench_without_sensors_is_one_line(imu_bench, tmp_path):
    path = tmp_path / 'empty.yaml'
    path.write_text('name: empty\nsensors: []\n', encoding='utf-8')
    code, _, err = imu_bench('record', path, '-o', tmp_path / 'a')
    assert code == 1
    assert err.count('\n') == 1
    assert "sensors: missing; give a list of entries like '- file: x.yaml'" in err


def test_without_ros_it_says_how_to_get_it(imu_bench, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'rclpy', None)
    # sensors are recorded without it: test/recording/test_direct.py
    code, out, err = imu_bench('record', '-o', tmp_path / 'a')
    assert (code, out) == (1, '')
    assert err.startswith(
        'imu-bench: error: ROS 2 is not installed for this Python. Either source'
    )
    assert not list(tmp_path.iterdir())


# --- room on the disk ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ('storage', 'per_message'), [('mcap', (20, 100)), ('sqlite3', (350, 500))]
)
def test_what_a_bench_takes_follows_from_its_sensors(masts, storage, per_message):
    messages = 200 * 2 + 503.6 * 1.02  # an inclinometer with its angles, an IMU, temperatures
    found = place.bytes_per_second(masts, storage)
    assert per_message[0] < found / messages < per_message[1]


@pytest.fixture
def disk(monkeypatch):
    """Return a function that sets how much is free on every disk."""

    def leave(free):
        monkeypatch.setattr(shutil, 'disk_usage', lambda place: SimpleNamespace(free=free))

    return leave


def test_a_disk_without_room_is_said_before_anything_starts(imu_bench, disk, tmp_path):
    disk(100_000_000)
    code, out, err = imu_bench(
        'record', 'mast_inclination', '--duration', '14h', '-o', tmp_path / 'night'
    )
    assert (code, out) == (1, '')
    assert err.startswith(f'imu-bench: error: {tmp_path}/night: 14 h of recording take about 2.')
    assert ' GB, and 100.0 MB are free there; make room, or name another disk, or record ' in err
    assert not list(tmp_path.iterdir())


def test_how_long_there_is_room_for(disk, tmp_path):
    disk(10_000_000_000)
    assert place.check(tmp_path / 'a', 1e6, None) == '10.0 GB free, room for about 2 h 45 min'
    assert place.check(tmp_path / 'a', 1e6, 3600.0).startswith('about 3.6 GB of the 10.0 GB')
    disk(20_000_000)
    with pytest.raises(RecordingError, match=r'60.0 s of recording take about 66.\d MB, and 20.0'):
        place.check(tmp_path / 'a', 1e6, None)


def test_what_is_said_to_fit_does(disk, tmp_path):
    disk(1_000_000_000)
    with pytest.raises(RecordingError) as caught:
        place.check(tmp_path / 'a', 1e6, 5000.0)
    most = float(str(caught.value).rpartition('or record ')[2].split()[0])
    assert most > 900.0
    assert place.check(tmp_path / 'a', 1e6, most - 1.0)


# --- signals -------------------------------------------------------------------------------


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_is_a_wish_and_the_first_counts(number):
    before = signal.getsignal(number)
    with Interruption() as stop:
        assert stop.asked == ''
        os.kill(os.getpid(), number)
        os.kill(os.getpid(), signal.SIGTERM)
        assert stop.asked == signal.Signals(number).name
    assert signal.getsignal(number) is before


def test_nohup_is_respected_and_a_job_in_the_background_can_be_interrupted():
    before = {number: signal.getsignal(number) for number in (signal.SIGHUP, signal.SIGINT)}
    try:
        for number in before:
            signal.signal(number, signal.SIG_IGN)
        with Interruption() as stop:
            os.kill(os.getpid(), signal.SIGHUP)
            assert stop.asked == ''
            os.kill(os.getpid(), signal.SIGINT)
            assert stop.asked == 'SIGINT'
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def test_ros_that_is_missing_is_an_error_of_the_bench(monkeypatch):
    spinning = import_module('imu_bench.nodes.spinning')
    monkeypatch.setitem(sys.modules, 'rclpy', None)
    with pytest.raises(NotReady, match='ROS 2 is not installed'):
        spinning.require_ros()
