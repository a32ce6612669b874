# SPDX-License-Identifier: Apache-2.0
"""What a deviation must do on any data: algebra, gaps, decimation, bad input."""

import warnings

from hypothesis import given, settings
from hypothesis import strategies as st
from imu_bench.errors import DataError, UnitError
from imu_bench.metrology import allan
import numpy as np
import pytest

KINDS = ('adev', 'oadev', 'mdev', 'tdev', 'hdev', 'ohdev', 'totdev')
TWO_DIFFERENCES = ('adev', 'oadev', 'mdev', 'totdev')

seeds = st.integers(0, 2**32 - 1)
records = st.integers(40, 400)
rates = st.sampled_from([1.0, 12.5, 200.0, 1666.7])


# --- algebra -----------------------------------------------------------------------------


@pytest.mark.parametrize('kind', KINDS)
@settings(max_examples=20, deadline=None)
@given(value=st.floats(-1e6, 1e6), n=records, rate=rates)
def test_constant_rate_has_no_deviation(kind, value, n, rate):
    curve = allan.deviation(np.full(n, value), rate, kind=kind)
    assert not curve.deviation.any()
    assert not curve.low.any()
    assert not curve.high.any()
    assert np.all(curve.edf >= 1.0)


@pytest.mark.parametrize('kind', TWO_DIFFERENCES)
@settings(max_examples=20, deadline=None)
@given(slope=st.floats(1e-6, 1e6), n=records, rate=rates)
def test_ramp(kind, slope, n, rate):
    """A rate that grows by `slope` per second: slope * tau / sqrt(2) (IEEE Std 952, annex C)."""
    # the reflected ends of the total deviation are no ramp; without averaging they do not count
    tau = [1.0 / rate] if kind == 'totdev' else 'octave'
    curve = allan.deviation(slope * np.arange(n) / rate, rate, kind=kind, tau=tau)
    np.testing.assert_allclose(curve.deviation, slope * curve.tau / np.sqrt(2.0), rtol=1e-9)


@pytest.mark.parametrize('kind', ['hdev', 'ohdev'])
def test_hadamard_rejects_a_ramp(kind):
    curve = allan.deviation(0.25 * np.arange(500), 10.0, kind=kind)
    assert np.all(curve.deviation < 1e-9)


@pytest.mark.parametrize('kind', KINDS)
@settings(max_examples=20, deadline=None)
@given(seed=seeds, n=records, factor=st.floats(1e-9, 1e9), offset=st.floats(-1e3, 1e3))
def test_scaling_and_offset(noise, kind, seed, n, factor, offset):
    data = noise(seed, n)
    plain = allan.deviation(data, 50.0, kind=kind)
    scaled = allan.deviation(factor * data, 50.0, kind=kind)
    moved = allan.deviation(data + offset, 50.0, kind=kind)
    for name in ('deviation', 'low', 'high'):
        wanted = getattr(plain, name)
        np.testing.assert_allclose(getattr(scaled, name), factor * wanted, rtol=1e-9)
        np.testing.assert_allclose(getattr(moved, name), wanted, rtol=1e-9)


@pytest.mark.parametrize('kind', ['oadev', 'mdev', 'tdev', 'ohdev', 'totdev'])
@settings(max_examples=20, deadline=None)
@given(seed=seeds, n=records, alpha=st.sampled_from([0, -2]))
def test_time_reversal(noise, kind, seed, n, alpha):
    data = noise(seed, n, alpha)
    forward = allan.deviation(data, 50.0, kind=kind)
    backward = allan.deviation(data[::-1], 50.0, kind=kind)
    np.testing.assert_allclose(backward.deviation, forward.deviation, rtol=1e-9)


@pytest.mark.parametrize('kind', KINDS)
@settings(max_examples=10, deadline=None)
@given(seed=seeds, n=records, rate=rates)
def test_rate_and_its_integral_agree(noise, kind, seed, n, rate):
    data = noise(seed, n)
    integral = np.concatenate(([0.0], np.cumsum(data))) / rate
    by_rate = allan.deviation(data, rate, kind=kind)
    by_phase = allan.deviation(integral, rate, kind=kind, data_type='phase')
    np.testing.assert_allclose(by_phase.deviation, by_rate.deviation, rtol=1e-9)
    np.testing.assert_allclose(by_phase.edf, by_rate.edf)


@pytest.mark.parametrize(('alpha', 'slope'), [(0, -0.5), (-1, 0.0), (-2, 0.5)])
@pytest.mark.parametrize('kind', ['adev', 'oadev', 'mdev', 'hdev', 'ohdev', 'totdev'])
def test_slopes_of_power_laws(noise, kind, alpha, slope):
    data = noise(11, 200_000, alpha)
    curve = allan.deviation(data, 1.0, kind=kind, tau=[20.0, 2000.0])
    measured = np.log10(curve.deviation[1] / curve.deviation[0]) / 2.0
    assert measured == pytest.approx(slope, abs=0.06)
    assert curve.alpha.tolist() == [alpha, alpha]


def test_level_of_white_noise_is_n_over_root_tau(noise):
    density, rate = 3e-3, 200.0
    data = density * np.sqrt(rate) * noise(12, 1_000_000)
    curve = allan.deviation(data, rate, tau=[0.1, 1.0, 10.0])
    assert np.all(curve.low <= density / np.sqrt(curve.tau))
    assert np.all(curve.high >= density / np.sqrt(curve.tau))


def test_offset_of_gravity_costs_no_digits(noise):
    """10 million samples around 9.81 m/s² would lose seven digits if summed as they are."""
    data = 1e-4 * noise(13, 1_000_000)
    bare = allan.deviation(data, 200.0, tau=[0.005, 1.0])
    heavy = allan.deviation(data + 9.81, 200.0, tau=[0.005, 1.0])
    np.testing.assert_allclose(heavy.deviation, bare.deviation, rtol=1e-9)


def test_axes_are_separate():
    data = np.random.default_rng(14).normal(size=(500, 3)) * [1.0, 2.0, 3.0]
    curves = allan.deviations(data, 10.0, unit='rad/s')
    for axis, curve in enumerate(curves):
        alone = allan.deviation(data[:, axis], 10.0, unit='rad/s')
        np.testing.assert_array_equal(curve.deviation, alone.deviation)


def test_time_deviation_is_in_the_integral_of_the_unit(noise):
    data = noise(15, 500)
    mdev = allan.deviation(data, 10.0, kind='mdev', unit='rad/s')
    tdev = allan.deviation(data, 10.0, kind='tdev', unit='rad/s')
    assert (mdev.unit, tdev.unit) == ('rad/s', 'rad')
    np.testing.assert_allclose(tdev.deviation, mdev.deviation * mdev.tau / np.sqrt(3.0))


# --- gaps --------------------------------------------------------------------------------


@pytest.mark.parametrize('kind', KINDS)
@settings(max_examples=15, deadline=None)
@given(seed=seeds, n=records)
def test_without_gaps_a_mask_changes_nothing(noise, kind, seed, n):
    data = noise(seed, n)
    plain = allan.deviation(data, 10.0, kind=kind)
    masked = allan.deviation(data, 10.0, kind=kind, valid=np.ones(n, bool))
    for name in ('m', 'deviation', 'low', 'high', 'edf', 'terms', 'alpha'):
        np.testing.assert_array_equal(getattr(masked, name), getattr(plain, name))


@settings(max_examples=60, deadline=None)
@given(seed=seeds, n=st.integers(60, 300), m=st.integers(1, 12), lost=st.integers(1, 20))
def test_only_complete_differences_count(seed, n, m, lost):
    """Every difference is formed by hand, and kept if all its samples are there."""
    rng = np.random.default_rng(seed)
    data, valid = rng.normal(size=n), np.ones(n, bool)
    valid[rng.integers(0, n, size=lost)] = False
    squares = [
        (data[i + m : i + 2 * m].mean() - data[i : i + m].mean()) ** 2
        for i in range(n - 2 * m + 1)
        if valid[i : i + 2 * m].all()
    ]
    holes = np.where(valid, data, np.nan)
    if not squares:
        with pytest.raises(DataError, match='no averaging time'):
            allan.deviation(holes, 10.0, tau=[m / 10.0], valid=valid)
        return
    curve = allan.deviation(holes, 10.0, tau=[m / 10.0], valid=valid)
    assert curve.terms.tolist() == [len(squares)]
    assert curve.deviation[0] == pytest.approx(np.sqrt(np.mean(squares) / 2.0), rel=1e-9)
    assert curve.samples == valid.sum()
    assert curve.span == n


def test_what_a_missing_sample_holds_does_not_matter(noise):
    data = noise(16, 1000)
    valid = np.ones(1000, bool)
    valid[100:300] = False
    curves = []
    for filler in (0.0, 1e300, np.nan, np.inf):
        held = data.copy()
        held[~valid] = filler
        curves.append(allan.deviation(held, 10.0, valid=valid))
    for curve in curves[1:]:
        np.testing.assert_array_equal(curve.deviation, curves[0].deviation)
        np.testing.assert_array_equal(curve.high, curves[0].high)


@pytest.mark.parametrize('kind', KINDS)
def test_gaps_pool_the_runs(noise, kind):
    """Two runs with a hole between are two records: their squares add, weighted by terms."""
    data = noise(17, 1500)
    valid = np.ones(1500, bool)
    valid[600:700] = False
    tau = [0.1, 0.5, 2.0]
    first = allan.deviation(data[:600], 10.0, kind=kind, tau=tau)
    second = allan.deviation(data[700:], 10.0, kind=kind, tau=tau)
    both = allan.deviation(data, 10.0, kind=kind, tau=tau, valid=valid)
    terms = first.terms + second.terms
    variance = (first.terms * first.deviation**2 + second.terms * second.deviation**2) / terms
    np.testing.assert_array_equal(both.terms, terms)
    np.testing.assert_allclose(both.deviation, np.sqrt(variance), rtol=1e-9)
    assert np.all(both.edf > np.maximum(first.edf, second.edf))


@pytest.mark.slow
def test_three_holes_of_ten_minutes_in_three_hours(noise):
    """
    At 300 s the mean deviation of 100 records is within 3 % of theory.

    With what is left moved together, as other tools do, it is not.
    """
    rate, hours = 2.0, 3
    n = int(hours * 3600 * rate)
    valid = np.ones(n, bool)
    for start in (30, 85, 140):
        valid[int(start * 60 * rate) : int((start + 10) * 60 * rate)] = False
    white, walk = 1.0, 0.0035
    tau = np.array([1.0, 10.0, 100.0, 300.0])
    theory = np.sqrt(white**2 / (rate * tau) + walk**2 * rate * tau / 3.0)
    masked, joined = [], []
    for seed in range(100):
        data = white * noise(seed, n) + walk * np.cumsum(noise(1000 + seed, n))
        data[~valid] = np.nan
        masked.append(allan.deviation(data, rate, tau=tau, valid=valid).deviation)
        joined.append(allan.deviation(data[valid], rate, tau=tau).deviation)
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(masked), axis=0)), theory, rtol=0.03)
    assert np.sqrt(np.mean(np.square(joined), axis=0))[-1] / theory[-1] > 1.04


def test_averaging_times_that_gaps_rule_out_are_listed(noise):
    valid = np.ones(1000, bool)
    valid[::100] = False
    curve = allan.deviation(noise(18, 1000), 10.0, tau=[1.0, 4.0, 20.0], valid=valid)
    assert curve.tau.tolist() == [1.0, 4.0]
    assert curve.omitted == (
        (20.0, 'needs 2 x 20 s, the longest stretch without a gap has 9.9 s'),
    )


# --- averaging times ---------------------------------------------------------------------


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('tau', ['log', 'octave', 'decade', 'all'])
def test_named_grids_can_all_be_had(noise, kind, tau):
    for n in (9, 10, 100, 999):
        curve = allan.deviation(noise(19, n), 1.0, kind=kind, tau=tau)
        assert curve.omitted == ()
        assert curve.m[0] == 1
        assert np.all(np.diff(curve.m) > 0)


def test_log_grid_is_even():
    m = allan.averaging_factors(10**7)
    assert 55 <= m.size <= 62
    assert m[-1] <= 10**7 // 3 < 1.35 * m[-1]
    ratios = m[1:] / m[:-1]
    assert np.all(ratios[m[1:] > 30] < 1.4)
    assert np.all(ratios[m[1:] > 30] > 1.15)


def test_any_whole_factor_may_be_asked_for():
    m = np.array([1, 7, 11, 97, 331])
    assert allan.averaging_factors(1000, m / 62.5, 62.5).tolist() == m.tolist()


def test_tau_below_the_sample_period(noise):
    with pytest.raises(DataError, match=r'tau 0\.001 s is below the sample period of 0\.01 s'):
        allan.deviation(noise(20, 100), 100.0, tau=[0.001, 0.1])


# --- bad input ---------------------------------------------------------------------------


def test_nothing_is_said_on_the_screen(noise):
    """Equal data, tiny and huge data, short data: no warning of numpy's."""
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        for data in (np.zeros(50), np.full(50, 1e-300), noise(30, 7), 1e150 * noise(30, 50)):
            for kind in KINDS:
                curve = allan.deviation(data, 10.0, kind=kind)
                for values in (curve.deviation, curve.low, curve.high, curve.edf):
                    assert np.all(np.isfinite(values))


@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize('data_type', ['rate', 'phase'])
def test_unfinite_samples(noise, bad, data_type):
    data = noise(31, 200)
    data[[17, 50]] = bad
    with pytest.raises(DataError, match=r'2 of 200 samples.*index 17; declare.*valid='):
        allan.deviation(data, 10.0, data_type=data_type)


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('size', [1e160, 1e307])
def test_squares_beyond_floating_point(noise, kind, size):
    with pytest.raises(DataError, match='too large'):
        allan.deviation(size * noise(35, 100), 10.0, kind=kind)


@pytest.mark.parametrize(
    ('data', 'options', 'says'),
    [
        (np.zeros((5, 2)), {}, r'shape \(n,\), got \(5, 2\); see deviations'),
        (np.zeros(0), {}, 'there are no samples'),
        (np.zeros(2), {}, 'too few samples'),
        (np.array(['a', 'b']), {}, 'must be numbers'),
        (np.zeros(99), {'kind': 'avar'}, "unknown kind 'avar'"),
        (np.zeros(99), {'overlap': 'some'}, "unknown overlap 'some'"),
        (np.zeros(99), {'data_type': 'freq'}, "unknown data_type 'freq'"),
        (np.zeros(99), {'intervals': 'none'}, "unknown intervals 'none'"),
        (np.zeros(99), {'tau': 'lin'}, "unknown tau 'lin'"),
        (np.zeros(99), {'tau': []}, 'list of averaging times is empty'),
        (np.zeros(99), {'tau': [np.nan]}, 'must be finite'),
        (np.zeros(99), {'tau': [1e3]}, 'needs 2 x 1000 s.*has 9.9 s; record longer'),
        (np.zeros(99), {'confidence': 95.0}, 'confidence must lie between 0 and 1, got 95.0'),
        (np.zeros(99), {'valid': np.ones(98, bool)}, r'bool array of shape \(99,\)'),
        (np.zeros(99), {'valid': np.ones(99)}, 'bool array'),
        (np.zeros(99), {'valid': np.zeros(99, bool)}, 'longest stretch without a gap has 0 s'),
    ],
)
def test_refused(data, options, says):
    with pytest.raises(DataError, match=says):
        allan.deviation(data, 10.0, **options)


@pytest.mark.parametrize('rate', [0.0, -1.0, np.nan, np.inf])
def test_rate_must_be_positive(rate):
    with pytest.raises(DataError, match='rate_hz must be positive and finite'):
        allan.deviation(np.zeros(99), rate)


def test_unknown_unit():
    with pytest.raises(UnitError):
        allan.deviation(np.zeros(99), 10.0, unit='furlong')


def test_spelling_of_the_unit_is_the_house_one():
    assert allan.deviation(np.zeros(99), 10.0, unit='m/s^2').unit == 'm/s²'


def test_the_data_are_left_alone(noise):
    data = noise(32, 500)
    kept = data.copy()
    data.flags.writeable = False
    for data_type in ('rate', 'phase'):
        for kind in KINDS:
            allan.deviation(data, 10.0, kind=kind, data_type=data_type)
    np.testing.assert_array_equal(data, kept)


def test_single_precision_is_summed_in_double(noise):
    data = (9.81 + 1e-2 * noise(33, 5000)).astype(np.float32)
    single = allan.deviation(data, 10.0)
    double = allan.deviation(data.astype(np.float64), 10.0)
    np.testing.assert_allclose(single.deviation, double.deviation, rtol=1e-12)


def test_whole_numbers_are_data():
    counts = np.random.default_rng(34).integers(-100, 100, size=500, dtype=np.int16)
    np.testing.assert_allclose(
        allan.deviation(counts, 10.0).deviation,
        allan.deviation(counts.astype(float), 10.0).deviation,
    )
