# SPDX-License-Identifier: Apache-2.0
"""Several records of one sensor: one curve, one set of coefficients, and their scatter."""

from imu_bench.errors import DataError
from imu_bench.metrology import allan
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.noise_fit import fitted
from imu_bench.metrology.pooling import pooled, scatter
import numpy as np
import pytest


def record(seed, n=20_000, level=1.0, walk=0.0, rate=100.0):
    rng = np.random.default_rng([40, seed])
    x = rng.normal(scale=level * rate**0.5, size=n)
    return x + walk * np.cumsum(rng.normal(size=n)) / rate**0.5


def test_a_pool_is_the_record_with_holes_that_it_would_have_been():
    parts = [record(seed, n) for seed, n in enumerate((9000, 14_000, 20_000))]
    hole = np.full(500, np.nan)
    whole = np.concatenate([parts[0], hole, parts[1], hole, parts[2]])
    holed = allan.deviation(whole, 100.0, valid=np.isfinite(whole), tau='octave')
    both = pooled([allan.deviation(part, 100.0, tau='octave') for part in parts])
    assert both.samples == holed.samples
    short = np.isin(both.m, holed.m) & (both.m <= 1024)
    np.testing.assert_array_equal(both.terms[short], holed.terms[: short.sum()])
    np.testing.assert_allclose(both.deviation[short], holed.deviation[: short.sum()], rtol=2e-3)
    np.testing.assert_allclose(both.edf[short], holed.edf[: short.sum()], rtol=0.05)
    one, other = fitted(both), fitted(holed)
    assert one.N.value == pytest.approx(other.N.value, rel=1e-3)
    assert one.N.high - one.N.low == pytest.approx(other.N.high - other.N.low, rel=0.1)


@pytest.mark.slow
def test_the_interval_of_the_pool_holds_the_truth_and_is_narrower():
    held, widths, alone = 0, [], []
    for seed in range(20):
        curves = [allan.deviation(record([seed, k], 6000), 100.0) for k in range(5)]
        model, single = fitted(pooled(curves)), fitted(curves[0])
        held += model.N.low < 1.0 < model.N.high
        widths.append(model.N.high - model.N.low)
        alone.append(single.N.high - single.N.low)
    assert held >= 17
    assert np.mean(widths) < 0.7 * np.mean(alone)


def test_scatter_tells_chance_from_difference():
    alike = [fitted(allan.deviation(record(seed), 100.0)).N for seed in range(8)]
    assert scatter(alike).excess.low < 1.0
    levels = np.linspace(0.8, 1.2, 8)
    different = [
        fitted(allan.deviation(record(seed, level=level), 100.0)).N
        for seed, level in enumerate(levels)
    ]
    found = scatter(different)
    assert found.excess.low > 1.0 and found.records == 8
    assert found.std.low < levels.std(ddof=1) < found.std.high


def test_numbers_that_no_record_has_scatter_not():
    absent = Estimate.not_observable('1', 'not there')
    assert scatter([absent, Estimate(1.0, 0.9, 1.1, '1')]) is None


def test_what_is_not_pooled():
    curve = allan.deviation(record(1), 100.0)
    with pytest.raises(DataError, match='100, 200 Hz are not pooled'):
        pooled([curve, allan.deviation(record(2), 200.0)])
    with pytest.raises(DataError, match='in rad/s is not pooled'):
        pooled([curve, allan.deviation(record(2), 100.0, unit='rad/s')])
