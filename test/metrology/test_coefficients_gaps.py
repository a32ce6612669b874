# SPDX-License-Identifier: Apache-2.0
"""Coefficients of records with holes: what was recorded counts, not how long nothing was."""

from imu_bench.metrology import allan
from imu_bench.metrology.noise_fit import fitted
import numpy as np
import pytest

RATE = 100.0
N = 1e-4


def holed(seed, half_s, hole_s):
    """Return the model of white noise of two equal halves with a hole between them."""
    half, hole = int(half_s * RATE), int(hole_s * RATE)
    noise = np.random.default_rng(seed).normal(scale=N * RATE**0.5, size=2 * half)
    data = np.concatenate([noise[:half], np.full(hole, np.nan), noise[half:]])
    curve = allan.deviation(data, RATE, valid=np.isfinite(data), unit='rad/s')
    return fitted(curve)


@pytest.mark.parametrize('seed', range(3))
def test_bounds_do_not_depend_on_the_length_of_a_hole(seed):
    short, *longer = (holed(seed, 100.0, hole) for hole in (50.0, 200.0, 2000.0, 20_000.0))
    for model in longer:
        for term in 'QBKR':
            assert model.coefficients[term].high == pytest.approx(
                short.coefficients[term].high, rel=0.01
            )
        assert model.N.low == pytest.approx(short.N.low, rel=1e-3)
        assert model.K.reason == short.K.reason


@pytest.mark.parametrize('seed', range(3))
def test_a_bound_is_that_of_half_the_record_if_nothing_longer_is_in_one_piece(seed):
    """Two halves tell of a random walk as much as one of them, or a little more."""
    bounds = [holed(seed, 100.0, hole).K.high for hole in (0.0, 2000.0)]
    one = holed(seed, 50.0, 0.0).K.high
    assert bounds[0] < bounds[1] < 3.0 * bounds[0]
    assert bounds[1] < 2.0 * one


def test_a_minute_now_and_then_tells_n_and_claims_no_more():
    """Six minutes with six hours between two: N was held in 9 of 16."""
    held = claims = 0
    rate, hole, minute = 10.0, 216_000, 600
    for seed in range(16):
        rng = np.random.default_rng([8, seed])
        data = np.full(5 * hole + 6 * minute, np.nan)
        for part in range(6):
            first = part * (hole + minute)
            data[first : first + minute] = rng.normal(scale=N * rate**0.5, size=minute)
        curve = allan.deviation(data, rate, valid=np.isfinite(data), unit='rad/s')
        model = fitted(curve)
        held += model.N.observable and model.N.low < N < model.N.high
        claims += model.B.observable or model.K.observable
    assert held >= 14 and claims <= 1
