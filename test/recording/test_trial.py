# SPDX-License-Identifier: Apache-2.0
"""What `imu-bench demo --test` and `--scenario` make of a bench, without any process."""

import subprocess
import sys

from imu_bench import bench
from imu_bench.config.location import named_file
from imu_bench.errors import ConfigError
from imu_bench.recording.trial import NOT_YET, of_scenario, of_test
from imu_bench.simulation.scenario import load_scenario
import pytest

DEMO_S = 60.0


def load(name):
    return bench.load_bench(named_file('benches', name))


@pytest.mark.parametrize('name', ['mast_inclination', 'machine_vibration', 'vehicle_vibration'])
def test_every_test_of_the_three_benches_has_a_form_for_a_minute(name):
    config = load(name)
    for test in config.tests:
        live = of_test(config, test.name, DEMO_S)
        assert 30.0 < live.duration_s <= DEMO_S, test.name
        assert live.test is test
        assert live.remark.startswith(f'scenario {live.name} for ')


def test_what_each_bench_shows_by_itself():
    assert load('machine_vibration').demo == ''  # six sensors at rest
    assert load('mast_inclination').demo == 'tilt'
    assert load('vehicle_vibration').demo == 'sine_on_random'


def test_a_test_that_fits_is_run_as_it_is():
    config = load('mast_inclination')
    whole, short = (of_test(config, 'tilt', seconds) for seconds in (600.0, 60.0))
    assert (whole.overrides, whole.duration_s) == ((), 296.0)
    assert short.duration_s == 58.0
    assert 'made short with tilt_steps.steps=3, ' in short.remark


def test_one_that_stands_still_is_cut_where_the_time_ends():
    live = of_test(load('machine_vibration'), 'night', 45.0)
    assert live.duration_s == 45.0
    assert live.remark == 'scenario still for 45 s; the test takes 50400 s'


def test_the_first_of_many_runs():
    live = of_test(load('vehicle_vibration'), 'sine_on_random', DEMO_S)
    assert live.name == 'sine_on_random_sc1'
    assert live.overrides[0] == 'axis=x'
    assert '; one of 69 runs; ' in live.remark


def test_the_plan_and_its_settings():
    config = load('machine_vibration')
    assert of_test(config, 'engine', DEMO_S).analysis() == [
        '--plan', 'vibration', '--set', 'cylinders=4', '--reference', 'mtn1100',
    ]  # fmt: skip
    assert of_scenario('sine', (), DEMO_S).analysis() == []


@pytest.mark.parametrize(
    ('name', 'duration_s', 'text'),
    [
        ('tolt', 60.0, '--test tolt: bench mast_inclination has: static, tilt, tilt_fine, heat'),
        ('tilt', 20.0, 'test tilt takes 58 s at least, not 20 s; give a longer --duration'),
    ],
)
def test_what_cannot_be_run_is_one_line(name, duration_s, text):
    with pytest.raises(ConfigError) as problem:
        of_test(load('mast_inclination'), name, duration_s)
    assert str(problem.value).startswith(text)
    assert '\n' not in str(problem.value)


def test_a_bench_without_tests_says_so():
    with pytest.raises(ConfigError, match='all_eight lists no tests'):
        of_test(load('all_eight'), 'tilt', DEMO_S)


def test_a_scenario_may_be_cut():
    assert of_scenario('sweep', (), DEMO_S).remark == 'scenario sweep for 60 s of its 1037 s'
    assert of_scenario('still', (), DEMO_S).remark == 'scenario still for 60 s'


def test_sensors_get_the_very_scenario(tmp_path):
    live = of_test(load('vehicle_vibration'), 'sine_on_random', DEMO_S)
    parameters = live.write(tmp_path / 'scenario')
    assert parameters['simulation.begin'] == NOT_YET
    read = load_scenario(parameters['simulation.scenario'])
    assert read.truth == live.scenario.truth
    assert read.name == 'sine_on_random_sc1'


def test_who_follows_a_scenario_waits_for_no_filters_and_no_analysis():
    script = (
        'import sys, imu_bench.recording.session\n'
        'from imu_bench.recording import trial\n'
        "trial.of_scenario('still', (), 10.0)\n"
        "print([name for name in ('scipy', 'imu_bench.offline.plans') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, '-c', script], capture_output=True, text=True)
    assert done.stdout == '[]\n', done.stdout + done.stderr
