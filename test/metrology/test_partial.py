# SPDX-License-Identifier: Apache-2.0
"""Averages that lack a few samples: by their definition, and close to those of a whole record."""

from imu_bench.errors import DataError
from imu_bench.metrology import allan, blockwise
from imu_bench.metrology.noise_fit import fitted
import numpy as np
import pytest


def differences(rate, valid, m, min_share):
    """Return the differences of neighbouring means over those samples that are there."""
    found = []
    for start in range(rate.size - 2 * m + 1):
        halves = [slice(start + k * m, start + (k + 1) * m) for k in (0, 1)]
        if all(valid[half].mean() >= min_share for half in halves):
            first, second = (rate[half][valid[half]].mean() for half in halves)
            found.append(second - first)
    return np.array(found)


def fewer(valid, m, min_share):
    """Return by how much white noise is above that of full averages."""
    found = []
    for start in range(valid.size - 2 * m + 1):
        counts = [np.count_nonzero(valid[start + k * m : start + (k + 1) * m]) for k in (0, 1)]
        if min(counts) >= min_share * m:
            found.append(0.5 * m * (1.0 / counts[0] + 1.0 / counts[1]))
    return np.mean(found)


@pytest.mark.parametrize('min_share', [0.5, 0.9, 0.95])
@pytest.mark.parametrize('dtype', [np.float64, np.float32, np.int32])
def test_by_the_definition(min_share, dtype, monkeypatch):
    monkeypatch.setattr(blockwise, 'BLOCK', 1 << 8)
    rng = np.random.default_rng(1)
    rate = (1000.0 * rng.normal(9.81, 1.0, 1000)).astype(dtype)
    valid = rng.random(rate.size) > 0.04
    valid[[0, 500, 501, 502, 503, 504, -1]] = False
    m = [1, 2, 10, 20, 60]
    found = allan.deviation(rate, 1.0, valid=valid, tau=[float(k) for k in m], min_share=min_share)
    wanted = [differences(rate.astype(float), valid, k, min_share) for k in m]
    assert found.terms.tolist() == [steps.size for steps in wanted]
    expected = np.array([np.mean(steps**2) / 2.0 for steps in wanted])
    # white noise: brought back to averages that lack nothing, with the counts of each difference
    short = np.array([fewer(valid, k, min_share) for k in m])
    assert short[0] == 1.0 < short[-1] < 1.1
    np.testing.assert_allclose(found.deviation**2, expected / short, rtol=0.02)
    full = short == 1.0
    np.testing.assert_allclose(found.deviation[full] ** 2, expected[full], rtol=1e-9)
    assert found.min_share == min_share
    assert found.samples == np.count_nonzero(valid)


def test_a_record_without_gaps_is_not_touched():
    rate = np.random.default_rng(2).normal(size=2000)
    strict = allan.deviation(rate, 1.0)
    for valid in (None, np.ones(2000, bool)):
        lenient = allan.deviation(rate, 1.0, valid=valid, min_share=0.95)
        np.testing.assert_array_equal(lenient.deviation, strict.deviation)
        assert lenient.min_share == 1.0


@pytest.mark.slow
@pytest.mark.parametrize('lost', [0.001, 0.01])
@pytest.mark.parametrize('noise', ['white', 'walk', 'both', 'ramp'])
def test_losses_at_random_cost_a_percent(lost, noise):
    """Against the same records without losses, averaged over 20; strict gives up long before."""
    rng = np.random.default_rng(3)
    whole, lossy, alike = 0.0, 0.0, 0.0
    for _ in range(20):
        white, walk = rng.normal(size=(2, 40_000))
        rate = {
            'white': white,
            'walk': np.cumsum(walk),
            'both': white + 0.01 * np.cumsum(walk),
            'ramp': 0.01 * np.arange(white.size) + white,
        }[noise]
        valid = rng.random(rate.size) > lost
        full = allan.deviation(rate, 100.0)
        found = allan.deviation(np.where(valid, rate, np.nan), 100.0, valid=valid, min_share=0.95)
        np.testing.assert_array_equal(found.m, full.m)
        whole = whole + full.deviation**2
        lossy = lossy + found.deviation**2
        alike = alike + (found.alpha == full.alpha) / 20
    strict = allan.deviation(rate, 100.0, valid=valid)
    assert strict.m[-1] < 0.5 * full.m[-1]
    ratio = np.sqrt(lossy / whole)
    np.testing.assert_allclose(ratio, 1.0, atol=0.006 if lost < 0.005 else 0.015)
    assert alike.mean() > 0.95


@pytest.mark.slow
def test_intervals_hold_the_truth():
    rng = np.random.default_rng(4)
    tau = [0.01, 1.0, 10.0, 30.0]
    held = np.zeros(4)
    for _ in range(300):
        valid = rng.random(30_000) > 0.01
        found = allan.deviation(
            rng.normal(size=30_000), 100.0, valid=valid, tau=tau, min_share=0.95
        )
        truth = 1.0 / np.sqrt(found.m)
        held += (found.low < truth) & (truth < found.high)
    assert np.all(held > 0.92 * 300), held


def test_decimated_and_threads(monkeypatch):
    rng = np.random.default_rng(5)
    rate, valid = rng.normal(size=100_000), rng.random(100_000) > 0.005
    full = allan.deviation(rate, 10.0, valid=valid, min_share=0.9, overlap='full')
    thin = allan.deviation(rate, 10.0, valid=valid, min_share=0.9, overlap='decimated')
    assert thin.terms.sum() < 0.6 * full.terms.sum()
    below = full.m < 10_000
    np.testing.assert_allclose(thin.deviation[below], full.deviation[below], rtol=0.01)
    np.testing.assert_allclose(thin.edf, full.edf, rtol=0.01)
    monkeypatch.setattr(blockwise, 'BLOCK', 1 << 12)
    monkeypatch.setattr(blockwise, '_WORTH_THREADS', 0)
    one, four = (
        allan.deviation(rate, 10.0, valid=valid, min_share=0.9, threads=threads)
        for threads in (1, 4)
    )
    np.testing.assert_array_equal(one.deviation, four.deviation)


def test_averages_that_have_too_little_are_named():
    rng = np.random.default_rng(6)
    valid = np.arange(2000) % 4 > 0
    with pytest.raises(allan.NoAveragingTime, match='have 95 % of their samples at any'):
        allan.deviation(rng.normal(size=2000), 1.0, valid=valid, tau=[400.0], min_share=0.95)
    some = allan.deviation(rng.normal(size=2000), 1.0, valid=valid, min_share=0.95)
    assert some.m.tolist() == [1]
    assert 'have 95 % of their samples' in some.omitted[-1][1]


@pytest.mark.parametrize(
    ('options', 'says'),
    [
        ({'min_share': 0.4}, 'between 0.5 and 1'),
        ({'min_share': 1.1}, 'between 0.5 and 1'),
        ({'min_share': np.nan}, 'between 0.5 and 1'),
        ({'min_share': 0.9, 'kind': 'mdev'}, "not for 'mdev'"),
        ({'min_share': 0.9, 'data_type': 'phase'}, "of 'phase'"),
    ],
)
def test_refused(options, says):
    with pytest.raises(DataError, match=says):
        allan.deviation(np.arange(100.0), 1.0, **options)


def test_random_losses_invent_no_filter_and_leave_n_where_it_is():
    """One sample in twenty: short averages lack nothing, long ones a twentieth."""
    held, errors, filters = 0, [], 0
    for seed in range(12):
        rng = np.random.default_rng([9, seed])
        valid = rng.random(60_000) > 0.05
        curve = allan.deviation(rng.normal(size=60_000), 100.0, valid=valid, min_share=0.9)
        model = fitted(curve)
        held += model.N.low < 0.1 < model.N.high
        errors.append(model.N.value / 0.1 - 1.0)
        filters += model.low_pass is not None
    assert held >= 10 and filters <= 1
    assert abs(np.mean(errors)) < 0.003
