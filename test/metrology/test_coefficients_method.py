# SPDX-License-Identifier: Apache-2.0
"""The parts of the fit, each against something independent."""

from itertools import pairwise

from imu_bench.errors import DataError
from imu_bench.metrology.deviations import confidence
from imu_bench.metrology.fitting.fit_report import seconds_needed
from imu_bench.metrology.fitting.model_fit import degrees_of_freedom, octaves_of, prepare, solve
from imu_bench.metrology.fitting.noise_model import (
    density_basis,
    gauss_markov_density,
    gauss_markov_variance,
    GM_PEAK,
    GM_PEAK_TAU,
    variance_basis,
)
from imu_bench.metrology.fitting.scoring import subsets
from imu_bench.metrology.fitting.transfer import overlapped_degrees, transfer
from imu_bench.metrology.fitting.uncertainty import pearson3_below, respond
import numpy as np
import pytest
from scipy import integrate, optimize, stats

M = np.array([1, 2, 4, 8, 16, 32, 100, 316, 1000, 3162, 10_000])


@pytest.mark.parametrize('term', 'QNBK')
def test_variance_and_density_of_a_term_are_a_pair(term):
    """σ²(τ) = ∫ S H df, IEEE Std 952-1997 annex C, S one-sided and H as sampled."""
    seen = transfer(M, 0.01)
    variance = density_basis(seen.frequency, 0.01, term)[0] * seen.power @ seen.width
    # flicker and random walk near the sample period depend on how the sensor samples; the
    # logarithmic grid is coarse where quantisation noise has its power
    near, far = {'Q': (0.01, 0.3), 'N': (0.01, 0.02), 'B': (0.5, 0.02), 'K': (0.5, 0.02)}[term]
    tolerance = np.where(M < 10, near, far)
    expected = variance_basis(M * 0.01, term)[0]
    assert np.all(np.abs(variance / expected - 1.0) < tolerance)


def test_the_gauss_markov_process_by_integration():
    time = 3.0
    for tau in (0.02, 0.3, 3.0, 30.0, 300.0):

        def integrand(x, tau=tau):
            density = float(gauss_markov_density(x / (np.pi * tau), time))
            return density * 2.0 * np.sin(x) ** 4 / x**2 / (np.pi * tau)

        edges = np.concatenate([[0.0], np.geomspace(1e-4, 3000.0, 400)])
        area = sum(integrate.quad(integrand, a, b, limit=200)[0] for a, b in pairwise(edges))
        assert float(gauss_markov_variance([tau], time)[0]) == pytest.approx(area, rel=2e-3)


def test_the_gauss_markov_peak_of_the_standard():
    peak = optimize.minimize_scalar(
        lambda tau: -float(gauss_markov_variance([tau], 1.0)[0]), bounds=(1.0, 3.0)
    )
    assert peak.x == pytest.approx(GM_PEAK_TAU, abs=5e-3)
    assert np.sqrt(-peak.fun) == pytest.approx(GM_PEAK, abs=5e-4)


def test_the_gauss_markov_series_joins_the_closed_form():
    x = np.geomspace(0.005, 0.02, 50)
    ratio = gauss_markov_variance(x, 1.0) / (x / 3.0)
    assert np.all(np.abs(np.diff(ratio, 3)) < 1e-6)
    assert float(gauss_markov_variance([1e-12], 1.0)[0]) == pytest.approx(1e-12 / 3, rel=1e-9)
    with pytest.raises(DataError, match='correlation time'):
        gauss_markov_variance([1.0], 0.0)


@pytest.mark.parametrize('alpha', [0, -1, -2])
def test_degrees_of_freedom_agree_with_greenhall_and_riley(alpha):
    n = 100_000
    m = np.array([3, 10, 30, 100, 300, 1000, 3000, 10_000, 25_000])
    ours = overlapped_degrees(np.full(m.size, alpha), m, 1.0, n)
    theirs = confidence.edf('oadev', alpha, m, n + 1)
    np.testing.assert_allclose(ours, theirs, rtol=0.12)
    np.testing.assert_allclose(ours[1:], theirs[1:], rtol=0.08)


def test_degrees_of_freedom_of_a_mixture_lie_between_its_parts():
    problem = prepare(M, np.ones(M.size), 0.01, 100_000, 'NK')
    white, walk, both = degrees_of_freedom(problem, np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 0.3]]))
    assert np.all(both <= 1.1 * np.maximum(white, walk))
    assert np.all(both >= 0.9 * np.minimum(white, walk))
    assert both[0] == pytest.approx(white[0], rel=0.05)
    assert both[-1] == pytest.approx(walk[-1], rel=0.05)


def test_predicted_scatter_and_correlation_are_those_of_simulated_white_noise():
    n, runs = 4096, 400
    m = np.array([1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024])
    rng = np.random.default_rng(3)
    variances = np.array([_oavar(rng.standard_normal(n), m) for _ in range(runs)])
    problem = prepare(m, np.sqrt(variances.mean(axis=0)), 1.0, n, 'NK')
    fitted = solve(problem, subsets(2, 1))[1]
    assert fitted.mask.tolist() == [True, False]
    answer = respond(problem, fitted)['N']
    model = fitted.squares @ problem.basis
    weights = problem.octaves / (2.0 / fitted.degrees + 1e-4) / model**2
    row = weights * problem.basis[0] / (weights @ problem.basis[0] ** 2)
    estimates = variances / problem.scale**2 @ row
    assert answer.value == pytest.approx(float(estimates.mean()), rel=0.01)
    assert answer.spread(answer.value) == pytest.approx(float(estimates.std()), rel=0.1)


def _oavar(x, factors):
    phase = np.concatenate([[0.0], np.cumsum(x - x.mean())])
    result = []
    for m in factors:
        d = phase[2 * m :] - 2.0 * phase[m:-m] + phase[: -2 * m]
        result.append(float(d @ d) / (2.0 * d.size * m**2))
    return result


@pytest.mark.parametrize('skewness', [-1.5, -0.2, 0.0, 1e-4, 0.3, 2.0])
def test_pearson_type_three(skewness):
    z = np.linspace(-4.0, 4.0, 41)
    expected = stats.pearson3.cdf(z, skewness)
    np.testing.assert_allclose(pearson3_below(z, np.full(41, skewness)), expected, atol=2e-4)


def test_octaves_do_not_depend_on_how_many_points_share_them():
    for count in (20, 200):
        tau = np.geomspace(1.0, 1024.0, count)
        assert octaves_of(tau).sum() == pytest.approx(10.0, rel=0.06)
    assert octaves_of(np.array([3.0])).tolist() == [1.0]


def test_the_best_subset_is_the_non_negative_optimum():
    """Enumerating subsets is non-negative least squares: the same as scipy's."""
    rng = np.random.default_rng(5)
    m = 2 ** np.arange(14)
    for _ in range(20):
        truth = rng.uniform(0.1, 1.0, 4) * np.array([1e-4, 1e-3, 1e-4, 1e-6])
        d = np.sqrt(truth @ variance_basis(m * 0.01, 'QNBK')) * rng.uniform(0.95, 1.05, m.size)
        problem = prepare(m, d, 0.01, 2**20, 'QNBK')
        found = solve(problem, subsets(4, 4))
        best = int(np.argmin(np.where(np.isfinite(found.score), found.misfit, np.inf)))
        degrees = found.degrees[best]
        weight = np.sqrt(problem.octaves / (2.0 / degrees + 1e-4))
        weight = weight / (found.squares[best] @ problem.basis)
        scale = np.linalg.norm(problem.basis * weight, axis=1)
        theirs, _ = optimize.nnls(((problem.basis * weight).T / scale), problem.variance * weight)
        np.testing.assert_allclose(found.squares[best] * scale, theirs, atol=2e-3 * theirs.max())


def test_record_length_of_known_cases():
    # white noise alone: variance 2/edf falls as 1/T, so 10 % of N needs a quarter of 5 %
    squares = np.array([1.0])
    assert seconds_needed('N', squares, 'N', 0.01, 100.0, 0.1) == 100.0
    needed = seconds_needed('N', squares, 'N', 0.01, 100.0, 0.4)
    assert needed == pytest.approx(400.0, rel=0.1)
    # a random walk known to 40 % of K in 20 min: about (40/10)² of them
    walk = np.array([2.5e-3**2, 7e-5**2])
    needed = seconds_needed('NK', walk, 'K', 0.01, 1200.0, 0.8 * walk[1])
    assert 10.0 < needed / 1200.0 < 22.0
    # under white noise that hides it, the lowest frequency of a longer record shows it first
    faint = np.array([1.0, 1e-8])
    sooner = seconds_needed('NK', faint, 'K', 0.01, 1200.0, 5000.0 * faint[1])
    assert sooner > 1200.0
    assert seconds_needed('N', squares, 'N', 0.01, 100.0, 1e6) == np.inf


@pytest.mark.parametrize(('others', 'power'), [('N', 1.5), ('NB', 1.0), ('NK', 0.5)])
def test_record_length_of_a_ramp(others, power):
    terms, squares = others + 'R', np.ones(len(others) + 1)
    needed = seconds_needed(terms, squares, 'R', 0.01, 1000.0, 0.8)
    assert needed == pytest.approx(1000.0 * 4.0 ** (1.0 / power))
