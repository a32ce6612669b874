# SPDX-License-Identifier: Apache-2.0
"""The verdict on a sensor whose wires failed as scripted, and what its recording misses."""

import json
from threading import Thread

import pytest

pytestmark = pytest.mark.ros

VALUES = {'samples': '17000', 'nominal_hz': '400', 'delivered_hz': '400.0', 'lost': '1345'}


def view(lost, /, *, states=None, **values):
    """Return what was heard of a sensor with so many samples lost by each fault."""
    from imu_bench.nodes.bench_monitor import SensorView

    sensor = SensorView('mti300', values={**VALUES, **values})
    states = states or ['recovered'] * len(lost)
    for number, (state, count) in enumerate(zip(states, lost, strict=True)):
        sensor.hear_of_faults({f'{number}.state': state, f'{number}.lost': str(count)})
    return sensor


def test_what_faults_took_is_no_broken_rate():
    assert view([430, 915]).verdict == (
        '1345 samples lost to the scripted faults, none otherwise; '
        'keeps its rate since (400.0 of 400 Hz)'
    )


def test_what_was_lost_beside_the_faults_is_said():
    assert '1015 samples lost to the scripted faults, 330 otherwise; keeps' in view([1015]).verdict


def test_a_rate_that_has_the_last_fault_in_it_is_no_verdict_yet():
    sensor = view([1345], delivered_hz='357.1')
    # what counts is when the rate was told, not when the verdict is asked for
    sensor.heard_s = sensor.recovered_s + 10.0
    assert 'has the last fault in it (357.1 of 400 Hz)' in sensor.verdict
    sensor.heard_s = sensor.recovered_s + 11.5
    assert sensor.verdict.endswith('does NOT keep its rate since: 357.1 of 400 Hz')


def test_a_fault_that_goes_on_is_said_and_one_to_come_is_none():
    assert 'has NOT recovered' in view([430, 915], states=['recovered', 'over']).verdict
    assert view([0], states=['planned'], lost='0').verdict.startswith('kept its rate')


@pytest.mark.parametrize(
    ('missing', 'said'),
    [
        (1345, 'mti300: 1345 lost by faults; 1345 missing in the recording\n'),
        (1645, '1645 missing in the recording, 300 more than the sensor lost: they did not reach'),
    ],
)
def test_what_the_recording_misses_beyond_that_was_lost_on_the_way(
    tmp_path, capsys, missing, said
):
    from imu_bench.cli.fault_lines import show_gaps

    recording = {'topic': '/bench/mti300/imu/data_raw', 'health': {'missing': missing}}
    results = tmp_path / 'results.json'
    results.write_text(json.dumps({'recordings': [recording]}), encoding='utf-8')
    show_gaps(results, {'mti300': view([430, 915])})
    assert said in capsys.readouterr().out


def test_waiting_ends_with_the_message_that_was_waited_for():
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
    from imu_bench.nodes.bench_monitor import BenchMonitor

    monitor = BenchMonitor(['mpu9250'])
    heard = DiagnosticStatus(
        name='/bench/mpu9250: acquisition',
        level=DiagnosticStatus.OK,
        values=[KeyValue(key='samples', value='5')],
    )
    listener = Thread(target=monitor._diagnostics, args=(DiagnosticArray(status=[heard]),))

    def publishing():
        found = monitor.sensors['mpu9250'].publishing
        if not listener.ident:
            listener.start()
        return found

    # without being told it would wait for longer than a test may take
    assert monitor.wait_for(publishing, 1e6)
    assert not monitor.wait_for(lambda: False, 0.0)
    listener.join()
