# SPDX-License-Identifier: Apache-2.0
"""Histogram and normality: honest with few samples and with millions."""

from imu_bench.errors import DataError
from imu_bench.metrology.normality import histogram, LILLIEFORS, MOST_BINS, normality
import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter


def verdicts(make, runs=40):
    return [normality(make()).verdict for _ in range(runs)]


def test_normal_noise_is_hardly_ever_called_otherwise():
    rng = np.random.default_rng(1)
    for n in (100, 1000, 20_000):
        found = verdicts(lambda n=n: rng.normal(3.0, 0.1, n))
        assert found.count('not normal') <= 8
    assert found.count('normal') >= 34


@pytest.mark.slow
def test_the_quantiles_of_the_distance_are_those_of_normal_records():
    records = np.sort(np.random.default_rng(4).normal(size=(1500, 4000)), axis=1)
    records -= records.mean(axis=1, keepdims=True)
    expected = stats.norm.cdf(records / records.std(axis=1, ddof=1, keepdims=True))
    steps = np.arange(4001) / 4000
    distance = np.maximum(steps[1:] - expected, expected - steps[:-1]).max(axis=1)
    quantiles = np.quantile(distance * np.sqrt(4000), (0.80, 0.85, 0.90, 0.95, 0.99))
    assert quantiles[:4] == pytest.approx(np.array(LILLIEFORS[:4]), rel=0.03)
    assert quantiles[4] == pytest.approx(LILLIEFORS[4], rel=0.06)


@pytest.mark.parametrize('kind', ['uniform', 'student', 'two levels'])
def test_other_noise_is_seen(kind):
    rng = np.random.default_rng(2)
    make = {
        'uniform': lambda: rng.uniform(size=5000),
        'student': lambda: rng.standard_t(4, size=5000),
        'two levels': lambda: rng.normal(size=5000) + 3 * (rng.random(5000) < 0.5),
    }[kind]
    assert set(verdicts(make)) == {'not normal'}


def test_a_departure_nobody_cares_about_is_named_as_such_with_millions_of_samples():
    x = np.random.default_rng(3).normal(size=3_000_000)
    found = normality(x + 0.01 * x**2)
    assert found.verdict == 'practically normal'
    assert found.p_value < 1e-10
    assert found.distance.high < 0.02
    assert found.skewness.low > 0


def test_too_few_samples_decide_nothing():
    assert normality(np.random.default_rng(4).normal(size=30)).verdict == 'undecided'


def test_correlated_samples_do_not_count_as_independent_ones():
    rng = np.random.default_rng(5)
    small = []
    for _ in range(60):
        x = lfilter([1.0], [1.0, -0.98], rng.normal(size=30_000))
        small.append(normality(x).p_value < 0.05)
    assert np.mean(small) < 0.2
    assert stats.normaltest(x).pvalue >= 0  # the textbook test would reject far more often


def test_moments_are_those_of_scipy():
    x = np.random.default_rng(6).gamma(9.0, size=10_000)
    found = normality(x)
    assert found.skewness.value == pytest.approx(stats.skew(x), rel=2e-3)
    assert found.kurtosis.value == pytest.approx(stats.kurtosis(x), rel=2e-3, abs=2e-3)
    assert found.skewness.low < 2 / 3 < found.skewness.high
    assert found.distance.value == pytest.approx(
        stats.kstest((x - x.mean()) / x.std(ddof=1), 'norm').statistic, abs=1e-3
    )
    assert found.beyond_three_sigma == np.mean(np.abs(x - x.mean()) > 3 * x.std(ddof=1))


@pytest.mark.parametrize('step', [0.1, 0.5, 1.0])
def test_quantisation_alone_is_not_a_departure(step):
    x = np.round(np.random.default_rng(7).normal(size=50_000) / step) * step
    assert normality(x).verdict in ('normal', 'practically normal')


def test_histogram_counts_everything():
    x = np.random.default_rng(8).normal(size=100_000)
    x[:3] = 1e6, 1e6, -1e6
    found = histogram(x, 'rad/s')
    assert found.count.sum() + found.below + found.above == 100_000
    assert found.count.size <= MOST_BINS
    assert found.unit == 'rad/s'


def test_histogram_of_normal_noise_is_as_expected():
    found = histogram(np.random.default_rng(9).normal(5.0, 2.0, 200_000), 'm/s²')
    often = found.expected > 20
    pull = (found.count - found.expected)[often] / np.sqrt(found.expected[often])
    assert np.std(pull) == pytest.approx(1.0, abs=0.25)


def test_bins_of_quantised_data_hold_whole_codes():
    step = 9.80665 / 16384
    codes = np.round(np.random.default_rng(10).normal(0, 7, 50_000))
    found = histogram(9.80665 + codes * step, 'm/s²')
    width = np.diff(found.edges) / step
    assert width == pytest.approx(np.full(width.size, round(width[0])), abs=1e-6)
    off = (found.edges - 9.80665) / step
    assert np.abs(off - np.floor(off) - 0.5) == pytest.approx(np.zeros(off.size), abs=1e-6)
    often = found.expected > 200
    assert np.abs(found.count / found.expected - 1)[often].max() < 0.25


def test_histogram_with_a_given_number_of_bins():
    assert histogram(np.random.default_rng(11).normal(size=1000), '1', bins=20).count.size == 20


@pytest.mark.parametrize(
    ('call', 'text'),
    [
        (lambda: histogram([1.0], '1'), 'record longer'),
        (lambda: histogram([1.0, 1.0, 1.0], '1'), 'equal'),
        (lambda: histogram([1.0, 2.0], '1', bins=0), 'at least one bin'),
        (lambda: histogram(np.zeros((2, 2)), '1'), 'shape'),
        (lambda: normality(np.arange(5.0)), 'least'),
        (lambda: normality(np.ones(100)), 'equal'),
        (lambda: normality([np.nan] * 50), 'finite'),
    ],
)
def test_data_without_a_distribution_are_named(call, text):
    with pytest.raises(DataError, match=text):
        call()
