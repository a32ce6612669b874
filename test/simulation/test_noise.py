# SPDX-License-Identifier: Apache-2.0
"""The noise processes against their definition: the Allan variance of IEEE Std 952-1997."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st
from imu_bench.simulation.noise import Flicker, Quantisation, RandomWalk, White
import numpy as np
import pytest

PROCESSES = (White, Flicker, RandomWalk, Quantisation)


def allan_deviation(samples, factor):
    """Return the overlapping Allan deviation of columns at one averaging factor, by definition."""
    phase = np.concatenate([np.zeros((1, samples.shape[1])), np.cumsum(samples, axis=0)])
    second = phase[2 * factor :] - 2 * phase[factor:-factor] + phase[: -2 * factor]
    return math.sqrt(np.mean(second**2) / 2) / factor


def made(process, coefficient, n, period_s, axes=24, seed=1):
    return process(np.full(axes, coefficient), np.random.default_rng(seed)).sample(n, period_s)


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
    process = Flicker(np.ones(1), np.random.default_rng(1))
    process.sample(1, period_s)
    sigma_squared = float(process._sigma[0]) ** 2
    for tau in np.geomspace(50 * period_s, 3e5, 50):
        variance = 0.0
        for time in process._times:
            # Allan variance of a first-order Gauss-Markov process, IEEE Std 952-1997 eq. (C.12)
            x = tau / time
            bracket = 1 - (3 - 4 * math.exp(-x) + math.exp(-2 * x)) / (2 * x)
            # the closed form cancels for small x; its series is x²/3
            variance += sigma_squared * 2 / x * (bracket if x > 1e-4 else x * x / 3)
        assert math.sqrt(variance) == pytest.approx(0.6643, rel=0.03)


def test_flicker_costs_the_same_however_long_it_ran():
    process = Flicker(np.ones(3), np.random.default_rng(1))
    process.sample(10, 1e-3)
    states = process._state.shape
    for _ in range(20):
        process.sample(5_000, 1e-3)
    assert process._state.shape == states == (10, 3)


def test_flicker_goes_on_through_a_change_of_rate():
    process = Flicker(np.ones(2000), np.random.default_rng(4))
    process.sample(5, 1e-3)
    slow_before = process._state[:5].copy()
    process.sample(1, 1e-2)
    assert process._state.shape[0] == 9
    assert np.corrcoef(slow_before[0], process._state[0])[0, 1] > 0.999


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
    whole = made(process, 1.0, sum(cuts), 1e-2, axes=3)
    source = process(np.full(3, 1.0), np.random.default_rng(1))
    parts = [source.sample(n, 1e-2) for n in cuts]
    np.testing.assert_array_equal(np.concatenate(parts), whole)


@pytest.mark.parametrize('process', PROCESSES)
def test_axes_are_independent(process):
    samples = np.diff(made(process, 1.0, 4000, 1e-2, axes=3), axis=0)
    correlation = np.corrcoef(samples.T)
    assert np.abs(correlation[np.triu_indices(3, 1)]).max() < 0.08
