# SPDX-License-Identifier: Apache-2.0
"""Stamps from counts: the period is the chip's, losses are counted, time never goes back."""

from hypothesis import given, settings
from hypothesis import strategies as st
from imu_bench.acquisition.clock_model import ClockModel, lower_edge
from imu_bench.errors import NotReady
import numpy as np
import pytest

EPOCH = 1_700_000_000_000_000_000


class Readings:
    """
    A chip in plain numbers, read as the acquisition reads: every `poll_s`, shifted within a
    period by the golden ratio, and late by up to `delay_s`.
    """

    def __init__(self, rate_hz, error=0.0, poll_s=0.02, delay_s=1e-3, seed=0):
        self.rng = np.random.default_rng(seed)
        self.period = 1.0 / (rate_hz * (1.0 + error))
        self.phase = self.rng.uniform(0.0, self.period)
        self.poll_s, self.delay_s = poll_s, delay_s
        self.model = ClockModel(rate_hz)
        self.turn, self.count, self.now = 0, 0, 0.0
        self.stamps, self.true = [], []
        self._waiting = []

    def read(self, until_s):
        while (self.turn + 1) * self.poll_s < until_s:
            self.turn += 1
            shift = self.turn * 0.618034 % 1.0 * min(self.period, 0.5 * self.poll_s)
            late = self.turn * self.poll_s + shift + self.rng.uniform(0.0, self.delay_s)
            # a reading never begins before the one before it has ended
            self.now = max(self.now, late)
            made = int((self.now - self.phase) // self.period) + 1
            self.take(made - self.count, self.now, made)

    def take(self, n, now, made):
        self._waiting.append(np.arange(made - n, made))
        self.count = made
        self.model.observe(n, EPOCH + round(now * 1e9))
        if not self.model.settling:
            self.release()

    def release(self):
        for numbers in self._waiting:
            if numbers.size:
                self.stamps.append(self.model.stamps(numbers.size))
                self.true.append(self.phase + numbers * self.period)
        self._waiting = []

    @property
    def errors(self):
        """Return stamps less truth, s."""
        return (np.concatenate(self.stamps) - EPOCH) * 1e-9 - np.concatenate(self.true)

    @property
    def intervals(self):
        return np.diff(np.concatenate(self.stamps)) * 1e-9


@pytest.mark.parametrize('rate_hz', [100.0, 400.0, 952.0, 1000.0, 1344.0])
@pytest.mark.parametrize('error', [-0.05, 0.0, 40e-6, 0.03])
def test_the_published_period_is_the_chips_with_jitter_below_20_us(rate_hz, error):
    chip = Readings(rate_hz, error)
    chip.read(40.0)
    assert chip.intervals.std() < 20e-6
    late = chip.intervals[round(5 * rate_hz) :]
    assert late.mean() == pytest.approx(chip.period, rel=1e-4)
    assert late.std() < 5e-6
    assert chip.model.rate().value == pytest.approx(1 / chip.period, rel=2e-5)


def test_stamps_are_those_of_the_measurement_not_of_the_reading():
    chip = Readings(1000.0, 0.01)
    chip.read(60.0)
    settled = chip.errors[10_000:]
    assert abs(settled.mean()) < 100e-6
    assert settled.std() < 20e-6


def test_readings_that_are_very_late_now_and_then_change_nothing():
    chip = Readings(1000.0, 0.01)
    quiet = Readings(1000.0, 0.01)
    for second in range(1, 31):
        chip.read(second)
        quiet.read(second)
        chip.turn += 1  # the host was away for one more poll period, and found all samples
    assert chip.errors[5000:].std() < 30e-6
    assert chip.model.missing == quiet.model.missing == 0


@pytest.mark.parametrize('rate_hz', [100.0, 1000.0, 1344.0])
@pytest.mark.parametrize('lost', [1, 2, 57, 5000])
def test_a_loss_is_counted_exactly_and_shows_as_a_gap(rate_hz, lost):
    chip = Readings(rate_hz, 0.02, seed=lost)
    chip.read(20.0)
    chip.model.interrupt()
    chip.turn += int(np.ceil(lost * chip.period / chip.poll_s))
    chip.count += lost
    chip.read(20.0 + lost * chip.period + 20.0)
    assert chip.model.missing == lost
    gap = chip.intervals.max()
    # the period of 20 s is known to some ppm, which a gap of a minute shows
    assert gap == pytest.approx((lost + 1) * chip.period, rel=1e-5, abs=0.01 * chip.period)
    assert abs(chip.errors[-1000:]).max() < 0.1 * chip.period


def test_the_period_is_kept_through_a_loss():
    chip = Readings(1000.0, 0.03)
    chip.read(20.0)
    before = chip.model.period_ns
    chip.model.interrupt()
    chip.count += 300
    chip.turn += 15
    chip.read(21.5)
    assert chip.model.period_ns == pytest.approx(before, rel=2e-5)


def test_a_long_outage_counts_what_the_chip_would_have_made():
    chip = Readings(1000.0, 0.01)
    chip.read(20.0)
    chip.model.interrupt()
    chip.turn += 50 * 600
    made = 600 * 1010
    chip.count += made
    chip.read(640.0)
    assert chip.model.missing == pytest.approx(made, rel=1e-4)


@pytest.mark.parametrize('late', [0, 5, 40])
@pytest.mark.parametrize('lost', [3, 99])
def test_a_loss_that_is_told_from_one_late_reading_is_counted_right_in_the_end(lost, late):
    """A FIFO that runs over while an overrun is read out: two interruptions, one reading."""
    chip = Readings(1000.0, error=0.01)
    chip.read(3.0)
    chip.model.interrupt()
    made = chip.count + lost + 32
    chip.take(32, chip.phase + (made + late) * chip.period, made)
    chip.model.interrupt()
    chip.now = chip.phase + (made + late) * chip.period
    chip.turn = int(chip.now / chip.poll_s)
    chip.read(6.0)
    assert abs(chip.model.missing - lost) <= 1
    assert (chip.intervals > 0).all()


def test_an_interruption_without_loss_leaves_no_gap():
    chip = Readings(1000.0, 0.01)
    chip.read(10.0)
    chip.model.interrupt()
    chip.read(20.0)
    assert chip.model.missing == 0
    assert chip.intervals.max() < 1.01 * chip.period


def test_a_chip_that_stalls_and_does_not_say_so_is_found_out():
    chip = Readings(1000.0)
    chip.read(15.0)
    chip.phase += 3.0  # its oscillator stood still for three seconds
    chip.turn += 150
    chip.read(40.0)
    assert chip.model.missing == pytest.approx(3000, abs=1)
    assert abs(chip.errors[-5000:]).max() < 1.5e-3


def test_samples_are_held_back_until_the_model_has_settled():
    model = ClockModel(1000.0)
    model.observe(20, EPOCH)
    assert model.settling
    with pytest.raises(NotReady, match='settle'):
        model.stamps(20)
    assert not model.rate().observable
    model.settle()
    stamps = model.stamps(20)
    assert stamps[-1] == EPOCH
    np.testing.assert_allclose(np.diff(stamps), 1e6, rtol=2e-3)


def test_a_reading_without_samples_says_nothing():
    model = ClockModel(10.0)
    for i in range(40):
        model.observe(0, EPOCH + i * 10_000_000)
    assert model.settling


@given(
    seed=st.integers(0, 2**32 - 1),
    rate_hz=st.floats(5.0, 4000.0),
    error=st.floats(-0.1, 0.1),
    delay_s=st.floats(0.0, 0.02),
    losses=st.lists(st.tuples(st.floats(0.05, 3.0), st.integers(0, 3000)), max_size=4),
)
@settings(max_examples=60, deadline=None)
def test_stamps_rise_and_no_sample_is_invented_whatever_happens(
    seed, rate_hz, error, delay_s, losses
):
    chip = Readings(rate_hz, error, delay_s=delay_s, seed=seed)
    until = 0.0
    for pause, lost in losses:
        until = chip.turn * chip.poll_s + pause
        chip.read(until)
        chip.model.settle()
        chip.release() if not chip.model.settling else None
        chip.model.interrupt()
        chip.turn += int(np.ceil(lost * chip.period / chip.poll_s))
        chip.count += lost
    chip.read(until + 2.0 + sum(lost for _, lost in losses) * chip.period)
    chip.model.settle()
    if not chip.model.settling:
        chip.release()
    given = sum(stamps.size for stamps in chip.stamps)
    assert given + sum(lost for _, lost in losses) == chip.count
    if given > 1:
        assert (chip.intervals > 0).all()


@pytest.mark.parametrize('seed', range(5))
def test_the_interval_of_the_rate_holds_the_true_one(seed):
    chip = Readings(1000.0, 0.013, seed=seed)
    for until in (8.0, 20.0, 50.0):
        chip.read(until)
        rate = chip.model.rate()
        assert rate.low <= 1 / chip.period <= rate.high


def test_the_lower_edge_supports_every_point():
    rng = np.random.default_rng(3)
    for _ in range(50):
        k = np.sort(rng.choice(1000, 30, replace=False)).astype(float)
        t = 2.0 * k + rng.exponential(5.0, 30)
        (k0, t0), (k1, t1) = lower_edge(list(zip(k, t, strict=True)))
        line = t0 + (t1 - t0) / (k1 - k0) * (k - k0)
        assert (t - line > -1e-9).all()
        assert k0 <= k.mean() <= k1
