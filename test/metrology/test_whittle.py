# SPDX-License-Identifier: Apache-2.0
"""The spectrum's opinion on the coefficients, and where it contradicts the Allan variance."""

import math

from imu_bench.errors import DataError
from imu_bench.metrology import allan, coefficients, whittle
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.fitting.noise_model import NoiseModel
from imu_bench.metrology.likelihood.cosines import Cosines
from imu_bench.metrology.markov.gauss_markov import Process
import numpy as np
import pytest
from scipy import fft, stats

RATE_HZ = 100.0
UNSEEN = Estimate.not_observable('1', 'not asked for')


def white(n, rng, density=2e-3):
    return density * math.sqrt(RATE_HZ) * rng.standard_normal(n)


def flicker(n, rng, b):
    """Return noise of two-sided density b²/(2πf), by shaping a white spectrum."""
    spectrum = fft.rfft(rng.standard_normal(2 * n))
    frequency = fft.rfftfreq(2 * n, 1.0 / RATE_HZ)
    gain = b * np.sqrt(RATE_HZ / (2 * np.pi * np.maximum(frequency, frequency[1])))
    return fft.irfft(spectrum * gain)[:n]


def test_white_noise():
    model = whittle.fit(white(2**17, np.random.default_rng(1)), RATE_HZ, unit='m/s²')
    assert model.terms == 'N'
    assert model.N.low < 2e-3 < model.N.high
    assert model.N.high - model.N.low < 0.03 * 2e-3
    assert model.N.unit == 'm/s²/√Hz' and model.B.unit == 'm/s²'


def test_every_term_by_itself():
    rng = np.random.default_rng(2)
    n = 2**16
    signals = {
        'Q': 1e-3 * RATE_HZ * np.diff(rng.standard_normal(n + 1)),
        'N': white(n, rng, 1e-3),
        'B': flicker(n, rng, 1e-3),
        'K': np.cumsum(1e-3 / math.sqrt(RATE_HZ) * rng.standard_normal(n)),
    }
    for term, x in signals.items():
        # the discrete random walk and its continuous density differ near half the rate
        model = whittle.fit(x, RATE_HZ, terms=term, shortest_tau=0.1)
        estimate = model.coefficients[term]
        assert estimate.value == pytest.approx(1e-3, rel=0.12), term
        assert model.terms == term


@pytest.mark.slow
def test_intervals_hold_the_truth():
    truth = {'N': 1e-3, 'B': 1e-3, 'K': 4e-4}
    held = {term: [] for term in truth}
    for run in range(50):
        rng = np.random.default_rng([3, run])
        n = 2**16
        x = white(n, rng, 1e-3) + flicker(n, rng, 1e-3)
        x += np.cumsum(4e-4 / math.sqrt(RATE_HZ) * rng.standard_normal(n))
        model = whittle.fit(x, RATE_HZ, terms='NBK')
        for term, true in truth.items():
            estimate = model.coefficients[term]
            held[term].append(estimate.low <= true <= estimate.high)
    for term, inside in held.items():
        assert np.mean(inside) >= 0.84, term


def test_a_line_is_not_noise():
    rng = np.random.default_rng(4)
    x = white(2**17, rng)
    t = np.arange(x.size) / RATE_HZ
    model = whittle.fit(x + 0.02 * np.sin(2 * np.pi * 17.3 * t), RATE_HZ)
    assert model.N.value == pytest.approx(2e-3, rel=0.01)
    assert model.terms == 'N'


def test_the_longest_piece_without_gaps_counts():
    rng = np.random.default_rng(5)
    x = white(2**16, rng)
    valid = np.ones(x.size, bool)
    valid[[1000, 50_000]] = False
    holed = np.where(valid, x, np.nan)
    model = whittle.fit(holed, RATE_HZ, valid=valid)
    piece = whittle.fit(x[1001:50_000], RATE_HZ)
    assert model.N == piece.N


def test_it_agrees_with_the_allan_variance_on_noise():
    rng = np.random.default_rng(6)
    x = white(2**17, rng) + np.cumsum(3e-4 / math.sqrt(RATE_HZ) * rng.standard_normal(2**17))
    model = coefficients.fit(allan.deviation(x, RATE_HZ))
    assert whittle.disagreements(model, whittle.fit(x, RATE_HZ, terms='NK')) == ()


def test_a_step_makes_them_disagree():
    """A jump of the bias is no noise: the two methods read different coefficients from it."""
    rng = np.random.default_rng(7)
    x = white(2**17, rng) + 0.2 * (np.arange(2**17) > 70_000)
    model = coefficients.fit(allan.deviation(x, RATE_HZ))
    found = whittle.disagreements(model, whittle.fit(x, RATE_HZ))
    assert found
    assert 'look at the spectrum' in found[0]
    assert all(text[0] in 'QBKR' for text in found)


def test_disagreement_is_symmetric_and_names_both_sides():
    rng = np.random.default_rng(8)
    one = whittle.fit(white(2**15, rng), RATE_HZ)
    other = whittle.fit(white(2**15, rng, 4e-3), RATE_HZ)
    assert len(whittle.disagreements(one, other)) == len(whittle.disagreements(other, one)) == 1
    text = whittle.disagreements(one, other)[0]
    assert text.startswith('N from the Whittle likelihood') and 'to 0.00' in text


def with_n(n):
    return NoiseModel('1', **{t: n if t == 'N' else UNSEEN for t in 'QNBKR'}, method='a test')


def test_the_level_of_a_contradiction_counts_both_intervals():
    exact = with_n(Estimate(1.0, 0.999, 1.001, '1'))
    # 2.5 standard deviations: a chance of 1 %, which six axes have one time in twenty
    rough = Estimate(1.128, 1.03, 1.24, '1')
    assert whittle.disagreements(exact, with_n(rough)) == ()
    assert whittle.disagreements(exact, with_n(rough), false_alarm=0.05)
    assert whittle.disagreements(exact, with_n(rough.scaled(1.05, '1')))


def test_at_most_one_record_of_six_axes_in_a_hundred_is_contradicted():
    """An estimate with an interval of 2 % against one of a thirtieth of the data, both right."""
    rng = np.random.default_rng(15)
    flagged = 0
    quantiles = stats.chi2.ppf([0.975, 0.025], 250) / 250
    for _ in range(1000):
        squares = rng.chisquare(250, 6) / 250
        exact = rng.normal(1.0, 0.005, 6)
        flagged += any(
            whittle.disagreements(
                with_n(Estimate(a, a - 0.0098, a + 0.0098, '1')),
                with_n(Estimate(*np.sqrt(b / np.array([1.0, *quantiles])), '1')),
            )
            for a, b in zip(exact, squares, strict=True)
        )
    assert flagged <= 15  # of 10 allowed; 169 had intervals that do not overlap


def test_a_value_contradicts_a_bound_that_it_is_clearly_above():
    bound = with_n(Estimate.not_observable('1', 'hidden', high=1.0))
    for low, told in ((1.05, False), (1.4, True)):
        value = with_n(Estimate(1.5, low, 1.5**2 / low, '1'))
        assert bool(whittle.disagreements(bound, value)) is told
        assert bool(whittle.disagreements(value, bound)) is told
    assert whittle.disagreements(bound, bound) == ()


@pytest.mark.parametrize(
    ('data', 'reason'),
    [(np.ones(1000), 'never changes'), (np.arange(10.0), '10 samples'), ([], '0 samples')],
)
def test_data_without_a_spectrum(data, reason):
    model = whittle.fit(data, RATE_HZ)
    assert model.terms == ''
    assert all(reason in e.reason for e in model.coefficients.values())


@pytest.mark.parametrize(
    ('keywords', 'text'),
    [
        ({'data': np.ones((100, 2))}, '2 dimensions'),
        ({'data': np.full(100, np.nan)}, 'NaN'),
        ({'rate_hz': 0.0}, 'sample rate'),
        ({'rate_hz': math.nan}, 'sample rate'),
        ({'terms': 'R'}, 'terms'),
        ({'terms': 'NN'}, 'terms'),
        ({'confidence': 1.0}, 'confidence'),
        ({'valid': [True]}, 'valid has shape'),
    ],
)
def test_bad_input_is_named(keywords, text):
    arguments = {'data': np.arange(100.0), 'rate_hz': 10.0} | keywords
    data, rate_hz = arguments.pop('data'), arguments.pop('rate_hz')
    with pytest.raises(DataError, match=text):
        whittle.fit(data, rate_hz, **arguments)


@pytest.mark.parametrize('factor', [1e-120, 1e120])
def test_any_scale(factor):
    x = white(4096, np.random.default_rng(9))
    assert whittle.fit(factor * x, RATE_HZ).N.value == pytest.approx(
        factor * whittle.fit(x, RATE_HZ).N.value
    )


def test_a_process_with_a_memory_is_not_taken_for_a_term():
    for seed in range(5):
        rng = np.random.default_rng([12, seed])
        x = white(2**16, rng) + Process(2e-3, 10.0).simulate(2**16, RATE_HZ, rng)
        model = whittle.fit(x, RATE_HZ, terms='NBK', correlation_time=10.0)
        assert model.N.value == pytest.approx(2e-3, rel=0.02)
        assert not model.B.observable and not model.K.observable
        alone = whittle.fit(x, RATE_HZ, terms='NBK')
        assert alone.B.observable or alone.K.observable


def test_a_correlation_time_is_positive():
    with pytest.raises(DataError, match='correlation time'):
        whittle.fit(white(1000, np.random.default_rng(1)), RATE_HZ, correlation_time=-1.0)


@pytest.mark.parametrize('taken', [1, 300, 4095, 9000])
def test_bins_of_terms_that_stay_are_not_counted_again(taken):
    """Held against a transform that knows nothing of what it was before."""
    rng = np.random.default_rng(taken)
    whole = Cosines.of(np.cumsum(rng.normal(size=20_000)), 100.0)
    rest = whole.without(rng.normal(size=taken))
    again = Cosines(rest.terms, rest.rate_hz).binned(40.0)
    found = rest.without(rng.normal(size=2)).without(np.zeros(2)).binned(40.0)
    for one, other in ((rest.binned(40.0), again), (found, again)):
        assert one.density[4:].tolist() == other.density[4:].tolist()
        assert one.degrees.tolist() == other.degrees.tolist()
    assert rest.binned(40.0).density.tolist() == again.density.tolist()
    assert found.density[:2].tolist() != again.density[:2].tolist()
