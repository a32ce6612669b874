# SPDX-License-Identifier: Apache-2.0
"""From a configuration to errors and motion: what a datasheet says, and what a file replaces."""

from imu_bench.config import SensorConfig
from imu_bench.registers import Typical
from imu_bench.simulation.world import errors_of, motion_of, sensor_source
import numpy as np

TYPICAL = {
    'acceleration': Typical('sheet', noise_density=3e-3, bias=(0.6, 0.6, 0.8), scale_error=0.03),
    'temperature': Typical('sheet'),
}


def sensor(name='mine', **simulation):
    given = {key.replace('__', '.'): value for key, value in simulation.items()}
    return SensorConfig(name, 'any', 'emulated', simulation=given)


def test_limits_of_a_datasheet_become_constants_of_the_sensor_within_them():
    drawn = [errors_of(sensor(seed=seed), TYPICAL)['acceleration'] for seed in range(200)]
    biases = np.array([errors.bias for errors in drawn])
    scales = np.array([errors.scale_factor for errors in drawn])
    assert (np.abs(biases) <= [0.6, 0.6, 0.8]).all()
    assert (np.abs(scales) <= 0.03).all()
    assert (biases.std(axis=0) > 0.25).all()
    again = errors_of(sensor(seed=3), TYPICAL)['acceleration']
    np.testing.assert_array_equal(again.bias, biases[3])


def test_what_the_file_gives_replaces_the_typical_value_and_nothing_else():
    plain = errors_of(sensor(), TYPICAL)['acceleration']
    given = errors_of(sensor(acceleration__bias=(0.1,)), TYPICAL)['acceleration']
    np.testing.assert_array_equal(given.bias, [0.1, 0.1, 0.1])
    np.testing.assert_array_equal(given.scale_factor, plain.scale_factor)
    np.testing.assert_array_equal(given.noise_density, [3e-3] * 3)


def test_a_generic_source_has_what_its_file_speaks_of():
    config = sensor(acceleration__noise_density=(1e-3,), angular_velocity__bias=(0.1,))
    assert list(errors_of(config, {})) == ['acceleration', 'angular_velocity']


def test_dies_of_one_chip_are_sampled_at_rates_of_their_own():
    config = sensor(rate_error=(0.01,))
    source = sensor_source(config, TYPICAL, 50.0, 0, ('temperature',))
    assert (source.quantities, source.rate_hz) == (('temperature',), 50.5)


def test_the_bench_is_tilted_and_heated_as_the_file_says():
    motion = motion_of(sensor(roll=(np.pi / 2,), temperature=(60.0,)))
    t = np.zeros(1)
    np.testing.assert_allclose(motion.specific_force(t), [[0.0, 9.80665, 0.0]], atol=1e-12)
    assert motion.temperature(t) == [60.0]
