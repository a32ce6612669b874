# SPDX-License-Identifier: Apache-2.0
"""Tilt table, lift and oven: angles, ways and temperatures that were asked for."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st
from imu_bench.errors import ConfigError
from imu_bench.simulation.lift import jerk_limited, LiftRide
from imu_bench.simulation.motion import Still, Sum
from imu_bench.simulation.motion_kinds import TemperatureRamp
from imu_bench.simulation.tilt_table import TiltSteps
from imu_bench.units import DEGREE
from imu_bench.units import STANDARD_GRAVITY as G
import numpy as np
import pytest


def table(**changes):
    return TiltSteps(Still(), 0.58139 * DEGREE, 6, dwell_s=20.0, move_s=3.0, **changes)


def inclination(force, axis):
    own = force[:, axis]
    others = np.delete(force, axis, axis=1)
    return np.arctan2(own, np.sqrt((others**2).sum(axis=1)))


@pytest.mark.parametrize('axis', ['x', 'y'])
def test_the_steps_of_table_3_are_what_an_inclinometer_measures(axis):
    tilt = table(axis=axis)
    t = 10.0 + 23.0 * np.arange(13)
    force = Sum((tilt.base, tilt)).specific_force(t)
    angles = inclination(force, 'xy'.index(axis)) / DEGREE
    rising = 0.58139 * np.arange(7)
    np.testing.assert_allclose(angles, [*rising, *rising[-2::-1]], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(force, axis=1), G, rtol=1e-12)
    assert tilt.duration_s == pytest.approx(296.0)
    assert [event['end_s'] - event['begin_s'] for event in tilt.events] == pytest.approx(
        [20.0] * 13
    )


@pytest.mark.parametrize('axis', ['x', 'y'])
def test_the_table_turns_as_fast_as_its_angle_changes(axis):
    tilt = table(axis=axis)
    t = np.linspace(19.0, 26.0, 70_001)
    rate = tilt.angular_velocity(t)
    about = rate[:, 1] * -1.0 if axis == 'x' else rate[:, 0]
    np.testing.assert_allclose(about, np.gradient(tilt.angle(t), t), atol=1e-8)
    assert np.count_nonzero(np.abs(rate).max(axis=0)) == 1
    assert tilt.angular_velocity(np.array([5.0])).shape == (1, 3)


def test_a_tilted_bench_stays_a_rigid_bench():
    base = Still(roll=0.02, pitch=-0.03)
    tilt = TiltSteps(base, 0.05, 2)
    force = Sum((base, tilt)).specific_force(np.linspace(0.0, tilt.duration_s, 500))
    np.testing.assert_allclose(np.linalg.norm(force, axis=1), G, rtol=1e-12)


def test_a_hand_on_the_knob_errs_and_trembles_and_the_truth_says_by_how_much():
    tilt = table(knob_error=0.01 * DEGREE, tremor=1e-3, seed=5)
    errors = tilt.angles - tilt.set_angles
    assert 0.003 * DEGREE < errors.std() < 0.03 * DEGREE
    stated = [event['angle']['value'] for event in tilt.events]
    np.testing.assert_array_equal(stated, tilt.angles)
    still, moving = np.linspace(5, 15, 2000), np.linspace(20.5, 22.5, 2000)
    shake = [(tilt.specific_force(t) - table().specific_force(t))[:, 1] for t in (still, moving)]
    assert not shake[0].any()
    assert shake[1].std() == pytest.approx(math.sqrt(1e-3 * 13), rel=0.5)
    assert not np.array_equal(table(knob_error=1e-4, seed=6).angles, tilt.angles)


@pytest.mark.parametrize('bad', [{'axis': 'z'}, {'steps': 0}, {'dwell_s': 0.0}])
def test_a_table_that_is_none_is_refused(bad):
    with pytest.raises(ConfigError, match='tilt_steps'):
        TiltSteps(Still(), **{'step': 0.01, 'steps': 1, **bad})


@given(
    distance=st.floats(0.01, 500.0),
    speed=st.floats(0.1, 10.0),
    acceleration=st.floats(0.1, 3.0),
    jerk=st.floats(0.1, 5.0),
    sign=st.sampled_from([1, -1]),
)
@settings(deadline=None)
def test_every_way_arrives_at_rest_within_its_limits(distance, speed, acceleration, jerk, sign):
    way = jerk_limited(sign * distance, speed, acceleration, jerk)
    assert way.position[-1] == pytest.approx(sign * distance, rel=1e-9)
    assert way.velocity[-1] == pytest.approx(0.0, abs=1e-9 * speed)
    assert way.acceleration[-1] == pytest.approx(0.0, abs=1e-9)
    assert np.abs(way.velocity).max() <= speed * (1 + 1e-9)
    assert np.abs(way.acceleration).max() <= acceleration * (1 + 1e-9)
    assert (np.diff(way.times) >= -1e-12).all()


def test_a_tall_lift_like_the_recorded_one_reaches_its_speed_and_acceleration():
    # elevator_phone: a_max 0.93 m/s², v_max 4.01 m/s, 74.30 m
    ride = LiftRide(74.30, 4.01, 0.93, 0.8, wait_s=10.0)
    t = np.arange(0.0, ride.duration_s, 1e-3)
    force = ride.specific_force(t)[:, 2]
    velocity = np.cumsum(force) * 1e-3
    height = np.cumsum(velocity) * 1e-3
    assert force.max() == pytest.approx(0.93, rel=1e-3)
    assert velocity.max() == pytest.approx(4.01, rel=1e-3)
    assert height[-1] == pytest.approx(74.30, rel=1e-3)
    assert np.abs(np.diff(force)).max() <= 0.8e-3 * 1.001
    summary = ride.events[0]
    assert (summary['height']['value'], summary['highest_speed']['value']) == pytest.approx(
        (74.30, 4.01)
    )


def test_doors_thud_and_rails_rattle_while_the_lift_moves_only():
    smooth = LiftRide(10.0, 1.0, 0.8, 1.0, wait_s=10.0)
    rough = LiftRide(
        10.0, 1.0, 0.8, 1.0, wait_s=10.0, door_thud=0.5, guide_vibration=1e-3,
        rail_length=2.5, joint_thud=0.3, seed=2,
    )  # fmt: skip
    t = np.arange(0.0, rough.duration_s, 1e-3)
    extra = rough.specific_force(t) - smooth.specific_force(t)
    before, doors, ride = t < 8.0, (t > 8.0) & (t < 10.0), (t > 13.0) & (t < 17.0)
    assert not extra[before].any()
    assert np.abs(extra[doors]).max() == pytest.approx(0.5, rel=0.3)
    assert extra[ride].std(axis=0)[0] > 0.1
    assert extra[ride].std(axis=0)[2] < extra[ride].std(axis=0)[0]
    assert len(rough._thuds) == 2 + 3


@pytest.mark.parametrize('bad', [{'distance': 0.0}, {'speed': 0.0}, {'wait_s': 1.0}])
def test_a_ride_that_is_none_is_refused(bad):
    with pytest.raises(ConfigError, match='lift_ride'):
        LiftRide(**{'distance': 7.0, 'speed': 1.0, 'acceleration': 0.8, 'jerk': 1.0, **bad})


def test_an_oven_ramps_soaks_and_cools():
    oven = TemperatureRamp(600.0, 23.0, 80.0, 4.0 / 60.0, soak_s=1200.0)
    room = Sum((Still(temperature_c=23.0), oven))
    up = 600.0 + 57.0 * 15.0
    t = np.array([0.0, 600.0, 600.0 + 15.0 * 7, up, up + 600.0, up + 1200.0, oven.duration_s])
    np.testing.assert_allclose(room.temperature(t), [23, 23, 30, 80, 80, 80, 23])
    stays = TemperatureRamp(0.0, 23.0, -10.0, 1.0, returns=False)
    np.testing.assert_allclose(stays.temperature(np.array([16.5, 100.0])), [-16.5, -33.0])


def test_a_ramp_that_leads_nowhere_is_refused():
    with pytest.raises(ConfigError, match='temperature_ramp'):
        TemperatureRamp(0.0, 25.0, 25.0, 1.0)
