# SPDX-License-Identifier: Apache-2.0
"""The noise processes against their definition: the Allan variance of IEEE Std 952-1997."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st
from imu_bench.simulation.noise import (
    correlation_times,
    Flicker,
    flicker_filter,
    Quantisation,
    RandomWalk,
    White,
)
import numpy as np
import pytest
from scipy.signal import sosfreqz

PROCESSES = (White, Flicker, RandomWalk, Quantisation)
PERIODS = (300.0, 10.0, 0.1, 2.5e-3, 1e-3, 1 / 1344, 1e-4)


def allan_deviation(samples, factor):
    """Return the overlapping Allan deviation of columns at one averaging factor, by definition."""
    phase = np.concatenate([np.zeros((1, samples.shape[1])), np.cumsum(samples, axis=0)])
    second = phase[2 * factor :] - 2 * phase[factor:-factor] + phase[: -2 * factor]
    return math.sqrt(np.mean(second**2) / 2) / factor


def made(process, coefficient, n, period_s, axes=24, seed=1):
    streams = np.random.default_rng(seed).spawn(axes)
    return np.stack([process(coefficient, rng).sample(n, period_s) for rng in streams], axis=1)


@pytest.mark.parametrize('rate_hz', [50.0, 100.0, 800.0])
def test_white_noise_has_the_same_density_at_every_rate(rate_hz):
    samples = made(White, 3.0, 60_000, 1 / rate_hz)
    one_second = allan_deviation(samples, round(rate_hz))
    assert one_second == pytest.approx(3.0 / math.sqrt(2), rel=0.02)


@pytest.mark.parametrize('period_s', [1e-3, 0.1, 10.0, 300.0])
@pytest.mark.parametrize('factor', [30, 100, 300])
def test_the_allan_floor_of_flicker_is_0_664_of_its_coefficient_over_seven_decades(
    period_s, factor
):
    samples = made(Flicker, 2.0, 30_000, period_s)
    assert allan_deviation(samples, factor) == pytest.approx(0.6643 * 2.0, rel=0.05)


@pytest.mark.parametrize('period_s', [1e-3, 2.5e-3, 4e-3])
def test_the_floor_is_flat_by_the_formula_and_not_only_by_simulation(period_s):
    sigma_squared = math.log(10) / math.pi
    for tau in np.geomspace(50 * period_s, 3e5, 50):
        variance = 0.0
        for time in correlation_times(period_s):
            # Allan variance of a first-order Gauss-Markov process, IEEE Std 952-1997 annex C
            x = tau / time
            bracket = 1 - (3 - 4 * math.exp(-x) + math.exp(-2 * x)) / (2 * x)
            # the closed form cancels for small x; its series is x²/3
            variance += sigma_squared * 2 / x * (bracket if x > 1e-4 else x * x / 3)
        assert math.sqrt(variance) == pytest.approx(0.6643, rel=0.03)


@pytest.mark.parametrize('period_s', PERIODS)
def test_the_filter_has_the_spectrum_of_the_sum_of_the_processes(period_s):
    angle = np.geomspace(1e-9, 0.999 * np.pi, 80)
    _, response = sosfreqz(flicker_filter(period_s).sections, angle)
    ratio = period_s / correlation_times(period_s)[:, None]
    # a first-order process of unit variance: (1 - a²) / |1 - a e^(-jw)|²
    gap = -np.expm1(-ratio)
    density = gap * (2 - gap) / (gap**2 + 4 * (1 - gap) * np.sin(angle / 2) ** 2)
    expected = density.sum(axis=0) * math.log(10) / math.pi
    np.testing.assert_allclose(np.abs(response) ** 2, expected, rtol=1e-5)


@pytest.mark.parametrize('period_s', PERIODS)
def test_flicker_starts_as_it_is_after_a_long_time(period_s):
    filter_ = flicker_filter(period_s)
    start = filter_.modes @ filter_.correlation
    # the first output of the sections: their states, and what passes straight through
    row, through = np.zeros(len(start)), 1.0
    for k, (b0, *_) in enumerate(filter_.sections):
        row, through = b0 * row, b0 * through
        row[2 * k] += 1.0
    variance = row @ start @ start.T @ row + through**2
    components = correlation_times(period_s).size
    assert variance == pytest.approx(components * math.log(10) / math.pi, rel=1e-9)


def test_flicker_costs_the_same_however_long_it_ran():
    process = Flicker(1.0, np.random.default_rng(1))
    process.sample(10, 1e-3)
    states = process._state.shape
    for _ in range(20):
        process.sample(5_000, 1e-3)
    assert process._state.shape == states == (5, 2)


def test_flicker_goes_on_through_a_change_of_rate():
    process = Flicker(3.0, np.random.default_rng(4))
    before, after, anew = [], [], []
    for seed in range(400):
        process = Flicker(3.0, np.random.default_rng(seed))
        # averages hide the fast components, which have no memory
        before.append(process.sample(2000, 1e-3).mean())
        after.append(process.sample(200, 1e-2).mean())
        anew.append(Flicker(3.0, np.random.default_rng(1000 + seed)).sample(2000, 1e-2).mean())
    assert np.corrcoef(before, after)[0, 1] > 0.9
    assert np.std(after) == pytest.approx(np.std(anew), rel=0.15)


@pytest.mark.parametrize('rate_hz', [20.0, 100.0])
def test_random_walk_rises_with_the_root_of_a_third_of_tau(rate_hz):
    samples = made(RandomWalk, 0.7, 40_000, 1 / rate_hz)
    for tau in (2.0, 8.0):
        expected = 0.7 * math.sqrt(tau / 3)
        assert allan_deviation(samples, round(tau * rate_hz)) == pytest.approx(expected, rel=0.06)


@pytest.mark.parametrize('rate_hz', [50.0, 200.0])
def test_quantisation_falls_with_tau(rate_hz):
    samples = made(Quantisation, 1e-3, 20_000, 1 / rate_hz)
    for tau in (0.1, 1.0):
        expected = math.sqrt(3) * 1e-3 / tau
        assert allan_deviation(samples, round(tau * rate_hz)) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize('process', PROCESSES)
@given(cuts=st.lists(st.integers(0, 40), min_size=1, max_size=8))
@settings(max_examples=30, deadline=None)
def test_the_stream_does_not_depend_on_how_it_is_cut(process, cuts):
    whole = process(1.0, np.random.default_rng(1)).sample(sum(cuts), 1e-2)
    source = process(1.0, np.random.default_rng(1))
    parts = [source.sample(n, 1e-2) for n in cuts]
    np.testing.assert_array_equal(np.concatenate(parts), whole)
