# SPDX-License-Identifier: Apache-2.0
"""SCL3300: driver, acquisition and emulated chip together; faults are named, counted, survived."""

from imu_bench.acquisition import Acquisition
from imu_bench.drivers import load
from imu_bench.emulators import create
from imu_bench.emulators.faults import Fault, wrap
from imu_bench.errors import (
    BusBusy,
    BusError,
    ChecksumError,
    FrameError,
    IdentityError,
    NoAnswer,
    NotReady,
    PermissionDenied,
)
import numpy as np
import pytest

DRIVER = load('scl3300')
RATE = 200.0


class Bench:
    """A driver on an emulated bus with faults, and what came out of the acquisition."""

    def __init__(self, clock, source, faults=(), **settings):
        self.clock, self.source = clock, source
        chip = create('scl3300', 'frame', source, clock)
        self.chip = chip[''].chip
        self.bus = wrap(chip, DRIVER, clock, faults)['']
        self.driver = DRIVER(self.bus, clock, {'mode': 1, 'rate_hz': RATE, **settings})
        self.acquisition = Acquisition(self.driver, clock, name='scl3300')
        self.errors = set()
        self.runs = []
        clock.sleep(0.05)

    def run(self, seconds):
        end = self.clock.now_ns() + round(seconds * 1e9)
        while self.clock.now_ns() < end:
            self.acquisition.advance(min(self.clock.now_ns() + 5_000_000, end))
            self.runs += self.acquisition.drain()
            if self.acquisition.error is not None:
                self.errors.add(type(self.acquisition.error))

    @property
    def samples(self):
        return sum(map(len, self.runs))

    @property
    def stats(self):
        return self.acquisition.stats

    def assert_only_true_samples(self):
        for run in self.runs:
            np.testing.assert_allclose(run.acceleration, [[0, 0, 9.80665]], atol=1e-9)
            np.testing.assert_allclose(run.inclination, [[0, 0, np.pi / 2]], atol=1e-4)
            np.testing.assert_allclose(run.temperature, 25.0, atol=0.03)


@pytest.fixture
def bench(clock, make_source):
    def make(**settings):
        made = Bench(clock, make_source(), **settings)
        made.run(0.5)
        return made

    return make


def test_samples_come_at_the_deadlines_of_the_host(bench):
    made = bench()
    made.run(5.0)
    stamps = np.concatenate([run.stamps for run in made.runs])
    assert np.abs(np.diff(stamps) - 5e6).max() < 1000
    assert made.stats.lost == 0
    assert made.stats.delivered.value == pytest.approx(RATE, rel=1e-3)
    assert 'sets the pace' in made.stats.rate.reason
    assert made.stats.part == 'Murata SCL3300-D01, serial number 1021704154B33'
    assert not +made.driver.counters
    assert not made.errors
    made.assert_only_true_samples()


def test_a_single_bit_error_costs_one_sample(bench):
    made = bench()
    made.bus.inject('bit_error')
    made.run(1.0)
    assert made.errors == {ChecksumError}
    assert made.driver.counters['crc_errors'] == 1
    assert made.stats.lost == 1
    assert made.stats.recoveries == 0
    assert made.driver.continuity == 1
    made.assert_only_true_samples()


@pytest.mark.parametrize(
    ('kind', 'error', 'counter'),
    [
        ('bit_errors', ChecksumError, 'crc_errors'),
        ('garbage', ChecksumError, 'crc_errors'),
        ('no_answer', NoAnswer, 'bus_errors'),
        ('unplugged', NoAnswer, 'bus_errors'),
        ('stuck', BusBusy, 'bus_errors'),
        ('permission_denied', PermissionDenied, 'bus_errors'),
    ],
)
def test_a_burst_of_errors_is_named_counted_and_survived(bench, kind, error, counter):
    made = bench()
    before = made.samples
    made.bus.inject(kind, 0.3)
    made.run(0.3)
    assert error in made.errors
    assert made.driver.counters[counter] >= 3
    made.run(2.0)
    assert made.acquisition.error is None
    assert made.stats.recoveries == 1
    # recovered within a second: the rest of two seconds arrived
    assert made.samples - before > 200
    assert made.stats.lost == pytest.approx(2.3 * RATE - (made.samples - before), abs=2)
    made.assert_only_true_samples()
    assert made.driver.counters['brown_outs'] == 0 or kind == 'unplugged'


def test_a_silent_brown_out_is_found_and_no_sample_of_another_mode_delivered(bench):
    made = bench(mode=2)
    made.bus.inject('brown_out')
    made.run(1.0)
    assert made.driver.counters['brown_outs'] == 1
    assert made.driver.continuity == 2
    # 26 ms for the reset, 15 ms for the filter
    assert made.stats.lost == pytest.approx(0.041 * RATE, abs=2)
    made.assert_only_true_samples()


def test_a_reset_by_somebody_else_is_noticed_while_the_chip_starts(bench, clock):
    made = bench()
    made.chip.power_up(clock.now_ns())
    made.run(0.2)
    assert made.driver.counters['brown_outs'] == 1
    made.assert_only_true_samples()


def test_another_part_is_refused(clock, make_source):
    made = Bench(clock, make_source(), faults=[Fault('wrong_identity')])
    with pytest.raises(IdentityError, match='SCA3300'):
        made.acquisition.prepare()


def test_a_defective_self_test_is_reported_and_the_chip_reset(bench):
    made = bench()
    made.chip.self_test = 2000
    made.run(1.5)
    assert made.errors == {NotReady}
    assert made.driver.counters['self_test_exceeded'] > 150
    assert made.driver.counters['chip_errors'] == 1
    made.chip.self_test = 10
    made.run(1.0)
    assert made.acquisition.error is None


def test_a_chip_whose_flags_do_not_clear_is_not_used(clock, make_source, monkeypatch):
    made = Bench(clock, make_source())
    chip = made.chip
    monkeypatch.setattr(type(chip), '_return_status', lambda self: 3 if self.error_flags[1] else 1)
    with pytest.raises(NotReady, match=r'start-up failed: STATUS 0x0000 .nothing'):
        made.acquisition.prepare()


def test_frames_of_another_time_are_not_taken(bench, monkeypatch):
    made = bench()
    original, held = made.bus.transfer, []

    def late(frame):
        held.append(original(frame))
        return held.pop(0) if len(held) > 1 else held[0]

    before = made.samples
    monkeypatch.setattr(made.bus, 'transfer', late)
    made.run(0.2)
    assert made.samples == before
    assert FrameError in made.errors
    assert made.driver.counters['frame_errors'] > 0
    assert not issubclass(FrameError, BusError)


def test_a_held_bus_makes_a_gap_that_is_counted(bench):
    made = bench()
    made.bus.inject('stall', 0.1)
    made.run(1.0)
    assert made.stats.lost == pytest.approx(0.1 * RATE, abs=1)
    assert not made.errors
    made.assert_only_true_samples()
