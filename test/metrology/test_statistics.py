# SPDX-License-Identifier: Apache-2.0
"""Statistics of still sensors: values, intervals, outliers, ratios, the theses' tables."""

import json
import math

from hypothesis import given, settings
from hypothesis import strategies as st
from imu_bench.errors import DataError
from imu_bench.metrology.moments import Moments
from imu_bench.metrology.statistics import (
    describe,
    outliers,
    resolution,
    variance_ratio,
)
import numpy as np
import pytest
from scipy.signal import lfilter


def correlated(n, memory, rng):
    """Return first-order noise of unit variance."""
    start = rng.normal(size=n + 20 * int(1 / (1 - memory) + 1))
    return lfilter([math.sqrt(1 - memory**2)], [1, -memory], start)[-n:]


@pytest.mark.parametrize('n', [2, 5, 31, 32, 63, 64, 1000, 70_001])
def test_values_are_those_of_numpy(n):
    x = np.random.default_rng(n).normal(9.81, 0.02, n)
    s = describe(x, 'm/s²')
    assert s.samples == n
    assert s.mean.value == pytest.approx(x.mean(), rel=1e-14)
    assert s.std.value == pytest.approx(x.std(ddof=1), rel=1e-10)
    assert s.rms.value == pytest.approx(x.std(), rel=1e-10)
    assert s.rms_total.value == pytest.approx(np.sqrt(np.mean(x**2)), rel=1e-12)
    assert s.three_sigma.value == pytest.approx(3 * x.std(ddof=1), rel=1e-10)
    assert (s.minimum.value, s.maximum.value) == (x.min(), x.max())
    assert s.peak_to_peak.value == pytest.approx(np.ptp(x))
    assert s.peak.value == pytest.approx(np.abs(x - x.mean()).max(), rel=1e-9)
    assert s.mean.low <= s.mean.value <= s.mean.high
    assert s.std.low < s.std.value < s.std.high


@settings(max_examples=50, deadline=None)
@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e3), st.integers(100, 3000))
def test_offset_and_scale(offset, scale, n):
    x = np.random.default_rng(n).normal(size=n)
    plain, moved = Moments.of(x[None]), Moments.of((offset + scale * x)[None])
    mean = plain.mean_estimate(0, '1')
    other = moved.mean_estimate(0, '1')
    tolerance = 1e-9 * (abs(offset) + scale)
    assert other.value == pytest.approx(offset + scale * mean.value, abs=tolerance)
    assert other.low == pytest.approx(offset + scale * mean.low, abs=1e-6 * (abs(offset) + scale))
    assert moved.variance[0] == pytest.approx(
        scale**2 * plain.variance[0], rel=1e-6, abs=tolerance**2
    )


def test_a_large_bias_costs_no_digits():
    x = np.random.default_rng(1).normal(size=100_000) * 1e-3
    small, large = describe(x, 'm/s²'), describe(x + 2.0**20, 'm/s²')
    assert large.std.value == pytest.approx(small.std.value, rel=1e-6)


def test_a_constant_is_exactly_itself():
    s = describe(np.full(1000, 9.81), 'm/s²')
    assert (s.mean.value, s.std.value, s.peak_to_peak.value) == (9.81, 0.0, 0.0)
    assert (s.mean.low, s.mean.high) == (9.81, 9.81)
    assert s.outliers.count == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ('memory', 'n'), [(0.0, 30_000), (0.9, 30_000), (0.99, 30_000), (0.99, 5000), (0.99, 4000)]
)
def test_intervals_cover_for_correlated_noise(memory, n):
    """The last record is 40 correlation times long."""
    rng = np.random.default_rng(7)
    runs = 300
    inside = np.zeros(4)
    for _ in range(runs):
        s = describe(0.5 + correlated(n, memory, rng), '1')
        truths = (0.5, 1.0, 1.0, math.sqrt(1.25))
        for k, e in enumerate((s.mean, s.std, s.rms, s.rms_total)):
            inside[k] += e.low <= truths[k] <= e.high
    assert (inside > 0.90 * runs).all()
    assert (inside[:3] < 0.995 * runs).all()


@pytest.mark.parametrize('blocks', [8, 64])
@pytest.mark.parametrize('memory', [0.0, 0.3, 0.6])
def test_bias_of_the_correlation_of_neighbours(blocks, memory):
    """The formula that `error_of_mean` takes it off by."""
    rng = np.random.default_rng(11)
    off = np.array([correlated(blocks, memory, rng) for _ in range(4000)])
    off -= off.mean(axis=1, keepdims=True)
    found = (off[:, 1:] * off[:, :-1]).sum(axis=1) / (off**2).sum(axis=1)
    expected = memory - (1.0 + 4.0 * memory) / blocks
    assert found.mean() == pytest.approx(expected, abs=0.02)


def test_sigma_over_root_n_would_promise_too_much():
    rng = np.random.default_rng(8)
    s = describe(correlated(30_000, 0.99, rng), '1')
    naive = 1.96 * s.std.value / math.sqrt(s.samples)
    assert (s.mean.high - s.mean.low) / 2 > 5 * naive


def test_higher_confidence_is_wider():
    x = np.random.default_rng(9).normal(size=5000)
    half, most = (describe(x, '1', level) for level in (0.5, 0.99))
    assert most.mean.low < half.mean.low < half.mean.high < most.mean.high
    assert most.std.low < half.std.low < half.std.high < most.std.high


def test_not_finite_and_missing_samples_are_left_out_and_counted():
    x = np.random.default_rng(10).normal(size=1000)
    dirty = x.copy()
    dirty[[3, 500, 700]] = np.nan, np.inf, -np.inf
    valid = np.ones(1000, dtype=bool)
    valid[900:] = False
    s = describe(dirty, '1', valid=valid)
    clean = np.delete(x[:900], [3, 500, 700])
    assert (s.samples, s.left_out) == (897, 3)
    assert s.mean.value == pytest.approx(clean.mean())


@pytest.mark.parametrize(
    ('data', 'text'),
    [([], 'nothing'), ([np.nan, np.nan], 'nothing'), (np.zeros((2, 2)), 'shape')],
)
def test_data_that_cannot_be_described_are_named(data, text):
    with pytest.raises(DataError, match=text):
        describe(data, '1')


def test_a_mask_of_another_length_is_named():
    with pytest.raises(DataError, match='valid'):
        describe(np.zeros(5), '1', valid=np.ones(4, dtype=bool))


def test_a_single_sample_has_no_spread():
    s = describe([1.5], 'm/s²')
    assert s.mean.value == 1.5
    assert s.mean.low is None
    assert not s.std.observable


def test_normal_noise_of_any_length_has_hardly_an_outlier():
    rng = np.random.default_rng(11)
    found = sum(outliers(rng.normal(size=n)).count for n in (1000, 100_000) for _ in range(30))
    assert found <= 8  # 3 expected


def test_outliers_are_found_counted_and_kept_unless_asked():
    x = np.random.default_rng(12).normal(9.81, 0.01, 50_000)
    x[[10, 20_000]] = 0.0, 15.0
    kept, dropped = describe(x, 'm/s²'), describe(x, 'm/s²', drop_outliers=True)
    assert kept.outliers.indices.tolist() == [10, 20_000]
    assert (kept.samples, dropped.samples, dropped.left_out) == (50_000, 49_998, 2)
    assert kept.std.value > 3 * dropped.std.value
    assert kept.minimum.value == 0.0


def test_many_outliers_are_counted_and_the_largest_listed():
    x = np.random.default_rng(13).normal(size=100_000)
    x[::40] += 100.0
    found = outliers(x)
    assert found.count == 2500
    assert found.indices.size == 1000
    assert (np.diff(found.indices) > 0).all()


def test_quantised_noise_below_its_step_has_no_outliers():
    rng = np.random.default_rng(14)
    x = np.round(rng.normal(0.0, 0.2, 50_000)) * 0.01  # codes -1, 0, 1 and mostly 0
    assert outliers(x).count == 0
    assert outliers(np.append(x, 1.0)).indices.tolist() == [50_000]


@pytest.mark.parametrize('step', [1.0, 0.0078125, 9.80665 / 16384])
def test_the_step_of_quantised_data(step):
    x = np.round(np.random.default_rng(15).normal(0, 5, 20_000)) * step
    assert resolution(x) == pytest.approx(step, rel=1e-6)
    assert resolution(np.random.default_rng(16).normal(size=20_000)) == 0.0
    assert resolution(np.full(100, 3.0)) == 0.0


@pytest.mark.slow
def test_interval_of_a_ratio_covers():
    rng = np.random.default_rng(17)
    inside = 0
    for _ in range(200):
        first, second = (describe(s * correlated(5000, 0.9, rng), '1') for s in (2.0, 1.0))
        ratio = variance_ratio(first, second)
        inside += ratio.low <= 4.0 <= ratio.high
    assert inside >= 0.9 * 200


def test_ratios_that_make_no_sense_are_named():
    x = np.random.default_rng(18).normal(size=100)
    still = describe(np.zeros(100), 'm/s²')
    with pytest.raises(DataError, match='not zero'):
        variance_ratio(describe(x, 'm/s²'), still)
    with pytest.raises(DataError, match='rad/s'):
        variance_ratio(describe(x, 'm/s²'), describe(x, 'rad/s'))


def fabricated(std, samples=1000):
    """Return the statistics of a sensor of which only the standard deviation is printed."""
    x = np.random.default_rng(19).normal(size=samples)
    return describe((x - x.mean()) / x.std(ddof=1) * std, 'm/s²')


def test_scl3300_iim42652_thesis_table_1():
    """Table 1: variances 9.9557e-4 and 1.1874e-4 (TDK IIM-42652, Murata SCL3300), ratio 8.38."""
    tdk, murata = fabricated(math.sqrt(9.9557e-4)), fabricated(math.sqrt(1.1874e-4))
    assert variance_ratio(tdk, murata).value == pytest.approx(8.38, abs=0.005)
    # the printed three sigma are those of these variances
    assert tdk.three_sigma.value == pytest.approx(0.0947, abs=5e-5)
    assert murata.three_sigma.value == pytest.approx(0.0327, abs=5e-5)


@pytest.mark.parametrize(
    ('std', 'ratio'), [(0.0116, 116), (0.0318, 318), (0.0383, 383), (0.0140, 140), (0.30, 3000)]
)
def test_shabulinzenze_table_5_1_ratios(std, ratio):
    """
    Table 5.1 gives ratios to the piezo sensor (MTN-1100), z axis.

    They follow from 0.0001 m/s², which the text gives for it, and not from the 0.0788
    printed in the table (0.0116 / 0.0788 = 0.15): that number is in other units.
    """
    found = variance_ratio(fabricated(std), fabricated(1e-4)).value
    assert math.sqrt(found) == pytest.approx(ratio, rel=1e-9)
    assert variance_ratio(fabricated(std), fabricated(0.0788)).value < 4**2


@pytest.mark.data
def test_mpu6050_at_rest(shared_data):
    folder = shared_data / 'mpu6050_static'
    reference = json.loads((folder / 'reference_static_449s_raw.json').read_text())
    (path,) = folder.rglob(reference['dataset'])
    table = np.loadtxt(path, delimiter=',', skiprows=5)
    known = reference['channels']['ax']
    s = describe(table[:, 0], '1')
    assert s.mean.value == pytest.approx(known['mean'], rel=1e-12)
    assert s.mean.low < s.mean.value < s.mean.high
    assert s.samples == known['n']
    assert s.std.value == pytest.approx(known['std_ddof1'], rel=1e-12)
    assert s.rms.value == pytest.approx(known['rms_about_mean'], rel=1e-12)
    assert (s.minimum.value, s.maximum.value) == (known['min'], known['max'])
