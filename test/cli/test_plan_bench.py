# SPDX-License-Identifier: Apache-2.0
"""The mast bench through its plans: simulated, analysed, and compared with the truth."""

import json

import pytest

ANGLES = [0.58139 * k for k in (*range(7), *range(5, -1, -1))]


@pytest.fixture(scope='module')
def simulated(tmp_path_factory):
    """Return a function that simulates a scenario of the mast bench once."""
    from imu_bench.cli.main import main

    made = {}

    def simulate(scenario, *settings):
        key = (scenario, settings)
        if key not in made:
            bag = tmp_path_factory.mktemp('bench') / scenario
            given = [part for setting in settings for part in ('--set', setting)]
            command = ['simulate', 'mast_inclination', '--scenario', scenario, *given]
            assert main([*command, '-o', str(bag)]) == 0
            made[key] = bag
        return made[key]

    return simulate


def analysed(imu_bench, tmp_path, plan, bag, *more):
    document = tmp_path / f'{plan}.json'
    code, out, err = imu_bench('analyze', '--plan', plan, bag, '--json', document, *more)
    assert (code, err) == (0, '')
    return json.loads(document.read_text(encoding='utf-8')), out


def truth(bag):
    return json.loads((bag / 'truth.json').read_text(encoding='utf-8'))


def inside(estimate, value, slack=0.0):
    """Return whether a value lies in the interval, widened by a share of its width."""
    more = slack * (estimate['high'] - estimate['low'])
    return estimate['low'] - more < value < estimate['high'] + more


@pytest.mark.slow
@pytest.mark.usefixtures('only_svg')
def test_tilt_steps(imu_bench, simulated, tmp_path):
    bag = simulated('tilt_steps')
    page, figures = tmp_path / 'tilt.html', tmp_path / 'figures'
    found, out = analysed(
        imu_bench, tmp_path, 'inclination', bag, '--set', 'step=0.58139 °',
        '--html', page, '--figures', figures,
    )  # fmt: skip
    for name in ('scl3300', 'iim42652'):
        sensor = found['values'][name]
        assert [step['set'] for step in sensor['steps']] == pytest.approx(
            [angle * 0.017453292519943295 for angle in ANGLES]
        )
        assert sensor['axis'] == 'x'
        assert len(sensor['hysteresis']) == 6
        axes = truth(bag)['sensors'][name]['axes']
        x, z = (axes[f'linear_acceleration.{a}']['parameters'] for a in 'xz')
        # small angles: offset and slope of a_x / a_z with bias, scale and cross-axis terms
        upwards = 9.80665 * (1.0 + z['scale_factor']['value']) + z['bias']['value']
        slope = 9.80665 * (1.0 + x['scale_factor']['value']) / upwards
        assert inside(sensor['scale_error'], slope - 1.0, slack=1.0)
    on_chip = [s['on_chip_minus_trigonometry'] for s in found['values']['scl3300']['steps']]
    # one step of the angle output is 0.0055°
    assert all(abs(apart['value']) < 0.5 * 0.0055 * 0.01745 for apart in on_chip)
    assert 'on_chip' not in found['values']['iim42652']['steps'][0]
    smallest = found['values']['scl3300']['smallest_step']
    assert min(step['step']['value'] for step in smallest) < 0.005 * 0.01745
    assert 'on chip − trigonometry' in page.read_text(encoding='utf-8')
    assert len(list(figures.glob('*.svg'))) == 3
    assert 'Errors of the angle (mast thesis, appendix 6)' in out


@pytest.mark.slow
def test_a_table_that_is_set_by_hand(imu_bench, simulated, tmp_path):
    """The error of the knob is what the errors scatter by; the sensor itself is better."""
    bag = simulated(
        'tilt_steps', 'tilt_steps.knob_error=0.01 °', 'tilt_steps.tremor=1e-3 (m/s²)²/Hz'
    )
    found, _ = analysed(imu_bench, tmp_path, 'inclination', bag, '--set', 'step=0.58139 °')
    events = truth(bag)['scenario']['motions'][0]['events']
    knob = [e['angle']['value'] - e['set_angle']['value'] for e in events if 'set_angle' in e]
    steps = found['values']['scl3300']['steps']
    assert len(knob) == len(steps) == 13
    for step, error in zip(steps, knob, strict=True):
        # what is left is the sensor's own offset and slope
        assert step['compensated_error']['value'] == pytest.approx(
            error - knob[0], abs=0.007 * 0.01745
        )


@pytest.mark.slow
def test_fine_steps_the_other_way(imu_bench, simulated, tmp_path):
    bag = simulated('tilt_fine_steps')
    found, _ = analysed(
        imu_bench, tmp_path, 'inclination', bag, '--set', 'axis=-x',
        '--set', 'angles=' + ','.join(f'{0.05813 * k:.5f}' for k in range(7)),
    )  # fmt: skip
    for sensor in found['values'].values():
        # the IIM-42652 warms up by 1.5 K: 0.2 mg
        assert max(abs(s['compensated_error']['value']) for s in sensor['steps']) < 2.3e-4
        assert sensor['hysteresis'] == []


def test_set_angles_of_the_wrong_number_are_refused_in_one_line(imu_bench, simulated):
    code, _, err = imu_bench(
        'analyze', '--plan', 'inclination', '--set', 'angles=0,0.1,0.2',
        simulated('tilt_fine_steps'),
    )  # fmt: skip
    assert code == 1
    assert len(err.splitlines()) == 1
    assert '3 set angles for the 7 steps of' in err


@pytest.mark.slow
@pytest.mark.usefixtures('only_svg')
def test_heat_to_80(imu_bench, simulated, tmp_path):
    bag = simulated('heat_to_80')
    found, out = analysed(
        imu_bench, tmp_path, 'thermal', bag, '--html', tmp_path / 'h.html',
        '--figures', tmp_path / 'f',
    )  # fmt: skip
    hits = []
    for name, sensor in truth(bag)['sensors'].items():
        for axis, known in sensor['axes'].items():
            if '.' not in axis:
                continue
            errors = known['parameters']
            # at rest z shows gravity, and the temperature of its scale with it
            gravity = 9.80665 if axis == 'linear_acceleration.z' else 0.0
            through = errors['temperature_bias']['value']
            through += errors['temperature_scale']['value'] * gravity
            measured = found['values'][name]['axes'][axis]
            hits.append(inside(measured['coefficient'], through))
            assert inside(measured['coefficient'], through, slack=0.5)
            assert inside(measured['hysteresis'], 0.0, slack=1.0)
    assert sum(hits) >= 8  # of nine
    warm = found['values']['iim42652']
    assert warm['self_heating']['value'] == pytest.approx(1.5, abs=0.05)
    assert warm['warm_up_time']['value'] == pytest.approx(180.0, rel=0.05)
    assert 'mg/K' in out
    assert 'bias against temperature' in (tmp_path / 'h.html').read_text(encoding='utf-8')


def test_a_bench_that_was_not_heated_is_refused_in_one_line(imu_bench, simulated):
    code, _, err = imu_bench('analyze', '--plan', 'thermal', simulated('tilt_fine_steps'))
    assert code == 1
    assert 'heat by 5 K or more' in err.splitlines()[0]


@pytest.mark.data
def test_the_calibration_of_a_session_goes_into_a_sensor(
    imu_bench, shared_data, tmp_path, monkeypatch
):
    from imu_bench import bench

    columns = ','.join(
        f'{short}_{axis}={name}.{axis}'
        for short, name in (('gyr', 'angular_velocity'), ('acc', 'linear_acceleration'))
        for axis in 'xyz'
    )
    monkeypatch.setenv('COLUMNS', '200')
    yaml = tmp_path / 'calibration.yaml'
    session = shared_data / 'ferraris_session'
    code, out, err = imu_bench(
        'analyze', '--plan', 'six-position', session / 'example_ferraris_session.csv',
        '--rate', '102.4', '--columns', f'n_samples=index,{columns}',
        '--units', 'linear_acceleration=m/s^2,angular_velocity=deg/s',
        '--set', 'gravity=9.81 m/s²', '--set', f'yaml={yaml}',
    )  # fmt: skip
    assert (code, err) == (0, '')
    assert str(yaml) in out
    known = json.loads((session / 'imucal_calibration_of_example_session.json').read_text())
    own = tmp_path / 'own.yaml'
    own.write_text(
        '/**:\n  ros__parameters:\n    driver: mpu9250\n    backend: emulated\n'
        + yaml.read_text(encoding='utf-8').partition('ros__parameters:\n')[2],
        encoding='utf-8',
    )
    sensor = bench.load_sensor(own)
    assert sensor.calibration['acceleration'].bias == pytest.approx(known['b_a'], abs=2e-3)
    assert set(sensor.calibration) == {'acceleration', 'angular_velocity'}
