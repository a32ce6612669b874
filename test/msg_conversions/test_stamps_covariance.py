# SPDX-License-Identifier: Apache-2.0
"""Stamps and covariances by the conventions of ROS."""

from hypothesis import given
from hypothesis import strategies as st
from msg_conversions import covariance, stamps
import numpy as np
import pytest

REPRESENTABLE = st.integers(-(2**31) * 10**9, (2**31 - 1) * 10**9 + 999_999_999)


@given(st.lists(REPRESENTABLE, max_size=20))
def test_every_stamp_survives_the_split(given_ns):
    sec, nanosec = stamps.split(np.array(given_ns, dtype=np.int64))
    assert np.all(nanosec < 10**9)
    assert stamps.join(sec, nanosec).tolist() == given_ns


def test_time_before_1970_has_positive_nanoseconds():
    sec, nanosec = stamps.split([-1])
    assert (sec[0], nanosec[0]) == (-1, 999_999_999)


@pytest.mark.parametrize('late', [2**31 * 10**9, -(2**31) * 10**9 - 1])
def test_a_stamp_beyond_int32_seconds_is_refused(late):
    with pytest.raises(ValueError, match='do not fit builtin_interfaces/Time'):
        stamps.split([0, late])


def test_variance_stands_on_the_diagonal():
    matrix = np.reshape(covariance.diagonal(0.1), (3, 3))
    assert np.allclose(matrix, 0.01 * np.eye(3), rtol=1e-15)


def test_zero_is_unknown_and_minus_one_not_reported():
    assert covariance.diagonal(0.0) == covariance.UNKNOWN == (0.0,) * 9
    assert covariance.NOT_REPORTED[0] == -1.0
    assert not covariance.reported(covariance.NOT_REPORTED[0])
    assert covariance.reported(covariance.diagonal(0.3)[0])


@pytest.mark.parametrize('wrong', [-0.1, float('nan'), float('inf')])
def test_an_impossible_standard_deviation_is_refused(wrong):
    with pytest.raises(ValueError, match='standard deviation'):
        covariance.diagonal(wrong)
