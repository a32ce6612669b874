# SPDX-License-Identifier: Apache-2.0
"""Agreement with allantools on random data; by hand where it has no right answer."""

import allantools
from allantools import ci
from hypothesis import given, settings
from hypothesis import strategies as st
from imu_bench.errors import DataError
from imu_bench.metrology import allan
from imu_bench.metrology.deviations.confidence import DIFFERENCES
from imu_bench.metrology.deviations.greenhall import inverse_edf
import numpy as np
import pytest

KINDS = ('adev', 'oadev', 'mdev', 'tdev', 'hdev', 'ohdev', 'totdev')


@pytest.mark.parametrize('kind', KINDS)
@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(50, 3000),
    share=st.floats(0.0, 1.0),
    rate=st.sampled_from([1.0, 12.5, 100.0, 1600.0]),
    walk=st.booleans(),
    phase=st.booleans(),
)
def test_equal_on_random_data_and_factors(kind, seed, n, share, rate, walk, phase):
    rng = np.random.default_rng(seed)
    data = rng.normal(size=n) + 9.81
    if walk:
        data = np.cumsum(data - 9.81)
    m = int(1 + share * (n // 5 - 1))
    type_ = 'phase' if phase else 'rate'
    curve = allan.deviation(data, rate, kind=kind, tau=[m / rate], data_type=type_)
    tau, expected, _, terms = getattr(allantools, kind)(
        data, rate=rate, data_type='phase' if phase else 'freq', taus=[m / rate]
    )
    assert curve.tau == pytest.approx(tau)
    assert curve.deviation[0] == pytest.approx(expected[0], rel=1e-9)
    assert curve.terms[0] == terms[0]


@pytest.mark.parametrize('kind', ['adev', 'oadev', 'mdev', 'hdev', 'ohdev'])
@pytest.mark.parametrize('alpha', [2, 1, 0, -1, -2])
@pytest.mark.parametrize('m', [1, 2, 5, 30, 33, 34, 100, 1000])
def test_degrees_of_freedom_of_the_paper(kind, alpha, m):
    """The formulas of Greenhall and Riley as printed, without the change for sampled noise."""
    d, overlapping, modified, _ = DIFFERENCES[kind]
    compared = 0
    for points in (100, 1000, 1001, 5000, 100_000):
        terms = DIFFERENCES[kind].terms(m, points)
        if terms < 1 or (m == 1 and alpha == 1 and terms > 100):
            continue
        try:
            expected = ci.edf_greenhall(alpha, d, m, points, overlapping, modified)
        except NotImplementedError:
            # not there: alpha = 2 with few windows
            assert alpha == 2 and terms <= d * m
            continue
        stride = m if overlapping else 1
        ours = 1.0 / inverse_edf(alpha, d, m, terms, stride, modified, sampled=False)
        assert ours == pytest.approx(expected, rel=1e-9)
        compared += 1
    assert compared or m >= 100


def test_a_missing_sample_costs_two_differences_and_no_more():
    """Counted and summed by hand: allantools goes wrong from the first NaN on."""
    data = np.random.default_rng(4).normal(size=4000)
    data[500] = np.nan
    steps = np.diff(data)
    ours = allan.deviation(data, 1.0, tau=[1.0], valid=np.isfinite(data))
    assert ours.terms[0] == np.isfinite(steps).sum() == 3997
    assert ours.deviation[0] == pytest.approx(np.sqrt(np.nanmean(steps**2) / 2), rel=1e-12)


def test_nan_without_a_mask_is_an_error():
    data = np.random.default_rng(5).normal(size=400)
    data[100] = np.nan
    with pytest.raises(DataError, match=r'1 of 400 samples are NaN or infinite.*valid='):
        allan.deviation(data, 1.0, tau=[1.0])


def test_columns_are_axes():
    data = np.random.default_rng(7).normal(size=(100, 3))
    together = allan.deviations(data, 1.0)
    assert len(together) == 3
    for curve, column in zip(together, data.T, strict=True):
        _, expected, _, _ = allantools.oadev(column, data_type='freq', taus=curve.tau)
        np.testing.assert_allclose(curve.deviation, expected, rtol=1e-9)
