# SPDX-License-Identifier: Apache-2.0
"""The twin of a measured sensor errs as the sensor did."""

import json

from imu_bench import bench
from imu_bench.config import load_sensor, sensor_from_parameters
from imu_bench.errors import RecordingError
from imu_bench.simulation.twin import twins, write_twins
from imu_bench.simulation.world import errors_of
import numpy as np
import pytest

G = 9.80665


def estimate(value, unit='m/s²'):
    return {'value': value, 'low': value, 'high': value, 'unit': unit, 'observable': True}


UNSEEN = {'value': None, 'low': 0.0, 'high': 1.0, 'unit': 'm/s²', 'observable': False}


def axis(mean, n=1e-3, b=2e-4, **others):
    terms = {'Q': UNSEEN, 'N': estimate(n), 'B': estimate(b), 'K': UNSEEN, 'R': UNSEEN}
    return {'mean': estimate(mean), 'coefficients': terms, **others}


def document(axes, topic='/bench/left/imu/data_raw', resolution=None):
    health = {'rate': estimate(200.5, 'Hz'), 'resolution': resolution or {}}
    recording = {'topic': topic, 'frame_id': 'left_link', 'health': health, 'axes': axes}
    return {'schema': 'imu_bench.analysis/1', 'recordings': [recording]}


def made(tmp_path, content):
    path = tmp_path / 'results.json'
    path.write_text(json.dumps(content), encoding='utf-8')
    return twins(path)


def config(parameters, name='left'):
    return sensor_from_parameters(name, parameters, settings_of=bench.settings_of)


def three(**means):
    return {f'linear_acceleration.{letter}': axis(mean) for letter, mean in means.items()}


def test_noise_offset_rate_and_frame_are_those_measured(tmp_path):
    axes = three(x=0.1, y=-0.2, z=G + 0.3)
    axes |= {f'angular_velocity.{letter}': axis(0.01, 1e-4, 1e-5) for letter in 'xyz'}
    (parameters,) = made(tmp_path, document(axes)).values()
    sensor = config(parameters)
    errors = errors_of(sensor, {})
    force, turning = errors['acceleration'], errors['angular_velocity']
    np.testing.assert_allclose(force.noise_density, np.sqrt(2.0) * 1e-3)
    np.testing.assert_allclose(force.bias_instability, 2e-4)
    np.testing.assert_allclose(force.bias, [0.1, -0.2, 0.3])
    np.testing.assert_allclose(turning.bias, 0.01)
    assert not force.random_walk.any()
    assert (sensor.settings['rate_hz'], sensor.frame_id) == (200.5, 'left_link')


@pytest.mark.parametrize(
    ('up', 'sign'), [('x', 1), ('x', -1), ('y', 1), ('y', -1), ('z', 1), ('z', -1)]
)
def test_the_twin_lies_as_the_sensor_lay(tmp_path, up, sign):
    means = {letter: sign * G if letter == up else 0.05 for letter in 'xyz'}
    (parameters,) = made(tmp_path, document(three(**means))).values()
    from imu_bench.simulation.scenario import load_scenario

    source = bench.simulate(config(parameters), load_scenario('still')).sources[0]
    np.testing.assert_allclose(source.at_start()['acceleration'], list(means.values()), atol=1e-9)


def test_the_noise_of_rounding_is_not_counted_twice(tmp_path):
    axes = three(x=0.0, y=0.0, z=G)
    steps = {f'linear_acceleration.{letter}': estimate(0.02) for letter in 'xyz'}
    (parameters,) = made(tmp_path, document(axes, resolution=steps)).values()
    force = errors_of(config(parameters), {})['acceleration']
    n_squared = force.white_density**2 / 2.0 + 0.02**2 / 12.0 / 200.5
    np.testing.assert_allclose(n_squared, 1e-6)
    np.testing.assert_array_equal(force.resolution, 0.02)


def test_a_single_axis_that_sees_no_gravity_is_ac_coupled(tmp_path):
    axes = {
        'linear_acceleration.z': axis(0.001, noise_density_methods={'plateau': estimate(3e-4)})
    }
    (parameters,) = made(tmp_path, document(axes, topic='/9 piezo')).values()
    force = errors_of(config(parameters), {})['acceleration']
    assert (force.axes, force.high_pass[2], force.noise_density[2]) == ('z', 1.0, 3e-4)
    assert list(made(tmp_path, document(axes, topic='/9 piezo'))) == ['s_9_piezo']


def test_sensors_of_one_name_are_told_apart(tmp_path):
    content = document(three(z=G))
    content['recordings'] *= 3
    assert list(made(tmp_path, content)) == ['left', 'left_2', 'left_3']


def test_the_files_of_the_twins_can_be_loaded(tmp_path):
    twin = made(tmp_path, document(three(x=0.1, y=0.0, z=G)))
    write_twins(tmp_path / 'twin', twin, 'results.json')
    loaded = bench.load_bench(tmp_path / 'twin' / 'bench.yaml')
    assert [sensor.name for sensor in loaded.sensors] == ['left']
    alone = load_sensor(tmp_path / 'twin' / 'left.yaml')
    assert alone.simulation == config(twin['left']).simulation


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('{', 'not a JSON document'),
        ('[' * 100_000, 'not a JSON document'),
        ('[]', 'not a result'),
        ('{"schema": "other/2"}', "schema 'other/2'"),
        ('{"schema": "imu_bench.analysis/1"}', 'missing'),
        ('{"schema": "imu_bench.analysis/1", "recordings": [{}]}', 'missing'),
        ('{"schema": "imu_bench.analysis/1", "recordings": []}', 'no recording'),
        (
            json.dumps(
                {
                    'schema': 'imu_bench.analysis/1',
                    'recordings': [
                        {'topic': '/imu', 'health': {'rate': {'value': 'fast'}}, 'axes': {}}
                    ],
                }
            ),
            'could not convert',
        ),
    ],
)
def test_a_file_that_is_no_result_is_one_clear_line(tmp_path, text, message):
    path = tmp_path / 'results.json'
    path.write_text(text, encoding='utf-8')
    with pytest.raises(RecordingError, match=message) as caught:
        twins(path)
    assert '\n' not in str(caught.value)
    with pytest.raises(RecordingError, match='No such file'):
        twins(tmp_path / 'none.json')
