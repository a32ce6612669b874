# SPDX-License-Identifier: Apache-2.0
"""MPU-9250, driver and emulated chip: streams are complete, what fails beside is outlived."""

import numpy as np
import pytest


@pytest.fixture
def bench(running):
    return lambda kind='i2c', **settings: running('mpu9250', kind, **settings)


@pytest.mark.slow
@pytest.mark.parametrize(('kind', 'bypass'), [('i2c', False), ('i2c', True), ('spi', False)])
def test_every_sample_arrives_once_with_its_value(bench, kind, bypass):
    made = bench(kind, magnetometer_bypass=bypass)
    start = made.clock.now_ns()
    made.run(5.0)
    elapsed = (made.clock.now_ns() - start) * 1e-9
    assert made.samples == pytest.approx(1000 * elapsed, abs=20)
    assert sum(map(len, made.fields)) == pytest.approx(100 * elapsed, abs=3)
    for run in made.main:
        np.testing.assert_allclose(run.acceleration, [[0, 0, 9.80665]] * len(run), atol=1e-12)
        assert (np.abs(run.angular_velocity - [0.1, 0, -0.1]) <= 1.06423e-3 / 2).all()
    for run in made.fields:
        assert (np.abs(run.magnetic_field - [20e-6, 0, -40e-6]) <= 0.1e-6).all()
    assert not made.errors
    assert made.driver.continuity == 1
    assert not +made.driver.counters


@pytest.mark.slow
def test_stamps_of_the_field_are_within_its_period(bench):
    made = bench('spi')
    made.run(2.0)
    stamps = np.concatenate([run.stamps for run in made.fields])
    np.testing.assert_allclose(np.diff(stamps), 10e6, atol=1.1e6)


@pytest.mark.slow
def test_a_slower_rate(bench):
    made = bench(rate_hz=100.0, accelerometer_bandwidth=44.8)
    made.run(5.0)
    assert made.samples == pytest.approx(500, abs=10)


@pytest.mark.parametrize('bus', ['i2c', 'spi'])
def test_a_silent_brown_out_is_found_and_no_sample_of_the_wrong_range_delivered(bench, bus):
    made = bench(bus)
    made.run(0.2)
    made.inject('brown_out')
    made.run(1.0)
    assert made.driver.counters['brown_outs'] == 1
    assert made.driver.continuity == 2
    values = np.concatenate([run.acceleration for run in made.main])
    np.testing.assert_allclose(values, [[0, 0, 9.80665]] * len(values), atol=1e-12)
    assert made.samples > 900
    fields = np.concatenate([run.magnetic_field for run in made.fields])
    assert (np.abs(fields - [20e-6, 0, -40e-6]) <= 0.1e-6).all()


def test_a_held_bus_overflows_the_fifo_and_the_loss_is_a_gap(bench):
    made = bench()
    made.run(0.2)
    before = made.samples
    made.buses[''].inject('stall', 0.06)
    made.run(1.0)
    assert made.driver.counters['fifo_overflows'] == 1
    assert made.driver.continuity == 2
    assert 900 < made.samples - before < 960
    assert not made.errors


def test_garbage_is_not_taken_for_samples_for_long(bench):
    made = bench()
    made.run(0.2)
    before = made.samples
    made.inject('garbage')
    made.run(0.1)
    made.clear()
    made.errors.clear()
    made.run(0.5)
    assert not made.errors
    assert made.driver.continuity > 1
    tail = np.concatenate([run.acceleration for run in made.main])[-300:]
    np.testing.assert_allclose(tail, [[0, 0, 9.80665]] * len(tail), atol=1e-12)
    assert made.samples > before + 300


def test_a_magnetometer_that_fails_does_not_cost_samples_of_the_main_die(bench):
    made = bench(magnetometer_bypass=True)
    made.buses['magnetometer'].inject('no_answer')
    start, errors = made.clock.now_ns(), made.driver.counters['bus_errors']
    made.run(1.0)
    elapsed = (made.clock.now_ns() - start) * 1e-9
    assert made.samples == pytest.approx(1000 * elapsed, abs=20)
    assert made.driver.counters['bus_errors'] - errors == pytest.approx(143, abs=2)
    assert made.driver.continuity == 1
    made.clear()
    made.run(0.5)
    assert sum(map(len, made.fields)) == pytest.approx(50, abs=2)


@pytest.mark.slow
@pytest.mark.parametrize(('kind', 'bypass'), [('i2c', False), ('i2c', True), ('spi', False)])
def test_a_magnetometer_that_alone_lost_its_mode_is_configured_again(clock, bench, kind, bypass):
    made = bench(kind, magnetometer_bypass=bypass)
    made.run(1.0)
    assert made.driver.counters['brown_outs'] == 0
    chip = made.buses['']._bus.chip
    chip.magnetometer.power_up(clock.now_ns())
    made.run(2.0)
    made.fields.clear()
    made.run(1.0)
    assert made.driver.counters['brown_outs'] == 1
    assert sum(map(len, made.fields)) == pytest.approx(100, abs=3)
    assert made.errors == []
