# SPDX-License-Identifier: Apache-2.0
"""White noise behind the low-pass filter that every sensor has: N as before, and nothing else."""

from dataclasses import replace
import math

from imu_bench.metrology import allan, coefficients
from imu_bench.metrology.markov.gauss_markov import Process
from imu_bench.metrology.noise_fit import fitted
import numpy as np
import pytest
from scipy import signal

RATE_HZ = 100.0
TRUE = 0.1
"""N of white noise with a standard deviation of one."""


def curve(x):
    return allan.deviation(x, RATE_HZ, unit='rad/s')


def behind(order, share, x):
    """Return what a filter leaves, settled."""
    return signal.lfilter(*signal.butter(order, 2.0 * share), x)[2000:]


def white(seed, run, n=50_000):
    return np.random.default_rng([seed, run]).standard_normal(n + 2000)


def expected(order, share, m):
    """Return the Allan deviations that follow from the autocovariance of scipy's filter."""
    answer = signal.lfilter(*signal.butter(order, 2.0 * share), np.eye(1, 2000)[0])
    covariance = np.correlate(answer, answer, 'full')[1999:]
    lag, m = np.arange(2000), m[:, None]
    # of the difference of two means of m; every lag but 0 comes twice, the half is Allan's
    weight = np.where(lag < m, 2.0 * m - 3.0 * lag, np.minimum(lag - 2 * m, 0))
    weight[:, 0] *= 0.5
    return np.sqrt(weight @ covariance) / m[:, 0]


CELLS = [(order, share) for order in (1, 2) for share in (0.05, 0.2, 0.45)]


@pytest.mark.parametrize(('order', 'share'), CELLS)
@pytest.mark.parametrize('n', [5000, 50_000, 1_000_000])
def test_n_has_no_bias(order, share, n):
    """The fit of the expected curve, weighted as one of so many samples."""
    seen = curve(behind(order, share, white(21, 0, n)))
    model = coefficients.fit(replace(seen, deviation=expected(order, share, seen.m)))
    assert model.N.value == pytest.approx(TRUE, rel=2e-3)
    assert model.low_pass.cutoff == pytest.approx(share * RATE_HZ, rel=0.01)
    assert model.bandwidth.low < share * RATE_HZ < model.bandwidth.high
    assert model.terms == 'N'


@pytest.mark.slow
@pytest.mark.parametrize(('n', 'runs'), [(5000, 9), (50_000, 9), (1_000_000, 2)])
def test_its_interval_holds_and_nothing_else_appears(n, runs):
    models = [
        (share, coefficients.fit(curve(behind(order, share, white(21, run, n)))))
        for order, share in CELLS
        for run in range(runs)
    ]
    count = len(models)
    held = sum(model.N.low <= TRUE <= model.N.high for _, model in models)
    # 95 % less three standard deviations of the binomial: 47 of 54
    assert held >= 0.95 * count - 3.0 * math.sqrt(0.95 * 0.05 * count)
    claimed = sum(model.B.observable or model.K.observable for _, model in models)
    assert claimed <= 0.05 * count
    widths = [(share * RATE_HZ, m.bandwidth) for share, m in models if m.bandwidth is not None]
    assert len(widths) > 0.9 * count
    inside = sum(width.low <= true <= width.high for true, width in widths)
    assert inside >= 0.95 * count - 3.0 * math.sqrt(0.95 * 0.05 * count)
    cutoffs = [m.low_pass.cutoff / share for share, m in models if m.low_pass is not None]
    assert len(cutoffs) > 0.9 * count
    assert np.median(cutoffs) == pytest.approx(RATE_HZ, rel=0.1)


def sampled(share, x):
    """Return samples of noise behind an analogue filter of first order, folding included."""
    pole = math.exp(-2.0 * math.pi * share)
    return signal.lfilter([1.0 - pole], [1.0, -pole], x)[2000:]


@pytest.mark.slow
@pytest.mark.parametrize(('share', 'held'), [(0.32, 34), (0.625, 35)])
def test_what_folds_back_behind_an_analogue_filter_is_known(share, held):
    """As most chips filter; the samples of a minute at 100 Hz."""
    models = [coefficients.fit(curve(sampled(share, white(29, run, 6000)))) for run in range(40)]
    assert not any('bump' in flag for model in models for flag in model.flags)
    assert sum(model.N.low <= TRUE <= model.N.high for model in models) >= held
    assert np.mean([model.N.value for model in models]) == pytest.approx(TRUE, rel=0.02)


@pytest.mark.slow
def test_rounding_behind_a_slow_filter_does_not_move_n():
    """Steps as large as σ, 17 s at 200 Hz: a quarter of the first variance joins behind it."""
    models = [
        coefficients.fit(curve(np.round(sampled(0.05, white(31, run, 3400)) / 0.4) * 0.4))
        for run in range(60)
    ]
    assert all(model.N.observable for model in models)
    true = math.hypot(TRUE, 0.4 / math.sqrt(12.0 * RATE_HZ))
    errors = np.array([model.N.value for model in models]) / true - 1.0
    assert abs(errors.mean()) < 0.02 and errors.std() < 0.08
    assert sum(model.N.low <= true <= model.N.high for model in models) >= 50
    assert sum(model.B.observable or model.K.observable for model in models) <= 1


def test_a_slow_filter_of_a_short_record_is_never_taken_for_flicker():
    """Rounded, so that the very start follows no filter; the record is short for what is left."""
    for run in range(15):
        x = sampled(0.05, white(30, run, 12_000))
        model = coefficients.fit(curve(np.round(x / 0.13) * 0.13))
        assert not model.B.observable and model.N.high > 0.9 * TRUE


def test_the_filter_is_named_and_the_curve_drawn_from_its_first_point():
    seen = curve(behind(1, 0.2, white(22, 0, 200_000)))
    model = coefficients.fit(seen)
    assert model.tau_low == seen.tau[0] and model.tau_flat == pytest.approx(5.0 / 20.0, rel=0.05)
    assert any('low-pass filter of about 20 Hz' in flag for flag in model.flags)
    assert not any('left out' in flag or 'do not describe' in flag for flag in model.flags)
    first = seen.tau < 0.5
    np.testing.assert_allclose(model.deviation(seen.tau)[first], seen.deviation[first], rtol=0.02)
    assert 'low-pass' in model.Q.reason
    assert model.Q.high == pytest.approx(seen.deviation[0] * seen.tau[0] / math.sqrt(3.0))


def test_without_a_filter_none_is_found():
    found = [coefficients.fit(curve(white(23, run))).low_pass for run in range(30)]
    assert sum(f is not None for f in found) <= 1


def test_slower_noise_is_found_behind_a_filter():
    for run in range(5):
        rng = np.random.default_rng([24, run])
        x = rng.standard_normal(202_000)
        x += np.cumsum(3e-3 * rng.standard_normal(x.size))
        model = coefficients.fit(curve(behind(1, 0.1, x)))
        assert model.low_pass is not None and model.terms == 'NK'
        assert model.N.value == pytest.approx(TRUE, rel=0.02)
        assert model.K.value == pytest.approx(3e-3 * math.sqrt(RATE_HZ), rel=0.35)


@pytest.mark.parametrize(
    'filtered',
    [
        lambda x: np.convolve(x, np.ones(8) / 8.0, 'valid'),
        lambda x: np.convolve(x, np.ones(3) / 3.0, 'valid'),
        lambda x: behind(4, 0.1, x),
        lambda x: np.round(behind(2, 0.1, x) / 0.3) * 0.3,
    ],
    ids=['average of 8', 'average of 3', 'order 4', 'rounded'],
)
def test_a_filter_of_another_kind_is_left_to_the_part_that_all_share(filtered):
    models = [coefficients.fit(curve(filtered(white(25, run, 200_000)))) for run in range(10)]
    assert np.mean([m.N.value for m in models]) == pytest.approx(TRUE, rel=0.015)
    assert sum(m.N.low <= TRUE <= m.N.high for m in models) >= 8
    assert not any(m.B.observable or m.K.observable for m in models)
    assert all(any('left out' in flag or 'low-pass' in flag for flag in m.flags) for m in models)


def test_a_process_is_found_behind_a_filter_and_leaves_n():
    found = 0
    for run in range(6):
        rng = np.random.default_rng([26, run])
        x = rng.standard_normal(202_000) + Process(0.3, 20.0).simulate(202_000, RATE_HZ, rng)
        model = fitted(curve(behind(1, 0.2, x)))
        assert model.N.value == pytest.approx(TRUE, rel=0.04)
        if model.gauss_markov is not None:
            found += 1
            assert model.gauss_markov.T_c.low < 20.0 < model.gauss_markov.T_c.high
    assert found >= 4


@pytest.mark.slow
def test_any_bent_curve_gives_numbers_or_a_reason():
    """Steps of rounding, walks, processes and filters together, power laws or not."""
    for run in range(25):
        rng = np.random.default_rng([27, run])
        x = rng.standard_normal(6000) + np.cumsum(10 ** rng.uniform(-4, -1) * white(28, run, 4000))
        x = behind(1 + run % 2, rng.uniform(0.02, 0.49), x)
        model = fitted(curve(np.round(x / (rounding := 10 ** rng.uniform(-3, 1))) * rounding))
        assert np.all(np.isfinite(model.deviation([0.01, 1.0, 1e4])))
        for estimate in model.coefficients.values():
            if estimate.observable:
                assert 0.0 <= estimate.low <= estimate.value <= estimate.high
            else:
                assert estimate.reason


def test_a_cutoff_that_the_curve_does_not_tell_has_finite_bounds():
    """White noise beside a Gauss-Markov process, whose uncertainty of the cutoff is boundless."""
    rng = np.random.default_rng(1)
    noise = rng.normal(0.0, 1e-3, (60_000, 3))[:, 0] + Process(3e-4, 15.0).simulate(
        60_000, 20.0, rng
    )
    width = fitted(allan.deviation(noise, 20.0, unit='rad/s')).bandwidth
    assert width is None or (0.0 <= width.low <= width.value <= width.high < math.inf)
