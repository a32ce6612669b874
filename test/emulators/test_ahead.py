# SPDX-License-Identifier: Apache-2.0
"""
Samples made into words before they are due, and short waits put together.

The witness is the same chip on a source that never hands out a sample before its time, so that
all is converted one by one when it is asked for.
"""

from dataclasses import fields

from imu_bench.acquisition import Acquisition
from imu_bench.config import SensorConfig
from imu_bench.drivers import load, names
from imu_bench.emulators import create
from imu_bench.emulators.ahead import Ahead
from imu_bench.emulators.line import SHORT_NS, Waiting
from imu_bench.samples import Samples
from imu_bench.simulation.chip import SensorSource
from imu_bench.simulation.clock import SimulatedClock
from imu_bench.simulation.motion import Still
from imu_bench.simulation.sensor_errors import Errors
from imu_bench.simulation.sensor_model import ErrorModel
from imu_bench.simulation.world import sensor_source
import numpy as np
import pytest

MS = 1_000_000
# the converters of the MTN/1100 are asked for what they have converted: nothing is made ahead
CASES = [(name, kind) for name in names() if name != 'mtn1100' for kind in load(name).bus_kinds]


class InTime:
    """A source that hands out nothing before it is due."""

    def __init__(self, source):
        self.samples_until, self.restart = source.samples_until, source.restart


def delivered(name, kind, around):
    """Return what a sensor delivers that is configured anew twice while its samples wait."""
    clock = SimulatedClock()
    driver = load(name)
    config = SensorConfig('mine', name, 'emulated', simulation={'rate_error': (0.003,)})
    source = sensor_source(config, driver.typical, 1.0, clock.now_ns(), on_wire=True)
    buses = create(name, kind, around(source), clock)
    clock.sleep(driver.start_up_s)
    device = driver(buses, clock, {})
    acquisition = Acquisition(device, clock)
    runs = []
    for k in range(30):
        acquisition.advance(clock.now_ns() + 77 * MS)
        runs += acquisition.drain()
        if k in (10, 19):
            device.configured = False  # as after a brown-out: the next reading begins anew
    acquisition.finish()
    return runs + acquisition.drain(), acquisition.stats.counters


@pytest.mark.parametrize(('name', 'kind'), CASES)
def test_a_chip_shows_the_same_whether_its_words_are_made_ahead_or_in_time(name, kind):
    ahead, counted = delivered(name, kind, lambda source: source)
    in_time, counted_in_time = delivered(name, kind, InTime)
    assert counted == counted_in_time
    assert len(ahead) == len(in_time) > 5
    for one, two in zip(ahead, in_time, strict=True):
        for field in fields(Samples):
            mine, other = getattr(one, field.name), getattr(two, field.name)
            assert (mine is None) == (other is None), field.name
            assert mine is None or mine.tobytes() == other.tobytes(), field.name


class Sum:
    """The sum of all stamps in ms so far, times a gain: what it carries on is the sum."""

    def __init__(self):
        self.state, self.gain = 0, 1

    def convert(self, samples):
        sums = self.state + np.cumsum(samples.stamps // MS)
        self.state = int(sums[-1])
        return (self.gain * sums).tolist()


def test_a_setting_holds_from_the_next_sample_on_and_filters_go_on():
    source = SensorSource(Still(), ErrorModel({'temperature': Errors()}), 1000.0, start_ns=0)
    total = Sum()
    ahead = Ahead(source, total.convert, lambda: (total,))

    def shown(until_ms):
        return [x for due in ahead.until(until_ms * MS) for x in due.rows[due.first : due.last]]

    assert shown(3) == [1, 3, 6]
    ahead.rewind()
    total.gain = 100
    assert shown(3) == []
    ahead.rewind()
    total.gain = 10
    assert shown(5) == [100, 150]
    # over the end of the block of 250
    assert shown(600)[-1] == 10 * 600 * 601 // 2
    ahead.restart(700 * MS, 100.0)
    total.state = 0
    assert shown(725) == [10 * 710, 10 * (710 + 720)]


class Counting(SimulatedClock):
    """A clock that counts how often somebody waits for it."""

    waits = 0

    def sleep_until(self, deadline_ns):
        self.waits += deadline_ns > self.now_ns()
        super().sleep_until(deadline_ns)


def test_short_waits_are_put_together_and_the_clock_is_never_far_ahead():
    rng = np.random.default_rng(4)
    real = Counting(start_ns=0)
    clock = Waiting(real)
    waits = rng.choice([50_000, 130_000, 400_000, 2_900_000], size=4000).tolist()
    shown = 0
    for wait in waits:
        clock.sleep_until(clock.now_ns() + wait)
        shown += wait
        assert clock.now_ns() == shown
        assert 0 <= shown - real.now_ns() <= SHORT_NS
    assert len(waits) / 4 < real.waits < len(waits) / 1.8
    clock.sleep(5e-3)
    assert clock.now_ns() == real.now_ns() == shown + 5 * MS
