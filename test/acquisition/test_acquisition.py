# SPDX-License-Identifier: Apache-2.0
"""The acquisition of one sensor: every sample once, faults named and outlived, losses counted."""

import threading

from imu_bench.acquisition import Acquisition
from imu_bench.bus.clock import SystemClock
from imu_bench.errors import IdentityError, NoAnswer, NotReady
from imu_bench.samples import Samples
import numpy as np
import pytest

SECOND = 1_000_000_000


def numbers(runs):
    """Return the sample numbers that a fake chip hid in x."""
    return np.concatenate([run.acceleration[:, 0] for run in runs]).astype(int)


def stamps(runs):
    return np.concatenate([run.stamps for run in runs])


def run_for(acquisition, clock, seconds):
    """Advance in slices, draining as a node would."""
    runs = []
    for _ in range(round(seconds / 0.5)):
        acquisition.advance(clock.now_ns() + SECOND // 2)
        runs += acquisition.drain()
    return runs


@pytest.mark.slow
@pytest.mark.parametrize('rate_hz', [100.0, 1000.0, 1344.0])
@pytest.mark.parametrize('rate_error', [-0.04, 0.0, 1e-5, 0.03])
def test_every_sample_once_with_the_time_of_its_measurement(clock, chip, rate_hz, rate_error):
    device = chip(rate_hz=rate_hz, rate_error=rate_error, poll_s=min(0.02, 2 / rate_hz))
    acquisition = Acquisition(device, clock)
    runs = run_for(acquisition, clock, 30)
    acquisition.finish()
    runs += acquisition.drain()
    got = numbers(runs)
    np.testing.assert_array_equal(np.diff(got), 1)
    intervals = np.diff(stamps(runs))
    assert intervals.std() < 20e3
    assert (intervals > 0).all()
    settled = slice(len(got) // 2, None)
    errors = stamps(runs)[settled] - device.true_ns(got[settled])
    assert np.abs(errors).max() < 150e3
    # a slow sensor shows its phase rarely: 1 % of its period is found out
    assert errors.std() < max(20e3, 0.01 * device.period_ns)
    stats = acquisition.stats
    assert (stats.samples, stats.lost, stats.failures) == (len(got), 0, 0)
    assert stats.rate_error.low <= rate_error * 1e6 <= stats.rate_error.high
    assert stats.jitter.value < 20e-6


def test_an_overflow_leaves_a_gap_of_the_right_length_and_a_count(clock, chip):
    device = chip(rate_error=0.01)
    acquisition = Acquisition(device, clock)
    runs = run_for(acquisition, clock, 10)
    clock.sleep(0.5)  # the host was away: the FIFO holds 42 of about 505
    runs += run_for(acquisition, clock, 5)
    got, times = numbers(runs), stamps(runs)
    lost = np.diff(got) - 1
    assert lost.max() > 400
    assert acquisition.stats.lost == lost.sum()
    assert acquisition.stats.late == 1
    at = lost.argmax()
    gap = times[at + 1] - times[at]
    assert gap == pytest.approx((lost[at] + 1) * device.period_ns, abs=50e3)


def test_unplugged_and_back_again(clock, chip):
    device = chip()
    acquisition = Acquisition(device, clock)
    runs = run_for(acquisition, clock, 5)
    device.unplugged = True
    runs += run_for(acquisition, clock, 4)
    broken = acquisition.stats
    assert broken.state == 'recovering'
    assert isinstance(acquisition.error, NoAnswer)
    assert 'nothing answers' in broken.error
    assert broken.bus_errors >= 3
    assert broken.failures == broken.bus_errors
    device.unplugged = False
    back_ns = clock.now_ns()
    runs += run_for(acquisition, clock, 5)
    healthy = acquisition.stats
    assert (healthy.state, healthy.error, healthy.recoveries) == ('running', '', 1)
    assert device.calls[-3:] == ['identify', 'configure', 'start']
    got, times = numbers(runs), stamps(runs)
    assert healthy.lost == (np.diff(got) - 1).sum()
    after = times[np.searchsorted(times, back_ns)]
    assert after - back_ns < 2 * SECOND
    np.testing.assert_allclose(times, device.true_ns(got), atol=0.5 * device.period_ns)


def test_data_are_published_again_within_two_seconds_of_the_end_of_a_fault(clock, chip):
    device = chip()
    acquisition = Acquisition(device, clock)
    run_for(acquisition, clock, 5)
    for outage in (0.1, 0.35, 1.7, 3.1):
        device.unplugged = True
        run_for(acquisition, clock, 0.5)
        clock.sleep(outage)
        device.unplugged = False
        end_ns = clock.now_ns()
        while not any(run.stamps[-1] > end_ns for run in acquisition.drain()):
            acquisition.advance(clock.now_ns() + SECOND // 50)
            assert clock.now_ns() - end_ns < 2 * SECOND
        assert acquisition.stats.state == 'running'


def test_one_failed_reading_is_counted_and_costs_nothing(clock, chip):
    device = chip()
    acquisition = Acquisition(device, clock)
    runs = run_for(acquisition, clock, 3)
    device.unplugged = True
    acquisition.step()
    device.unplugged = False
    runs += run_for(acquisition, clock, 3)
    assert (np.diff(numbers(runs)) == 1).all()
    stats = acquisition.stats
    assert (stats.failures, stats.recoveries, stats.lost) == (1, 0, 0)


def test_a_chip_reset_behind_our_back_is_configured_again(clock, chip):
    device = chip()
    acquisition = Acquisition(device, clock)
    run_for(acquisition, clock, 3)
    device.asleep = True  # answers, and delivers nothing
    before = len(device.calls)
    runs = run_for(acquisition, clock, 3)
    assert device.calls[before:] == ['identify', 'configure', 'start']
    assert acquisition.stats.recoveries == 1
    assert acquisition.stats.lost > 400
    assert len(runs)


def test_a_sensor_that_is_not_there_at_the_start_is_waited_for(clock, chip):
    device = chip()
    device.unplugged = True
    acquisition = Acquisition(device, clock)
    run_for(acquisition, clock, 2)
    stats = acquisition.stats
    assert (stats.state, stats.samples, stats.lost) == ('starting', 0, 0)
    assert 'nothing answers' in stats.error
    assert not stats.rate.observable
    device.unplugged = False
    run_for(acquisition, clock, 3)
    stats = acquisition.stats
    assert (stats.state, stats.part, stats.error) == ('running', 'FAKE-1', '')
    assert (stats.recoveries, stats.lost) == (0, 0)


def test_prepare_tells_at_once_that_the_sensor_is_missing_and_is_not_repeated(clock, chip):
    device = chip()
    acquisition = Acquisition(device, clock)
    device.unplugged = True
    with pytest.raises(NoAnswer):
        acquisition.prepare()
    device.unplugged = False
    device.calls.clear()
    assert acquisition.prepare() == 'FAKE-1'
    acquisition.advance(clock.now_ns() + SECOND)
    assert device.calls == ['identify', 'configure', 'start']


def test_another_chip_is_refused_for_as_long_as_it_is_there(clock, chip):
    device = chip()
    device.identify = lambda: (_ for _ in ()).throw(IdentityError('another chip'))
    acquisition = Acquisition(device, clock)
    run_for(acquisition, clock, 2)
    assert isinstance(acquisition.error, IdentityError)
    assert acquisition.stats.samples == 0


def test_a_full_queue_drops_and_counts_and_never_blocks(clock, chip):
    acquisition = Acquisition(chip(), clock, capacity_samples=2000)
    acquisition.advance(clock.now_ns() + 5 * SECOND)
    stats = acquisition.stats
    assert stats.queued <= 2000
    assert stats.dropped > 2500
    assert stats.lost == stats.dropped
    kept = numbers(acquisition.drain())
    assert len(kept) == stats.samples == stats.queued
    assert (np.diff(kept) > 0).all()
    acquisition.advance(clock.now_ns() + SECOND)
    runs = acquisition.drain()
    assert numbers(runs)[0] > kept[-1]
    assert acquisition.stats.queued == 0


def test_stopping_hands_over_what_was_held_back(clock, chip):
    acquisition = Acquisition(chip(), clock)
    acquisition.advance(clock.now_ns() + 3 * SECOND // 10)
    assert acquisition.drain() == []
    acquisition.finish()
    got = numbers(acquisition.drain())
    assert len(got) > 100
    assert acquisition.stats.state == 'stopped'


def test_what_passes_between_stop_and_start_is_not_lost(clock, chip):
    acquisition = Acquisition(chip(), clock)
    before = run_for(acquisition, clock, 2)
    clock.sleep(0.5)
    run_for(acquisition, clock, 2)
    lost = acquisition.stats.lost
    acquisition.finish()
    before += acquisition.drain()
    clock.sleep(100)
    after = run_for(acquisition, clock, 2)
    assert acquisition.stats.lost == lost > 400
    assert after[0].stamps[0] - before[-1].stamps[-1] > 100 * SECOND


def test_a_stop_that_fails_is_counted(clock, chip):
    device = chip()
    acquisition = Acquisition(device, clock)
    run_for(acquisition, clock, 1)
    device.unplugged = True
    acquisition.finish()
    assert acquisition.stats.failures == 1
    assert 'nothing answers' in acquisition.stats.error


def test_a_stream_beside_the_main_one_keeps_the_drivers_stamps_in_order(clock, chip):
    device = chip()
    device.rates_hz = {'magnetic_field': 50.0}
    inertial = device.read
    guesses = iter([5, 9, 9, 8, 12, *range(13, 500)])

    def read():
        field = Samples(stamps=[next(guesses)], magnetic_field=np.ones((1, 3)))
        return [*inertial(), field]

    device.read = read
    acquisition = Acquisition(device, clock)
    runs = run_for(acquisition, clock, 2)
    fields = [run for run in runs if run.magnetic_field is not None]
    assert stamps(fields)[:5].tolist() == [5, 9, 10, 11, 12]
    assert (np.diff(numbers([run for run in runs if run.acceleration is not None])) == 1).all()


def test_the_thread_runs_stops_and_announces(chip):
    clock = SystemClock()
    heard = threading.Event()
    device = chip(delay_s=0.0)
    device.clock, device.origin_ns = clock, clock.now_ns()
    device.configure = lambda: None
    acquisition = Acquisition(device, clock, on_data=heard.set)
    acquisition.start()
    with pytest.raises(NotReady, match='runs already'):
        acquisition.start()
    heard.wait()
    acquisition.stop()
    assert acquisition.stats.state == 'stopped'
    assert not [thread for thread in threading.enumerate() if thread.name.startswith('acquire')]
    assert len(numbers(acquisition.drain())) == acquisition.stats.samples > 0
    acquisition.close()
    assert device.closed
    assert device.calls[-1] == 'stop'


def test_a_bus_that_hangs_is_reported_and_not_waited_for(chip):
    clock = SystemClock()
    release, inside = threading.Event(), threading.Event()
    device = chip(delay_s=0.0)
    device.clock, device.origin_ns = clock, clock.now_ns()
    device.configure = lambda: None

    def hang():
        inside.set()
        release.wait(300.0)
        return []

    device.read = hang
    acquisition = Acquisition(device, clock, name='left')
    acquisition.start()
    inside.wait()
    with pytest.raises(NotReady, match=r'left: the bus has not answered'):
        acquisition.stop(timeout_s=0.05)
    release.set()
    acquisition.stop()
