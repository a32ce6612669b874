# SPDX-License-Identifier: Apache-2.0
"""The health check on recordings that nobody simulated."""

from imu_bench.offline import health
from imu_bench.offline.recordings import load_all, open_source, ReadOptions
import pytest

pytestmark = pytest.mark.data

BAD = ('warning', 'severe')
# the sensor's registers: 16384 counts per g, 131 counts per °/s
MPU6050 = ReadOptions(
    rate_hz=100.0, units='linear_acceleration=g/16384,angular_velocity=deg/s/131'
)
MPU9150 = ReadOptions(
    rate_hz=100.0,
    columns=','.join(
        f'{q}.{a}' for q in ('linear_acceleration', 'angular_velocity') for a in 'xyz'
    ),
    units='linear_acceleration=m/s^2,angular_velocity=rad/s',
)


def check(path, options=None):
    with open_source(path, options) as source:
        [recording] = load_all(source, source.select())
        return health.check(recording, problems=source.problems)


def bad(found):
    return {finding.code for finding in found.findings if finding.severity in BAD}


@pytest.mark.parametrize(
    'name',
    ['calibration data/example_data_tinit_calc.csv', 'results test data/imu_static_test.csv'],
)
def test_a_still_sensor_raises_no_alarm(shared_data, name):
    found = check(shared_data / 'mpu6050_static' / name, MPU6050)
    assert bad(found) == set()
    # this unit leaves its two lowest bits at zero
    assert found.resolution['linear_acceleration.x'].value == pytest.approx(
        4 * 9.80665 / 16384, rel=1e-6
    )


def test_one_turn_is_found_where_it_was(shared_data):
    found = check(
        shared_data / 'mpu6050_static' / 'results test data' / 'imu_90_x_rot.csv', MPU6050
    )
    # and the knocks of a hand that takes the sensor and lets it go, a single sample each
    assert bad(found) == {'motion', 'outliers'}
    [(begin, end)] = found.motion
    # the reference names rows 1500 to 2250 at 100 Hz
    assert begin == pytest.approx(15.0, abs=1.0)
    assert end == pytest.approx(22.5, abs=1.0)


def test_a_calibration_by_hand_moves_and_saturates(shared_data):
    path = shared_data / 'mpu6050_static' / 'calibration data' / 'example_data_calibration.csv'
    found = check(path, MPU6050)
    assert bad(found) == {'motion', 'saturated'}
    assert found.still == pytest.approx((0.0, 36.0), abs=1.0)
    [cut] = [f for f in found.findings if f.code == 'saturated']
    assert 'angular_velocity.x at -4.366 rad/s' in cut.text  # -32768 counts: 250 °/s


@pytest.mark.parametrize('unit', range(5))
def test_five_units_in_the_hand(shared_data, unit):
    found = check(shared_data / 'mpu9150_five_units' / f'imu{unit}.log', MPU9150)
    [motion] = [f for f in found.findings if f.code == 'motion']
    assert motion.severity == 'severe'
    assert 'saturated' not in bad(found)


@pytest.mark.parametrize('bag', ['test1.bag', 'test2.bag'])
def test_a_robot_drives(shared_data, bag):
    found = check(shared_data / 'rosbag1_husky_imu' / 'test' / bag)
    assert bad(found) == {'motion'}
    assert found.severity == 'severe'
    assert found.gap_count == 0
