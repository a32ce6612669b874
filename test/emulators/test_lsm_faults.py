# SPDX-License-Identifier: Apache-2.0
"""LSM9DS1 and LSM303DLHC, driver and emulated chip: faults are named, counted, and outlived."""

from imu_bench.emulators.faults import Fault
import numpy as np
import pytest

CASES = [('lsm9ds1', 'i2c'), ('lsm9ds1', 'spi'), ('lsm303dlhc', 'i2c')]
every_bus = pytest.mark.parametrize(('name', 'kind'), CASES)
every_chip = pytest.mark.parametrize('name', ['lsm9ds1', 'lsm303dlhc'])
MAG = 'magnetometer'


@every_bus
@pytest.mark.parametrize('at', [0.0, 0.0005, 0.001, 0.0015, 0.003])
def test_a_silent_brown_out_is_found_and_no_sample_of_the_wrong_range_delivered(
    driven, name, kind, at
):
    made = driven(name, kind, [Fault('brown_out', at_s=0.5 + at)])
    made.bring_up()
    made.run(1.5)
    assert made.driver.counters['brown_outs'] == 1
    assert made.driver.continuity > 1
    half = made.driver.acceleration.resolution(16.0).max() / 2
    assert (np.abs(made.values - [0, 0, 9.80665]) <= half * (1 + 1e-9)).all()
    assert made.samples > 1.2 * made.driver.rate_hz
    fields = np.concatenate([run.magnetic_field for run in made.fields])
    assert (np.abs(fields - [20e-6, 0, -40e-6]) <= 0.06e-6).all()


@every_chip
def test_a_magnetometer_alone_that_lost_its_settings_is_found_by_its_silence(running, name):
    made = running(name)
    made.run(0.2)
    made.buses[MAG].inject('brown_out')
    made.run(1.0)
    assert made.driver.counters['brown_outs'] == 1
    before = sum(map(len, made.fields))
    made.run(1.0)
    rate = made.driver.rates_hz['magnetic_field']
    assert sum(map(len, made.fields)) - before == pytest.approx(rate, abs=4)


@every_bus
def test_a_held_bus_overflows_the_fifo_and_what_is_left_is_a_new_beginning(running, name, kind):
    made = running(name, kind)
    made.run(0.2)
    before = made.samples
    made.buses[''].inject('stall', 0.06)
    made.run(1.0)
    assert made.driver.counters['fifo_overflows'] == 1
    assert made.driver.continuity == 2
    rate = made.driver.rate_hz
    assert made.samples - before == pytest.approx(rate * 0.94 + 32, abs=0.03 * rate)
    assert not made.errors


@every_chip
def test_fields_that_came_and_went_unseen_are_counted(running, name):
    made = running(name)
    made.run(0.5)
    made.buses[''].inject('stall', 0.1)
    made.run(0.5)
    rate = made.driver.rates_hz['magnetic_field']
    assert made.driver.counters['magnetometer_lost'] == pytest.approx(0.1 * rate - 1, abs=1.5)


@every_chip
def test_garbage_is_not_taken_for_samples_for_long(running, name):
    made = running(name)
    made.run(0.2)
    made.inject('garbage')
    made.run(0.1)
    made.clear()
    made.errors.clear()
    made.run(0.5)
    assert not made.errors
    assert made.driver.continuity > 1
    half = made.driver.acceleration.resolution(16.0).max() / 2
    assert (np.abs(made.values - [0, 0, 9.80665]) <= half * (1 + 1e-9)).all()
    assert made.samples > 0.5 * made.driver.rate_hz


@every_chip
def test_a_magnetometer_that_fails_does_not_cost_samples_of_the_main_die(running, name):
    made = running(name)
    made.buses[MAG].inject('no_answer')
    start = made.clock.now_ns()
    made.run(1.0)
    elapsed = (made.clock.now_ns() - start) * 1e-9
    assert made.samples == pytest.approx(made.driver.rate_hz * elapsed, abs=40)
    assert made.driver.counters['bus_errors'] > 100
    assert made.driver.continuity == 1
    made.clear()
    made.run(0.5)
    rate = made.driver.rates_hz['magnetic_field']
    assert sum(map(len, made.fields)) == pytest.approx(0.5 * rate, abs=3)
