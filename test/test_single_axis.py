# SPDX-License-Identifier: Apache-2.0
"""The grammar's channel for a sensor with one axis of three."""

from imu_bench.registers import Axis, Register
import numpy as np
import pytest


def channel(**changes):
    given = {
        'first': Register(0, access='ro', size=2, reset=None), 'quantity': 'acceleration',
        'unit': 'm/s²', 'dtype': '>i2', 'si_per_lsb': 0.5,
    }  # fmt: skip
    return Axis(**given | changes)


@pytest.mark.parametrize('axis', [0, 1, 2])
def test_the_other_axes_are_nan(axis):
    made = channel(axis=axis)
    si = made.decode(np.array([4, -6], dtype='>i2'))
    assert si[:, axis].tolist() == [2.0, -3.0]
    assert np.isnan(np.delete(si, axis, axis=1)).all()
    assert made.encode(si).tolist() == [4, -6]


def test_offset_binary_has_its_zero_in_the_middle():
    made = channel(dtype='>u2', limits=(0, 4095), zero=2048)
    si = np.array([[9.0, 9.0, 0.0], [9.0, 9.0, -1e9], [9.0, 9.0, 1e9], [9.0, 9.0, 1.0]])
    words = made.encode(si)
    assert words.tolist() == [2048, 0, 4095, 2050]
    assert made.saturated(words).tolist() == [False, True, True, False]
    np.testing.assert_allclose(made.decode(words)[:, 2], [0, -1024, 1023.5, 1.0])


def test_a_trim_scales_both_ways():
    made = channel()
    assert made.decode(np.array([4]), trim=2.0)[0, 2] == 4.0
    assert made.encode(np.array([[0, 0, 4.0]]), trim=2.0).tolist() == [4]
    assert made.resolution(trim=2.0).tolist() == [1.0]
