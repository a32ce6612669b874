# SPDX-License-Identifier: Apache-2.0
"""
Arrays and numbers to message objects; the only module here that needs ROS.

Everything is converted with float(): rclpy of Jazzy publishes an int or a numpy.float32 in a
float64 field as garbage without a word, unless ROS_PYTHON_CHECK_FIELDS is set.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Vector3, Vector3Stamped
from msg_conversions import covariance, stamps
from msg_conversions.allan_layout import pack
import numpy.typing as npt
from sensor_msgs.msg import Imu, MagneticField, Temperature
from std_msgs.msg import Float64MultiArray, Header, MultiArrayDimension, MultiArrayLayout

LEVELS = {
    'ok': DiagnosticStatus.OK,
    'warn': DiagnosticStatus.WARN,
    'error': DiagnosticStatus.ERROR,
    'stale': DiagnosticStatus.STALE,
}


def time(stamp_ns: int) -> Time:
    """
    Return builtin_interfaces/Time of a stamp in nanoseconds since the epoch.

    Examples
    --------
    >>> time(1_500_000_000)
    builtin_interfaces.msg.Time(sec=1, nanosec=500000000)
    """
    sec, nanosec = stamps.split([stamp_ns])
    return Time(sec=int(sec[0]), nanosec=int(nanosec[0]))


def header(stamp_ns: int, frame_id: str) -> Header:
    """Return std_msgs/Header."""
    return Header(stamp=time(stamp_ns), frame_id=frame_id)


def imu(
    stamp_ns: int,
    frame_id: str,
    acceleration: Sequence[float] | None = None,
    angular_velocity: Sequence[float] | None = None,
    *,
    acceleration_covariance: Sequence[float] = covariance.UNKNOWN,
    angular_velocity_covariance: Sequence[float] = covariance.UNKNOWN,
) -> Imu:
    """
    Return sensor_msgs/Imu without orientation; a quantity of None is not reported (REP-145).

    Parameters
    ----------
    stamp_ns : int
        Time of measurement.
    acceleration, angular_velocity : sequence of 3 float, optional
        In m/s² and rad/s.
    acceleration_covariance, angular_velocity_covariance : sequence of 9 float
        By `msg_conversions.covariance`.

    Examples
    --------
    >>> message = imu(0, 'imu_link', acceleration=(0, 0, 9.8))
    >>> message.linear_acceleration.z, float(message.angular_velocity_covariance[0])
    (9.8, -1.0)
    """
    message = Imu(header=header(stamp_ns, frame_id))
    message.orientation_covariance = covariance.NOT_REPORTED
    message.linear_acceleration_covariance = covariance.NOT_REPORTED
    message.angular_velocity_covariance = covariance.NOT_REPORTED
    if acceleration is not None:
        message.linear_acceleration = _vector(acceleration)
        message.linear_acceleration_covariance = _floats(acceleration_covariance)
    if angular_velocity is not None:
        message.angular_velocity = _vector(angular_velocity)
        message.angular_velocity_covariance = _floats(angular_velocity_covariance)
    return message


def magnetic_field(
    stamp_ns: int,
    frame_id: str,
    field: Sequence[float],
    field_covariance: Sequence[float] = covariance.UNKNOWN,
) -> MagneticField:
    """Return sensor_msgs/MagneticField; `field` in tesla, NaN for an axis that is missing."""
    return MagneticField(
        header=header(stamp_ns, frame_id),
        magnetic_field=_vector(field),
        magnetic_field_covariance=_floats(field_covariance),
    )


def temperature(
    stamp_ns: int, frame_id: str, celsius: float, variance: float = 0.0
) -> Temperature:
    """Return sensor_msgs/Temperature in °C; a variance of 0 is unknown."""
    return Temperature(
        header=header(stamp_ns, frame_id), temperature=float(celsius), variance=float(variance)
    )


def vector3(stamp_ns: int, frame_id: str, values: Sequence[float]) -> Vector3Stamped:
    """Return geometry_msgs/Vector3Stamped; NaN for a component that is not known."""
    return Vector3Stamped(header=header(stamp_ns, frame_id), vector=_vector(values))


def allan_message(
    curves: Mapping[str, Mapping[str, npt.ArrayLike] | None], start_ns: int, end_ns: int
) -> Float64MultiArray:
    """
    Return the curves of all axes as std_msgs/Float64MultiArray.

    The layout is that of `msg_conversions.allan_layout`, where the parameters are described;
    `msg_conversions.reading.allan_from_message` is the way back.

    Raises
    ------
    ValueError
        If the fields of a curve differ in length.
    """
    packed = pack(curves, start_ns, end_ns)
    dimensions = [
        MultiArrayDimension(label=label, size=size, stride=stride)
        for label, size, stride in packed.dimensions
    ]
    return Float64MultiArray(
        layout=MultiArrayLayout(dim=dimensions, data_offset=0), data=packed.data.tolist()
    )


def diagnostic_status(
    name: str,
    level: str,
    message: str,
    hardware_id: str,
    values: Mapping[str, object],
) -> DiagnosticStatus:
    """
    Return diagnostic_msgs/DiagnosticStatus.

    Parameters
    ----------
    name : str
        Such as 'mpu9250: acquisition'.
    message : str
        One line for people.
    hardware_id : str
        Which device this is about.
    values : mapping of str to object
        Converted with str().

    Examples
    --------
    >>> status = diagnostic_status('mpu9250: acquisition', 'ok', 'fine', 'i2c', {'lost': 0})
    >>> status.level == DiagnosticStatus.OK, status.values[0].key, status.values[0].value
    (True, 'lost', '0')
    """
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return DiagnosticStatus(
        name=name, level=LEVELS[level], message=message, hardware_id=hardware_id, values=pairs
    )


def diagnostic_array(stamp_ns: int, statuses: Iterable[DiagnosticStatus]) -> DiagnosticArray:
    """Return diagnostic_msgs/DiagnosticArray."""
    return DiagnosticArray(header=header(stamp_ns, ''), status=list(statuses))


def _vector(values: Sequence[float]) -> Vector3:
    x, y, z = values
    return Vector3(x=float(x), y=float(y), z=float(z))


def _floats(values: Sequence[float]) -> list[Any]:
    return [float(value) for value in values]
