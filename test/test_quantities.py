# SPDX-License-Identifier: Apache-2.0
"""The one table of quantities: whoever carries samples carries all that it names."""

from dataclasses import fields

from imu_bench.nodes.topic_names import SUFFIXES
from imu_bench.offline.recordings.columns import recognise
from imu_bench.samples import Samples
from msg_conversions.encoding import SensorEncoder
from msg_conversions.quantities import QUANTITIES
import numpy as np
from rosbags.typesys import get_typestore, Stores

STORE = get_typestore(Stores.ROS2_JAZZY)


def test_samples_have_a_column_for_every_quantity():
    table = {quantity.field for quantity in QUANTITIES}
    assert {field.name for field in fields(Samples)} - {'stamps'} == table


def test_every_topic_is_recorded():
    assert {quantity.topic for quantity in QUANTITIES} <= set(SUFFIXES)


def test_a_text_table_names_every_component():
    for quantity in QUANTITIES:
        for column in quantity.columns:
            assert recognise(column)[0] == column


def test_what_is_encoded_is_read_by_the_message_definitions_of_ros():
    """Distinct numbers, so that no component can stand at the place of another."""
    for quantity in QUANTITIES:
        values = np.arange(1.0, 1.0 + 2 * len(quantity.columns)).reshape(2, *quantity.shape)
        encoder = SensorEncoder('chip_link', {})
        rows = encoder.rows(np.array([0, 1_500_000_000]), {quantity.field: values})
        message = STORE.deserialize_cdr(rows[1].tobytes(), quantity.message.type)
        assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 500_000_000)
        assert message.header.frame_id == 'chip_link'
        found = getattr(message, quantity.name, None)
        found = message.vector if found is None else found
        if quantity.components:
            found = [getattr(found, component) for component in quantity.components]
        assert np.array_equal(found, values[1])


def test_what_a_message_does_not_carry_it_declares_as_not_reported():
    encoder = SensorEncoder('chip_link', {'angular_velocity': (0.25,) * 9})
    columns = {'angular_velocity': np.ones((1, 3))}
    message = STORE.deserialize_cdr(
        encoder.rows(np.array([0]), columns)[0].tobytes(), 'sensor_msgs/msg/Imu'
    )
    assert message.angular_velocity_covariance.tolist() == [0.25] * 9
    assert message.linear_acceleration_covariance[0] == -1.0
    assert message.orientation_covariance[0] == -1.0
    assert message.orientation.w == 1.0
