# SPDX-License-Identifier: Apache-2.0
"""The Kalman filter against its textbook recursion, its own claims, and wrong models."""

import math

from imu_bench.errors import DataError
from imu_bench.metrology.markov import kalman
from imu_bench.metrology.markov.gauss_markov import Process
import numpy as np
import pytest

PROCESS = Process(0.5, 20.0)
RATE_HZ = 10.0
WHITE = 2.0


def signals(n, seed=1, offset=9.8):
    rng = np.random.default_rng(seed)
    bias = PROCESS.simulate(n, RATE_HZ, rng)
    return bias, bias + offset + WHITE * rng.standard_normal(n)


def textbook(x, process, step, noise, valid):
    """Predict and correct, sample by sample."""
    state, spread = 0.0, process.sigma**2
    states, spreads, innovations = [], [], []
    for index, (sample, good) in enumerate(zip(x, valid, strict=True)):
        if index:
            state *= process.transition(step)
            spread = process.transition(step) ** 2 * spread + process.driving_variance(step)
        if good:
            innovations.append((sample - state) / math.sqrt(spread + noise))
            gain = spread / (spread + noise)
            state += gain * (sample - state)
            spread *= 1.0 - gain
        else:
            innovations.append(0.0)
        states.append(state)
        spreads.append(spread)
    return np.array(states), np.array(spreads), np.array(innovations)


@pytest.mark.parametrize('gaps', [(), ((300, 340),), ((0, 50), (700, 1200), (2990, 3000))])
def test_it_is_the_textbook_filter(gaps):
    _, x = signals(3000)
    valid = np.ones(x.size, bool)
    for start, end in gaps:
        valid[start:end] = False
    tracked = kalman.track(np.where(valid, x, np.nan), RATE_HZ, PROCESS, WHITE, valid=valid)
    mean = x[valid].mean()
    states, spreads, innovations = textbook(x - mean, PROCESS, 0.1, WHITE**2, valid)
    if gaps and gaps[0][0] == 0:
        # a gap at the start predicts from the stationary state, as the textbook does
        assert tracked.deviation[0] == pytest.approx(PROCESS.sigma)
    np.testing.assert_allclose(tracked.bias, states + mean, rtol=0, atol=1e-8)
    np.testing.assert_allclose(tracked.deviation, np.sqrt(spreads), rtol=1e-7)
    np.testing.assert_allclose(tracked.innovation, innovations, atol=1e-8)


def test_the_error_is_what_it_says():
    bias, x = signals(200_000)
    tracked = kalman.track(x, RATE_HZ, PROCESS, WHITE)
    error = tracked.bias - 9.8 - bias
    assert error.std() == pytest.approx(tracked.deviation[-1], rel=0.03)
    # and better than any moving average
    averages = [kalman.moving_average(x, RATE_HZ, w) - 9.8 - bias for w in (2.0, 5.0, 60.0)]
    assert all(error.std() < 1.35 * average.std() for average in averages)


def test_innovations_of_the_right_model_are_white_and_of_wrong_ones_are_not():
    _, x = signals(100_000)
    right = kalman.track(x, RATE_HZ, PROCESS, WHITE).whiteness
    assert right.white and right.variance == pytest.approx(1.0, abs=0.02)
    for wrong in (Process(0.5, 1.0), Process(0.05, 20.0)):
        assert not kalman.track(x, RATE_HZ, wrong, WHITE).whiteness.white
    loud = kalman.track(x, RATE_HZ, PROCESS, 2 * WHITE).whiteness
    assert loud.variance == pytest.approx(0.26, abs=0.03)


def test_the_slow_test_sees_what_single_samples_hide():
    """Drift of a thousandth of the noise variance: invisible between neighbours."""
    rng = np.random.default_rng(3)
    x = rng.standard_normal(200_000) + Process(0.05, 200.0).simulate(200_000, 1.0, rng)
    result = kalman.whiteness(x, 50)
    assert result.slow < 1e-3
    assert not result.white


@pytest.mark.slow
def test_the_whiteness_test_keeps_its_level():
    white = [
        kalman.whiteness(np.random.default_rng(seed).standard_normal(5000), 20)
        for seed in range(200)
    ]
    for level in (0.1, 0.5):
        for attribute in ('fast', 'slow'):
            share = np.mean([getattr(w, attribute) < level for w in white])
            assert share == pytest.approx(level, abs=0.11)


@pytest.mark.parametrize('data', [[], [1.0], np.ones(100)])
def test_whiteness_of_next_to_nothing(data):
    result = kalman.whiteness(data, 10)
    assert result.fast == result.slow == 1.0 and result.white


def test_rmse_against_the_smoothed_measurement():
    _, x = signals(50_000)
    tracked = kalman.track(x, RATE_HZ, PROCESS, WHITE)
    smoothed = kalman.moving_average(x, RATE_HZ, 5.0)
    result = kalman.rmse(tracked, x, RATE_HZ, 5.0, unit='m/s²')
    assert result.value == pytest.approx(float(np.sqrt(np.mean((tracked.bias - smoothed) ** 2))))
    assert result.low < result.value < result.high and result.unit == 'm/s²'


@pytest.mark.slow
def test_the_interval_of_the_rmse_holds_its_truth():
    """The mean over many records stands for the truth."""
    results = []
    for seed in range(60):
        _, x = signals(5000, seed)
        results.append(kalman.rmse(kalman.track(x, RATE_HZ, PROCESS, WHITE), x, RATE_HZ, 5.0))
    truth = math.sqrt(np.mean([r.value**2 for r in results]))
    assert np.mean([r.low < truth < r.high for r in results]) >= 0.8


def test_a_moving_average_uses_what_there_is():
    valid = np.array([True, False, True, True, False, False, False, True])
    x = np.array([1.0, 99.0, 3.0, 5.0, 99.0, 99.0, 99.0, 7.0])
    average = kalman.moving_average(x, 1.0, 2.0, valid)
    np.testing.assert_allclose(average[[0, 2, 3, 7]], [1.0, 4.0, 4.0, 7.0])
    assert np.all(np.isfinite(average))


def test_white_noise_of_a_sample():
    assert kalman.white_sigma(2e-3, 100.0) == pytest.approx(0.02)


def test_constant_data_are_tracked_without_a_warning():
    tracked = kalman.track(np.full(1000, 9.8), RATE_HZ, PROCESS, WHITE)
    np.testing.assert_allclose(tracked.bias, 9.8)
    assert kalman.rmse(tracked, np.full(1000, 9.8), RATE_HZ, 1.0).value == pytest.approx(0.0)


@pytest.mark.parametrize(
    ('data', 'keywords', 'text'),
    [
        ([], {}, 'no sample'),
        ([1.0, 2.0], {'valid': [False, False]}, 'no sample'),
        ([1.0, math.nan], {}, 'NaN'),
        ([1.0, 2.0], {'white': 0.0}, 'white noise'),
        ([1.0, 2.0], {'rate_hz': math.inf}, 'sample rate'),
        ([1.0, 2.0], {'valid': [True]}, 'valid has shape'),
        (np.ones((3, 2)), {}, '2 dimensions'),
    ],
)
def test_bad_input_is_named(data, keywords, text):
    arguments = {'rate_hz': 1.0, 'process': PROCESS, 'white': 1.0} | keywords
    with pytest.raises(DataError, match=text):
        kalman.track(data, **arguments)
