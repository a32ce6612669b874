# SPDX-License-Identifier: Apache-2.0
"""The spectrum agrees on noise, contradicts what is not; the tangent is there by name."""

from imu_bench.metrology import allan, coefficients
from imu_bench.offline.analysis import checks
from imu_bench.offline.analysis.blocks import averages
from imu_bench.offline.analysis.checks import SecondOpinion, Signal
import numpy as np
import pytest
from scipy import signal

RATE_HZ = 100.0


def opinion_on(model, curve, x, blocks, valid=None):
    heard = checks.hear(model, Signal(x, valid, RATE_HZ, 'rad/s', 0.0), blocks, 0.95)
    return checks.second_opinion(model, heard and heard[1], curve)


def ask(x, size=1):
    curve = allan.deviation(x, RATE_HZ, unit='rad/s')
    model = coefficients.fit(curve)
    return model, opinion_on(model, curve, x, averages(x, RATE_HZ, size))


@pytest.mark.parametrize('size', [1, 7])
def test_they_agree_on_white_noise_and_random_walk(size):
    for seed in range(8):
        rng = np.random.default_rng([3, seed])
        x = rng.normal(0.0, 1e-3, 60_000) + np.cumsum(rng.normal(0.0, 1e-5, 60_000))
        _, found = ask(x, size)
        assert found.disagreements == ()
        N = found.coefficients['whittle']['N']
        assert N.value == pytest.approx(1e-4, rel=0.01 if size == 1 else 0.05)
        assert N.low <= N.value <= N.high


@pytest.mark.slow
def test_an_analogue_filter_near_half_the_rate_is_no_contradiction():
    """One minute of the gyroscope of a BNO055: one axis in 600 may be flagged, 1 in 40 was."""
    pole = np.exp(-2.0 * np.pi * 0.32)
    flagged = 0
    for run in range(120):
        x = np.random.default_rng([15, run]).normal(0.0, 1e-3, 6500)
        _, found = ask(signal.lfilter([1.0 - pole], [1.0, -pole], x)[500:])
        flagged += bool(found.disputed)
    assert flagged <= 1


@pytest.mark.slow
def test_averages_of_filtered_noise_do_not_lower_n():
    """An hour of the gyroscope of an MPU-9250 in blocks of 14: N came out 1 % low."""
    pole, found = np.exp(-2.0 * np.pi * 0.184), []
    for run in range(6):
        x = np.random.default_rng([16, run]).normal(0.0, 1e-3, 14 * 2**17)
        x = signal.lfilter([1.0 - pole], [1.0, -pole], x)
        curve = allan.deviation(x[:200_000], RATE_HZ, unit='rad/s')
        model = coefficients.fit(curve)
        assert model.low_pass is not None
        opinion = opinion_on(model, curve, x, averages(x, RATE_HZ, 14))
        found.append(opinion.coefficients['whittle']['N'].value / 1e-4)
    assert np.mean(found) == pytest.approx(1.0, abs=0.006)


def test_noise_that_comes_and_goes_is_described_by_no_model():
    rng = np.random.default_rng(4)
    x = rng.normal(0.0, 1e-3, 200_000)
    x[100_000:120_000] += np.repeat(rng.normal(0.0, 3e-3, 200), 100)
    model = coefficients.fit(allan.deviation(x, RATE_HZ))
    looked_at = Signal(x, None, RATE_HZ, '1', 0.0)
    choice, _ = checks.hear(model, looked_at, averages(x, RATE_HZ, 1), 0.95)
    assert choice.lowered


def with_gaps(x, rng, share=0.01):
    """Return the opinion on a signal that lacks single samples here and there."""
    valid = rng.random(x.size) > share
    x = np.where(valid, x, 0.0)
    curve = allan.deviation(x, RATE_HZ, valid=valid, unit='rad/s', threads=1)
    model = coefficients.fit(curve)
    return opinion_on(model, curve, x, averages(x, RATE_HZ, 1, valid), valid)


@pytest.mark.slow
def test_scattered_gaps_make_no_contradiction():
    """The spectrum sees one short piece: at most 1 % of records of six axes may be flagged."""
    flagged = sum(
        bool(with_gaps(rng.normal(0.0, 1e-3, 5_000), rng).disputed)
        for rng in map(np.random.default_rng, ([13, run] for run in range(120)))
    )
    assert flagged <= 1


@pytest.mark.slow
def test_noise_that_comes_and_goes_is_contradicted_in_spite_of_gaps():
    found = 0
    for run in range(10):
        rng = np.random.default_rng([14, run])
        x = rng.normal(0.0, 1e-3, 100_000)
        x[30_000:60_000] *= 4.0
        valid = rng.random(x.size) > 0.005
        valid[2_000:10_000] = True  # the piece that the spectrum sees
        x = np.where(valid, x, 0.0)
        curve = allan.deviation(x, RATE_HZ, valid=valid, unit='rad/s', threads=1)
        blocks = averages(x, RATE_HZ, 1, valid)
        found += 'N' in opinion_on(coefficients.fit(curve), curve, x, blocks, valid).disputed
    assert found == 10


def test_a_ramp_is_no_random_walk_to_the_spectrum():
    x = np.random.default_rng(5).normal(0.0, 1e-3, 200_000) + 1e-8 * np.arange(200_000)
    model, found = ask(x)
    assert 'R' in model.terms
    assert found.disagreements == ()
    assert found.coefficients['whittle']['N'].value == pytest.approx(1e-4, rel=0.02)


def test_the_tangent_method_always_has_three_numbers_and_no_interval():
    _, found = ask(np.random.default_rng(6).normal(0.0, 1e-3, 50_000))
    tangent = found.coefficients['tangent']
    assert all(tangent[term].value is not None for term in 'NBK')
    assert tangent['N'].value == pytest.approx(1e-4, rel=0.1)
    assert tangent['B'].low is None
    assert not tangent['Q'].observable


def test_json_gives_it_back():
    _, found = ask(np.random.default_rng(7).normal(0.0, 1e-3, 20_000))
    document = found.to_json()
    assert set(document) == {'coefficients_whittle', 'coefficients_tangent', 'disagreements'}
    assert SecondOpinion.from_json(document).to_json() == document
    assert SecondOpinion.from_json({}) is None
