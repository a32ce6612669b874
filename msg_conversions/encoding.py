# SPDX-License-Identifier: Apache-2.0
"""Columns of samples as blocks of the messages of a sensor's topics."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from msg_conversions import covariance
from msg_conversions.cdr import IMU as IMU_NUMBERS
from msg_conversions.cdr import IMU_ORIENTATION
from msg_conversions.quantities import IMU, IMU_QUANTITIES, ORIENTATION, QUANTITIES, TEMPERATURE
from msg_conversions.templates import Template
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
