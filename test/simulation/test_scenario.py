# SPDX-License-Identifier: Apache-2.0
"""The truth: gravity where it belongs, motions that add up, sampling that aliases."""

import math

from hypothesis import given
from hypothesis import strategies as st
from imu_bench.errors import ConfigError
from imu_bench.simulation.scenario import Sine, Still, Sum
from imu_bench.units import STANDARD_GRAVITY as G
import numpy as np
import pytest

T = np.linspace(0.0, 1.0, 5)


def test_a_level_bench_feels_gravity_upwards():
    np.testing.assert_array_equal(Still().specific_force(T), np.tile([0.0, 0.0, G], (5, 1)))
    assert not Still().angular_velocity(T).any()


def test_roll_raises_y_and_pitch_lowers_x():
    np.testing.assert_allclose(Still(roll=math.pi / 2).specific_force(T)[0], [0, G, 0], atol=1e-12)
    np.testing.assert_allclose(
        Still(pitch=math.pi / 2).specific_force(T)[0], [-G, 0, 0], atol=1e-12
    )


@given(roll=st.floats(-3, 3), pitch=st.floats(-1.5, 1.5))
def test_gravity_keeps_its_magnitude_however_the_bench_is_tilted(roll, pitch):
    force = Still(roll=roll, pitch=pitch).specific_force(T)
    np.testing.assert_allclose(np.linalg.norm(force, axis=1), G, rtol=1e-12)


def test_motions_add_up():
    moving = Sum((Still(temperature_c=20.0), Sine(2.0, 1.0, 'x'), Sine(1.0, 0.25, 'x')))
    force = moving.specific_force(np.array([0.25, 1.0]))
    np.testing.assert_allclose(force[0], [2.0 + math.sin(math.pi / 8), 0.0, G])
    np.testing.assert_allclose(force[1], [1.0, 0.0, G], atol=1e-12)
    np.testing.assert_array_equal(moving.temperature(T), np.full(5, 20.0))
    np.testing.assert_array_equal(moving.magnetic_field(T), Still().magnetic_field(T))
    assert not moving.angular_velocity(T).any()


def test_what_lies_above_nyquist_aliases():
    t = np.arange(100) / 100.0
    fast, slow = Sine(1.0, 90.0), Sine(1.0, 10.0)
    np.testing.assert_allclose(fast.specific_force(t), -slow.specific_force(t), atol=1e-9)


def test_an_unknown_axis_is_refused():
    with pytest.raises(ConfigError, match=r"'w'.*x, y, z"):
        Sine(1.0, 1.0, 'w')
