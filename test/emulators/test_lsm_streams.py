# SPDX-License-Identifier: Apache-2.0
"""LSM9DS1 and LSM303DLHC, driver and emulated chip: every sample once, with its value."""

from pathlib import Path

from imu_bench.bench import build, load_sensor
from imu_bench.samples import Samples
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
CASES = [('lsm9ds1', 'i2c'), ('lsm9ds1', 'spi'), ('lsm303dlhc', 'i2c')]
every_bus = pytest.mark.parametrize(('name', 'kind'), CASES)
every_chip = pytest.mark.parametrize('name', ['lsm9ds1', 'lsm303dlhc'])
COUNT = 0.05  # m/s² per sample number: five LSB of the coarser one at ±2 g


def numbering(source):
    """Let the source put the sample's number, modulo 256, on the x axis."""

    class Numbered(type(source)):
        def samples_until(self, t_ns):
            first = self.made
            made = super().samples_until(t_ns)
            force = made.acceleration.copy()
            force[:, 0] = (np.arange(first, self.made) % 256) * COUNT
            return Samples(
                made.stamps, force, made.angular_velocity, made.magnetic_field, made.temperature
            )

    source.__class__ = Numbered
    return source


@every_bus
def test_every_sample_arrives_once_with_its_value(running, name, kind):
    made = running(name, kind)
    start = made.clock.now_ns()
    made.run(5.0)
    elapsed = (made.clock.now_ns() - start) * 1e-9
    driver = made.driver
    assert made.samples == pytest.approx(driver.rate_hz * elapsed, abs=40)
    half = driver.acceleration.resolution(16.0).max() / 2
    assert (np.abs(made.values - [0, 0, 9.80665]) <= half * (1 + 1e-9)).all()
    for quantity, runs in (('magnetic_field', made.fields), ('temperature', made.temperatures)):
        rate = driver.rates_hz[quantity]
        assert sum(map(len, runs)) == pytest.approx(rate * elapsed, abs=3), quantity
    for run in made.fields:
        assert (np.abs(run.magnetic_field - [20e-6, 0, -40e-6]) <= 0.06e-6).all()
    for run in made.temperatures:
        np.testing.assert_allclose(run.temperature, 25.0)
    assert not made.errors
    assert driver.continuity == 1
    assert not +driver.counters


def test_gyroscope_and_accelerometer_of_one_slot_belong_together(running):
    made = running('lsm9ds1')
    made.run(0.5)
    for run in made.main:
        assert (np.abs(run.angular_velocity - [0.1, 0, -0.1]) <= 1.2218e-3 / 2).all()


@pytest.mark.parametrize('repeats', [False, True])
@every_bus
def test_no_sample_is_missing_or_doubled_even_if_an_emptied_fifo_repeats(
    driven, make_source, name, kind, repeats
):
    source = numbering(make_source())
    made = driven(name, kind, options={'repeats': repeats}, source=source, accelerometer_range=2.0)
    # no filter in the way of the numbers
    chip = made.buses['']._bus.chip
    settle = chip.settle

    def unfiltered(rate_hz):
        settle(rate_hz)
        for name in ('_filter', '_force_filter'):
            if hasattr(chip, name):
                getattr(chip, name)._sections = None

    chip.settle = unfiltered
    made.bring_up()
    made.run(3.0)
    numbers = np.rint(made.values[:, 0] / COUNT).astype(int)
    assert len(numbers) > 2500
    assert set(np.diff(numbers) % 256) == {1}


@every_chip
def test_samples_that_are_not_settled_are_not_delivered(running, name):
    made = running(name)
    made.run(0.1)
    half = made.driver.acceleration.resolution(16.0).max() / 2
    assert (np.abs(made.values[0] - [0, 0, 9.80665]) <= half * (1 + 1e-9)).all()


@pytest.mark.slow
@pytest.mark.parametrize('stays', [False, True])
def test_each_field_once_whether_or_not_reading_clears_its_flag(clock, make_source, driven, stays):
    source = make_source()
    made = driven('lsm303dlhc', options={'ready_stays': stays}, source=source)
    made.bring_up()
    assert made.driver._ready_stays is stays
    start = clock.now_ns()
    for step in range(100):  # a field that changes from one measurement to the next
        source.values['magnetic_field'] = (1e-6 * step, 0.0, -40e-6)
        made.run(0.05)
    elapsed = (clock.now_ns() - start) * 1e-9
    count = sum(map(len, made.fields))
    if not stays:
        assert count == pytest.approx(75 * elapsed, abs=3)
    seen = np.concatenate([run.magnetic_field for run in made.fields])[:, 0]
    assert (np.diff(seen[2:]) >= -1e-12).all()
    assert len(np.unique(seen)) > 90
    assert count <= 75 * elapsed + 3
    assert made.driver.counters['magnetometer_lost'] == 0


def test_a_field_that_does_not_change_still_arrives_if_its_flag_stays(driven):
    made = driven('lsm303dlhc', options={'ready_stays': True}).bring_up()
    made.run(2.0)
    assert 75 < sum(map(len, made.fields)) <= 150


@every_chip
def test_stamps_of_the_field_are_within_its_period(running, name):
    made = running(name)
    made.run(2.0)
    stamps = np.concatenate([run.stamps for run in made.fields])
    period = 1e9 / made.driver.rates_hz['magnetic_field']
    np.testing.assert_allclose(np.diff(stamps), period, atol=0.75 * period)
    assert np.diff(stamps).mean() == pytest.approx(period, rel=0.02)


@pytest.mark.parametrize(
    ('name', 'settings'),
    [
        ('lsm9ds1', {'rate_hz': 14.9}),
        ('lsm9ds1', {'rate_hz': 119.0, 'accelerometer_bandwidth': 50.0}),
        ('lsm9ds1', {'rate_hz': 238.0, 'gyroscope_low_pass_2': 29.0}),
        ('lsm9ds1', {'magnetometer_rate_hz': 0.0}),
        ('lsm303dlhc', {'rate_hz': 1.0, 'magnetometer_rate_hz': 0.0}),
        ('lsm303dlhc', {'rate_hz': 400.0, 'magnetometer_rate_hz': 220.0}),
    ],
)
def test_other_rates(running, name, settings):
    made = running(name, **settings)
    made.run(2.0)  # turn-on
    made.run(20 / made.driver.rate_hz)
    before, start = made.samples, made.clock.now_ns()
    fields = sum(map(len, made.fields))
    made.run(5.0)
    elapsed = (made.clock.now_ns() - start) * 1e-9
    assert made.samples - before == pytest.approx(made.driver.rate_hz * elapsed, abs=10)
    rate = made.driver.values['magnetometer_rate_hz']
    assert sum(map(len, made.fields)) - fields == pytest.approx(rate * elapsed, abs=3)
    assert not +made.driver.counters


@pytest.mark.slow
def test_the_noise_of_the_shipped_file_is_there_in_the_band(clock):
    acquisition = build(load_sensor(ROOT / 'config' / 'sensors' / 'lsm9ds1.yaml'), clock)
    runs = []
    for _ in range(60):
        acquisition.advance(clock.now_ns() + 1_000_000_000)
        runs += [run.acceleration for run in acquisition.drain() if run.acceleration is not None]
    # means over 25 ms: long for the filter of 408 Hz, short for drift
    values = np.concatenate(runs)
    means = values[: len(values) // 24 * 24].reshape(-1, 24, 3).mean(axis=1)
    measured = np.diff(means, axis=0).std(axis=0) * np.sqrt(24 / (952 * 0.988))
    rounding = 0.732e-3 * 9.80665 / np.sqrt(6 * 952)
    given = np.array([210e-6, 203e-6, 223e-6]) * 9.80665
    np.testing.assert_allclose(measured, np.hypot(given, rounding), rtol=0.06)


def test_a_magnetometer_that_is_off_is_never_asked(driven):
    made = driven('lsm9ds1', magnetometer_rate_hz=0.0)
    made.buses['magnetometer'].inject('no_answer')
    made.bring_up()
    made.run(0.5)
    assert made.samples > 400
    assert made.driver.counters['bus_errors'] == 0
    assert list(made.driver.rates_hz) == ['temperature']


def test_the_zero_of_the_thermometer_can_be_set(running):
    made = running('lsm303dlhc', temperature_zero=21.5)
    made.run(0.2)
    np.testing.assert_allclose(made.temperatures[0].temperature, 26.5)
