# SPDX-License-Identifier: Apache-2.0
"""The truth: gravity where it belongs, motions that add up, come and go, and tilt."""

import math

from hypothesis import given
from hypothesis import strategies as st
from imu_bench.errors import ConfigError
from imu_bench.simulation.motion import along, attitude, During, highest_hz, Mounted, Still, Sum
from imu_bench.simulation.tones import Sine
from imu_bench.units import STANDARD_GRAVITY as G
import numpy as np
import pytest

T = np.linspace(0.0, 1.0, 5)


def test_a_level_bench_feels_gravity_upwards():
    np.testing.assert_array_equal(Still().specific_force(T), [[0.0, 0.0, G]])
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
    turn = attitude(roll, pitch)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)


def test_motions_add_up():
    moving = Sum((Still(temperature_c=20.0), Sine(2.0, 1.0, 'x'), Sine(1.0, 0.25, 'x')))
    force = moving.specific_force(np.array([0.25, 1.0]))
    np.testing.assert_allclose(force[0], [2.0 + math.sin(math.pi / 8), 0.0, G])
    np.testing.assert_allclose(force[1], [1.0, 0.0, G], atol=1e-12)
    np.testing.assert_array_equal(moving.temperature(T), [20.0])
    np.testing.assert_array_equal(moving.magnetic_field(T), Still().magnetic_field(T))
    assert not moving.angular_velocity(T).any()
    assert highest_hz(moving) == 1.0
    assert moving.duration_s is None


def test_a_vibration_is_there_in_its_spans_only():
    shaken = During(Sine(1.0, 1.0), ((10.0, 20.0), (30.0, 35.0)), fade_s=1.0)
    t = np.array([9.9, 10.0, 12.25, 20.0, 25.0, 32.25, 35.1])
    np.testing.assert_allclose(shaken.specific_force(t)[:, 2], [0, 0, 1, 0, 0, 1, 0], atol=1e-12)
    assert shaken.duration_s == 35.0
    quiet = shaken.specific_force(np.linspace(0.0, 5.0, 100))
    assert quiet.shape == (1, 3)
    assert not quiet.any()


def test_what_does_not_begin_anew_goes_on_through_the_spans():
    wave = Sine(1.0, 1.0)
    shaken = During(wave, ((10.1, 20.0),), fade_s=0.0, anew=False)
    t = np.linspace(11.0, 12.0, 7)
    np.testing.assert_allclose(shaken.specific_force(t), wave.specific_force(t), atol=1e-12)


def test_a_sensor_tilted_on_the_bench_has_the_motion_along_its_own_axes_and_is_warm():
    bench = Sum((Still(temperature_c=20.0), Sine(1.0, 1.0, 'x')))
    mounted = Mounted(bench, attitude(math.pi / 2, 0.0), heating_k=2.0, warm_up_s=10.0)
    np.testing.assert_allclose(
        mounted.specific_force(np.array([0.25])), [[1.0, G, 0.0]], atol=1e-12
    )
    warm = mounted.temperature(np.array([0.0, 10.0, 1e4]))
    np.testing.assert_allclose(warm, [20.0, 22.0 - 2.0 / math.e, 22.0])


def test_an_unknown_axis_is_refused():
    with pytest.raises(ConfigError, match=r"'w'.*x, y, z"):
        along('w')
