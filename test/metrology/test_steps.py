# SPDX-License-Identifier: Apache-2.0
"""Stands between steps are found where they are, and nowhere else."""

from imu_bench.errors import DataError
from imu_bench.metrology.trials.steps import find_stands
import numpy as np
import pytest

RATE = 100.0


def staircase(levels, *, dwell=20.0, move=3.0, noise=0.0, seed=1):
    """Return a signal that stands at every level, with straight moves in between."""
    times, values = [], []
    now = 0.0
    for level in levels:
        times += [now, now + dwell]
        values += [level, level]
        now += dwell + move
    t = np.arange(0.0, now - move, 1.0 / RATE)
    return np.interp(t, times, values) + np.random.default_rng(seed).normal(0.0, noise, t.size)


def test_every_stand_is_found_and_no_move_is_in_it():
    levels = [0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.0]
    found = find_stands(staircase(levels, noise=0.3), RATE).stands
    assert [round(stand.level) for stand in found] == levels
    for number, stand in enumerate(found):
        begin, end = 23.0 * number, 23.0 * number + 20.0
        assert begin <= stand.begin / RATE < begin + 3.0
        assert end - 3.0 < stand.end / RATE <= end
    assert [stand.level for stand in found] == pytest.approx(levels, abs=0.05)


def test_steps_far_below_the_noise_of_a_sample_are_found():
    """The steps of table 4, 0.058°, with ten times the σ of the sensor there (3σ of 0.0164°)."""
    fine = staircase(np.arange(7) * 0.058, noise=0.055)
    assert len(find_stands(fine, RATE, dwell_s=10.0).stands) == 7


@pytest.mark.parametrize('seed', range(20))
def test_noise_alone_has_no_steps(seed):
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=60_000)
    assert len(find_stands(noise, RATE).stands) == 1
    # and flicker noise, as a sum of first-order processes
    flicker = sum(
        np.convolve(rng.normal(size=60_000), np.exp(-np.arange(4000) / time) / time, 'same')
        * np.sqrt(time)
        for time in (10.0, 100.0, 1000.0)
    )
    assert len(find_stands(flicker, RATE, dwell_s=20.0).stands) <= 3


def test_spikes_are_no_steps():
    values = staircase([0.0, 1.0], noise=0.1)
    values[300] = values[3300] = 50.0
    assert len(find_stands(values, RATE).stands) == 2


def test_a_shaken_move_is_left_out():
    values = staircase([0.0, 1.0, 0.0], noise=0.02)
    rng = np.random.default_rng(4)
    values[2000:2300] += rng.normal(0.0, 5.0, 300)
    values[4300:4600] += rng.normal(0.0, 5.0, 300)
    found = find_stands(values, RATE).stands
    assert [stand.level for stand in found] == pytest.approx([0.0, 1.0, 0.0], abs=0.01)


def test_without_noise_too():
    assert [round(s.level) for s in find_stands(staircase([0, 5, 0]), RATE).stands] == [0, 5, 0]
    assert len(find_stands(np.full(6000, 7.0), RATE).stands) == 1


def test_too_short_or_too_slow_is_said():
    with pytest.raises(DataError, match='3 s are too short for two stands of 5 s'):
        find_stands(np.zeros(300), RATE)
    with pytest.raises(DataError, match='1 Hz is too slow'):
        find_stands(np.zeros(300), 1.0)
