# SPDX-License-Identifier: Apache-2.0
"""Faults of chips with a FIFO and a magnetometer: named, counted, outlived."""

from imu_bench.emulators.faults import Fault, KINDS
from imu_bench.errors import (
    BusBusy,
    BusError,
    ConfigError,
    IdentityError,
    NoAnswer,
    PermissionDenied,
)
import numpy as np
import pytest

CASES = [
    ('mpu9250', 'i2c'),
    ('mpu9250', 'spi'),
    ('lsm9ds1', 'i2c'),
    ('lsm9ds1', 'spi'),
    ('lsm303dlhc', 'i2c'),
]
every_bus = pytest.mark.parametrize(('name', 'kind'), CASES)
every_chip = pytest.mark.parametrize('name', ['mpu9250', 'lsm9ds1', 'lsm303dlhc'])


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
def test_a_bus_that_fails_is_named_counted_and_recovers(running, name, kind, fault, error):
    made = running(name, kind)
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
def test_only_what_lost_its_supply_is_configured_again(running, name):
    made = running(name)
    for fault, brown_outs in (('no_answer', 0), ('unplugged', 1)):
        made.inject(fault)
        made.run(0.1)
        made.clear()
        made.run(0.5)
        assert made.driver.counters['brown_outs'] == brown_outs


@pytest.mark.parametrize(
    ('name', 'port'), [('mpu9250', 0x74), ('lsm9ds1', 0x18), ('lsm303dlhc', 0x28)]
)
def test_a_torn_burst_is_dropped_and_the_stream_starts_anew(running, monkeypatch, name, port):
    made = running(name)
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


@pytest.mark.parametrize(
    ('name', 'words'),
    [
        ('mpu9250', r'0x6F .*expected 0x71'),
        ('lsm9ds1', r'0x76 .*expected 0x68'),
        ('lsm303dlhc', 'expected 0x483433'),
    ],
)
def test_another_chip_at_the_address(driven, name, words):
    made = driven(name, faults=[Fault('wrong_identity')])
    with pytest.raises(IdentityError, match=words):
        made.bring_up()


@pytest.mark.parametrize('name', ['mpu9250', 'lsm9ds1'])
def test_spi_has_no_acknowledge_and_the_driver_notices_all_the_same(driven, name):
    made = driven(name, 'spi', faults=[Fault('unplugged')])
    with pytest.raises(NoAnswer, match='nothing drives the line'):
        made.bring_up()


def test_faults_follow_their_times(running):
    faults = [Fault('stuck', at_s=1.0, for_s=0.2), Fault('brown_out', at_s=1.5)]
    made = running('mpu9250', faults=faults)
    made.run(0.6)
    assert not made.errors
    made.run(0.6)
    assert set(made.errors) == {BusBusy}
    made.run(1.0)
    assert made.driver.counters['brown_outs'] == 1


def test_an_unknown_fault_lists_the_known():
    with pytest.raises(ConfigError, match=', '.join(KINDS)):
        Fault('gremlin')
