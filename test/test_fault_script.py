# SPDX-License-Identifier: Apache-2.0
"""Faults as they are written in a file, what is kept of each, and how it is told."""

import json
from pathlib import Path
import re
from types import SimpleNamespace

from imu_bench import bench
from imu_bench.acquisition import FaultWatch
from imu_bench.config import sensor_from_parameters
from imu_bench.config.faults import Fault, KINDS, ONCE, ONLY_ON, parse_fault, script
from imu_bench.drivers import load
from imu_bench.emulators.faults import possible
from imu_bench.errors import ConfigError
from imu_bench.recording.fault_news import FaultNews
from imu_bench.simulation.clock import SimulatedClock
from imu_bench.terminal.tables import show_faults
import pytest

ROOT = Path(__file__).resolve().parent.parent
SECOND = 1_000_000_000


def sensor(*faults, **settings):
    given = {'driver': 'mpu9250', 'backend': 'emulated', **settings}
    if faults:
        given['simulation'] = {'faults': list(faults)}
    return sensor_from_parameters('mine', given, settings_of=bench.settings_of)


# --- the script --------------------------------------------------------------------------
def test_a_script_is_in_the_order_of_time():
    planned = script(['brown_out 20', 'unplugged 1.5 2e0'])
    assert planned == (Fault('unplugged', 1.5, 2.0), Fault('brown_out', 20.0))
    assert [fault.over_s for fault in planned] == [3.5, 20.0]


@pytest.mark.parametrize(
    ('text', 'says'),
    [
        ('', f'allowed: {", ".join(KINDS)}'),
        ('gremlin 1 2', f"no fault 'gremlin'; allowed: {', '.join(KINDS)}"),
        ('unplugd 1 2', "did you mean 'unplugged'\\?"),
        ('unplugged', 'needs a start and a duration; write .*unplugged 10 2'),
        ('unplugged 1', 'needs a start and a duration'),
        ('unplugged 1 2 3', 'needs a start and a duration'),
        ('unplugged one 2', 'are numbers'),
        ('unplugged -1 2', 'starts before 0 s'),
        ('unplugged 1 0', 'lasts no finite time'),
        ('stall 1 inf', 'lasts no finite time'),
        ('unplugged nan 2', 'starts before 0 s'),
    ],
)
def test_what_is_no_fault_is_refused_in_one_line(text, says):
    with pytest.raises(ConfigError, match=says) as caught:
        sensor(text)
    assert str(caught.value).startswith('ros__parameters.simulation.faults: ')
    assert '\n' not in str(caught.value)


def test_a_text_that_is_no_list_is_refused():
    with pytest.raises(ConfigError, match="a list of 'kind start_s duration_s'"):
        sensor_from_parameters(
            'mine',
            {'driver': 'mpu9250', 'backend': 'emulated', 'simulation.faults': 'stuck 1 2'},
            settings_of=bench.settings_of,
        )


def test_only_those_that_happen_once_need_no_duration():
    for kind in KINDS:
        if kind in ONCE:
            assert parse_fault(f'{kind} 3').over_s == 3.0
        else:
            assert parse_fault(f'{kind} 3 1').over_s == 4.0


def test_faults_that_cannot_happen_on_a_bus_are_refused():
    with pytest.raises(ConfigError, match='dropped_byte cannot happen to a mpu9250 on i2c; allo'):
        bench.faults_of(sensor('dropped_byte 1'))
    with pytest.raises(ConfigError, match='stretched cannot happen to a mpu9250 on spi'):
        bench.faults_of(sensor('stretched 1 1', bus='spi'))
    with pytest.raises(ConfigError, match='a generic source has no wire'):
        bench.build(sensor('stuck 1 1', driver='generic', rate_hz=10.0), SimulatedClock())


def test_every_kind_names_buses_that_exist():
    assert set(ONLY_ON) <= set(KINDS)
    assert set(ONCE) <= set(KINDS)
    assert 'wrong_identity' not in possible(load('mtn1100'), 'i2c')


def test_a_real_sensor_has_no_faults():
    assert bench.faults_of(sensor('stuck 1 1', backend='hardware', bus='i2c-1')) == ()


def test_a_scripted_fault_is_played_by_the_emulated_bus():
    clock = SimulatedClock()
    acquisition = bench.build(sensor('stuck 2 0.5'), clock)
    start = clock.now_ns()
    acquisition.advance(start + round(1.8 * SECOND))
    assert acquisition.stats.failures == 0
    acquisition.advance(start + round(2.3 * SECOND))
    assert acquisition.stats.state == 'recovering'
    assert acquisition.stats.last_error.startswith('BusBusy: emulated mpu9250 on i2c: a line')
    acquisition.advance(start + 5 * SECOND)
    assert acquisition.stats.state == 'running'
    assert acquisition.stats.errors['BusBusy'] == acquisition.stats.failures


def test_the_bench_of_the_demo_plays_every_kind_on_sensors_with_drivers():
    loaded = bench.load_bench(ROOT / 'config' / 'benches' / 'faults.yaml')
    played = [fault for each in loaded.sensors for fault in bench.faults_of(each)]
    assert {fault.kind for fault in played} == set(KINDS)
    for page in ('README.md', 'docs/faults.md'):
        assert f'{len(played)} ' in (ROOT / page).read_text(encoding='utf-8')


def test_the_page_has_a_row_for_every_kind():
    page = (ROOT / 'docs' / 'faults.md').read_text(encoding='utf-8')
    rows = [line.split('|')[1] for line in page.splitlines() if line.startswith('| `')]
    assert set(re.findall(r'`(\w+)`', ' '.join(rows))) == set(KINDS)


# --- what is kept of a fault -------------------------------------------------------------
def stats(**values):
    usual = {
        'state': 'running', 'error': '', 'last_error': '', 'errors': {}, 'lost': 0,
        'failures': 0, 'recoveries': 0, 'counters': {},
    }  # fmt: skip
    return SimpleNamespace(**usual | values)


def test_a_fault_is_followed_from_its_beginning_to_the_first_sample_after_it():
    watch = FaultWatch(script(['unplugged 10 2']), 0)
    (aftermath,) = watch.aftermaths
    assert watch.look(9 * SECOND, stats(lost=7), 9 * SECOND) == []
    down = {'state': 'recovering', 'error': 'x: nothing', 'last_error': 'NoAnswer: x: nothing'}
    assert watch.look(11 * SECOND, stats(lost=7, errors={'NoAnswer': 3}, failures=3, **down), 0)
    assert aftermath.state == 'active'
    assert aftermath.error == 'NoAnswer: x: nothing'
    assert watch.look(13 * SECOND, stats(lost=7, errors={'NoAnswer': 5}, **down), 10 * SECOND)
    assert aftermath.state == 'over'
    back = {'errors': {'NoAnswer': 5}, 'last_error': down['last_error'], 'recoveries': 1}
    # all is well, but nothing that was measured since has arrived
    assert watch.look(13 * SECOND, stats(lost=7, **back), 12 * SECOND) == []
    later = stats(lost=2507, counters={'brown_outs': 1, 'saturated': 0}, **back)
    assert watch.look(round(13.25 * SECOND), later, 13 * SECOND) == [aftermath]
    assert aftermath.state == 'recovered'
    assert aftermath.recovery_s == pytest.approx(1.25)
    assert aftermath.lost == 2500
    assert aftermath.errors == {'NoAnswer': 5}
    assert aftermath.counted == {'recoveries': 1, 'brown_outs': 1}
    # what comes soon after still belongs to it, what comes much later does not
    assert watch.look(14 * SECOND, stats(lost=2508, **back), 14 * SECOND) == []
    assert aftermath.lost == 2501
    watch.look(30 * SECOND, stats(lost=9999, **back), 30 * SECOND)
    assert aftermath.lost == 2501


# --- how it is told ----------------------------------------------------------------------
def told(**values):
    usual = {
        'kind': 'unplugged', 'at_s': '10', 'for_s': '2', 'state': 'recovered', 'lost': '1',
        'error': 'NoAnswer: i2c: nothing', 'errors': 'NoAnswer 3', 'recovery_s': '0.500',
        'counted': 'failures 3, brown_outs 1',
    }  # fmt: skip
    return {'left': SimpleNamespace(faults={0: usual | values}, values={'lost': '1'})}


def test_each_stage_of_a_fault_is_told_once():
    views = told(state='planned', error='')
    news = FaultNews(views)
    assert list(news.lines()) == []
    views['left'].faults[0] |= {'state': 'active'}
    assert [line.split() for line in news.lines()] == [
        ['left', 'unplugged', 'begins,', 'for', '2', 's']
    ]
    views['left'].faults[0] |= {'error': 'NoAnswer: i2c: nothing'}
    (line,) = news.lines()
    assert line.endswith('NoAnswer: i2c: nothing')
    assert list(news.lines()) == []
    views['left'].faults[0] |= {'state': 'recovered'}
    (line,) = news.lines()
    assert line.endswith('over: data again after 0.50 s, 1 sample lost (brown_outs 1)')
    assert list(news.lines()) == []


def test_the_summary_says_that_all_recovered(capsys):
    assert show_faults(told()) == 0
    output = capsys.readouterr().out
    assert '1 of 1 faults recovered from, 1 sample lost and counted' in output
    assert 'NoAnswer 3' in output


@pytest.mark.parametrize(
    ('change', 'says'),
    [
        ({'state': 'planned', 'recovery_s': ''}, 'was not played; give a longer --duration'),
        ({'state': 'active', 'recovery_s': ''}, 'was not over'),
        ({'state': 'over', 'recovery_s': ''}, 'has NOT recovered: NoAnswer: i2c: nothing'),
    ],
)
def test_the_summary_fails_if_one_did_not(capsys, change, says):
    assert show_faults(told(**change)) == 1
    output = capsys.readouterr().out
    assert says in output
    assert '0 of 1 faults recovered from' in output


def test_no_report_is_no_success(capsys):
    assert show_faults({'left': SimpleNamespace(faults={}, values={})}) == 1
    assert 'no fault was reported' in capsys.readouterr().out


@pytest.mark.ros
def test_what_the_recording_misses_is_said_beside_what_the_faults_took(tmp_path, capsys):
    from imu_bench.live.views import SensorView
    from imu_bench.terminal.tables import show_gaps

    sensor = SensorView('mti300')
    sensor.tally.hear({'lost': 1355})
    sensor.hear_of_faults({'0.lost': '430', '0.state': 'recovered'})
    sensor.hear_of_faults({'1.lost': '915', '1.state': 'recovered'})
    recording = {'topic': '/bench/mti300/imu/data_raw', 'health': {'missing': 1360}}
    results = tmp_path / 'results.json'
    results.write_text(json.dumps({'recordings': [recording]}), encoding='utf-8')
    show_gaps(results, {'mti300': sensor})
    said = 'mti300: 1345 lost by faults and 10 otherwise; 1360 missing in the recording\n'
    assert said in capsys.readouterr().out
