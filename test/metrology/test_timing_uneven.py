# SPDX-License-Identifier: Apache-2.0
"""Losses, and none, among stamps that scatter or take steps of two lengths."""

from imu_bench.metrology.stamps import timing
import numpy as np
import pytest


@pytest.mark.parametrize(('rate', 'jitter'), [(300.0, 0.25), (400.0, 0.2), (600.0, 0.1)])
def test_jitter_invents_no_missing_samples_in_milliseconds(rate, jitter):
    """400 Hz was a sensor of 500 Hz that loses one in four, 600 Hz of 1000 Hz."""
    times = np.arange(30_000) + jitter * np.random.default_rng(24).normal(size=30_000)
    found = timing.analyse(np.rint(np.sort(times) * 1e3 / rate).astype(np.int64) * 10**6)
    assert found.missing <= 1
    assert found.rate.value == pytest.approx(rate, rel=2e-4)


@pytest.mark.parametrize(('jitter', 'seeds'), [(0.2, 10), (0.3, 2)])
def test_jitter_invents_no_missing_samples(jitter, seeds):
    """Stamps off by a fifth of a period, as those of a busy host are."""
    held = 0
    for seed in range(seeds):
        times = np.arange(60_000) + jitter * np.random.default_rng([20, seed]).normal(size=60_000)
        found = timing.analyse(np.sort(np.round(times * 1e7).astype(np.int64)))
        assert found.missing == 0
        assert found.rate.high - found.rate.low < 1e-2
        held += found.rate.low < 100.0 < found.rate.high
    assert held >= 0.8 * seeds


def test_losses_are_seen_through_jitter():
    for seed in range(4):
        rng = np.random.default_rng([21, seed])
        times = np.arange(60_000) + 0.2 * rng.normal(size=60_000)
        lost = rng.choice(np.arange(10, 59_990), 100, replace=False)
        found = timing.analyse(np.sort(np.round(np.delete(times, lost) * 1e7).astype(np.int64)))
        assert 90 <= found.missing <= 105
        assert found.rate.low < 100.0 < found.rate.high


@pytest.mark.parametrize('steps_ms', [(26.0, 43.0), (24.0, 46.0), (22.0, 50.0), (20.0, 46.0)])
@pytest.mark.parametrize('by_turns', [True, False])
def test_steps_of_two_lengths_are_no_losses(steps_ms, by_turns):
    """A sensor read on the ticks of something else; the rate is the mean one."""
    rng = np.random.default_rng(22)
    count, share = 1500, (steps_ms[1] - 33.0) / (steps_ms[1] - steps_ms[0])
    ticks = np.floor(np.arange(count + 1) * share)
    first = np.diff(ticks) > 0 if by_turns else rng.random(count) < share
    steps = np.where(first, *steps_ms) + rng.uniform(-0.5, 0.5, count)
    times = np.concatenate([[0.0], np.cumsum(steps)]) * 1e6
    found = timing.analyse(np.round(times).astype(np.int64))
    assert found.missing <= 2
    assert found.rate.value == pytest.approx(1e9 * count / times[-1], rel=0.01)
    # a hole is one all the same
    holed = timing.analyse(np.round(np.delete(times, slice(700, 720))).astype(np.int64))
    assert 18 <= holed.missing <= 22


def test_steps_of_one_and_two_periods_are_losses():
    rng = np.random.default_rng(23)
    times = np.round(np.arange(3000) * 1e7 + 1e5 * rng.normal(size=3000)).astype(np.int64)
    found = timing.analyse(np.delete(times, rng.choice(np.arange(5, 2995), 700, replace=False)))
    assert found.missing == 700 and found.rate.value == pytest.approx(100.0, rel=1e-4)
