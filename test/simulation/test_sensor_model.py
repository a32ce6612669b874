# SPDX-License-Identifier: Apache-2.0
"""The error model of a sensor: every error by itself, and all of them in their order."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st
from imu_bench.errors import ConfigError
from imu_bench.simulation.sensor_model import ErrorModel, Errors
from imu_bench.units import STANDARD_GRAVITY as G
import numpy as np
import pytest

LEVEL = np.tile([0.0, 0.0, G], (4, 1))


def shown(errors, truth=LEVEL, period_s=0.01, seed=1):
    model = ErrorModel({'acceleration': errors}, seed)
    return model.sample({'acceleration': np.asarray(truth)}, period_s)['acceleration']


def test_a_perfect_sensor_shows_the_truth():
    np.testing.assert_array_equal(shown(Errors()), LEVEL)


def test_bias_and_scale_factor_per_axis():
    values = shown(Errors(bias=(0.1, -0.2, 0.3), scale_factor=(0.0, 0.0, 0.01)))
    np.testing.assert_allclose(values[0], [0.1, -0.2, G * 1.01 + 0.3], rtol=1e-14)


def test_a_sensor_turned_about_x_sees_gravity_on_y():
    # the sensor's own y axis points up by the angle, so it sees +g sin on y
    values = shown(Errors(misalignment=(math.radians(30), 0.0, 0.0)))
    np.testing.assert_allclose(values[0], [0.0, G / 2, G * math.sqrt(3) / 2], atol=1e-12)


def test_saturation_and_resolution():
    truth = [[30.0, -30.0, 0.1249]]
    values = shown(Errors(range=20.0, resolution=0.05), truth)
    np.testing.assert_allclose(values, [[20.0, -20.0, 0.1]])


def test_rounding_comes_after_the_noise():
    values = shown(Errors(noise_density=0.5, resolution=0.25), np.zeros((500, 3)))
    np.testing.assert_array_equal(values, np.round(values / 0.25) * 0.25)
    assert values.std() > 0.25


def test_missing_axes_are_nan_and_leave_the_others_as_they_are():
    full = shown(Errors(noise_density=0.1))
    single = shown(Errors(noise_density=0.1, axes='z'))
    assert np.isnan(single[:, :2]).all()
    np.testing.assert_array_equal(single[:, 2], full[:, 2])


def test_an_ac_coupled_sensor_forgets_gravity_and_passes_vibration():
    t = np.arange(20_000) / 1000.0
    truth = np.zeros((t.size, 3))
    truth[:, 2] = G + np.sin(2 * np.pi * 50.0 * t)
    values = shown(Errors(high_pass=1.0, axes='z'), truth, 1e-3)[5000:, 2]
    assert abs(values.mean()) < 1e-3
    assert values.std() == pytest.approx(1 / math.sqrt(2), rel=0.01)


def test_the_corner_frequency_is_where_half_the_power_passes():
    t = np.arange(40_000) / 1000.0
    truth = np.zeros((t.size, 3))
    truth[:, 0] = np.sin(2 * np.pi * 2.0 * t)
    values = shown(Errors(high_pass=2.0), truth, 1e-3)[10_000:, 0]
    assert values.std() == pytest.approx(0.5, rel=0.01)


def test_one_error_does_not_change_the_draws_of_another():
    white = shown(Errors(noise_density=0.1))
    both = shown(Errors(noise_density=0.1, random_walk=0.1))
    walk = shown(Errors(random_walk=0.1))
    np.testing.assert_allclose(both - LEVEL, (white - LEVEL) + (walk - LEVEL), atol=1e-12)


def test_adding_a_quantity_leaves_the_others_as_they_were():
    truth = {'acceleration': LEVEL, 'temperature': np.full(4, 20.0)}
    errors = Errors(noise_density=0.1)
    alone = ErrorModel({'acceleration': errors}, 3).sample(truth, 0.01)
    both = ErrorModel({'acceleration': errors, 'temperature': errors}, 3).sample(truth, 0.01)
    np.testing.assert_array_equal(alone['acceleration'], both['acceleration'])
    assert both['temperature'].shape == (4,)


def test_the_seed_decides():
    errors = Errors(noise_density=1.0, bias_instability=1.0)
    np.testing.assert_array_equal(shown(errors, seed=5), shown(errors, seed=5))
    assert not np.array_equal(shown(errors, seed=5), shown(errors, seed=6))


@given(cuts=st.lists(st.integers(0, 50), min_size=1, max_size=6), seed=st.integers(0, 2**31))
@settings(max_examples=40, deadline=None)
def test_blocks_do_not_change_the_stream(cuts, seed):
    errors = Errors(0.1, 0.2, 0.3, 1e-3, (0.1, 0.2, 0.3), 0.01, 0.1, 0.5, 20.0, 1e-3)
    n = sum(cuts)
    truth = np.linspace(-1, 1, 3 * n).reshape(n, 3)
    whole = shown(errors, truth, seed=seed)
    model = ErrorModel({'acceleration': errors}, seed)
    parts, first = [], 0
    for length in cuts:
        part = {'acceleration': truth[first : first + length]}
        parts.append(model.sample(part, 0.01)['acceleration'])
        first += length
    np.testing.assert_allclose(np.concatenate(parts), whole, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ('name', 'value'),
    [('noise_density', -1.0), ('bias', (1.0, 2.0)), ('range', math.nan), ('axes', 'xw')],
)
def test_impossible_errors_are_refused_by_name(name, value):
    with pytest.raises(ConfigError, match=name):
        Errors(**{name: value})


@pytest.mark.parametrize('errors', [{}, {'pressure': Errors()}])
def test_unknown_or_no_quantities_are_refused(errors):
    with pytest.raises(ConfigError, match='acceleration'):
        ErrorModel(errors)
