# SPDX-License-Identifier: Apache-2.0
"""Sums of long arrays: as exact as the plain ones, whatever the blocks and the threads."""

from hypothesis import given
from hypothesis import strategies as st
from imu_bench.metrology import blockwise
from imu_bench.metrology.deviations.integral import cumulate
import numpy as np
import pytest


@given(size=st.integers(0, 40_000), seed=st.integers(0, 9))
def test_square_sum(size, seed):
    values = np.random.default_rng(seed).normal(size=size)
    assert blockwise.square_sum(values) == pytest.approx(float(np.sum(values**2)), rel=1e-12)


@pytest.mark.parametrize('size', [1, 2, 15, 16, 17, 8191, 8192, 8193, 100_003])
def test_phase_is_the_cumulative_sum(size):
    rate = 9.81 + np.random.default_rng(size).normal(size=size)
    expected = np.concatenate([[0.0], np.cumsum(rate - rate.mean())])
    np.testing.assert_allclose(cumulate(rate), expected, atol=1e-9)


def test_phase_has_no_steps_between_blocks(monkeypatch):
    """A step would be a difference that is not in the data."""
    monkeypatch.setattr(blockwise, 'BLOCK', 1 << 9)
    rate = 9.81 + 0.01 * np.random.default_rng(1).normal(size=5000)
    np.testing.assert_allclose(np.diff(cumulate(rate)), rate - rate.mean(), atol=1e-13)


def test_equal_samples_have_no_phase_at_all():
    assert not cumulate(np.full(700_000, 9.80665)).any()


def test_missing_samples_stand_still():
    rate = np.random.default_rng(2).normal(size=1000)
    valid = np.ones(1000, bool)
    valid[100:200] = False
    rate[100:200] = np.nan
    steps = np.diff(cumulate(rate, valid))
    assert not steps[100:200].any()
    np.testing.assert_allclose(steps[valid], rate[valid] - rate[valid].mean(), atol=1e-12)


def test_a_work_array_is_given_to_one_at_a_time():
    arrays = blockwise.WorkArrays(3)
    with arrays.taken() as one, arrays.taken() as two:
        assert one is not two
    with arrays.taken() as again:
        assert again is one or again is two
