# SPDX-License-Identifier: Apache-2.0
"""Scenario files: the shipped ones follow their documents, and wrong ones say what is wrong."""

import json
from pathlib import Path

from imu_bench.errors import ConfigError
from imu_bench.simulation.motion import highest_hz
from imu_bench.simulation.scenario import load_scenario, scenario_from
from imu_bench.units import DEGREE
from imu_bench.units import STANDARD_GRAVITY as G
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parent.parent.parent
SHIPPED = sorted(path.stem for path in (ROOT / 'config' / 'scenarios').glob('*.yaml'))


@pytest.mark.parametrize('name', SHIPPED)
def test_every_shipped_scenario_moves_and_states_its_truth(name):
    scenario = load_scenario(name)
    end = scenario.duration_s or 100.0
    # at no fixed interval: none of its tones may stand still in it
    t = np.sort(np.random.default_rng(1).uniform(0.0, end, 20_000))
    assert np.isfinite(scenario.motion.specific_force(t)).all()
    assert np.isfinite(scenario.motion.angular_velocity(t)).all()
    assert np.isfinite(scenario.motion.temperature(t)).all()
    force = np.broadcast_to(scenario.motion.specific_force(t), (t.size, 3))
    assert np.linalg.norm(force.mean(axis=0)) == pytest.approx(G, rel=0.1)
    assert scenario.title
    stated = json.loads(json.dumps(scenario.truth, allow_nan=False))
    assert stated['name'] == name
    for motion in stated['motions']:
        units = [v for v in motion.values() if isinstance(v, dict)]
        assert all(set(value) == {'value', 'unit'} for value in units)


@pytest.mark.parametrize(('condition', 'tone'), [(1, 5.0), (2, 10.0), (3, 15.0)])
def test_service_conditions_are_those_of_table_iii(condition, tone):
    scenario = load_scenario(f'sine_on_random_sc{condition}')
    sine, random = scenario.truth['motions']
    assert sine['frequency'] == {'value': tone, 'unit': 'Hz'}
    assert sine['amplitude']['value'] == pytest.approx(G)
    assert random['density']['value'] == pytest.approx(0.01 * G**2)
    assert (random['low']['value'], random['high']['value']) == (200.0, 2000.0)
    spans = [(zone.name, zone.end_s - zone.begin_s) for zone in scenario.zones]
    assert spans == [('before', 180.0), ('test', 600.0), ('after', 180.0)]
    assert scenario.duration_s == 960.0
    t = np.arange(200.0, 260.0, 1e-4)
    force = scenario.motion.specific_force(t)
    amplitude = 2 * abs(np.mean(force[:, 0] * np.exp(-2j * np.pi * tone * t)))
    assert amplitude == pytest.approx(G, rel=0.01)
    # peak 1 g, and 0.01 g²/Hz over 1800 Hz
    assert force[:, 0].std() == pytest.approx(G * np.sqrt(0.5 + 18.0), rel=0.02)
    quiet = scenario.motion.specific_force(np.arange(10.0, 170.0))
    np.testing.assert_array_equal(quiet, [[0.0, 0.0, G]])


def test_service_condition_4_sweeps_from_5_to_20_hz_at_1_octave_per_minute():
    sweep, _ = load_scenario('sine_on_random_sc4').truth['motions']
    assert (sweep['low']['value'], sweep['high']['value']) == (5.0, 20.0)
    assert sweep['rate']['value'] * 60 == pytest.approx(1.0)


def test_repetitions_follow_one_another_and_differ_in_the_random_part_only():
    scenario = load_scenario('sine_on_random_sc1', overrides=['repeat=2', 'axis=y'])
    assert [zone.name for zone in scenario.zones] == ['before', 'test', 'after'] * 2
    t = np.arange(300.0, 310.0, 1e-3)
    first, second = (scenario.motion.specific_force(t + k * 960.0)[:, 1] for k in (0, 1))
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.2
    assert not scenario.motion.specific_force(t)[:, 0].any()


def test_another_seed_is_another_random_vibration_of_the_same_plan():
    one, two, again = (load_scenario('random', seed=seed) for seed in (1, 2, 1))
    t = np.arange(0.0, 2.0, 1e-4)
    force = [scenario.motion.specific_force(t)[:, 2] - G for scenario in (one, two, again)]
    np.testing.assert_array_equal(force[0], force[2])
    assert abs(np.corrcoef(force[0], force[1])[0, 1]) < 0.1


def test_the_tilt_tables_of_the_thesis_have_six_steps():
    coarse = load_scenario('tilt_steps').truth['motions'][0]['events']
    fine = load_scenario('tilt_fine_steps').truth['motions'][0]['events']
    assert [round(e['set_angle']['value'] / DEGREE, 4) for e in coarse[5:8]] == [
        2.9069, 3.4883, 2.9069
    ]  # fmt: skip
    assert fine[-1]['set_angle']['value'] / DEGREE == pytest.approx(-0.34878)


def test_a_setting_is_replaced_from_the_command_line():
    scenario = load_scenario('sine', overrides=['sine.frequency=90 Hz', 'axis=x', 'duration=5 s'])
    assert highest_hz(scenario.motion) == 90.0
    assert scenario.duration_s == 5.0
    assert scenario.motion.specific_force(np.array([1 / 360]))[0, 0] == pytest.approx(G)


@pytest.mark.parametrize(
    ('override', 'text'),
    [
        ('sine.frequncy=3 Hz', "did you mean 'frequency'"),
        ('sine.frequency=3', 'no unit'),
        ('sine.frequency=3 furlong', "unknown unit 'furlong'; use one of Hz, kHz, rpm"),
        ('sine.frequency=3 m', 'length'),
        ('sine.frequency=["1 Hz", "2 Hz", "3 Hz"]', 'give one'),
        ('sine.zone=test', 'no zone'),
        ('axis=q', 'q is not allowed'),
        ('nope=1', 'unknown'),
        ('nonsense', 'no setting like'),
        ('lift_ride.jerk=1', "no 'lift_ride'"),
        ('sine.amplitude=[', 'no value'),
    ],
)
def test_a_wrong_override_is_one_clear_line(override, text):
    with pytest.raises(ConfigError) as caught:
        load_scenario('sine', overrides=[override])
    assert text in str(caught.value)
    assert '\n' not in str(caught.value)


def test_an_unknown_scenario_lists_those_there_are():
    with pytest.raises(
        ConfigError, match=r"no scenario 'nope'; known are engine_idle, .*tilt_steps"
    ):
        load_scenario('nope')
    with pytest.raises(ConfigError, match="did you mean 'lift_ride'"):
        load_scenario('liftride')


@pytest.mark.parametrize(
    ('document', 'text'),
    [
        ({'motions': 'sine'}, 'no list'),
        ({'motions': ['sine']}, 'no entry like'),
        ({'motions': [{'sine': 7}]}, 'sine: 7 is no mapping of settings'),
        ({'motions': [{'shake': {}}]}, "no motion 'shake'"),
        ({'motions': [{'sine': {}}]}, 'amplitude: missing'),
        ({'motions': [{'tilt_steps': {'step': '1 °', 'axis': 'z'}}]}, 'z is not allowed'),
        ({'motions': [{'random': {'density': '1 g²/Hz', 'low': '9 Hz', 'high': '5 Hz'}}]}, 'band'),
        ({'zones': ['test']}, 'no mapping'),
        ({'zones': {'test': '5'}}, 'zones.test'),
        ({'zones': {'test': '0 s'}}, 'no time'),
        ({'temperature': ['1 °C', '2 °C', '3 °C']}, 'give one'),
        ({'gravity': '1 g'}, 'unknown'),
    ],
)
def test_a_wrong_file_says_what_is_wrong_and_where(document, text):
    with pytest.raises(ConfigError) as caught:
        scenario_from(document, 'mine', where='mine.yaml')
    assert text in str(caught.value)
    assert 'mine.yaml' in str(caught.value)
