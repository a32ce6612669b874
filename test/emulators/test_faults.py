# SPDX-License-Identifier: Apache-2.0
"""Driver and emulated chip together: streams are complete, faults are named, counted, survived."""

from imu_bench.drivers import load
from imu_bench.emulators import create
from imu_bench.emulators.faults import Fault, KINDS, wrap
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

LOAD = load('mpu9250')


class Bench:
    """A driver on an emulated bus with faults, and what came out of it."""

    def __init__(self, clock, source, kind='i2c', faults=(), **settings):
        self.clock = clock
        self.source = source
        self.buses = wrap(create('mpu9250', kind, source, clock), LOAD, clock, faults)
        self.driver = LOAD(self.buses, clock, settings)
        self.errors = []
        self.main = []
        self.fields = []
        clock.sleep(0.05)

    def bring_up(self):
        self.driver.configure()
        self.driver.start()

    def run(self, seconds):
        end = self.clock.now_ns() + round(seconds * 1e9)
        due = self.clock.now_ns()
        while due < end:
            due += round(self.driver.poll_period_s * 1e9)
            self.clock.sleep_until(due)
            try:
                for run in self.driver.read():
                    (self.main if run.acceleration is not None else self.fields).append(run)
            except (BusError, IdentityError) as error:
                self.errors.append(type(error))

    def inject(self, kind, *args):
        for bus in self.buses.values():
            bus.inject(kind, *args)

    def clear(self):
        for bus in self.buses.values():
            bus.clear()

    @property
    def samples(self):
        return sum(len(run) for run in self.main)


@pytest.fixture
def bench(clock, make_source):
    def make(kind='i2c', **settings):
        made = Bench(clock, make_source(), kind, **settings)
        made.bring_up()
        return made

    return make


@pytest.mark.parametrize('kind', ['i2c', 'spi'])
def test_every_sample_arrives_once_with_its_value(bench, kind):
    made = bench(kind)
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


def test_stamps_of_the_field_are_within_its_period(bench):
    made = bench('spi')
    made.run(2.0)
    stamps = np.concatenate([run.stamps for run in made.fields])
    np.testing.assert_allclose(np.diff(stamps), 10e6, atol=1.1e6)


def test_a_slower_rate(bench):
    made = bench(rate_hz=100.0, accelerometer_bandwidth=41.0)
    made.run(5.0)
    assert made.samples == pytest.approx(500, abs=10)


# --- faults ------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ('kind', 'error'),
    [
        ('no_answer', NoAnswer),
        ('unplugged', NoAnswer),
        ('stuck', BusBusy),
        ('permission_denied', PermissionDenied),
    ],
)
@pytest.mark.parametrize('bus', ['i2c', 'spi'])
def test_a_bus_that_fails_is_named_counted_and_recovers(bench, bus, kind, error):
    made = bench(bus)
    made.run(0.2)
    made.inject(kind)
    made.run(0.1)
    # an open line on SPI reads ones: there is no acknowledge that could be missing
    assert set(made.errors) == {BusError if (bus, error) == ('spi', NoAnswer) else error}
    assert made.driver.counters['bus_errors'] == len(made.errors)
    before, lost_from = made.samples, made.driver.continuity
    made.clear()
    made.run(0.02)  # a chip that was without power needs 11 ms
    made.errors.clear()
    made.run(1.0)
    assert not made.errors
    assert made.samples - before > 700
    assert made.driver.continuity > lost_from
    values = np.concatenate([run.acceleration for run in made.main])
    np.testing.assert_allclose(values, [[0, 0, 9.80665]] * len(values), atol=1e-12)


def test_only_what_lost_its_supply_is_configured_again(bench):
    made = bench()
    for kind, brown_outs in (('no_answer', 0), ('unplugged', 1)):
        made.inject(kind)
        made.run(0.1)
        made.clear()
        made.run(0.5)
        assert made.driver.counters['brown_outs'] == brown_outs


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


def test_a_torn_burst_is_dropped_and_the_stream_starts_anew(bench, monkeypatch):
    made = bench()
    made.run(0.1)
    before = made.samples
    bus, original = made.buses[''], made.buses[''].read

    def torn(register, length):
        data = original(register, length)
        if register == 0x74:
            monkeypatch.setattr(bus, 'read', original)
            raise NoAnswer('the wire moved')
        return data

    monkeypatch.setattr(bus, 'read', torn)
    made.run(0.5)
    assert made.errors == [NoAnswer]
    assert made.driver.continuity == 2
    assert made.driver.counters['brown_outs'] == 0
    assert 450 < made.samples - before < 500


def test_a_magnetometer_that_fails_does_not_cost_samples_of_the_main_die(bench):
    made = bench()
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


def test_another_chip_at_the_address(clock, make_source):
    made = Bench(clock, make_source(), faults=[Fault('wrong_identity')])
    with pytest.raises(IdentityError, match=r'0x6F .*expected 0x71'):
        made.bring_up()


def test_spi_has_no_acknowledge_and_the_driver_notices_all_the_same(clock, make_source):
    made = Bench(clock, make_source(), 'spi', faults=[Fault('unplugged')])
    with pytest.raises(NoAnswer, match='nothing drives the line'):
        made.bring_up()


def test_faults_follow_their_times(clock, make_source):
    made = Bench(
        clock,
        make_source(),
        faults=[Fault('stuck', at_s=1.0, for_s=0.2), Fault('brown_out', at_s=1.5)],
    )
    made.bring_up()
    made.run(0.6)
    assert not made.errors
    made.run(0.6)
    assert set(made.errors) == {BusBusy}
    made.run(1.0)
    assert made.driver.counters['brown_outs'] == 1


def test_an_unknown_fault_lists_the_known():
    with pytest.raises(ConfigError, match=', '.join(KINDS)):
        Fault('gremlin')


@pytest.mark.parametrize('kind', ['i2c', 'spi'])
def test_a_magnetometer_that_alone_lost_its_mode_is_configured_again(clock, lsm_running, kind):
    bench = lsm_running('mpu9250', kind)
    bench.run(1.0)
    assert bench.driver.counters['brown_outs'] == 0
    chip = bench.buses['']._bus.chip
    chip.magnetometer.power_up(clock.now_ns())
    bench.run(2.0)
    bench.fields.clear()
    bench.run(1.0)
    assert bench.driver.counters['brown_outs'] == 1
    assert sum(map(len, bench.fields)) == pytest.approx(100, abs=3)
    assert bench.errors == []
