# SPDX-License-Identifier: Apache-2.0
"""The loop closed, small: what goes into a sensor comes out of its analysis."""

from imu_bench import bench
from imu_bench.config.location import named_file
from imu_bench.metrology.estimate import Estimate
from imu_bench.simulation.chip import SensorSource
from imu_bench.simulation.clock import START_NS
from imu_bench.simulation.motion import Still
from imu_bench.simulation.scenario import load_scenario
from imu_bench.simulation.sensor_errors import Errors
from imu_bench.simulation.sensor_model import ErrorModel
import pytest

from benchmarks._closed_loop import Check, check, Coverage, coverage

SECONDS = 600


def recorded(source):
    return source.samples_until(START_NS + SECONDS * 10**9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('folder', 'name'),
    [
        ('machine_vibration', 'mpu9250'),
        ('machine_vibration', 'mti300'),
        ('vehicle_vibration', 'dut1'),
    ],
)
def test_sensors_of_the_benches_give_back_what_went_into_them(folder, name):
    config = bench.load_bench(named_file('benches', folder))
    (sensor,) = [one for one in config.sensors if one.name == name]
    checks = []
    for run in range(4):
        source = bench.simulate(sensor, load_scenario('still'), run=run).sources[0]
        checks += check(source, recorded(source))
    counted = coverage(one.row for one in checks)
    assert {'rate', 'N', 'B'} <= set(counted)
    assert all(one.acceptable for one in counted.values()), counted


def source_of(**errors):
    model = ErrorModel({'acceleration': Errors(**errors)}, 5)
    return SensorSource(Still(), model, 50.0, rate_error=1e-3)


def test_a_wrong_truth_is_noticed():
    loud, quiet = source_of(noise_density=1.1e-3), source_of(noise_density=1e-3)
    # what one sensor made, held against the other
    checks = [one for one in check(quiet, recorded(loud)) if one.parameter == 'N']
    assert len(checks) == 3
    assert not any(one.inside for one in checks)


@pytest.mark.slow
def test_what_is_defined_depends_on_the_sensor():
    def parameters(**errors):
        source = source_of(**errors)
        return {one.parameter for one in check(source, recorded(source))}

    assert parameters(noise_density=1e-3) == {'rate', 'no Q', 'N', 'no B', 'no K', 'bias'}
    slow = parameters(noise_density=1e-3, bias_instability=1e-4)
    assert slow == {'rate', 'no Q', 'N', 'B', 'no K'}
    assert parameters(noise_density=1e-3, high_pass=0.5) == {'rate', 'density'}
    assert parameters(noise_density=1e-3, resolution=0.1) == {'rate'}


def test_acceptance_is_by_chance_alone():
    assert Coverage(0, 1, 1).acceptable
    assert Coverage(90, 100, 100).acceptable
    assert not Coverage(80, 100, 100).acceptable
    unseen = Estimate.not_observable('m/s²', 'too short', high=2.0)
    assert Check('x', 'B', 1.0, unseen).inside
    assert not Check('x', 'B', 3.0, unseen).inside
    seen = Estimate(1.0, 0.9, 1.1, 'm/s²')
    rows = [Check('x', 'B', 1.05, seen).row, Check('y', 'B', 3.0, unseen).row]
    assert coverage(rows) == {'B': Coverage(inside=1, total=2, claimed=1)}
