# SPDX-License-Identifier: Apache-2.0
"""Allan variance and density of filtered white noise, against the filters of scipy."""

import math

from imu_bench.metrology.fitting.low_pass import bends, deficit, KINDS, LowPass, WEAKEST
import numpy as np
import pytest
from scipy import signal

PERIOD = 0.01
CUTOFFS = [0.003, 0.05, 0.2, 0.25, 0.3, 0.45]


def low_pass(share, order):
    return LowPass(math.log(math.tan(math.pi * share)), f'digital {order}', PERIOD)


def analogue(share, order):
    return LowPass(math.log(math.pi * share), f'analogue {order}', PERIOD)


def folded(share, order, frequency):
    """Return the density behind an analogue filter, with what folds back of 400 bands."""
    bands = np.asarray(frequency)[:, None] * PERIOD + np.arange(-400, 401)
    left = 1.0 / (1.0 + (bands / share) ** (2 * order))
    density = left.sum(axis=1)
    # beyond these bands the density falls as its power: the rest of the sum as an integral
    tail = 2.0 * share ** (2 * order) * 400.5 ** (1 - 2 * order) / (2 * order - 1)
    # unit gain at zero frequency: sampled white noise has a density of one there
    at_zero = (1.0 / (1.0 + (np.arange(-400, 401) / share) ** (2 * order))).sum() + tail
    return (density + tail) / at_zero


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
@pytest.mark.parametrize('share', [*CUTOFFS, 0.625, 1.5])
def test_behind_an_analogue_filter_the_density_folds_back(order, share):
    frequency = np.array([0.01, 1.0, 10.0, 30.0, 49.9])
    found = analogue(share, order)
    np.testing.assert_allclose(
        found.gain(frequency), folded(share, order, frequency), rtol=1e-5, atol=1e-9
    )
    assert found.cutoff == pytest.approx(share / PERIOD)


@pytest.mark.parametrize('order', [1, 2])
@pytest.mark.parametrize('share', [0.05, 0.3, 0.625, 1.5])
def test_the_allan_variance_of_analogue_kinds_is_the_integral_of_their_density(order, share):
    found = analogue(share, order)
    # IEEE Std 952-1997 annex C with a sum of samples in place of the integral
    frequency = (np.arange(40_000) + 0.5) / 80_000
    for m in (1, 2, 7, 40):
        turns = np.pi * frequency
        window = 2.0 * np.sin(m * turns) ** 4 / (m * np.sin(turns)) ** 2
        expected = 2.0 * np.mean(found.gain(frequency / PERIOD) * window) / PERIOD / 2.0
        assert found.variance([m * PERIOD])[0] == pytest.approx(expected, rel=1e-5)


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
    np.testing.assert_allclose(deficit(m, filtered.warped, 'digital 1'), expected, rtol=1e-4)


@pytest.mark.parametrize('kind', KINDS)
def test_nothing_is_left_of_a_filter_at_long_averaging_times(kind):
    tau = np.array([1e3, 1e5])
    filtered = LowPass(math.log(math.tan(math.pi * 0.05)), kind, PERIOD)
    np.testing.assert_allclose(filtered.variance(tau) * tau, 1.0, atol=1e-4)


@pytest.mark.parametrize('kind', KINDS)
def test_a_filter_that_does_nothing_has_no_effect(kind):
    filtered = LowPass(WEAKEST, kind, PERIOD)
    assert filtered.variance([PERIOD])[0] * PERIOD == pytest.approx(1.0, abs=0.07)
    np.testing.assert_allclose(filtered.gain([1.0, 30.0, 45.0]), 1.0, atol=0.05)


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('floor', [0.0, 0.2])
def test_the_bends_are_the_derivatives(kind, floor):
    at = LowPass(math.log(math.tan(math.pi * 0.1)), kind, PERIOD, floor)
    tau, step = PERIOD * np.array([1.0, 4.0, 30.0]), 1e-4
    above = LowPass(at.warped + step, kind, PERIOD, floor).variance(tau)
    more = LowPass(at.warped, kind, PERIOD, floor + step).variance(tau)
    by_cutoff, by_floor = bends(tau, at)
    np.testing.assert_allclose(by_cutoff, (above - at.variance(tau)) / step, rtol=1e-3)
    np.testing.assert_allclose(by_floor, (more - at.variance(tau)) / step, rtol=1e-6)


@pytest.mark.parametrize('kind', KINDS)
def test_a_floor_is_white_noise_that_joins_behind_the_filter(kind):
    warped, tau, f = math.log(math.tan(math.pi * 0.05)), [PERIOD, 0.1], [1.0, 20.0, 45.0]
    plain, floored = LowPass(warped, kind, PERIOD), LowPass(warped, kind, PERIOD, 0.1)
    np.testing.assert_allclose(floored.gain(f), 0.9 * plain.gain(f) + 0.1)
    np.testing.assert_allclose(
        floored.variance(tau), 0.9 * plain.variance(tau) + 0.1 / np.array(tau)
    )
