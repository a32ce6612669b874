# SPDX-License-Identifier: Apache-2.0
"""SCL3300: driver, acquisition and emulated chip together; faults are named, counted, survived."""

from imu_bench.emulators.faults import Fault
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

RATE = 200.0


def assert_only_true_samples(made):
    for run in made.runs:
        np.testing.assert_allclose(run.acceleration, [[0, 0, 9.80665]], atol=1e-9)
        np.testing.assert_allclose(run.inclination, [[0, 0, np.pi / 2]], atol=1e-4)
        np.testing.assert_allclose(run.temperature, 25.0, atol=0.03)


@pytest.fixture
def starting(acquired):
    return lambda **given: acquired('scl3300', 'frame', **{'mode': 1, 'rate_hz': RATE, **given})


@pytest.fixture
def bench(starting):
    return lambda **given: starting(**given).run(0.5)


@pytest.mark.slow
def test_samples_come_at_the_deadlines_of_the_host(bench):
    made = bench()
    made.run(5.0)
    stamps = made.stamps
    assert np.abs(np.diff(stamps) - 5e6).max() < 1000
    assert made.stats.lost == 0
    assert made.stats.delivered.value == pytest.approx(RATE, rel=1e-3)
    assert 'sets the pace' in made.stats.rate.reason
    assert made.stats.part == 'Murata SCL3300-D01, serial number 1021704154B33'
    assert not +made.driver.counters
    assert not made.errors
    assert_only_true_samples(made)


def test_a_single_bit_error_costs_one_sample(bench):
    made = bench()
    made.bus.inject('bit_error')
    made.run(1.0)
    assert made.errors == {ChecksumError}
    assert made.driver.counters['crc_errors'] == 1
    assert made.stats.lost == 1
    assert made.stats.recoveries == 0
    assert made.driver.continuity == 1
    assert_only_true_samples(made)


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
    before = made.stats.samples
    made.bus.inject(kind, 0.3)
    made.run(0.3)
    assert error in made.errors
    assert made.driver.counters[counter] >= 3
    made.run(2.0)
    assert made.acquisition.error is None
    assert made.stats.recoveries == 1
    # recovered within a second: the rest of two seconds arrived
    assert made.stats.samples - before > 200
    assert made.stats.lost == pytest.approx(2.3 * RATE - (made.stats.samples - before), abs=2)
    assert_only_true_samples(made)
    assert made.driver.counters['brown_outs'] == 0 or kind == 'unplugged'


def test_a_silent_brown_out_is_found_and_no_sample_of_another_mode_delivered(bench):
    made = bench(mode=2)
    made.bus.inject('brown_out')
    made.run(1.0)
    assert made.driver.counters['brown_outs'] == 1
    assert made.driver.continuity == 2
    # 26 ms for the reset, 15 ms for the filter
    assert made.stats.lost == pytest.approx(0.041 * RATE, abs=2)
    assert_only_true_samples(made)


def test_a_reset_by_somebody_else_is_noticed_while_the_chip_starts(bench, clock):
    made = bench()
    made.chip.power_up(clock.now_ns())
    made.run(0.2)
    assert made.driver.counters['brown_outs'] == 1
    assert_only_true_samples(made)


def test_another_part_is_refused(starting):
    made = starting(faults=[Fault('wrong_identity')])
    with pytest.raises(IdentityError, match='SCA3300'):
        made.acquisition.prepare()


@pytest.mark.slow
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


def test_a_chip_whose_flags_do_not_clear_is_not_used(starting, monkeypatch):
    made = starting()
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

    before = made.stats.samples
    monkeypatch.setattr(made.bus, 'transfer', late)
    made.run(0.2)
    assert made.stats.samples == before
    assert FrameError in made.errors
    assert made.driver.counters['frame_errors'] > 0
    assert not issubclass(FrameError, BusError)


def test_a_held_bus_makes_a_gap_that_is_counted(bench):
    made = bench()
    made.bus.inject('stall', 0.1)
    made.run(1.0)
    assert made.stats.lost == pytest.approx(0.1 * RATE, abs=1)
    assert not made.errors
    assert_only_true_samples(made)
