# SPDX-License-Identifier: Apache-2.0
"""Gaps at the ends, in their thousands, or all over: what is left is exact, and small."""

import tracemalloc

from imu_bench.metrology import allan, blockwise
from imu_bench.metrology.deviations import allan_kernels
import numpy as np
import pytest


def strict(rate, valid, m):
    """Return the differences of complete averages, by their definition."""
    starts = [
        i for i in range(rate.size - 2 * m + 1) if valid is None or valid[i : i + 2 * m].all()
    ]
    return np.array([rate[i + m : i + 2 * m].mean() - rate[i : i + m].mean() for i in starts])


@pytest.mark.parametrize('length', [648, 649, 650, 700])
def test_decimated_where_a_run_is_barely_long_enough(length):
    """The points that decimation keeps may all miss the few differences that there are."""
    rate = np.random.default_rng(length).normal(size=5000)
    valid = np.zeros(rate.size, bool)
    valid[5 : 5 + length] = True
    tau = [36.0, 108.0, 324.0]
    full = allan.deviation(rate, 1.0, valid=valid, tau=tau, overlap='full')
    thin = allan.deviation(rate, 1.0, valid=valid, tau=tau, overlap='decimated')
    np.testing.assert_array_equal(thin.m, full.m)
    np.testing.assert_allclose(thin.deviation, full.deviation, rtol=0.01)


def test_decimated_between_many_gaps_uses_up_the_record():
    rng = np.random.default_rng(1)
    rate, valid = rng.normal(size=100_000), rng.random(100_000) > 0.003
    full = allan.deviation(rate, 1.0, valid=valid, overlap='full')
    thin = allan.deviation(rate, 1.0, valid=valid, overlap='decimated')
    assert full.terms[-1] < 1000 < full.terms[0]
    np.testing.assert_allclose(thin.deviation, full.deviation, rtol=0.01)


@pytest.mark.parametrize('dtype', [np.float64, np.float32, np.int32])
@pytest.mark.parametrize('few', [0, 10_000])
@pytest.mark.parametrize('data_type', ['rate', 'phase'])
def test_scattered_gaps_by_the_definition(dtype, few, data_type, monkeypatch):
    """Runs that are summed together in a block, or one by one; block bounds cross them."""
    monkeypatch.setattr(allan_kernels, '_FEW_RUNS', few)
    monkeypatch.setattr(blockwise, 'BLOCK', 1 << 9)
    rng = np.random.default_rng(3)
    rate = (1000.0 * rng.normal(9.81, 1.0, size=3000)).astype(dtype)
    valid = rng.random(rate.size) > 0.05
    valid[[0, 1, -1]] = False
    wanted = [strict(rate.astype(float), valid, m) for m in (1, 2, 7, 20)]
    data = rate
    if data_type == 'phase':
        # a point is missing here, not the rate between two of them
        data = np.cumsum(rate.astype(float)) - 9810.0 * np.arange(rate.size)
        wanted = []
        for m in (1, 2, 7, 20):
            i = np.array([i for i in range(rate.size - 2 * m) if valid[i : i + 2 * m + 1].all()])
            wanted.append((data[i + 2 * m] - 2.0 * data[i + m] + data[i]) / m)
        data = np.where(valid, data, np.nan)
    found = allan.deviation(
        data, 1.0, valid=valid, tau=[1.0, 2.0, 7.0, 20.0], data_type=data_type, overlap='full'
    )
    assert found.terms.tolist() == [steps.size for steps in wanted]
    squares = [np.sqrt(np.mean(steps**2) / 2.0) for steps in wanted]
    np.testing.assert_allclose(found.deviation, squares, rtol=1e-9)


@pytest.mark.parametrize('data_type', ['rate', 'phase'])
def test_all_samples_missing(data_type):
    nothing = np.full(100, np.nan)
    with pytest.raises(allan.NoAveragingTime, match='0 s'):
        allan.deviation(nothing, 1.0, valid=np.zeros(100, bool), data_type=data_type)


def test_the_fewest_samples():
    assert allan.deviation([1.0, 3.0], 1.0, tau=[1.0]).deviation[0] == pytest.approx(2.0**0.5)
    with pytest.raises(allan.NoAveragingTime):
        allan.deviation([1.0], 1.0, tau=[1.0])
    gap = np.array([True, False, True, True, False])
    found = allan.deviation([1.0, 9.0, 3.0, 4.0, 9.0], 1.0, tau=[1.0], valid=gap)
    assert found.terms.tolist() == [1]
    assert found.deviation[0] == pytest.approx(0.5**0.5)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_number_of_gaps():
    rng = np.random.default_rng(2)
    rate, valid = rng.normal(size=3_000_000), rng.random(3_000_000) > 0.1
    tracemalloc.start()
    allan.deviation(rate, 10.0, valid=valid, threads=1)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak <= 2 * rate.nbytes
