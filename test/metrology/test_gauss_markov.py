# SPDX-License-Identifier: Apache-2.0
"""First-order Gauss-Markov processes: exact model, autocorrelation, correlation time."""

from dataclasses import replace
import math

from imu_bench.errors import DataError
from imu_bench.metrology import allan
from imu_bench.metrology.fitting.noise_model import gauss_markov_variance
from imu_bench.metrology.markov import gauss_markov
from imu_bench.metrology.markov.gauss_markov import Process
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
    p = Process(4.0, 8.0)
    assert p.q_c == pytest.approx(2.0)


@pytest.mark.parametrize('arguments', [(0.0, 1.0), (1.0, -1.0), (math.nan, 1.0), (1.0, math.inf)])
def test_a_process_needs_positive_numbers(arguments):
    with pytest.raises(DataError, match='must be positive'):
        Process(*arguments)


def test_a_simulated_process_is_stationary_and_has_its_autocorrelation():
    rng = np.random.default_rng(2)
    paths = np.array([Process(2.0, 5.0).simulate(30, 2.0, rng) for _ in range(4000)])
    np.testing.assert_allclose(paths.std(axis=0), 2.0, rtol=0.06)
    lagged = (paths[:, 0] * paths[:, 20]).mean()
    assert lagged == pytest.approx(4.0 * math.exp(-10.0 / 5.0), abs=0.25)
    assert Process(1.0, 1.0).simulate(0, 1.0, rng).size == 0


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
