# SPDX-License-Identifier: Apache-2.0
"""A Gauss-Markov process enters the model where power laws fail, and only there."""

from imu_bench.metrology import allan, coefficients
from imu_bench.metrology.markov.gauss_markov import Process
from imu_bench.metrology.noise_fit import fitted
import numpy as np
import pytest

RATE_HZ = 50.0


def curve(x):
    return allan.deviation(x, RATE_HZ, unit='rad/s')


def test_power_laws_are_fitted_as_live():
    for seed in range(10):
        rng = np.random.default_rng([1, seed])
        walk = np.cumsum(rng.normal(0.0, 2e-6, 100_000))
        seen = curve(rng.normal(0.0, 1e-3, 100_000) + walk)
        assert fitted(seen, 0.95).fitted == coefficients.fit(seen).fitted
        assert fitted(seen, 0.95).gauss_markov is None


def test_without_the_process_the_white_noise_would_be_wrong():
    errors = []
    for seed in range(5):
        rng = np.random.default_rng([2, seed])
        x = rng.normal(0.0, 1e-3, 180_000) + Process(1e-3, 20.0).simulate(180_000, RATE_HZ, rng)
        model = fitted(curve(x), 0.95)
        assert model.gauss_markov.T_c.value == pytest.approx(20.0, rel=0.4)
        assert model.N.value == pytest.approx(1e-3 / np.sqrt(RATE_HZ), rel=0.01)
        assert any('Gauss-Markov' in flag for flag in model.flags)
        errors.append(coefficients.fit(curve(x)).N.value / model.N.value - 1.0)
    assert max(map(abs, errors)) > 0.02


@pytest.mark.parametrize('walk', [0.0, 2e-5])
def test_the_coefficients_asked_for_do_not_depend_on_the_others(walk):
    rng = np.random.default_rng(3)
    x = rng.normal(0.0, 1e-3, 50_000) + np.cumsum(rng.normal(0.0, walk, 50_000))
    every, some = fitted(curve(x), 0.95), fitted(curve(x), 0.95, 'NB')
    assert (some.N, some.B, some.fitted, some.flags) == (
        every.N, every.B, every.fitted, every.flags,
    )  # fmt: skip
    assert [some.Q.reason, some.K.reason, some.R.reason] == ['not asked for'] * 3
