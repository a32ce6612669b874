# SPDX-License-Identifier: Apache-2.0
"""
Whole blocks of stamped sensor messages to their bytes on the wire.

The counterpart of `msg_conversions.cdr`: everything that stays the same from message to
message is laid down once, and a block is that row repeated with stamps and numbers filled in.
"""

from __future__ import annotations

from collections.abc import Sequence

from msg_conversions import covariance, stamps
from msg_conversions.cdr import (
    IMU,
    IMU_ANGULAR_VELOCITY,
    IMU_ANGULAR_VELOCITY_COVARIANCE,
    IMU_LINEAR_ACCELERATION,
    IMU_LINEAR_ACCELERATION_COVARIANCE,
    IMU_ORIENTATION,
    IMU_ORIENTATION_COVARIANCE,
)
from msg_conversions.wire_layout import row_type, start_of_numbers
import numpy as np
import numpy.typing as npt


class Template:
    """
    Serialises blocks of one message type whose constant parts are known beforehand.

    Parameters
    ----------
    constant : array_like of float64, shape (k,)
        All numbers of the message; those that vary are overwritten in each block.

    Examples
    --------
    >>> from msg_conversions.cdr import TEMPERATURE, TEMPERATURE_VALUE, decode_stamped
    >>> template = Template('imu_link', [0.0, 0.01])
    >>> blob = template.encode([1_500_000_000], (TEMPERATURE_VALUE, [[21.5]]))[0]
    >>> decode_stamped([blob], TEMPERATURE).values.tolist()
    [[21.5, 0.01]]
    """

    def __init__(self, frame_id: str, constant: npt.ArrayLike) -> None:
        numbers = np.asarray(constant, dtype=np.float64)
        text = frame_id.encode() + b'\0'
        start = start_of_numbers(len(text), 8)
        size = start + 8 * numbers.size
        self._type = row_type('<', len(text), start, numbers.size, size)
        head = bytes([0, 1, 0, 0]) + bytes(8) + len(text).to_bytes(4, 'little') + text
        # rows of bytes: repeating a structured array would not copy what lies between its fields
        self._row = np.frombuffer(bytearray(head.ljust(size, b'\0')), dtype=np.uint8)
        self._row.view(self._type)['values'] = numbers

    def encode(
        self, stamps_ns: npt.ArrayLike, *columns: tuple[slice, npt.ArrayLike | None]
    ) -> list[bytes]:
        """
        Return one serialised message per stamp, little-endian XCDR1.

        Parameters and errors as `rows`.
        """
        table = self.rows(stamps_ns, *columns)
        joined, size = table.tobytes(), self._type.itemsize
        return [joined[edge : edge + size] for edge in range(0, len(joined), size)]

    def rows(
        self, stamps_ns: npt.ArrayLike, *columns: tuple[slice, npt.ArrayLike | None]
    ) -> npt.NDArray[np.uint8]:
        """
        Return serialised messages as the rows of one array, shape (n, bytes): for bags.

        Parameters
        ----------
        *columns : (slice, array_like of float64, shape (n, width), or None)
            Which numbers vary, and their values; None leaves the constant ones.

        Raises
        ------
        ValueError
            If a stamp does not fit the message.
        """
        sec, nanosec = stamps.split(stamps_ns)
        table = np.tile(self._row, sec.size).view(self._type)
        table['sec'], table['nanosec'] = sec, nanosec
        for part, values in columns:
            if values is not None:
                table['values'][:, part] = values
        return table.view(np.uint8).reshape(-1, self._type.itemsize)


class ImuTemplate(Template):
    """
    Serialises blocks of sensor_msgs/Imu.

    Parameters
    ----------
    acceleration_covariance, angular_velocity_covariance, orientation_covariance : 9 float each
        By `msg_conversions.covariance`; NOT_REPORTED for a quantity the sensor does not have.

    Examples
    --------
    >>> template = ImuTemplate('imu_link', angular_velocity_covariance=covariance.UNKNOWN)
    >>> blobs = template.encode_imu([0, 1], angular_velocity=[[0, 0, 1], [0, 0, 2]])
    >>> [len(blob) for blob in blobs]
    [324, 324]
    """

    def __init__(
        self,
        frame_id: str,
        *,
        acceleration_covariance: Sequence[float] = covariance.NOT_REPORTED,
        angular_velocity_covariance: Sequence[float] = covariance.NOT_REPORTED,
        orientation_covariance: Sequence[float] = covariance.NOT_REPORTED,
    ) -> None:
        constant = np.zeros(IMU)
        # a quaternion is a rotation also where nobody reports it
        constant[IMU_ORIENTATION] = (0.0, 0.0, 0.0, 1.0)
        constant[IMU_ORIENTATION_COVARIANCE] = orientation_covariance
        constant[IMU_ANGULAR_VELOCITY_COVARIANCE] = angular_velocity_covariance
        constant[IMU_LINEAR_ACCELERATION_COVARIANCE] = acceleration_covariance
        super().__init__(frame_id, constant)

    def encode_imu(
        self,
        stamps_ns: npt.ArrayLike,
        acceleration: npt.ArrayLike | None = None,
        angular_velocity: npt.ArrayLike | None = None,
        orientation: npt.ArrayLike | None = None,
    ) -> list[bytes]:
        """Return one serialised sensor_msgs/Imu per stamp."""
        columns = self._imu(acceleration, angular_velocity)
        return self.encode(stamps_ns, *columns, (IMU_ORIENTATION, orientation))

    def imu_rows(
        self,
        stamps_ns: npt.ArrayLike,
        acceleration: npt.ArrayLike | None = None,
        angular_velocity: npt.ArrayLike | None = None,
        orientation: npt.ArrayLike | None = None,
    ) -> npt.NDArray[np.uint8]:
        """Return serialised sensor_msgs/Imu as rows, shape (n, bytes); see `encode_imu`."""
        columns = self._imu(acceleration, angular_velocity)
        return self.rows(stamps_ns, *columns, (IMU_ORIENTATION, orientation))

    @staticmethod
    def _imu(
        acceleration: npt.ArrayLike | None, angular_velocity: npt.ArrayLike | None
    ) -> tuple[tuple[slice, npt.ArrayLike | None], ...]:
        return (
            (IMU_LINEAR_ACCELERATION, acceleration),
            (IMU_ANGULAR_VELOCITY, angular_velocity),
        )
