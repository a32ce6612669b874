# SPDX-License-Identifier: Apache-2.0
"""What rounding adds to the noise of an axis, against the axis itself."""

import math

from imu_bench.simulation.sensor_errors import Errors
from imu_bench.simulation.sensor_model import ErrorModel
from imu_bench.simulation.simulated import expected_coefficients, HIDDEN, rounded_variance
import numpy as np
import pytest
from scipy import stats


@pytest.mark.parametrize('mean', [0.0, 0.3, 0.5, -7.2])
@pytest.mark.parametrize('sigma', [0.2, 0.475, 1.0, 3.0])
def test_the_variance_of_rounded_noise_is_the_exact_one(mean, sigma):
    values = np.rint(np.random.default_rng(1).normal(mean, sigma, 400_000))
    assert rounded_variance(mean, sigma, 1.0) == pytest.approx(values.var(), rel=0.02, abs=2e-3)


@pytest.mark.parametrize(('sigma', 'most'), [(HIDDEN, 0.037), (0.3, 0.34)])
def test_slow_noise_is_scaled_by_rounding_as_told(sigma, most):
    codes, noise = np.arange(-6, 8), stats.norm(scale=sigma)
    mean = np.linspace(0.0, 1.0, 201)
    reached = noise.cdf(codes + 0.5 - mean[:, None]) - noise.cdf(codes - 0.5 - mean[:, None])
    slope = np.gradient(reached @ codes, mean)
    assert np.abs(slope - 1.0).max() == pytest.approx(most, rel=0.02)
    assert 2.0 * math.exp(-2.0 * math.pi**2 * sigma**2) == pytest.approx(most, rel=0.02)


@pytest.mark.parametrize('step', [0.0, 0.3, 1.2])
def test_the_white_noise_of_an_output_is_as_told(step):
    errors = Errors(noise_density=0.1, resolution=step, bias=0.37)
    x = ErrorModel({'acceleration': errors}, 2).sample({}, 300_000, 0.01)['acceleration'][:, 0]
    n = expected_coefficients(errors, 0, 100.0, 0.37)['N']
    assert x.std() / math.sqrt(100.0) == pytest.approx(n, rel=0.01)


def test_what_is_not_noise_is_handed_on():
    errors = Errors(bias_instability=(1.0, 2.0, 3.0), random_walk=4.0, quantisation=5.0)
    assert expected_coefficients(errors, 1, 100.0, 0.0) == {'Q': 5.0, 'N': 0.0, 'B': 2.0, 'K': 4.0}
