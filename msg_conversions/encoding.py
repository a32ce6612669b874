# SPDX-License-Identifier: Apache-2.0
"""
Samples to the bytes of the messages of a sensor's topics, whole blocks at a time.

The counterpart of `msg_conversions.cdr`: everything that stays the same from message to
message is laid down once, and a block is that row repeated with stamps and numbers filled in.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from msg_conversions import covariance, stamps
from msg_conversions.cdr import IMU as IMU_NUMBERS
from msg_conversions.cdr import (
    IMU_ANGULAR_VELOCITY,
    IMU_ANGULAR_VELOCITY_COVARIANCE,
    IMU_LINEAR_ACCELERATION,
    IMU_LINEAR_ACCELERATION_COVARIANCE,
    IMU_ORIENTATION,
    IMU_ORIENTATION_COVARIANCE,
)
from msg_conversions.quantities import IMU, IMU_QUANTITIES, ORIENTATION, QUANTITIES, TEMPERATURE
from msg_conversions.wire_layout import row_type, start_of_numbers
import numpy as np
import numpy.typing as npt

Values = npt.NDArray[np.float64]
Rows = npt.NDArray[np.uint8]


class SensorEncoder:
    """
    Turns samples into messages, a block at a time: no message object is ever made.

    Of the temperature, which changes slowly and comes with every sample, the newest of each run
    becomes a message.

    Parameters
    ----------
    covariances : mapping of str to sequence of float
        By quantity, in the order of its message (`msg_conversions.covariance`); unknown where
        there is none.

    Examples
    --------
    >>> encoder = SensorEncoder('imu_link', {'linear_acceleration': covariance.diagonal(0.1)})
    >>> columns = {'acceleration': np.ones((2, 3)), 'temperature': np.array([20.0, 21.0])}
    >>> [(topic, rows.shape) for topic, _, rows in encoder.encode(np.array([0, 10]), columns)]
    [('imu/data_raw', (2, 324)), ('temperature', (1, 44))]
    """

    def __init__(self, frame_id: str, covariances: Mapping[str, Sequence[float]]) -> None:
        self._frame_id, self._covariances = frame_id, covariances
        self._templates: dict[tuple[str, ...], Template] = {}

    def encode(
        self, stamps: npt.NDArray[np.int64], columns: Mapping[str, Values]
    ) -> Iterator[tuple[str, npt.NDArray[np.int64], Rows]]:
        """
        Yield topic, stamps and serialised messages, shape (n, bytes), of everything in a run.

        Parameters
        ----------
        stamps : ndarray of int64, shape (n,)
            In ns.
        columns : mapping of str to ndarray, shape (n, components) or (n,)
            By the field of the quantity, in SI.

        Raises
        ------
        ValueError
            If a stamp does not fit a message.
        """
        if not len(stamps):
            return
        motion = {q.field: columns[q.field] for q in IMU_QUANTITIES if q.field in columns}
        if motion:
            yield IMU, stamps, self.rows(stamps, motion)
        for quantity in QUANTITIES:
            if quantity not in IMU_QUANTITIES and quantity.field in columns:
                newest = slice(-1, None) if quantity is TEMPERATURE else slice(None)
                own = {quantity.field: columns[quantity.field][newest]}
                if quantity is ORIENTATION:
                    own |= motion
                yield quantity.topic, stamps[newest], self.rows(stamps[newest], own)

    def rows(self, stamps: npt.NDArray[np.int64], columns: Mapping[str, Values]) -> Rows:
        """
        Return messages of one type that carry all of these columns; parameters as `encode`.

        Examples
        --------
        >>> SensorEncoder('link', {}).rows(np.array([0]), {'temperature': np.array([20.0])}).shape
        (1, 44)
        """
        there = [quantity for quantity in QUANTITIES if quantity.field in columns]
        key = tuple(quantity.name for quantity in there)
        if key not in self._templates:
            self._templates[key] = self._template(key)
        parts = [(q.values, columns[q.field].reshape(len(stamps), -1)) for q in there]
        return self._templates[key].rows(stamps, *parts)

    def _template(self, names: Sequence[str]) -> Template:
        message = next(q.message for q in QUANTITIES if q.name in names)
        constant = np.zeros(message.numbers)
        if message.numbers == IMU_NUMBERS:
            # a quaternion is a rotation also where nobody reports it
            constant[IMU_ORIENTATION] = (0.0, 0.0, 0.0, 1.0)
        for quantity in QUANTITIES:
            if quantity.message == message:
                size = quantity.covariance.stop - quantity.covariance.start
                known = self._covariances.get(quantity.name, covariance.UNKNOWN[:size])
                there = quantity.name in names
                constant[quantity.covariance] = known if there else covariance.NOT_REPORTED
        return Template(self._frame_id, constant)


def independent(stddevs: Mapping[str, float]) -> dict[str, tuple[float, ...]]:
    """
    Return the covariances of quantities whose axes are independent, by their standard deviation.

    Examples
    --------
    >>> independent({'angular_velocity': 0.5})['angular_velocity'][:4]
    (0.25, 0.0, 0.0, 0.0)
    """
    return {name: covariance.diagonal(stddev) for name, stddev in stddevs.items()}


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
        constant = np.zeros(IMU_NUMBERS)
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
