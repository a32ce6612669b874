# SPDX-License-Identifier: Apache-2.0
"""Built messages are read back as what went in, also through the wire and rosbags."""

import math

from msg_conversions import building, cdr, covariance, reading
from msg_conversions.allan_layout import FIELDS, GIVEN, pack
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import get_typestore, Stores
from std_msgs.msg import Float64MultiArray

STORE = get_typestore(Stores.ROS2_JAZZY)
T0 = 1_790_000_000_123_456_789


def as_rosbags(message, name):
    """Return what rosbags makes of the bytes that rclpy puts on the wire."""
    return STORE.deserialize_cdr(serialize_message(message), name)


def test_imu_survives_the_wire_and_both_libraries():
    message = building.imu(
        T0,
        'imu_link',
        acceleration=np.array([1, 2, 3]),
        angular_velocity=np.array([0.1, 0.2, 0.3], dtype=np.float32),
        acceleration_covariance=covariance.diagonal(0.5),
    )
    for each in (message, as_rosbags(message, 'sensor_msgs/msg/Imu')):
        read = reading.imu([each])
        assert read.stamps.tolist() == [T0]
        assert read.acceleration.tolist() == [[1.0, 2.0, 3.0]]
        assert read.angular_velocity.tolist() == np.float32([[0.1, 0.2, 0.3]]).tolist()
        assert read.acceleration_covariance.tolist() == [0.25]
        assert read.frame_ids == ('imu_link',)
    decoded = cdr.decode_imu([serialize_message(message)])
    assert decoded.acceleration.tolist() == [[1.0, 2.0, 3.0]]
    assert message.orientation_covariance[0] == -1.0


def test_a_quantity_of_none_is_not_reported():
    message = building.imu(T0, 'acc', acceleration=(0.0, 0.0, 9.8))
    assert message.angular_velocity_covariance[0] == -1.0
    assert message.linear_acceleration_covariance[0] == 0.0


def test_magnetic_field_keeps_nan_for_a_missing_axis():
    message = building.magnetic_field(T0, 'mag', (2e-5, math.nan, 4e-5))
    read = reading.magnetic_field([as_rosbags(message, 'sensor_msgs/msg/MagneticField')])
    assert read.values[0, 0] == 2e-5
    assert math.isnan(read.values[0, 1])


def test_temperature_and_vector():
    warm = building.temperature(T0, 'imu_link', np.float32(21.5))
    assert reading.temperature([warm]).values.tolist() == [[21.5]]
    vector = building.vector3(T0, 'imu_link', (1, math.nan, 3))
    read = reading.vector3([as_rosbags(vector, 'geometry_msgs/msg/Vector3Stamped')])
    assert read.stamps.tolist() == [T0]
    assert np.array_equal(read.values, [[1.0, math.nan, 3.0]], equal_nan=True)


def curve(points, seed):
    rng = np.random.default_rng(seed)
    return {name: np.sort(rng.uniform(0.1, 10.0, points)) for name in GIVEN}


def test_allan_curves_survive_message_wire_and_rosbags():
    given = {'linear_acceleration.x': curve(5, 1), 'linear_acceleration.y': None}
    given['angular_velocity.z'] = curve(3, 2)
    message = building.allan_message(given, T0, T0 + 599_999_999_999)
    wire = deserialize_message(serialize_message(message), Float64MultiArray)
    for each in (message, wire, as_rosbags(message, 'std_msgs/msg/Float64MultiArray')):
        read = reading.allan_from_message(each)
        assert (read.start_ns, read.end_ns) == (T0, T0 + 599_999_999_999)
        assert set(read.curves) == {'linear_acceleration.x', 'angular_velocity.z'}
        for axis, table in read.curves.items():
            assert tuple(table) == FIELDS
            for name in GIVEN:
                assert np.array_equal(table[name], given[axis][name])
            assert np.array_equal(table['log10_tau'], np.log10(given[axis]['tau']))


def test_dimensions_follow_the_convention_of_multi_array():
    given = {f'axis{index}': curve(7, index) for index in range(6)}
    message = building.allan_message(given, 0, 1)
    sizes = [dimension.size for dimension in message.layout.dim]
    assert sizes == [6, len(FIELDS), 7]
    assert [dimension.stride for dimension in message.layout.dim] == [6 * 9 * 7, 9 * 7, 7]
    # element [axis 4][deviation][tau 2] by the formula of std_msgs/MultiArrayLayout.msg
    strides = [dimension.stride for dimension in message.layout.dim]
    element = message.data[strides[1] * 4 + strides[2] * FIELDS.index('deviation') + 2]
    assert element == given['axis4']['deviation'][2]


def test_no_curve_at_all_is_a_message_too():
    message = building.allan_message({'linear_acceleration.x': None}, 5, 6)
    assert reading.allan_from_message(message).curves == {}


def test_a_deviation_of_zero_has_no_logarithm_and_no_warning():
    flat = curve(2, 1) | {'deviation': [0.0, 1.0]}
    read = reading.allan_from_message(building.allan_message({'a': flat}, 0, 1))
    logs = read.curves['a']['log10_deviation']
    assert math.isnan(logs[0])
    assert logs[1] == 0.0


def test_fields_of_different_length_are_refused():
    with pytest.raises(ValueError, match='curve of a differ in length'):
        pack({'a': curve(2, 1) | {'low': [1.0]}}, 0, 1)


@pytest.mark.parametrize('label', ['tau', 'tau: start_ns=1', ''])
def test_another_array_is_not_taken_for_allan_curves(label):
    message = building.allan_message({'a': curve(2, 1)}, 0, 1)
    message.layout.dim[2].label = label
    with pytest.raises(ValueError, match='no Allan deviation array'):
        reading.allan_from_message(message)
    with pytest.raises(ValueError, match='no Allan deviation array'):
        reading.allan_from_message(Float64MultiArray())


def test_a_short_array_is_refused():
    message = building.allan_message({'a': curve(2, 1)}, 0, 1)
    message.data = message.data[:-1]
    with pytest.raises(ValueError, match='17 numbers'):
        reading.allan_from_message(message)


def test_diagnostics_are_text():
    status = building.diagnostic_status('a: b', 'warn', 'why', 'id', {'lost': 3, 'rate': 1.5})
    array = building.diagnostic_array(T0, [status])
    assert array.header.stamp.nanosec == T0 % 10**9
    assert array.status[0].level == b'\x01'
    assert {pair.key: pair.value for pair in status.values} == {'lost': '3', 'rate': '1.5'}
