# SPDX-License-Identifier: Apache-2.0
"""Correlation time and sigma of a Gauss-Markov process, from its autocorrelation."""

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
from imu_bench.errors import DataError
from imu_bench.metrology.markov import decay as decaying
from imu_bench.metrology.markov.gauss_markov import Process
import numpy as np
import pytest

SIGMA, TIME, RATE_HZ = 5e-4, 50.0, 100.0
BLOCK = 200  # samples, 2 s: far less than the correlation time


def measured(run, n=2**18):
    """Return a slow process deep under white noise: sigma 0.0005 under 0.005 per sample."""
    rng = np.random.default_rng([1, run])
    return Process(SIGMA, TIME).simulate(n, RATE_HZ, rng) + 0.005 * rng.standard_normal(n)


@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=60))
def test_autocorrelation_is_the_sum_it_stands_for(values):
    x = np.array(values)
    r = decaying.autocorrelation(x, 1.0, longest_s=len(values))
    centred = x - x.mean()
    direct = np.correlate(centred, centred, 'full')[x.size - 1 :] / x.size
    scale = max(float(direct[0]), 1e-300)
    np.testing.assert_allclose(r.value / scale, direct / scale, atol=1e-9)
    assert np.all(np.abs(r.value) <= r.value[0] + 1e-9 * scale)


def test_the_correlation_time_of_a_clean_process():
    x = Process(2.0, 10.0).simulate(2**17, 10.0, np.random.default_rng(3))
    decay = decaying.from_autocorrelation(decaying.autocorrelation(x, 10.0, unit='m/s²'))
    assert decay.T_c.low < 10.0 < decay.T_c.high and decay.T_c.unit == 's'
    assert decay.sigma.low < 2.0 < decay.sigma.high and decay.sigma.unit == 'm/s²'
    assert decay.misfit < 0.05
    assert decay.process == Process(decay.sigma.value, decay.T_c.value)


@pytest.mark.slow
def test_its_intervals_hold_the_truth_under_white_noise():
    held, whites = [], []
    for run in range(40):
        averages = measured(run, 2**19)[: 2**19 // BLOCK * BLOCK].reshape(-1, BLOCK).mean(axis=1)
        decay = decaying.from_autocorrelation(decaying.autocorrelation(averages, RATE_HZ / BLOCK))
        held.append(
            (
                decay.T_c.low < TIME < decay.T_c.high,
                decay.sigma.low < SIGMA < decay.sigma.high,
            )
        )
        whites.append(decay.white.value)
    assert np.all(np.mean(held, axis=0) >= 0.9)
    assert np.median(whites) == pytest.approx(0.005 / math.sqrt(200.0), rel=0.1)


def test_lag_zero_without_white_noise_is_extrapolated():
    """Exact autocorrelation with a spike at zero: sigma and T_c as without it."""
    lag = np.arange(400) * 0.5
    value = 4.0 * np.exp(-lag / 30.0)
    value[0] += 9.0
    r = decaying.Autocorrelation(lag, value, '1', 1e5)
    decay = decaying.from_autocorrelation(r)
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
    r = decaying.Autocorrelation(np.arange(value.size) * 1.0, value, 'm/s²', 100.0)
    decay = decaying.from_autocorrelation(r)
    assert decay.process is None
    assert reason in decay.T_c.reason and reason in decay.sigma.reason


def test_a_random_walk_has_no_correlation_time():
    x = np.cumsum(np.random.default_rng(4).standard_normal(20_000))
    r = decaying.autocorrelation(x, 1.0)
    assert not decaying.from_autocorrelation(r).T_c.observable


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
        decaying.autocorrelation(data, rate_hz)


@pytest.mark.slow
def test_white_noise_widens_the_intervals_of_the_decay():
    rng = np.random.default_rng(31)
    truth, held, runs = Process(1.0, 10.0), 0, 200
    for _ in range(runs):
        x = truth.simulate(2000, 1.0, rng) + 1.5 * rng.standard_normal(2000)
        decay = decaying.from_autocorrelation(decaying.autocorrelation(x, 1.0, longest_s=120.0))
        held += decay.T_c.low < 10.0 < decay.T_c.high
    assert 0.9 * runs < held < runs


def test_a_decay_deep_in_white_noise_is_not_observable():
    value = np.exp(-np.arange(121) / 10.0)
    lag = np.arange(121.0)
    clear = decaying.Autocorrelation(lag, value, '1', 2000.0)
    assert decaying.from_autocorrelation(clear).T_c.value == pytest.approx(10.0)
    buried = value + 9.0 * (lag == 0.0)
    found = decaying.from_autocorrelation(replace(clear, value=buried))
    assert found.process is None
    assert 'white noise hides' in found.T_c.reason


@pytest.mark.parametrize(
    ('share', 'time', 'white'),
    [(0.003, 20.0, 0.0), (0.015, 20.0, 0.0), (0.015, 6.0, 0.0), (0.01, 20.0, 1.5)],
)
def test_intervals_hold_the_truth_in_short_records(share, time, white):
    """A record of few correlation times shows them too short more often than too long."""
    rng = np.random.default_rng(32)
    n, held = int(time / share), []
    for _ in range(200):
        x = Process(1.0, time).simulate(n, 1.0, rng) + white * rng.standard_normal(n)
        found = decaying.from_autocorrelation(decaying.autocorrelation(x, 1.0, longest_s=n / 3.0))
        if found.process is not None:
            inside = found.sigma.low < 1.0 < found.sigma.high
            held.append((found.T_c.low < time < found.T_c.high, inside))
    assert len(held) > 190
    shares = np.mean(held, axis=0)
    assert np.all(shares > 0.92) and np.all(shares < 1.0), shares


def test_a_time_that_a_random_walk_may_show_has_no_upper_end():
    """Higher confidence needs a longer record."""
    lag = np.arange(200.0)
    r = decaying.Autocorrelation(lag, np.exp(-lag / 43.0), '1', 1000.0)
    assert decaying.from_autocorrelation(r, confidence=0.68).T_c.observable
    refused = decaying.from_autocorrelation(r, confidence=0.95)
    assert 'random walk' in refused.T_c.reason and refused.process is None
    longer = replace(r, span=2000.0)
    wide, narrow = (
        decaying.from_autocorrelation(longer, confidence=level).T_c for level in (0.95, 0.8)
    )
    assert wide.low < narrow.low < 43.0 < narrow.high < wide.high
