# SPDX-License-Identifier: Apache-2.0
"""
Stamps by a data-ready line against the truth, for every chip that has one.

The truth is the source's: its own stamps, and a step of the acceleration at a known time, by which
a stamp that is off by a whole sample is found.
"""

from functools import cache

from imu_bench import bench
from imu_bench.acquisition import Acquisition
from imu_bench.config import SensorConfig
from imu_bench.drivers import load, names
from imu_bench.emulators import create
from imu_bench.errors import ConfigError
from imu_bench.samples import Samples
from imu_bench.simulation.clock import SimulatedClock
import numpy as np
import pytest

WITH_PIN = [
    (name, kind) for name in names() if load(name).data_ready_pin for kind in load(name).bus_kinds
]
RATE_ERRORS = {'i2c': -0.03, 'spi': 0.02}
RUN_S, STEP_S, SETTLED_S = 6.0, 5.0, 3.0


class Step:
    """A source whose acceleration steps at a known time, at a rate that is not the nominal one."""

    def __init__(self, clock, rate_error):
        self.step_ns = clock.now_ns() + round(STEP_S * 1e9)
        self.rate_error = rate_error
        self.stamps = []
        self.restart(clock.now_ns(), 1000.0)

    def restart(self, t_ns, nominal_hz=None):
        self.nominal_hz = nominal_hz or self.nominal_hz
        self.period_ns = 1e9 / (self.nominal_hz * (1 + self.rate_error))
        self.anchor_ns, self.made = t_ns, 0
        # what was made ahead of it was never shown
        self.stamps = [stamps[stamps <= t_ns] for stamps in self.stamps]

    def samples_ahead(self, t_ns):
        # what costs by the call is paid for many samples at once, as with a simulated sensor
        return self.samples_until(t_ns + round(64 * self.period_ns))

    def samples_until(self, t_ns):
        due = max(int((t_ns - self.anchor_ns) / self.period_ns), self.made)
        k = np.arange(self.made + 1, due + 1)
        self.made = due
        stamps = self.anchor_ns + np.rint(k * self.period_ns).astype(np.int64)
        self.stamps.append(stamps)
        moving = np.where(stamps < self.step_ns, 0.0, 10.0)
        return Samples(
            stamps,
            np.column_stack([moving, moving, moving]),
            np.zeros((len(k), 3)),
            magnetic_field=np.full((len(k), 3), 20e-6),
            temperature=np.full(len(k), 25.0),
        )


class Run:
    """What came of a chip with or without a line."""

    def __init__(self, name, kind, wired, rate_error=0.02, silent_after_s=None):
        clock = SimulatedClock()
        self.source = Step(clock, rate_error)
        buses = create(name, kind, self.source, clock, lines=('data_ready',) if wired else ())
        clock.sleep(load(name).start_up_s)
        self.driver = load(name)(buses, clock, {})
        self.acquisition = Acquisition(self.driver, clock, capacity_samples=1 << 30, name=name)
        start = clock.now_ns()
        if silent_after_s is not None:
            self.acquisition.advance(start + round(silent_after_s * 1e9))
            buses[''].chip.pin = None
        self.acquisition.advance(start + round(RUN_S * 1e9))
        runs = [run for run in self.acquisition.drain() if run.acceleration is not None]
        self.stamps = np.concatenate([run.stamps for run in runs])
        self.values = np.concatenate([run.acceleration[:, 2] for run in runs])
        self.period_ns = self.source.period_ns
        self.start_ns = start

    def errors(self):
        """Return by how much settled stamps are off the nearest sample that was made, ns."""
        truth = np.concatenate(self.source.stamps)
        stamps = self.stamps[self.stamps > self.start_ns + SETTLED_S * 1e9]
        right = np.searchsorted(truth, stamps).clip(1, len(truth) - 1)
        off = np.stack([stamps - truth[right - 1], stamps - truth[right]])
        return off[np.abs(off).argmin(axis=0), np.arange(len(stamps))]

    def crossing_ns(self):
        """Return when half of the step was passed, counted from the first sample behind it."""
        truth = np.concatenate(self.source.stamps)
        behind_ns = truth[np.searchsorted(truth, self.source.step_ns)]
        k = int(np.argmax(self.values > 5.0))
        share = (5.0 - self.values[k - 1]) / (self.values[k] - self.values[k - 1])
        return self.stamps[k - 1] + share * self.period_ns - behind_ns


@cache
def ran(name, kind, wired):
    return Run(name, kind, wired, RATE_ERRORS[kind])


@pytest.mark.slow
@pytest.mark.parametrize(('name', 'kind'), WITH_PIN)
def test_stamps_by_the_line_are_right_to_20_us(name, kind):
    by_line, polled = (ran(name, kind, wired) for wired in (True, False))
    assert np.sqrt(np.mean(np.square(by_line.errors()))) <= 20e3
    # and not off by a whole sample, which polling cannot be
    assert abs(by_line.crossing_ns() - polled.crossing_ns()) < 0.4 * by_line.period_ns
    counters = by_line.driver.counters
    assert counters['edges'] > counters['edges_unused']
    stats = by_line.acquisition.stats
    assert (stats.lost, stats.failures) == (0, 0)
    assert 'edges' not in polled.driver.counters


@pytest.mark.slow
@pytest.mark.parametrize('wired', [True, False])
@pytest.mark.parametrize(('name', 'kind'), WITH_PIN)
def test_the_uncertainty_of_stamps_holds(name, kind, wired):
    run = ran(name, kind, wired)
    bound = run.acquisition.stats.stamp_uncertainty
    assert bound.unit == 's'
    held = np.abs(run.errors()) <= bound.high * 1e9
    assert held.mean() >= 0.95
    # and is worth something
    assert bound.high < (30e-6 if wired else 0.5e-9 * run.period_ns)


@pytest.mark.slow
@pytest.mark.parametrize(('name', 'kind'), [(n, k) for n, k in WITH_PIN if k == 'i2c'])
def test_a_line_that_falls_off_leaves_polling(name, kind):
    run = Run(name, kind, True, silent_after_s=3.0)
    assert np.abs(run.errors()).max() < 0.2 * run.period_ns
    assert run.acquisition.stats.lost == 0


def test_a_line_at_a_sensor_without_a_pin_is_refused(tmp_path):
    path = tmp_path / 'tilt.yaml'
    path.write_text(
        '/**:\n  ros__parameters:\n    driver: scl3300\n    backend: emulated\n'
        '    data_ready: gpiochip0:17\n'
    )
    with pytest.raises(ConfigError, match=r'data_ready: a scl3300 has no such pin.*mpu9250'):
        bench.load_sensor(path)


def test_a_sensor_of_a_bench_is_wired_up_and_its_recording_plays_the_same(tmp_path):
    path = str(tmp_path / 'chip.wire')
    clock = SimulatedClock()
    sensor = SensorConfig(
        'chip', 'mpu9250', 'emulated', data_ready='gpiochip0:17', wire_recording=path,
        settings=load('mpu9250').check_settings({}),
    )  # fmt: skip
    acquisition = bench.build(sensor, clock)
    acquisition.advance(clock.now_ns() + 3_000_000_000)
    acquisition.finish()
    live = acquisition.drain()
    assert acquisition.stats.counters['edges'] > 100
    played, _ = bench.play(path)
    for one, other in zip(live, played, strict=True):
        np.testing.assert_array_equal(one.stamps, other.stamps)
