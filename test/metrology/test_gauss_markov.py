# SPDX-License-Identifier: Apache-2.0
"""First-order Gauss-Markov processes: exact model, autocorrelation, correlation time."""

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
from imu_bench.errors import DataError
from imu_bench.metrology import allan, gauss_markov
from imu_bench.metrology.gauss_markov import Process
from imu_bench.metrology.noise_model import gauss_markov_variance
import numpy as np
import pytest

SIGMA, TIME, RATE_HZ = 5e-4, 50.0, 100.0


def measured(run, n=2**18):
    """Return a slow process deep under white noise: sigma 0.0005 under 0.005 per sample."""
    rng = np.random.default_rng([1, run])
    return Process(SIGMA, TIME).simulate(n, RATE_HZ, rng) + 0.005 * rng.standard_normal(n)


def test_the_discrete_model_is_exact_for_any_step():
    """Two steps of t are one step of 2t, and the variance stays what it is."""
    p = Process(3.0, 7.0)
    for step in (1e-6, 0.1, 5.0, 100.0):
        assert p.transition(step) ** 2 == pytest.approx(p.transition(2 * step), abs=1e-15)
        twice = p.transition(step) ** 2 * p.driving_variance(step) + p.driving_variance(step)
        assert twice == pytest.approx(p.driving_variance(2 * step))
        stays = p.transition(step) ** 2 * 9.0 + p.driving_variance(step)
        assert stays == pytest.approx(9.0)
    # for a short step it is the driving noise q_c² dt
    assert p.driving_variance(1e-9) == pytest.approx(p.q_c**2 * 1e-9)


def test_strength_and_sigma():
    p = Process.from_strength(2.0, 8.0)
    assert p.sigma == pytest.approx(4.0)
    assert p.q_c == pytest.approx(2.0)


@pytest.mark.parametrize('arguments', [(0.0, 1.0), (1.0, -1.0), (math.nan, 1.0), (1.0, math.inf)])
def test_a_process_needs_positive_numbers(arguments):
    with pytest.raises(DataError, match='must be positive'):
        Process(*arguments)
    with pytest.raises(DataError, match='correlation time'):
        Process.from_strength(1.0, 0.0)


def test_a_simulated_process_is_stationary_and_has_its_autocorrelation():
    rng = np.random.default_rng(2)
    paths = np.array([Process(2.0, 5.0).simulate(30, 2.0, rng) for _ in range(4000)])
    np.testing.assert_allclose(paths.std(axis=0), 2.0, rtol=0.06)
    lagged = (paths[:, 0] * paths[:, 20]).mean()
    assert lagged == pytest.approx(4.0 * math.exp(-10.0 / 5.0), abs=0.25)
    assert Process(1.0, 1.0).simulate(0, 1.0, rng).size == 0


@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=60))
def test_autocorrelation_is_the_sum_it_stands_for(values):
    x = np.array(values)
    r = gauss_markov.autocorrelation(x, 1.0, longest_s=len(values))
    centred = x - x.mean()
    direct = np.correlate(centred, centred, 'full')[x.size - 1 :] / x.size
    scale = max(float(direct[0]), 1e-300)
    np.testing.assert_allclose(r.value / scale, direct / scale, atol=1e-9)
    assert np.all(np.abs(r.value) <= r.value[0] + 1e-9 * scale)


def test_the_correlation_time_of_a_clean_process():
    x = Process(2.0, 10.0).simulate(2**17, 10.0, np.random.default_rng(3))
    decay = gauss_markov.from_autocorrelation(gauss_markov.autocorrelation(x, 10.0, unit='m/s²'))
    assert decay.T_c.low < 10.0 < decay.T_c.high and decay.T_c.unit == 's'
    assert decay.sigma.low < 2.0 < decay.sigma.high and decay.sigma.unit == 'm/s²'
    assert decay.misfit < 0.05
    assert decay.process == Process(decay.sigma.value, decay.T_c.value)


@pytest.mark.slow
def test_its_intervals_hold_the_truth_under_white_noise():
    held, whites = [], []
    for run in range(40):
        averages, rate = gauss_markov.block_average(measured(run, 2**19), RATE_HZ, 2.0)
        decay = gauss_markov.from_autocorrelation(gauss_markov.autocorrelation(averages, rate))
        held.append(
            (
                decay.T_c.low < TIME < decay.T_c.high,
                decay.sigma.low < SIGMA < decay.sigma.high,
            )
        )
        whites.append(decay.white.value)
    assert np.all(np.mean(held, axis=0) >= 0.82)
    assert np.median(whites) == pytest.approx(0.005 / math.sqrt(200.0), rel=0.1)


def test_lag_zero_without_white_noise_is_extrapolated():
    """Exact autocorrelation with a spike at zero: sigma and T_c as without it."""
    lag = np.arange(400) * 0.5
    value = 4.0 * np.exp(-lag / 30.0)
    value[0] += 9.0
    r = gauss_markov.Autocorrelation(lag, value, '1', 1e5)
    decay = gauss_markov.from_autocorrelation(r)
    assert decay.T_c.value == pytest.approx(30.0, rel=1e-3)
    assert decay.sigma.value == pytest.approx(2.0, rel=1e-6)
    assert decay.white.value == pytest.approx(3.0, rel=1e-6)
    assert decay.misfit < 1e-6


@pytest.mark.parametrize(
    ('value', 'reason'),
    [
        (np.zeros(50), 'never changes'),
        (np.r_[1.0, np.zeros(49)], 'not correlated'),
        (np.r_[1.0, 0.5, np.zeros(48)], 'no memory'),
        (np.ones(50), 'does not fall'),
        (np.exp(-np.arange(50) / 1000.0), 'record longer'),
        (np.ones(3), '3 lags'),
    ],
)
def test_what_is_no_gauss_markov_process(value, reason):
    r = gauss_markov.Autocorrelation(np.arange(value.size) * 1.0, value, 'm/s²', 100.0)
    decay = gauss_markov.from_autocorrelation(r)
    assert decay.process is None
    assert reason in decay.T_c.reason and reason in decay.sigma.reason


def test_a_random_walk_has_no_correlation_time():
    x = np.cumsum(np.random.default_rng(4).standard_normal(20_000))
    r = gauss_markov.autocorrelation(x, 1.0)
    assert not gauss_markov.from_autocorrelation(r).T_c.observable


def exact_curve(strength, time, white=0.0):
    curve = allan.deviation(np.random.default_rng(1).standard_normal(2**16), 10.0)
    variance = strength**2 * gauss_markov_variance(curve.tau, time) + white**2 / curve.tau
    d = np.sqrt(variance)
    spread = 1.0 / np.sqrt(curve.edf)
    return replace(
        curve, deviation=d, low=d * (1 - spread / 2), high=d * (1 + spread), unit='rad/s'
    )


@pytest.mark.parametrize('white', [0.0, 3e-4])
def test_the_peak_of_the_allan_deviation(white):
    process = gauss_markov.from_allan(exact_curve(1e-3, 8.0, white), white=white)
    assert process.T_c.value == pytest.approx(8.0, rel=0.02)
    assert process.q_c.value == pytest.approx(1e-3, rel=0.01)
    assert process.T_c.low < 8.0 < process.T_c.high
    assert process.q_c.unit == 'rad/s²/√Hz'


def test_a_curve_without_a_peak():
    x = np.random.default_rng(5).standard_normal(10_000)
    falling = gauss_markov.from_allan(allan.deviation(x, 1.0))
    assert 'shortest' in falling.T_c.reason
    rising = gauss_markov.from_allan(allan.deviation(np.cumsum(x), 1.0, tau='octave'))
    assert not rising.q_c.observable and rising.q_c.reason
    nothing = gauss_markov.from_allan(allan.deviation(x, 1.0), white=100.0)
    assert 'white noise' in nothing.T_c.reason


@pytest.mark.slow
def test_the_peak_of_real_curves():
    """Intervals hold the truth where a peak is claimed at all."""
    found = [
        gauss_markov.from_allan(allan.deviation(measured(run, 2**19), RATE_HZ), white=5e-4)
        for run in range(20)
    ]
    claimed = [process for process in found if process.T_c.observable]
    assert claimed
    held = [p.T_c.low < TIME < p.T_c.high and p.q_c.low < 1e-4 < p.q_c.high for p in claimed]
    assert np.mean(held) >= 0.8


def test_block_averages():
    averages, rate = gauss_markov.block_average(np.arange(10.0), 10.0, 0.3)
    assert averages.tolist() == [1.0, 4.0, 7.0]
    assert rate == pytest.approx(10.0 / 3.0)
    with pytest.raises(DataError, match='no two blocks'):
        gauss_markov.block_average(np.arange(10.0), 10.0, 0.6)


@pytest.mark.parametrize(
    ('data', 'rate_hz', 'text'),
    [
        (np.ones((4, 2)), 1.0, '2 dimensions'),
        ([1.0], 1.0, '1 samples'),
        ([1.0, math.inf], 1.0, 'NaN or infinite'),
        ([1.0, 2.0], -1.0, 'sample rate'),
    ],
)
def test_bad_input_is_named(data, rate_hz, text):
    with pytest.raises(DataError, match=text):
        gauss_markov.autocorrelation(data, rate_hz)


@pytest.mark.slow
def test_white_noise_widens_the_intervals_of_the_decay():
    rng = np.random.default_rng(31)
    truth, held, runs = Process(1.0, 10.0), 0, 200
    for _ in range(runs):
        x = truth.simulate(2000, 1.0, rng) + 1.5 * rng.standard_normal(2000)
        decay = gauss_markov.from_autocorrelation(
            gauss_markov.autocorrelation(x, 1.0, longest_s=120.0)
        )
        held += decay.T_c.low < 10.0 < decay.T_c.high
    assert 0.9 * runs < held < runs


def test_a_decay_deep_in_white_noise_is_not_observable():
    value = np.exp(-np.arange(121) / 10.0)
    lag = np.arange(121.0)
    clear = gauss_markov.Autocorrelation(lag, value, '1', 2000.0)
    assert gauss_markov.from_autocorrelation(clear).T_c.value == pytest.approx(10.0)
    buried = value + 9.0 * (lag == 0.0)
    found = gauss_markov.from_autocorrelation(replace(clear, value=buried))
    assert found.process is None
    assert 'white noise hides' in found.T_c.reason
