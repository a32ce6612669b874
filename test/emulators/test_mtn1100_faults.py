# SPDX-License-Identifier: Apache-2.0
"""MTN/1100 behind each converter: every sample once, faults named, counted and survived."""

from imu_bench.errors import BusBusy, NoAnswer, PermissionDenied
import numpy as np
import pytest

KINDS = ('daqhat', 'i2c', 'frame')
RATES = {'daqhat': 51200 / 51, 'i2c': 500.0, 'frame': 1000.0}
SLOW = {'daqhat': {}, 'i2c': {'rate_hz': 128.0}, 'frame': {'rate_hz': 200.0}}
# 2.5 m/s² in steps of the converters, half of one off at most
HALF_LSB = {'daqhat': 3e-5, 'i2c': 3.1e-3, 'frame': 4e-2}


def assert_only_true_samples(made):
    for run in made.runs:
        assert np.isnan(run.acceleration[:, :2]).all()
        np.testing.assert_allclose(run.acceleration[:, 2], 2.5, atol=HALF_LSB[made.kind])


@pytest.fixture
def bench(acquired, make_source):
    def make(kind, rate_error=0.0, **settings):
        source = make_source(acceleration=(1.0, 2.0, 2.5), rate_error=rate_error)
        # two of the seconds let the sensor settle; blocks of a tenth of a second take longer
        # until their times are known
        return acquired('mtn1100', kind, source=source, **settings).run(
            4.0 if kind == 'daqhat' else 2.5
        )

    return make


@pytest.mark.slow
@pytest.mark.parametrize('kind', KINDS)
def test_every_sample_arrives_once_with_its_time(bench, kind):
    made = bench(kind, rate_error=40e-6 if kind == 'daqhat' else 0.0)
    before = made.stats.samples
    made.run(3.0)
    assert made.stats.samples - before == pytest.approx(3 * RATES[kind], abs=60)
    assert made.stats.lost == 0
    assert not made.errors
    assert not +made.driver.counters
    intervals = np.diff(made.stamps)
    assert np.abs(intervals[-1000:] - 1e9 / RATES[kind]).max() < 20_000
    assert_only_true_samples(made)


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize(
    ('fault', 'error'),
    [
        ('no_answer', NoAnswer),
        ('unplugged', NoAnswer),
        ('stuck', BusBusy),
        ('permission_denied', PermissionDenied),
    ],
)
def test_a_wire_that_fails_is_named_counted_and_recovers(bench, kind, fault, error):
    made = bench(kind, **SLOW[kind])
    rate_hz = made.driver.rate_hz
    made.bus.inject(fault, 0.5)
    made.run(0.6)
    assert made.errors == {error}
    assert made.driver.counters['bus_errors'] >= 3
    # a sensor that was without current settles for two seconds
    made.run(4.0)
    assert made.acquisition.error is None
    assert made.stats.recoveries >= 1
    assert made.stats.lost > 0.4 * rate_hz
    before, lost = made.stats.samples, made.stats.lost
    made.run(1.0)
    # the MCC 172 hands over blocks of a tenth of a second
    assert made.stats.samples - before == pytest.approx(rate_hz, rel=0.11)
    assert made.stats.lost == lost
    assert_only_true_samples(made)


@pytest.mark.slow
def test_an_ads1115_at_its_reset_values_is_noticed_at_once(bench):
    made = bench('i2c', ads1115_range=1.024)
    made.bus.inject('brown_out')
    made.run(1.0)
    assert made.driver.counters['brown_outs'] == 1
    assert made.stats.lost <= 2
    assert_only_true_samples(made)


def test_a_board_without_power_for_a_moment_settles_again(bench):
    made = bench('daqhat')
    made.bus.inject('brown_out')
    made.run(5.0)
    assert made.errors == {NoAnswer}
    assert made.stats.lost == pytest.approx(2.3 * RATES['daqhat'], rel=0.1)
    assert_only_true_samples(made)


def test_an_overrun_is_a_gap_that_is_counted(bench):
    made = bench('daqhat')
    made.chip.hardware_overrun = True
    made.run(3.0)
    assert made.driver.counters['hardware_overruns'] == 1
    assert made.driver.continuity == 2
    assert made.stats.lost > 0
    gap = np.diff(made.stamps).max() * RATES['daqhat'] * 1e-9
    assert round(gap) - 1 == made.stats.lost
    assert not made.errors
    assert_only_true_samples(made)


def test_nobody_reads_the_board_for_too_long(bench):
    made = bench('daqhat')
    made.bus.inject('stall', 12.0)
    made.run(14.0)
    assert made.driver.counters['buffer_overruns'] == 1
    assert made.stats.lost > 11 * RATES['daqhat']
    assert_only_true_samples(made)


def test_a_mcp3208_with_a_dead_sensor_is_reported(bench):
    made = bench('frame')
    made.source.values['acceleration'] = (0.0, 0.0, -500.0)
    made.run(1.0)
    assert made.errors == {NoAnswer}
    assert made.driver.counters['saturated'] > 300


@pytest.mark.parametrize('kind', ['i2c', 'frame'])
def test_a_held_bus_makes_a_gap_that_is_counted(bench, kind):
    made = bench(kind)
    made.bus.inject('stall', 0.1)
    made.run(1.0)
    assert made.stats.lost == pytest.approx(0.1 * RATES[kind], abs=2)
    assert not made.errors
    assert_only_true_samples(made)
