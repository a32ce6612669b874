# SPDX-License-Identifier: Apache-2.0
"""The error model of a sensor: every error by itself, and all of them in their order."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st
from imu_bench.errors import ConfigError
from imu_bench.simulation.sensor_errors import Errors
from imu_bench.simulation.sensor_model import ErrorModel
from imu_bench.units import STANDARD_GRAVITY as G
import numpy as np
import pytest

LEVEL = np.tile([0.0, 0.0, G], (4, 1))
EVERYTHING = Errors(
    noise_density=0.1, bias_instability=0.2, random_walk=0.3, quantisation=1e-3,
    bias=(0.1, 0.2, 0.3), turn_on_bias=0.1, scale_factor=0.01, misalignment=0.1,
    cross_axis=((0, 0.1, 0.2), (0.1, 0, 0), (0, 0.3, 0)), temperature_bias=0.01,
    temperature_scale=1e-3, vibration_rectification=1e-3, low_pass=20.0, high_pass=0.5,
    range=20.0, resolution=1e-3, outlier_rate=3.0, outlier_size=5.0, zeros=0.05,
    stuck_rate=2.0, stuck_time=0.05,
)  # fmt: skip


def shown(errors, truth=LEVEL, period_s=0.01, seed=1, **others):
    truths = {'acceleration': np.asarray(truth), **others}
    n = max(len(values) for values in truths.values())
    return ErrorModel({'acceleration': errors}, seed).sample(truths, n, period_s)['acceleration']


def test_a_perfect_sensor_shows_the_truth():
    np.testing.assert_array_equal(shown(Errors()), LEVEL)


def test_a_single_row_is_a_truth_that_does_not_change():
    np.testing.assert_array_equal(
        ErrorModel({'acceleration': Errors()}).sample({'acceleration': LEVEL[:1]}, 4, 0.01)[
            'acceleration'
        ],
        LEVEL,
    )


def test_bias_and_scale_factor_per_axis():
    values = shown(Errors(bias=(0.1, -0.2, 0.3), scale_factor=(0.0, 0.0, 0.01)))
    np.testing.assert_allclose(values[0], [0.1, -0.2, G * 1.01 + 0.3], rtol=1e-14)


def test_a_sensor_turned_about_x_sees_gravity_on_y():
    # the sensor's own y axis points up by the angle, so it sees +g sin on y
    values = shown(Errors(misalignment=(math.radians(30), 0.0, 0.0)))
    np.testing.assert_allclose(values[0], [0.0, G / 2, G * math.sqrt(3) / 2], atol=1e-12)


def test_cross_axis_sensitivity_is_output_by_row_and_truth_by_column():
    errors = Errors(cross_axis=((0, 0.1, 0.02), (0, 0, 0.03), (0.5, 0, 0)))
    values = shown(errors, [[1.0, 10.0, 100.0]])
    np.testing.assert_allclose(values, [[1.0 + 1.0 + 2.0, 10.0 + 3.0, 100.0 + 0.5]])


def test_temperature_shifts_offset_and_scale_from_25_degrees():
    errors = Errors(temperature_bias=(0.01, 0.0, 0.0), temperature_scale=1e-3)
    values = shown(errors, LEVEL[:3], temperature=np.array([25.0, 35.0, 5.0]))
    np.testing.assert_allclose(values[:, 0], [0.0, 0.1, -0.2], atol=1e-12)
    np.testing.assert_allclose(values[:, 2], [G, G * 1.01, G * 0.98])


def test_a_gyroscope_feels_acceleration_along_every_axis():
    errors = Errors(acceleration_bias=((0.1, 0, 0.01), (0, 0.2, 0), (0, 0, 0)))
    model = ErrorModel({'angular_velocity': errors})
    truth = {'acceleration': np.array([[1.0, 2.0, 10.0]])}
    values = model.sample(truth, 1, 0.01)['angular_velocity']
    np.testing.assert_allclose(values, [[0.2, 0.4, 0.0]])


def test_vibration_becomes_an_offset_by_the_mean_square_even_above_the_low_pass():
    fold, rate = 50, 100.0
    t = np.arange(1, 20_000 * fold + 1) / (fold * rate)
    force = np.zeros((t.size, 3))
    force[:, 0] = 3.0 * np.sin(2 * np.pi * 1234.0 * t)
    model = ErrorModel({'acceleration': Errors(vibration_rectification=0.01, low_pass=10.0)})
    made = model.sample({'acceleration': force}, 20_000, 1 / rate, oversampling=fold)
    assert made['acceleration'][500:, 0].mean() == pytest.approx(0.01 * 4.5, rel=0.01)
    assert made['acceleration'][500:, 0].std() < 0.03


@pytest.mark.parametrize('order', [1, 2])
def test_what_lies_above_nyquist_passes_the_low_pass_and_folds_back(order):
    fold, rate, corner, tone = 60, 119.0, 50.0, 400.0
    n = 12_000
    t = np.arange(1, n * fold + 1) / (fold * rate)
    force = np.zeros((t.size, 3))
    force[:, 1] = np.sin(2 * np.pi * tone * t)
    model = ErrorModel({'acceleration': Errors(low_pass=corner, low_pass_order=order)})
    y = model.sample({'acceleration': force}, n, 1 / rate, oversampling=fold)['acceleration'][:, 1]
    alias = abs(tone - round(tone / rate) * rate)
    spectrum = np.abs(np.fft.rfft(y * np.hanning(n)))
    assert np.fft.rfftfreq(n, 1 / rate)[spectrum.argmax()] == pytest.approx(alias, abs=0.02)
    assert y[200:].std() * math.sqrt(2) == pytest.approx(
        1 / math.sqrt(1 + (tone / corner) ** (2 * order)), rel=0.03
    )


@pytest.mark.slow
def test_noise_is_filtered_but_keeps_its_density_at_low_frequencies():
    rate, n = 1000.0, 400_000
    errors = Errors(noise_density=2.0, low_pass=20.0)
    x = shown(errors, np.zeros((n, 3)), 1 / rate)[:, 0]
    assert x.std() == pytest.approx(2.0 * math.sqrt(20.0 * math.pi / 2), rel=0.05)
    means = x.reshape(-1, 1000).mean(axis=1)
    assert means.std() == pytest.approx(2.0 * math.sqrt(0.5), rel=0.15)
    # filtered from the first sample on
    first = [shown(errors, np.zeros((1, 3)), 1 / rate, seed=s)[0, 0] for s in range(400)]
    assert np.std(first) == pytest.approx(2.0 * math.sqrt(20.0 * math.pi / 2), rel=0.15)


def test_one_sided_density_is_root_two_times_the_two_sided_one():
    one = shown(Errors(noise_density=math.sqrt(2.0)), np.zeros((50, 3)))
    two = shown(Errors(noise_density=1.0, noise_type='two-sided'), np.zeros((50, 3)))
    np.testing.assert_allclose(one, two)


@pytest.mark.parametrize('rate', [50.0, 800.0])
def test_double_the_rate_and_the_density_stays(rate):
    x = shown(Errors(noise_density=0.3), np.zeros((round(rate) * 400, 3)), 1 / rate)
    seconds = x[:, 0].reshape(400, -1).mean(axis=1)
    assert seconds.std() == pytest.approx(0.3 / math.sqrt(2), rel=0.1)


def test_the_offset_at_turn_on_differs_from_run_to_run():
    errors = Errors(turn_on_bias=(0.2, 0.0, 0.0))
    offsets = [shown(errors, np.zeros((2, 3)), seed=seed) for seed in range(400)]
    assert all((run[0] == run[1]).all() for run in offsets)
    assert np.std([run[0, 0] for run in offsets]) == pytest.approx(0.2, rel=0.1)
    assert not np.any([run[:, 1:] for run in offsets])
    model = ErrorModel({'acceleration': errors}, 7)
    assert model.turn_on['acceleration'][0] == shown(errors, np.zeros((1, 3)), seed=7)[0, 0]


def test_saturation_and_resolution():
    truth = [[30.0, -30.0, 0.1249]]
    values = shown(Errors(range=20.0, resolution=0.05), truth)
    np.testing.assert_allclose(values, [[20.0, -20.0, 0.1]])


def test_rounding_comes_after_the_noise():
    values = shown(Errors(noise_density=0.5, resolution=0.25), np.zeros((500, 3)))
    np.testing.assert_array_equal(values, np.round(values / 0.25) * 0.25)
    assert values.std() > 0.25


def test_spikes_come_as_often_and_as_large_as_asked_at_every_rate():
    for rate in (100.0, 1000.0):
        errors = Errors(outlier_rate=0.5, outlier_size=8.0)
        x = shown(errors, np.zeros((round(rate) * 1000, 3)), 1 / rate)[:, 0]
        spikes = x[x != 0.0]
        assert spikes.size == pytest.approx(500, rel=0.15)
        assert np.abs(spikes).max() == pytest.approx(8.0, rel=0.02)
        assert abs(spikes.mean()) < 1.0


def test_zeros_come_in_their_share_and_replace_the_word():
    x = shown(Errors(zeros=(0.3, 0.0, 0.0), bias=5.0), np.zeros((20_000, 3)))
    assert np.mean(x[:, 0] == 0.0) == pytest.approx(0.3, abs=0.02)
    assert (x[:, 1] == 5.0).all()


def test_a_stuck_output_repeats_its_word_for_its_time():
    errors = Errors(noise_density=1.0, stuck_rate=0.5, stuck_time=0.2)
    x = shown(errors, np.zeros((200_000, 3)), 1e-3)[:, 0]
    held = np.diff(x) == 0.0
    edges = np.diff(np.concatenate([[0], held.astype(int), [0]]))
    lengths = np.flatnonzero(edges == -1) - np.flatnonzero(edges == 1)
    assert set(lengths[:-1]) == {199}
    # 0.5 per second of the time in which it is free
    assert lengths.size == pytest.approx(0.5 * 200 / 1.1, rel=0.25)


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


def test_an_ac_coupled_sensor_does_not_begin_with_a_transient():
    """Settled on its first noise it began 2.5 times as noisy, which passed for unsteady noise."""
    starts = np.array([
        shown(Errors(noise_density=0.1, high_pass=1.0), np.tile(LEVEL[:1], (300, 1)), 1e-3, seed)
        for seed in range(60)
    ])  # fmt: skip
    # averages of a fifth of a second: what is left of white noise scatters by 0.16 at most
    assert starts[:, :200].mean(axis=1).std() < 0.2
    assert abs(starts.mean()) < 0.02


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
    alone = ErrorModel({'acceleration': errors}, 3).sample(truth, 4, 0.01)
    both = ErrorModel({'acceleration': errors, 'temperature': errors}, 3).sample(truth, 4, 0.01)
    np.testing.assert_array_equal(alone['acceleration'], both['acceleration'])
    assert both['temperature'].shape == (4,)


def test_axes_are_independent():
    errors = Errors(noise_density=0.1, bias_instability=0.1, quantisation=1e-3)
    steps = np.diff(shown(errors, np.zeros((8000, 3))), axis=0)
    correlation = np.corrcoef(steps.T)
    assert np.abs(correlation[np.triu_indices(3, 1)]).max() < 0.06


def test_the_seed_decides():
    errors = Errors(noise_density=1.0, bias_instability=1.0)
    np.testing.assert_array_equal(shown(errors, seed=5), shown(errors, seed=5))
    assert not np.array_equal(shown(errors, seed=5), shown(errors, seed=6))


@pytest.mark.slow
@given(
    cuts=st.lists(st.integers(0, 50), min_size=1, max_size=6),
    seed=st.integers(0, 2**31),
    fold=st.integers(1, 3),
)
@settings(max_examples=40, deadline=None)
def test_blocks_do_not_change_the_stream(cuts, seed, fold):
    n = sum(cuts)
    truth = np.linspace(-1, 1, 3 * n * fold).reshape(n * fold, 3)
    heat = np.linspace(20, 30, n * fold)

    def block(model, first, length):
        part = slice(first * fold, (first + length) * fold)
        truths = {'acceleration': truth[part], 'temperature': heat[part]}
        return model.sample(truths, length, 0.01, oversampling=fold)['acceleration']

    whole = block(ErrorModel({'acceleration': EVERYTHING}, seed), 0, n)
    model = ErrorModel({'acceleration': EVERYTHING}, seed)
    parts, first = [], 0
    for length in cuts:
        parts.append(block(model, first, length))
        first += length
    np.testing.assert_allclose(np.concatenate(parts), whole, rtol=0, atol=1e-12)


def test_what_it_shows_without_noise_is_told():
    model = ErrorModel({'acceleration': EVERYTHING, 'temperature': Errors(bias=1.0)}, 3)
    ideal = model.ideal({'acceleration': LEVEL[:1], 'temperature': np.array([35.0])})
    offset = 0.1 + model.turn_on['acceleration'][0]
    assert ideal['acceleration'][0, 0] != 0.0
    assert ideal['temperature'].tolist() == [[36.0]]
    plain = ErrorModel({'acceleration': Errors(bias=0.1)}).ideal({'acceleration': LEVEL[:1]})
    np.testing.assert_allclose(plain['acceleration'], [[0.1, 0.1, G + 0.1]])
    assert offset != 0.1


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('noise_density', -1.0),
        ('bias', (1.0, 2.0)),
        ('range', math.nan),
        ('axes', 'xw'),
        ('cross_axis', (1.0, 2.0, 3.0)),
        ('cross_axis', np.eye(3)),
        ('noise_type', 'both'),
        ('low_pass', 0.0),
        ('low_pass_order', 3),
        ('zeros', 1.5),
    ],
)
def test_impossible_errors_are_refused_by_name(name, value):
    with pytest.raises(ConfigError, match=name):
        Errors(**{name: value})


@pytest.mark.parametrize('errors', [{}, {'pressure': Errors()}])
def test_unknown_or_no_quantities_are_refused(errors):
    with pytest.raises(ConfigError, match='acceleration'):
        ErrorModel(errors)
