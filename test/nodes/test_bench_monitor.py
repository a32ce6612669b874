# SPDX-License-Identifier: Apache-2.0
"""What the monitor of a bench makes of what its nodes say."""

from threading import Thread
import time

import pytest

pytestmark = pytest.mark.ros


def status(**values):
    """Return what the node of a sensor would say."""
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    name = '/bench/mpu9250: acquisition'
    return DiagnosticArray(
        status=[DiagnosticStatus(name=name, level=DiagnosticStatus.OK, values=pairs)]
    )


def test_a_sensor_is_held_to_the_slower_of_its_two_rates():
    from imu_bench.nodes.bench_monitor import BenchMonitor

    monitor = BenchMonitor(['mpu9250'])
    view = monitor.sensors['mpu9250']
    for true, delivered, full in ((1010, 991, True), (980, 971, True), (1010, 989, False)):
        values = {'nominal_hz': 1000, 'rate_hz': true, 'delivered_hz': delivered}
        monitor._diagnostics(status(**values))
        assert view.at_full_rate is full, values


def test_what_the_analysis_has_missed_belongs_to_the_sensor():
    from imu_bench.nodes.bench_monitor import BenchMonitor

    monitor = BenchMonitor(['mpu9250'])
    for missed in ('not known', 12, 3):  # the last by one that was started again
        said = status(missed=missed)
        said.status[0].name = '/bench/mpu9250: analysis'
        monitor._diagnostics(said)
    assert monitor.sensors['mpu9250'].unanalysed == 12
    assert not monitor.sensors['mpu9250'].values


def test_what_a_sensor_has_counted_outlives_its_node():
    from imu_bench.nodes.bench_monitor import BenchMonitor

    monitor = BenchMonitor(['mpu9250'])
    for samples in (100, 900, 50):
        monitor._diagnostics(status(samples=samples, lost=samples // 50))
    tally = monitor.sensors['mpu9250'].tally
    assert (tally['samples'], tally['lost'], tally.restarts) == (950, 19, 1)


def test_what_is_played_from_a_bag_is_no_news():
    from imu_bench.nodes.bench_monitor import BenchMonitor

    monitor = BenchMonitor(['mpu9250'])
    for said_s, samples in ((time.time(), 100), (time.time() - 3600.0, 5), (time.time(), 200)):
        said = status(samples=samples)
        said.header.stamp.sec = int(said_s)
        monitor._diagnostics(said)
    tally = monitor.sensors['mpu9250'].tally
    assert (tally['samples'], tally.restarts) == (200, 0)


def test_waiting_ends_with_the_message_that_was_waited_for():
    from imu_bench.nodes.bench_monitor import BenchMonitor

    monitor = BenchMonitor(['mpu9250'])
    listener = Thread(target=monitor._diagnostics, args=(status(samples=5),))

    def publishing():
        found = monitor.sensors['mpu9250'].publishing
        if not listener.ident:
            listener.start()
        return found

    # without being told it would wait for longer than a test may take
    assert monitor.wait_for(publishing, 1e6)
    assert not monitor.wait_for(lambda: False, 0.0)
    listener.join()


def test_it_ends_although_nobody_says_anything():
    from imu_bench.nodes.bench_monitor import BenchMonitor

    with BenchMonitor(['mpu9250']) as monitor:
        # long enough that its thread waits for what does not come
        assert not monitor.wait_for(lambda: False, 1.0)


def test_nonsense_in_the_name_of_a_sensor_or_of_the_recorder_ends_nothing():
    from imu_bench.nodes.bench_monitor import BenchMonitor

    monitor = BenchMonitor(['mpu9250'], '/bag')
    for kind in ('faults', 'acquisition', 'analysis'):
        said = status(**{'x': 'y', '1.state': 'active', '1.lost': 'much', 'samples': 'many'})
        said.status[0].name = f'/bench/mpu9250: {kind}'
        monitor._diagnostics(said)
    said = status(**{'stored./a': 'x', 'dropped': '-', 'turned_away': '', 'beside./a': '1e9'})
    said.status[0].name, said.status[0].hardware_id = 'recorder: recording', '/bag'
    monitor._diagnostics(said)
    view, recorder = monitor.sensors['mpu9250'], monitor.recorder
    assert (view.lost_by_faults, view.publishing, view.tally['samples']) == (0, False, 0)
    assert (recorder.stored('/a'), recorder.dropped, recorder.turned_away) == (0, 0, 0)
    assert recorder.beside == {}
