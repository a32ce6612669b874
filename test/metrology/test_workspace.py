# SPDX-License-Identifier: Apache-2.0
"""Long arrays are looked at in parts, and that changes nothing."""

from imu_bench.metrology import workspace
import numpy as np
import pytest


@pytest.mark.parametrize('size', [0, 1, 6, 7, 8, 20])
def test_parts_cover_every_item_once(size):
    items = np.arange(size)
    joined = [items[part] for part in workspace.parts(size, 7)]
    assert all(0 < part.size <= 7 for part in joined)
    assert np.concatenate([*joined, np.empty(0)]).tolist() == items.tolist()


def test_extremes_and_finiteness_beyond_one_part():
    values = np.random.default_rng(1).normal(size=2 * workspace.PART + 5)
    values[-1], values[3] = 100.0, -100.0
    assert workspace.extremes(values) == (-100.0, 100.0)
    assert workspace.all_finite(values)
    values[-2] = np.nan
    assert workspace.extremes(values) == (-100.0, 100.0)
    assert not workspace.all_finite(values)


def test_extremes_of_nothing_but_nan():
    assert np.isnan(workspace.extremes(np.full(4, np.nan))).all()


@pytest.mark.parametrize('size', [1, 2, 3, 4, 999, 1000])
def test_the_median_is_that_of_numpy(size):
    rng = np.random.default_rng(size)
    for values in (rng.normal(size=size), np.round(rng.normal(size=size)), np.zeros(size)):
        assert workspace.median(values) == np.median(values)
