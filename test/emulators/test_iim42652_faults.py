# SPDX-License-Identifier: Apache-2.0
"""IIM-42652: driver, acquisition and emulated chip; every sample once, faults survived."""

from imu_bench.emulators.faults import Fault
from imu_bench.errors import (
    BenchError,
    BusBusy,
    BusError,
    IdentityError,
    NoAnswer,
    PermissionDenied,
)
import numpy as np
import pytest


def assert_only_true_samples(made):
    for run in made.runs:
        force = np.broadcast_to([0, 0, 9.80665], run.acceleration.shape)
        np.testing.assert_allclose(run.acceleration, force, atol=1e-9)
        # half an LSB at 2000 °/s
        assert (np.abs(run.angular_velocity - [0.1, 0, -0.1]) <= 5.4e-4).all()


@pytest.fixture
def bench(acquired, make_source):
    def make(kind='i2c', rate_error=0.0, **settings):
        source = make_source(rate_error=rate_error)
        return acquired('iim42652', kind, source=source, **settings).run(2.0)

    return make


@pytest.mark.slow
@pytest.mark.parametrize('kind', ['i2c', 'spi'])
@pytest.mark.parametrize('settings', [{}, {'fifo_bits': 20}, {'rate_hz': 1000.0}])
def test_every_sample_arrives_once_with_its_time(bench, kind, settings):
    made = bench(kind, rate_error=0.012, **settings)
    made.run(5.0)
    made.acquisition.finish()
    made.runs += made.acquisition.drain()
    stamps = made.stamps
    rate = made.driver.rate_hz * 1.012
    assert len(stamps) == pytest.approx(rate * 6.88, rel=0.02)
    # the clock model follows the chip's true rate
    np.testing.assert_allclose(np.diff(stamps)[-500:], 1e9 / rate, rtol=0.01)
    assert made.stats.rate.value == pytest.approx(rate, rel=2e-4)
    assert made.stats.lost == 0
    assert not made.errors
    # on I2C the write that clears I3C goes unacknowledged, though it takes effect
    counters = +made.driver.counters
    assert counters == ({'bus_errors': 1} if kind == 'i2c' else {})
    assert_only_true_samples(made)
    # DS sections 12.9 and 14.34: nothing was written while it must not be
    assert made.chip.improper == []


def test_500_hz_are_500_hz(bench):
    """A vendor's program wrote another code for 500 Hz, and the chip delivered 12.5 Hz."""
    made = bench(rate_hz=500.0)
    assert made.stats.delivered.value == pytest.approx(500, rel=0.01)
    assert made.source.nominal_hz == 500.0


def test_a_configuration_that_is_not_taken_is_noticed(acquired, monkeypatch):
    made = acquired('iim42652', 'i2c')
    original = made.bus.write

    def disturbed(register, data):
        # the wrong code of the vendor: 11 instead of 15
        original(register, bytes([data[0] & 0xF0 | 0x0B]) if register == 0x4F else data)

    monkeypatch.setattr(made.bus, 'write', disturbed)
    with pytest.raises(BusError, match=r'gyroscope_rate .*set to 500\.0.*holds 0x0B'):
        made.acquisition.prepare()


OPEN = {'no_answer', 'unplugged'}
UNDETECTABLE = {'garbage', 'bit_errors'}  # there is no checksum: only what makes no sense is seen


@pytest.mark.parametrize(
    ('fault', 'error'),
    [
        ('no_answer', NoAnswer),
        ('unplugged', NoAnswer),
        ('stuck', BusBusy),
        ('permission_denied', PermissionDenied),
        ('garbage', BenchError),
        ('bit_errors', BenchError),
    ],
)
@pytest.mark.parametrize('kind', ['i2c', 'spi'])
def test_a_bus_that_fails_is_named_counted_and_recovers(bench, kind, fault, error):
    made = bench(kind)
    made.bus.inject(fault, 0.4)
    made.run(0.5)
    # an open line on SPI reads ones: there is no acknowledge that could be missing
    expected = BusError if kind == 'spi' and fault in OPEN else error
    assert any(issubclass(found, expected) for found in made.errors)
    made.run(2.5)  # the clock model settles as well
    assert made.acquisition.error is None
    before = made.stats.samples
    tail = len(made.runs)
    made.run(2.0)
    assert made.stats.samples - before == pytest.approx(1000, abs=60)
    assert made.stats.lost > 0
    if fault in UNDETECTABLE:
        made.runs = made.runs[tail:]
    else:
        assert made.driver.counters['bus_errors'] > 0
    assert_only_true_samples(made)


def test_a_silent_brown_out_is_found(bench):
    made = bench(accelerometer_range=4.0)
    made.bus.inject('brown_out')
    made.run(2.0)
    assert made.driver.counters['brown_outs'] == 1
    assert made.driver.continuity == 2
    assert_only_true_samples(made)
    assert 25 < made.stats.lost < 120


def test_a_held_bus_overflows_the_fifo_and_the_loss_is_a_gap(bench):
    made = bench()
    made.bus.inject('stall', 0.5)
    made.run(2.0)
    assert made.driver.counters['fifo_overflows'] == 1
    assert made.driver.counters['packets_lost'] > 50
    assert made.driver.counters['brown_outs'] == 0
    made.run(2.0)
    lost = made.stats.lost
    stamps = made.stamps
    assert round(np.diff(stamps).max() / 2e6) - 1 == lost
    assert_only_true_samples(made)


def test_another_part_is_refused(acquired):
    made = acquired('iim42652', 'i2c', faults=[Fault('wrong_identity')])
    with pytest.raises(IdentityError, match=r'0x71 .*expected 0x6F'):
        made.acquisition.prepare()
