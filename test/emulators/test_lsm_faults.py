# SPDX-License-Identifier: Apache-2.0
"""LSM9DS1 and LSM303DLHC, driver and emulated chip: faults are named, counted, and outlived."""

from imu_bench.emulators.faults import Fault
from imu_bench.errors import BusBusy, BusError, IdentityError, NoAnswer, PermissionDenied
import numpy as np
import pytest

CASES = [('lsm9ds1', 'i2c'), ('lsm9ds1', 'spi'), ('lsm303dlhc', 'i2c')]
every_bus = pytest.mark.parametrize(('name', 'kind'), CASES)
every_chip = pytest.mark.parametrize('name', ['lsm9ds1', 'lsm303dlhc'])
MAG = 'magnetometer'


@pytest.mark.parametrize(
    ('fault', 'error'),
    [
        ('no_answer', NoAnswer),
        ('unplugged', NoAnswer),
        ('stuck', BusBusy),
        ('permission_denied', PermissionDenied),
    ],
)
@every_bus
def test_a_bus_that_fails_is_named_counted_and_recovers(lsm_running, name, kind, fault, error):
    made = lsm_running(name, kind)
    made.run(0.2)
    made.inject(fault)
    made.run(0.1)
    # an open line on SPI reads ones: there is no acknowledge that could be missing
    assert set(made.errors) == {BusError if (kind, error) == ('spi', NoAnswer) else error}
    assert made.driver.counters['bus_errors'] == len(made.errors)
    before, continuity = made.samples, made.driver.continuity
    made.clear()
    made.run(0.05)
    made.errors.clear()
    made.run(1.0)
    assert not made.errors
    assert made.samples - before > 0.8 * made.driver.rate_hz
    assert made.driver.continuity > continuity
    half = made.driver.acceleration.resolution(16.0).max() / 2
    assert (np.abs(made.values - [0, 0, 9.80665]) <= half * (1 + 1e-9)).all()


@every_chip
def test_only_what_lost_its_supply_is_configured_again(lsm_running, name):
    made = lsm_running(name)
    for fault, brown_outs in (('no_answer', 0), ('unplugged', 1)):
        made.inject(fault)
        made.run(0.1)
        made.clear()
        made.run(0.5)
        assert made.driver.counters['brown_outs'] == brown_outs


@every_bus
@pytest.mark.parametrize('at', [0.0, 0.0005, 0.001, 0.0015, 0.003])
def test_a_silent_brown_out_is_found_and_no_sample_of_the_wrong_range_delivered(
    lsm_bench, name, kind, at
):
    made = lsm_bench(name, kind, [Fault('brown_out', at_s=0.5 + at)])
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
def test_a_magnetometer_alone_that_lost_its_settings_is_found_by_its_silence(lsm_running, name):
    made = lsm_running(name)
    made.run(0.2)
    made.buses[MAG].inject('brown_out')
    made.run(1.0)
    assert made.driver.counters['brown_outs'] == 1
    before = sum(map(len, made.fields))
    made.run(1.0)
    rate = made.driver.rates_hz['magnetic_field']
    assert sum(map(len, made.fields)) - before == pytest.approx(rate, abs=4)


@every_bus
def test_a_held_bus_overflows_the_fifo_and_what_is_left_is_a_new_beginning(
    lsm_running, name, kind
):
    made = lsm_running(name, kind)
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
def test_fields_that_came_and_went_unseen_are_counted(lsm_running, name):
    made = lsm_running(name)
    made.run(0.5)
    made.buses[''].inject('stall', 0.1)
    made.run(0.5)
    rate = made.driver.rates_hz['magnetic_field']
    assert made.driver.counters['magnetometer_lost'] == pytest.approx(0.1 * rate - 1, abs=1.5)


@every_chip
def test_garbage_is_not_taken_for_samples_for_long(lsm_running, name):
    made = lsm_running(name)
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


@pytest.mark.parametrize(('name', 'port'), [('lsm9ds1', 0x18), ('lsm303dlhc', 0x28)])
def test_a_torn_burst_is_dropped_and_the_stream_starts_anew(lsm_running, monkeypatch, name, port):
    made = lsm_running(name)
    made.run(0.1)
    bus, original = made.buses[''], made.buses[''].read

    def torn(register, length):
        data = original(register, length)
        if register == port:
            monkeypatch.setattr(bus, 'read', original)
            raise NoAnswer('the wire moved')
        return data

    monkeypatch.setattr(bus, 'read', torn)
    made.run(0.5)
    assert made.errors == [NoAnswer]
    assert made.driver.continuity == 2
    assert made.driver.counters['brown_outs'] == 0
    assert made.samples > 0.5 * made.driver.rate_hz


@every_chip
def test_a_magnetometer_that_fails_does_not_cost_samples_of_the_main_die(lsm_running, name):
    made = lsm_running(name)
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


@pytest.mark.parametrize(
    ('name', 'words'), [('lsm9ds1', r'0x76 .*expected 0x68'), ('lsm303dlhc', 'expected 0x483433')]
)
def test_another_chip_at_the_address(lsm_bench, name, words):
    made = lsm_bench(name, faults=[Fault('wrong_identity')])
    with pytest.raises(IdentityError, match=words):
        made.bring_up()


def test_spi_has_no_acknowledge_and_the_driver_notices_all_the_same(lsm_bench):
    made = lsm_bench('lsm9ds1', 'spi', faults=[Fault('unplugged')])
    with pytest.raises(NoAnswer, match='nothing drives the line'):
        made.bring_up()
