# SPDX-License-Identifier: Apache-2.0
"""From a configuration to errors and motion: what a datasheet says, and what a file replaces."""

from imu_bench.config import sensor_from_parameters, SensorConfig
from imu_bench.errors import ConfigError
from imu_bench.registers import Typical
from imu_bench.simulation.world import errors_of, motion_of, scenario_of, sensor_source
import numpy as np
import pytest

TYPICAL = {
    'acceleration': Typical(
        'sheet', noise_density=3e-3, bias=(0.6, 0.6, 0.8), scale_error=0.03, bandwidth=40.0,
        range=20.0, resolution=0.01, bias_per_kelvin=0.01, cross_axis=0.02, scale_per_kelvin=1e-4,
    ),
    'temperature': Typical('sheet'),
}  # fmt: skip


def sensor(name='mine', **simulation):
    given = {key.replace('__', '.'): value for key, value in simulation.items()}
    return SensorConfig(name, 'any', 'emulated', simulation=given)


def test_limits_of_a_datasheet_become_constants_of_the_sensor_within_them():
    drawn = [errors_of(sensor(seed=seed), TYPICAL)['acceleration'] for seed in range(200)]
    biases = np.array([errors.bias for errors in drawn])
    scales = np.array([errors.scale_factor for errors in drawn])
    crossed = np.array([errors.cross_axis for errors in drawn])
    assert (np.abs(biases) <= [0.6, 0.6, 0.8]).all()
    assert (np.abs(scales) <= 0.03).all()
    assert (np.abs(crossed) <= 0.02).all()
    assert (biases.std(axis=0) > 0.25).all()
    assert crossed.std(axis=0)[0, 1] > 0.01
    assert np.std([errors.temperature_bias[0] for errors in drawn]) > 0.004
    again = errors_of(sensor(seed=3), TYPICAL)['acceleration']
    np.testing.assert_array_equal(again.bias, biases[3])


def test_another_run_is_the_same_sensor_with_other_noise():
    def run(number):
        source = sensor_source(sensor(seed=1), TYPICAL, 100.0, 0, run=number)
        return source.samples_until(10**10).acceleration

    first, second = run(0), run(1)
    assert not np.array_equal(first, second)
    np.testing.assert_allclose(first.mean(axis=0), second.mean(axis=0), atol=0.02)
    np.testing.assert_array_equal(first, run(0))


def test_what_the_file_gives_replaces_the_typical_value_and_nothing_else():
    plain = errors_of(sensor(), TYPICAL)['acceleration']
    given = errors_of(sensor(acceleration__bias=(0.1,)), TYPICAL)['acceleration']
    np.testing.assert_array_equal(given.bias, [0.1, 0.1, 0.1])
    np.testing.assert_array_equal(given.scale_factor, plain.scale_factor)
    np.testing.assert_array_equal(given.noise_density, [3e-3] * 3)


def test_filter_range_and_steps_are_left_to_a_chip_on_the_wire():
    computed = errors_of(sensor(), TYPICAL)['acceleration']
    wired = errors_of(sensor(), TYPICAL, on_wire=True)['acceleration']
    assert (computed.low_pass[0], computed.range[0], computed.resolution[0]) == (40.0, 20.0, 0.01)
    assert (wired.low_pass[0], wired.range[0], wired.resolution[0]) == (np.inf, np.inf, 0.0)
    np.testing.assert_array_equal(wired.bias, computed.bias)
    np.testing.assert_array_equal(wired.cross_axis, computed.cross_axis)


def test_rows_of_a_matrix_are_put_together():
    parameters = {
        'driver': 'generic',
        'backend': 'emulated',
        'simulation': {
            'acceleration': {'cross_axis': {'y': ['1 %', '0 %', '2 %']}},
            'angular_velocity': {'acceleration_bias': {'z': ['0 °/s/g', '0 °/s/g', '1 °/s/g']}},
        },
    }
    config = sensor_from_parameters('mine', parameters)
    errors = errors_of(config, {})
    np.testing.assert_allclose(
        errors['acceleration'].cross_axis, [[0, 0, 0], [0.01, 0, 0.02], [0, 0, 0]]
    )
    assert errors['angular_velocity'].acceleration_bias[2, 2] == pytest.approx(
        np.pi / 180 / 9.80665
    )


def test_a_row_that_is_too_short_is_refused_with_its_name():
    config = sensor(acceleration__cross_axis__y=(0.1,))
    with pytest.raises(ConfigError, match=r'acceleration: cross_axis\.y: give three'):
        errors_of(config, {})


def test_a_generic_source_has_what_its_file_speaks_of():
    config = sensor(acceleration__noise_density=(1e-3,), angular_velocity__bias=(0.1,))
    assert list(errors_of(config, {})) == ['acceleration', 'angular_velocity']


def test_dies_of_one_chip_are_sampled_at_rates_of_their_own():
    config = sensor(rate_error=(0.01,))
    source = sensor_source(config, TYPICAL, 50.0, 0, ('temperature',))
    assert (source.quantities, source.rate_hz) == (('temperature',), 50.5)


def test_a_sensor_is_tilted_on_the_bench_and_warms_up():
    config = sensor(roll=(np.pi / 2,), self_heating=(3.0,), warm_up=(10.0,))
    motion = motion_of(config, scenario_of(config))
    np.testing.assert_allclose(
        motion.specific_force(np.zeros(1)), [[0.0, 9.80665, 0.0]], atol=1e-12
    )
    np.testing.assert_allclose(motion.temperature(np.array([0.0, 1e3])), [25.0, 28.0])


def test_an_unknown_scenario_of_a_sensor_lists_those_there_are():
    with pytest.raises(ConfigError, match=r"no scenario 'nope'; known are .*still"):
        scenario_of(sensor(scenario='nope'))
