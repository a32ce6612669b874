# SPDX-License-Identifier: Apache-2.0
"""Four BNO055 on one slow line: what is read is delivered once, dated as well as can be known."""

from dataclasses import replace
import heapq

from imu_bench.acquisition import Acquisition
from imu_bench.drivers import load
from imu_bench.emulators import create
from imu_bench.emulators.line import Line, Timing
from imu_bench.samples import Samples
from imu_bench.simulation.clock import SimulatedClock
import numpy as np
import pytest

SECOND = 1_000_000_000
STEP = 0.01  # m/s² per sample number: one LSB
ERRORS = (0.0, 0.004, -0.007, 0.01)


class Counting:
    """A source whose sample number is on x: 0.01 m/s² each, from -150 m/s² on."""

    def __init__(self, clock, rate_error):
        self._error = rate_error
        self.restart(clock.now_ns(), 100.0)

    def restart(self, t_ns, nominal_hz=100.0):
        self.period_ns = 1e9 / (nominal_hz * (1 + self._error))
        self.anchor_ns, self._made = t_ns, 0

    def samples_until(self, t_ns):
        due = max(int((t_ns - self.anchor_ns) / self.period_ns), self._made)
        k = np.arange(self._made + 1, due + 1)
        self._made = due
        force = np.zeros((len(k), 3))
        force[:, 0] = k * STEP - 150.0
        still = np.zeros((len(k), 3))
        return Samples(self.true_ns(k).astype(np.int64), force, still, still)

    def true_ns(self, k):
        return self.anchor_ns + np.rint(np.asarray(k) * self.period_ns)


@pytest.fixture(scope='module')
def desk():
    clock = SimulatedClock()
    # a bus that is full already; stretching would only make it fuller
    line = Line(clock, replace(Timing.i2c(50e3), stretchable=False))
    made = []
    for error in ERRORS:
        source = Counting(clock, error)
        buses = create('bno055', 'i2c', source, clock, line=line)
        clock.sleep(0.5)
        driver = load('bno055')(buses, clock, {'mode': 'amg', 'accelerometer_range': 16.0})
        made.append((source, Acquisition(driver, clock, name=f'{error:+}'), []))
    for _, acquisition, _ in made:
        acquisition.prepare()
    due = []
    for k, (_, acquisition, _) in enumerate(made):
        acquisition.advance(clock.now_ns())
        heapq.heappush(due, (clock.now_ns(), k))
    until_ns = clock.now_ns() + 20 * SECOND
    while due[0][0] < until_ns:
        at_ns, k = heapq.heappop(due)
        clock.sleep_until(at_ns)
        _, acquisition, runs = made[k]
        heapq.heappush(due, (acquisition.step(), k))
        runs += [run for run in acquisition.drain() if run.acceleration is not None]
    return made


@pytest.mark.parametrize('place', range(len(ERRORS)))
def test_what_is_read_is_delivered_once_and_the_rest_counted(desk, place):
    source, acquisition, runs = desk[place]
    numbers = np.rint(np.concatenate([run.acceleration[:, 0] for run in runs]) / STEP + 15000)
    stamps = np.concatenate([run.stamps for run in runs])
    steps = np.diff(numbers)
    assert (steps > 0).all()
    assert (np.diff(stamps) > 0).all()
    assert steps[5:].max() <= 4
    # one look after the other on the line; some find nothing new
    looks_hz = 1 / (4 * Timing.i2c(50e3).read_ns(18) * 1e-9)
    assert 0.9 * looks_hz < len(numbers) / 20.0 < 1.01 * looks_hz
    off_ns = stamps - source.true_ns(numbers)
    # nobody can know it better; readings are on the line for 4 ms, once a second for 10
    assert np.quantile(np.abs(off_ns), 0.98) < 0.5 * source.period_ns + 2_000_000
    assert np.abs(off_ns[5:]).max() < 0.5 * source.period_ns + 5_000_000
    assert abs(np.mean(off_ns)) < 2_000_000
    stats = acquisition.stats
    made = numbers[-1] - numbers[0] + 1
    assert stats.lost == pytest.approx(made - len(numbers), abs=2 + 0.011 * made)
    assert stats.counters['undated'] > 0.9 * len(numbers)
    assert not stats.rate.observable
    assert 'too seldom' in stats.rate.reason
