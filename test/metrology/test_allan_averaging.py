# SPDX-License-Identifier: Apache-2.0
"""Averaging factors and what decimation makes of them."""

from hypothesis import given
from hypothesis import strategies as st
from imu_bench.errors import DataError
from imu_bench.metrology.deviations.averaging import averaging_factors, decimation
import numpy as np
import pytest

KINDS = ('adev', 'oadev', 'mdev', 'tdev', 'hdev', 'ohdev', 'totdev')


@given(
    n=st.integers(1, 10**9),
    tau=st.sampled_from(['log', 'octave', 'decade']),
    kind=st.sampled_from(KINDS),
    per_decade=st.integers(1, 40),
)
def test_grids_are_whole_increasing_and_end_in_time(n, tau, kind, per_decade):
    m = averaging_factors(n, tau, 100.0, kind, per_decade)
    assert m.dtype == np.int64
    assert np.all(np.diff(m) > 0)
    reach = {'o': 3, 'a': 3, 'm': 4, 't': 4, 'h': 4}[kind[0]]
    reach = {'totdev': 2, 'ohdev': 4}.get(kind, reach)
    if n >= reach:
        assert m[0] == 1
        assert m[-1] <= n // reach
    else:
        assert m.size == 0


def test_grids():
    assert averaging_factors(30, 'all').tolist() == list(range(1, 11))
    assert averaging_factors(1000, 'decade').tolist() == [1, 2, 4, 10, 20, 40, 100, 200]
    assert averaging_factors(1000, 'octave', kind='totdev').tolist()[-1] == 256


@given(seconds=st.lists(st.floats(0.01, 1e4), min_size=1), rate=st.floats(100.0, 5000.0))
def test_seconds_go_to_the_nearest_sample(seconds, rate):
    m = averaging_factors(10**6, seconds, rate)
    assert np.all(np.diff(m) > 0)
    for wanted in seconds:
        assert np.min(np.abs(m / rate - wanted)) <= 0.5 / rate * (1.0 + 1e-9)


def test_periods_that_decimals_cannot_hold():
    """1/416 s written with four digits is still one sample."""
    assert averaging_factors(100, [0.002403], 416.0).tolist() == [1]
    with pytest.raises(DataError, match='below the sample period'):
        averaging_factors(100, [0.0023], 416.0)


def test_density_of_the_grid():
    with pytest.raises(DataError, match='per_decade must be at least 1, got 0'):
        averaging_factors(100, 'log', per_decade=0)


@given(m=st.integers(1, 10**7), n=st.integers(10**6, 10**9))
def test_decimation_divides_and_leaves_enough(m, n):
    stride = int(decimation(np.array([m]), n)[0])
    assert m % stride == 0
    if stride > 1:
        assert m / stride >= 12
        # the difference to full overlap stays below 0.2 %: 0.71 sqrt(m/n) / overlap
        assert 0.71 * np.sqrt(m / n) * stride / m <= 0.002


def test_the_default_grid_is_made_for_decimation():
    m = averaging_factors(10**7)
    work = (1.0 / decimation(m, 10**7)).sum()
    assert work < 0.35 * m.size
