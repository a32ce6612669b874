# SPDX-License-Identifier: Apache-2.0
"""Degrees of freedom against exact ones, intervals, and a small coverage experiment."""

from hypothesis import given, settings
from hypothesis import strategies as st
from imu_bench.errors import DataError
from imu_bench.metrology import allan
from imu_bench.metrology.deviations import confidence
from imu_bench.metrology.deviations.averaging import decimation
import numpy as np
import pytest
from scipy import stats
from scipy.linalg import toeplitz

from benchmarks import coverage

KINDS = ('adev', 'oadev', 'mdev', 'tdev', 'hdev', 'ohdev', 'totdev')
SAMPLES = 360


def phases(alpha, n):
    """Return what each of many white numbers adds to the phase of power-law noise."""
    before = 0 if alpha == 0 else n
    k = np.arange(1, n + before)
    response = np.concatenate(([1.0], np.cumprod((k - 1 - alpha / 2) / k)))
    rate = np.tril(toeplitz(response))[before:]
    return np.vstack((np.zeros(n + before), np.cumsum(rate, axis=0)))


def differences(phase, kind, m):
    if kind == 'mdev':
        summed = np.vstack((np.zeros(phase.shape[1]), np.cumsum(phase, axis=0)))
        steps = np.diff(sliding(summed, m, 4), n=3, axis=0)[0]
    else:
        order = 3 if kind.endswith('hdev') else 2
        steps = np.diff(sliding(phase, m, order + 1), n=order, axis=0)[0]
    return steps if kind[0] in 'om' else steps[::m]


def sliding(phase, m, count):
    end = phase.shape[0] - (count - 1) * m
    return np.stack([phase[i * m : i * m + end] for i in range(count)])


def exact(steps):
    """
    Return the degrees of freedom of a sum of squares of linear forms in white numbers.

    Of s = |D w|² the mean is tr(D D') and the variance 2 tr((D D')²).
    """
    products = steps @ steps.T
    return np.trace(products) ** 2 / np.sum(products**2)


@pytest.mark.slow
@pytest.mark.parametrize('kind', ['adev', 'oadev', 'mdev', 'hdev', 'ohdev'])
@pytest.mark.parametrize('alpha', [2, 1, 0, -1, -2])
def test_degrees_of_freedom_are_exact(kind, alpha):
    """
    Within 1 % of the exact number for sampled noise, at any tau.

    But for flicker phase noise at m > 25, where the tables of Greenhall and Riley, made for a
    clock whose phase is averaged, are 18 % on the safe side.
    """
    phase = phases(alpha, SAMPLES)
    for m in (1, 2, 3, 7, 20, 25, 40, 70, 100):
        wanted = exact(differences(phase, kind, m))
        found = float(confidence.edf(kind, alpha, m, SAMPLES))
        if alpha == 1 and m > 24:
            assert 0.80 * wanted < found < 1.01 * wanted
        else:
            assert found == pytest.approx(wanted, rel=0.01)


@pytest.mark.parametrize('alpha', [0, -1, -2])
def test_decimation_keeps_its_efficiency(alpha):
    """What `averaging.decimation` leaves out costs less than 1 % of the degrees of freedom."""
    phase = phases(alpha, SAMPLES)
    for m in (48, 60, 81, 108):
        steps = differences(phase, 'oadev', m)
        stride = 3
        assert m // stride >= 16
        assert exact(steps[::stride]) >= 0.99 * exact(steps)
    assert decimation(np.array([48]), 10**9)[0] == 3


def test_white_noise_of_the_textbook():
    """Without overlap and averaging: M differences, neighbours share half: M / 1.5."""
    assert float(confidence.edf('adev', 0, 1, 10**6)) == pytest.approx(10**6 / 1.5, rel=1e-5)


@settings(max_examples=100, deadline=None)
@given(
    kind=st.sampled_from(KINDS),
    alpha=st.floats(-4.0, 2.0),
    m=st.integers(1, 3000),
    n=st.integers(1, 20_000),
)
def test_degrees_of_freedom_are_sane(kind, alpha, m, n):
    """Never below 1, never more than there are terms; more samples, more of them."""
    terms = confidence.DIFFERENCES[kind].terms(m, n + 1)
    if terms < 1:
        with pytest.raises(DataError, match='hold no'):
            confidence.edf(kind, alpha, m, n)
        return
    degrees = float(confidence.edf(kind, alpha, m, n))
    assert 1.0 <= degrees <= terms * (1.0 + 1e-9)
    assert float(confidence.edf(kind, alpha, m, 2 * n + m)) >= degrees


def test_between_whole_exponents():
    below, above = confidence.edf('oadev', [-1.0, 0.0], 100, 10_000)
    middle = float(confidence.edf('oadev', -0.5, 100, 10_000))
    assert middle == pytest.approx(np.sqrt(below * above))


def test_shapes_broadcast():
    m = np.array([1, 10, 100])
    assert confidence.edf('oadev', 0.0, m, 10_000).shape == (3,)
    assert confidence.edf('oadev', np.array([[0.0], [-2.0]]), m, 10_000).shape == (2, 3)


def test_runs_of_many_lengths():
    """Hundreds of lengths go into groups; the sum stays within a percent of the whole."""
    lengths = np.random.default_rng(1).integers(60, 4000, size=500)
    m = np.array([1, 7, 25])
    each = np.array([[float(confidence.edf('oadev', 0, f, n)) for n in lengths] for f in m])
    terms = lengths[None, :] + 1.0 - 2.0 * m[:, None]
    wanted = terms.sum(axis=1) ** 2 / (terms**2 / each).sum(axis=1)
    found = confidence.edf_of_runs('oadev', np.zeros(3, np.int64), m, lengths)
    np.testing.assert_allclose(found, wanted, rtol=0.01)


def test_runs_too_short_do_not_count():
    m, white = np.array([100]), np.array([0])
    alone = confidence.edf_of_runs('oadev', white, m, np.array([5000]))
    beside = confidence.edf_of_runs('oadev', white, m, np.array([150, 5000, 90]))
    np.testing.assert_array_equal(alone, beside)


@pytest.mark.parametrize('level', [0.5, 0.6827, 0.9, 0.95, 0.99])
@pytest.mark.parametrize('degrees', [1.0, 2.7, 12.8, 146.2, 5e4, 1e9])
def test_interval_is_chi_squared(level, degrees):
    low, high = confidence.interval(2.0, degrees, level)
    tail = (1.0 - level) / 2.0
    assert low == pytest.approx(2.0 * np.sqrt(degrees / stats.chi2.ppf(1.0 - tail, degrees)))
    assert high == pytest.approx(2.0 * np.sqrt(degrees / stats.chi2.ppf(tail, degrees)))


def test_simple_interval_is_the_one_of_the_theses():
    """1/sqrt(2 (N/K - 1)), one standard deviation; 24 h to 216 h makes it a third."""
    one_sigma = 2.0 * stats.norm.cdf(1.0) - 1.0
    short, long = (
        (confidence.simple_interval(1.0, 3600, hours * 3600, one_sigma)[1] - 1.0)
        for hours in (24, 216)
    )
    assert short == pytest.approx(1.0 / np.sqrt(2.0 * 23.0))
    assert long == pytest.approx(1.0 / np.sqrt(2.0 * 215.0))
    assert short / long == pytest.approx(3.0, rel=0.02)
    curve = allan.deviation(
        np.random.default_rng(2).normal(size=1000), 1.0, intervals='simple', confidence=one_sigma
    )
    np.testing.assert_allclose(
        curve.high / curve.deviation - 1.0, 1.0 / np.sqrt(2.0 * (1000 / curve.m - 1.0))
    )


def test_simple_interval_of_everything():
    with pytest.raises(DataError, match='more samples than one average'):
        confidence.simple_interval(1.0, 100, 100, 0.95)


@pytest.mark.parametrize('level', [0.0, 1.0, 95.0, -0.1])
def test_levels(level):
    for call in (
        lambda: confidence.interval(1.0, 10.0, level),
        lambda: confidence.simple_interval(1.0, 1, 10, level),
    ):
        with pytest.raises(DataError, match='between 0 and 1'):
            call()


def test_unknown_kind():
    with pytest.raises(DataError, match="unknown deviation 'avar'; known are adev"):
        confidence.edf('avar', 0, 1, 100)


def deviation_alone(noise, m):
    """Return what the whole analysis finds, in a hundredth of the time, without coefficients."""
    return allan.deviation(noise, coverage.RATE_HZ, tau=m / coverage.RATE_HZ), ''


@pytest.mark.parametrize('alpha', [0, -1, -2])
def test_the_whole_analysis_gives_the_same_intervals(alpha):
    noise, m = coverage.made(alpha, 4096, 5), coverage.factors(4096)
    (whole, claimed), (alone, _) = coverage.analyzed_curve(noise, m), deviation_alone(noise, m)
    assert whole.deviation == pytest.approx(alone.deviation, rel=1e-9)
    assert whole.edf == pytest.approx(alone.edf, rel=1e-9)
    assert claimed == 'N' or alpha < 0


@pytest.mark.slow
@pytest.mark.parametrize('alpha', [0, -1, -2])
def test_coverage(alpha):
    """The small version of benchmarks/coverage.py: by chance 2.3 % and 1.1 % off with 400."""
    n = 4096
    lines = coverage.summary(
        alpha, n, [coverage.held(alpha, n, seed, deviation_alone) for seed in range(400, 800)]
    )
    assert lines[-1].m == 409
    for level, chance in ((0.68, 0.07), (0.95, 0.033)):
        covered = np.array([line.covered[level] for line in lines])
        assert np.all(np.abs(covered - level) < chance)
        # of a random walk all averaging times scatter together
        assert abs(covered.mean() - level) < chance / 1.5
    assert np.mean([line.identified for line in lines]) > 0.98


def test_true_deviation_of_the_coverage_experiment():
    """What is taken for the truth there: s/sqrt(m) for white, (2 m² + 1) / 6 m for a walk."""
    n = 500
    for m in (1, 4, 25):
        white = coverage.true_variance(coverage.power_law(0, 2 * n), n, m)
        assert white == pytest.approx(1.0 / m)
        walk = coverage.true_variance(coverage.power_law(-2, 2 * n), n, m)
        assert walk == pytest.approx((2.0 * m**2 + 1.0) / (6.0 * m))
        flicker = coverage.true_variance(coverage.power_law(-1, 2 * n), n, m)
        assert flicker == pytest.approx(2.0 * np.log(2.0) / np.pi, rel=0.5 / m + 0.03)
