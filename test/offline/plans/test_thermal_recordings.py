# SPDX-License-Identifier: Apache-2.0
"""
The thermal plan on recordings that nobody here made: none of them has a thermometer.

So the refusal is seen on all of them, and on the real noise of a still MPU-6050 that a heat
which never was leaves no coefficient, and one that is added comes out.
"""

from dataclasses import replace

from imu_bench.errors import RecordingError
from imu_bench.offline.plans.thermal import Thermal
from imu_bench.offline.recordings import load, open_source, ReadOptions
import numpy as np
import pytest

pytestmark = pytest.mark.data

MPU6050 = 'linear_acceleration=g/16384,angular_velocity=deg/s/131'
STILL = 'mpu6050_static/calibration data/example_data_tinit_calc.csv'
RECORDINGS = [
    (STILL, ReadOptions(rate_hz=100.0, units=MPU6050)),
    ('rosbag1_husky_imu/test/test1.bag', ReadOptions()),
    (
        'mpu9150_five_units/imu0.log',
        ReadOptions(rate_hz=100.0, columns='ax,ay,az,wx,wy,wz', units='SI'),
    ),
]


def first(path, options):
    source = open_source(str(path), options)
    return load(source, next(t.name for t in source.topics if t.is_imu))


@pytest.mark.parametrize(('path', 'options'), RECORDINGS, ids=lambda case: str(case)[:12])
def test_recordings_without_a_thermometer_are_refused_in_one_line(shared_data, path, options):
    recording = first(shared_data / path, options)
    with pytest.raises(RecordingError, match='no temperature in it: record the topic') as said:
        Thermal({}).measure(recording.source, [recording])
    assert '\n' not in str(said.value)


def test_noise_of_a_real_sensor_is_not_taken_for_temperature(shared_data):
    """Seven and a half minutes of a still MPU-6050, its wandering bias included."""
    recording = first(shared_data / STILL, RECORDINGS[0][1])
    samples = recording.samples
    when = (samples.stamps - samples.stamps[0]) * 1e-9
    celsius = np.interp(when, [60.0, 180.0, 270.0, 390.0], [23.0, 80.0, 80.0, 23.0])
    injected = {'linear_acceleration': 1e-3, 'angular_velocity': 5e-5}
    heated = replace(
        samples,
        acceleration=samples.acceleration + injected['linear_acceleration'] * celsius[:, None],
        angular_velocity=samples.angular_velocity
        + injected['angular_velocity'] * celsius[:, None],
        temperature=celsius,
    )
    plan = Thermal({})
    one = plan.measure(recording.source, [replace(recording, samples=heated)])[0]
    assert len(one.axes) == 6
    for name, found in one.axes.items():
        truth = injected[name.partition('.')[0]]
        assert found.coefficient.low < truth < found.coefficient.high
        # and says something: a tenth of it would have been seen
        assert found.coefficient.high - found.coefficient.low < 0.2 * truth
        assert found.hysteresis.low < 0.0 < found.hysteresis.high
