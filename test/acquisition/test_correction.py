# SPDX-License-Identifier: Apache-2.0
"""A calibration is applied to what leaves the acquisition, and to nothing else."""

from imu_bench import bench
from imu_bench.acquisition.correction import correction
from imu_bench.bus.clock import SystemClock
from imu_bench.config import Affine, sensor_from_parameters
from imu_bench.errors import ConfigError
from imu_bench.samples import Samples
from imu_bench.simulation.clock import SimulatedClock
import numpy as np
import pytest

GIVEN = {
    'driver': 'generic',
    'backend': 'emulated',
    'rate_hz': 100.0,
    'simulation': {'acceleration': {'bias': ['0.5 m/s²', '-0.2 m/s²', '0.1 m/s²']}},
}
CALIBRATION = {
    'acceleration': {
        'bias': ['0.5 m/s²', '-0.2 m/s²', '0.1 m/s²'],
        'matrix': {'z': ['0', '0.01', '1.02']},
    }
}


def configured(**more):
    return sensor_from_parameters('chip', {**GIVEN, **more}, settings_of=bench.settings_of)


def drained(config):
    clock = SimulatedClock()
    acquisition = bench.build(config, clock)
    acquisition.prepare()
    acquisition.advance(clock.now_ns() + 1_000_000_000)
    runs = acquisition.drain()
    acquisition.finish()
    return Samples.concatenate(runs)


def test_samples_are_corrected_as_they_are_drained():
    raw, true = drained(configured()), drained(configured(calibration=CALIBRATION))
    np.testing.assert_allclose(raw.acceleration[0], [0.5, -0.2, 9.90665], atol=1e-9)
    np.testing.assert_allclose(true.acceleration[0], [0.0, 0.0, 1.02 * 9.80665], atol=1e-9)


def test_nothing_is_corrected_by_default():
    assert configured().calibration == {}
    assert correction({}) is None


def test_missing_axes_stay_missing():
    unity = ((1.0, 0.5, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    correct = correction({'acceleration': Affine((1.0, 0.0, 0.0), unity)})
    run = Samples(stamps=[0], acceleration=[[3.0, np.nan, np.nan]], temperature=[20.0])
    found = correct(run)
    np.testing.assert_equal(found.acceleration, [[2.0, np.nan, np.nan]])
    assert found.temperature.tolist() == [20.0]


def test_quantities_that_are_not_there_are_no_problem():
    correct = correction({'magnetic_field': Affine((1e-6,) * 3, tuple(map(tuple, np.eye(3))))})
    run = Samples(stamps=[0], acceleration=[[0.0, 0.0, 9.8]])
    assert correct(run) is run


@pytest.mark.parametrize(
    ('calibration', 'text'),
    [
        ({'acceleration': {'matrix': {'x': '1.0'}}}, r'matrix\.x: one value is no row'),
        (
            {'acceleration': {'matrix': {'x': ['9.8', '0', '0']}}},
            r'matrix\.x: 9\.8, 0, 0 is no correction',
        ),
        ({'acceleration': {'bias': '1 furlong'}}, "unknown unit 'furlong'"),
        ({'acceleration': {'bias': 1.0}}, r'1\.0 has no unit'),
        ({'speed': {'bias': '1 m/s'}}, r'calibration\.speed\.bias: unknown'),
    ],
)
def test_a_calibration_that_makes_no_sense_is_refused(calibration, text):
    with pytest.raises(ConfigError, match=text):
        configured(calibration=calibration)


def test_the_clock_of_the_computer_is_the_default():
    acquisition = bench.build(configured(calibration=CALIBRATION), SystemClock())
    assert acquisition.drain() == []
