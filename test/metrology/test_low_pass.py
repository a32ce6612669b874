# SPDX-License-Identifier: Apache-2.0
"""The Allan variance and the density of filtered white noise, against the filters of scipy."""

import math

from imu_bench.metrology.fitting.low_pass import bend, deficit, LowPass
import numpy as np
import pytest
from scipy import signal

PERIOD = 0.01
CUTOFFS = [0.003, 0.05, 0.2, 0.25, 0.3, 0.45]


def low_pass(share, order):
    return LowPass(math.log(math.tan(math.pi * share)), order, PERIOD)


@pytest.mark.parametrize('order', [1, 2])
@pytest.mark.parametrize('share', CUTOFFS)
def test_the_allan_variance_is_that_of_the_impulse_response(order, share):
    b, a = signal.butter(order, 2.0 * share)
    response = signal.lfilter(b, a, np.concatenate([[1.0], np.zeros(6000)]))
    for m in (1, 2, 7, 40):
        # the difference of two neighbouring averages is a filter as well
        both = np.convolve(response, np.concatenate([np.ones(m), -np.ones(m)]))
        expected = float(both @ both) / (2.0 * m**2 * PERIOD)
        assert low_pass(share, order).variance([m * PERIOD])[0] == pytest.approx(
            expected, rel=1e-6
        )


@pytest.mark.parametrize('order', [1, 2])
@pytest.mark.parametrize('share', CUTOFFS)
def test_the_gain_is_that_of_the_filter(order, share):
    b, a = signal.butter(order, 2.0 * share)
    frequency = np.array([0.01, 1.0, 10.0, 30.0, 49.9])
    _, transfer = signal.freqz(b, a, frequency, fs=1.0 / PERIOD)
    np.testing.assert_allclose(
        low_pass(share, order).gain(frequency), np.abs(transfer) ** 2, rtol=1e-6
    )
    assert low_pass(share, order).cutoff == pytest.approx(share / PERIOD)
    assert low_pass(share, order).gain([share / PERIOD])[0] == pytest.approx(0.5)


def test_a_slow_first_order_filter_is_the_continuous_one():
    """T/2τ (3 − 4 e^(−τ/T) + e^(−2τ/T)) with T = 1/(2π f_c), IEEE Std 952-1997 annex C."""
    filtered, time = low_pass(1e-3, 1), 1.0 / (2.0 * math.pi * 1e-3)
    m = np.array([30.0, 100.0, 300.0, 1e3, 1e4])
    expected = time / (2.0 * m) * (3.0 - 4.0 * np.exp(-m / time) + np.exp(-2.0 * m / time))
    np.testing.assert_allclose(deficit(m, filtered.warped, 1), expected, rtol=1e-4)


@pytest.mark.parametrize('order', [1, 2])
def test_nothing_is_left_of_a_filter_at_long_averaging_times(order):
    tau = np.array([1e3, 1e5])
    np.testing.assert_allclose(low_pass(0.05, order).variance(tau) * tau, 1.0, atol=1e-4)


@pytest.mark.parametrize('order', [1, 2])
def test_the_bend_is_the_derivative(order):
    tau, at, step = PERIOD * np.array([1.0, 4.0, 30.0]), low_pass(0.1, order), 1e-4
    above = LowPass(at.warped + step, order, PERIOD).variance(tau)
    expected = (above - at.variance(tau)) / step
    np.testing.assert_allclose(bend(tau, at), expected, rtol=1e-3)
