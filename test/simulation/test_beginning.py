# SPDX-License-Identifier: Apache-2.0
"""A scenario that begins when its sensors are told."""

from imu_bench import bench
from imu_bench.config import sensor_from_parameters
from imu_bench.config.beginning import Beginning
from imu_bench.simulation.clock import SimulatedClock
from imu_bench.simulation.motion import Mounted
from imu_bench.simulation.scenario import load_scenario
from imu_bench.simulation.world import Later
import numpy as np
import pytest

START_NS = 1_000_000_000
LIFT = load_scenario('lift_ride')


def later(scenario, at_s):
    return Later(scenario.motion, scenario.still, START_NS, Beginning(at_s))


@pytest.mark.parametrize(
    'name', ['lift_ride', 'engine_idle', 'tilt_steps', 'heat_to_80', 'random']
)
def test_afterwards_it_is_the_motion_itself(name):
    scenario = load_scenario(name)
    moved, t = later(scenario, 6.0), np.arange(0.0, 60.0, 0.01)
    for quantity in ('specific_force', 'angular_velocity', 'magnetic_field', 'temperature'):
        wanted = getattr(scenario.motion, quantity)(t)
        np.testing.assert_allclose(getattr(moved, quantity)(t + 5.0), wanted, atol=1e-9)


def test_before_that_nothing_moves():
    engine = load_scenario('engine_idle')
    moved = later(engine, 6.0)
    t = np.arange(0.0, 10.0, 0.01)
    force = moved.specific_force(t)
    still = engine.still.specific_force(t)
    assert np.array_equal(force[t < 4.999], np.broadcast_to(still, force[t < 4.999].shape))
    assert np.ptp(force[t > 5.5], axis=0).min() > 0.5
    assert np.array_equal(moved.specific_force(t[:100]), still)


def test_the_chip_warms_up_from_when_it_is_switched_on():
    mounted = Mounted(later(LIFT, 1e10), np.eye(3), heating_k=2.0, warm_up_s=10.0)
    assert mounted.temperature(np.array([0.0, 100.0])) == pytest.approx([25.0, 27.0], abs=1e-3)


SCENARIO = """\
motions:
  - tilt_steps: {step: "0.58139 °", steps: 1, dwell: "2 s", move: "0.5 s"}
"""


@pytest.mark.parametrize('driver', ['generic', 'scl3300'])
def test_a_running_sensor_is_told(driver, tmp_path):
    clock = SimulatedClock()
    path = tmp_path / 'one_step.yaml'
    path.write_text(SCENARIO, encoding='utf-8')
    given = {'generic': {'rate_hz': 100.0, 'simulation.acceleration.noise_density': '1 µg/√Hz'}}
    simulation = {'simulation.scenario': str(path), 'simulation.begin': 1e10}
    config = sensor_from_parameters(
        'a', {'driver': driver, 'backend': 'emulated', **simulation, **given.get(driver, {})},
        settings_of=bench.settings_of,
    )  # fmt: skip
    beginning = Beginning(config.simulation['begin'])
    acquisition = bench.build(config, clock, beginning=beginning)
    seen = []
    for second in range(8):
        if second == 3:
            beginning.at_s = clock.now_ns() * 1e-9 + 1.0
        acquisition.advance(clock.now_ns() + 1_000_000_000)
        runs = [run for run in acquisition.drain() if run.acceleration is not None]
        seen.append(np.mean(np.concatenate([run.acceleration[:, 0] for run in runs])))
    acquisition.finish()
    acquisition.close()
    # it begins at 4 s, is raised from 6 s to 6.5 s, and stands by 0.58139° higher until 8.5 s
    assert np.ptp(seen[1:6]) < 0.02
    assert seen[7] - np.mean(seen[1:6]) == pytest.approx(0.0995, abs=0.005)
