# SPDX-License-Identifier: Apache-2.0
"""
The one table of quantities: what a sensor measures, and where a message carries it.

Whoever reads, writes, encodes or shows samples takes names, units, components, topics and the
layout of messages from here.
"""

from __future__ import annotations

from typing import NamedTuple

from msg_conversions import cdr

AXES = ('x', 'y', 'z')
_NOWHERE = slice(0, 0)

IMU = 'imu/data_raw'
ORIENTATION_TOPIC = 'imu/data'
MAGNETIC_FIELD_TOPIC = 'imu/mag'
TEMPERATURE_TOPIC = 'temperature'
INCLINATION_TOPIC = 'inclination'


class Message(NamedTuple):
    """A type of message: its name in ROS 2, and how many float64 follow its header."""

    type: str
    numbers: int


class Quantity(NamedTuple):
    """A measured quantity."""

    name: str  # in results, CSV columns and messages
    field: str  # of `imu_bench.samples.Samples`
    unit: str  # SI, of its values; of the temperature °C
    components: tuple[str, ...]  # empty for a scalar
    title: str  # what it is called over a table or a figure
    sensor: str  # what measures it
    topic: str  # last part of the name (REP-145)
    message: Message  # what it is published as
    # values, covariance: which of the message's numbers they are
    values: slice
    covariance: slice = _NOWHERE

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of its columns in tables and results."""
        return tuple(f'{self.name}.{one}' for one in self.components) or (self.name,)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of one value."""
        return (len(self.components),) if self.components else ()


_IMU = Message('sensor_msgs/msg/Imu', cdr.IMU)

LINEAR_ACCELERATION = Quantity(
    'linear_acceleration', 'acceleration', 'm/s²', AXES, 'Acceleration', 'accelerometer',
    IMU, _IMU, cdr.IMU_LINEAR_ACCELERATION, cdr.IMU_LINEAR_ACCELERATION_COVARIANCE,
)  # fmt: skip
ANGULAR_VELOCITY = Quantity(
    'angular_velocity', 'angular_velocity', 'rad/s', AXES, 'Angular velocity', 'gyroscope',
    IMU, _IMU, cdr.IMU_ANGULAR_VELOCITY, cdr.IMU_ANGULAR_VELOCITY_COVARIANCE,
)  # fmt: skip
MAGNETIC_FIELD = Quantity(
    'magnetic_field', 'magnetic_field', 'T', AXES, 'Magnetic field', 'magnetometer',
    MAGNETIC_FIELD_TOPIC, Message('sensor_msgs/msg/MagneticField', cdr.MAGNETIC_FIELD),
    cdr.MAGNETIC_FIELD_VECTOR, cdr.MAGNETIC_FIELD_COVARIANCE,
)  # fmt: skip
TEMPERATURE = Quantity(
    'temperature', 'temperature', '°C', (), 'Temperature', 'thermometer',
    TEMPERATURE_TOPIC, Message('sensor_msgs/msg/Temperature', cdr.TEMPERATURE),
    cdr.TEMPERATURE_VALUE, cdr.TEMPERATURE_VARIANCE,
)  # fmt: skip
INCLINATION = Quantity(
    'inclination', 'inclination', 'rad', AXES, 'Inclination', 'inclinometer',
    INCLINATION_TOPIC, Message('geometry_msgs/msg/Vector3Stamped', cdr.VECTOR3_STAMPED),
    cdr.VECTOR3_VECTOR,
)  # fmt: skip
ORIENTATION = Quantity(
    'orientation', 'orientation', '1', (*AXES, 'w'), 'Orientation', 'sensor fusion',
    ORIENTATION_TOPIC, _IMU, cdr.IMU_ORIENTATION, cdr.IMU_ORIENTATION_COVARIANCE,
)  # fmt: skip

IMU_QUANTITIES = (LINEAR_ACCELERATION, ANGULAR_VELOCITY)
QUANTITIES = (*IMU_QUANTITIES, MAGNETIC_FIELD, TEMPERATURE, INCLINATION, ORIENTATION)
BY_NAME = {quantity.name: quantity for quantity in QUANTITIES}
BY_FIELD = {quantity.field: quantity for quantity in QUANTITIES}
TYPES = {quantity.topic: quantity.message.type for quantity in QUANTITIES}
"""Type of message by the last part of a topic's name."""
