# SPDX-License-Identifier: Apache-2.0
"""Averages over blocks keep the noise coefficients, and never reach across a gap."""

from imu_bench.metrology import allan, coefficients
from imu_bench.offline.analysis.blocks import averages
import numpy as np
import pytest


def test_white_noise_keeps_its_coefficient():
    x = np.random.default_rng(1).normal(9.8, 0.02, 200_000)
    blocks = averages(x, 100.0, 8)
    model = coefficients.fit(allan.deviation(blocks.values, blocks.rate_hz, unit='m/s²'))
    assert blocks.rate_hz == 12.5
    assert model.N.low <= 2e-3 <= model.N.high


def test_a_gap_takes_its_blocks_with_it():
    x = np.arange(100.0)
    valid = np.ones(100, bool)
    valid[30:41] = False
    blocks = averages(np.where(valid, x, 1e9), 10.0, 10, valid)
    assert blocks.valid.tolist() == [True] * 3 + [False] * 2 + [True] * 5
    assert blocks.values[2] == 24.5
    assert blocks.values[3] == blocks.values[4] == 0.0
    assert blocks.longest_piece().tolist() == [54.5, 64.5, 74.5, 84.5, 94.5]


def test_a_single_missing_sample_of_many_does_not_cost_the_block():
    valid = np.ones(200, bool)
    valid[[3, 150, 151, 152, 153, 154, 155]] = False
    blocks = averages(np.where(valid, 1.0, np.inf), 10.0, 100, valid)
    assert blocks.valid.tolist() == [True, False]
    assert blocks.values.tolist() == [1.0, 0.0]


def test_coarser_is_the_same_as_at_once():
    x = np.random.default_rng(2).normal(size=10_000)
    once, twice = averages(x, 100.0, 20), averages(x, 100.0, 4).coarser(5)
    np.testing.assert_allclose(twice.values, once.values, atol=1e-12)
    assert (twice.size, twice.rate_hz) == (once.size, pytest.approx(once.rate_hz))


def test_nothing_left_is_empty_and_not_an_error():
    blocks = averages(np.zeros(5), 10.0, 2, np.zeros(5, bool))
    assert blocks.longest_piece().size == 0
    assert not blocks.valid.any()
