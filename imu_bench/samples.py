# SPDX-License-Identifier: Apache-2.0
"""The one shape that flows through the bench: a run of consecutive samples of one sensor."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Any

from imu_bench.errors import DataError
from msg_conversions.quantities import QUANTITIES
import numpy as np
import numpy.typing as npt

_FIELDS = tuple(quantity.field for quantity in QUANTITIES)


@dataclass(frozen=True, eq=False)
class Samples:
    """
    A run of consecutive samples of one sensor; immutable.

    A FIFO burst is a run of 30, a polled reading a run of 1, a whole recording
    a run of 50 million.  Fields the sensor does not have are None.

    Attributes
    ----------
    stamps : ndarray of int64, shape (n,)
        Time of measurement in nanoseconds.
    acceleration : ndarray of float64, shape (n, 3), or None
        Specific force in m/s²: +g on z at rest with z up (REP-145).
    angular_velocity : ndarray of float64, shape (n, 3), or None
        In rad/s.
    magnetic_field : ndarray of float64, shape (n, 3), or None
        In tesla.
    temperature : ndarray of float64, shape (n,), or None
        In degrees Celsius.
    inclination : ndarray of float64, shape (n, 3), or None
        Angle of each axis above the horizontal plane in rad, as an inclinometer computes it.
    orientation : ndarray of float64, shape (n, 4), or None
        Quaternion x, y, z, w that turns vectors of the sensor's frame into the world's, as a
        sensor with fusion of its own computes it (order of geometry_msgs/Quaternion).

    Examples
    --------
    >>> run = Samples(stamps=[0, 10_000_000], acceleration=[[0, 0, 9.8], [0, 0, 9.9]])
    >>> len(run), run.acceleration.shape, run.angular_velocity is None
    (2, (2, 3), True)
    >>> len(run[1:])
    1
    """

    stamps: npt.NDArray[np.int64]
    acceleration: npt.NDArray[np.float64] | None = None
    angular_velocity: npt.NDArray[np.float64] | None = None
    magnetic_field: npt.NDArray[np.float64] | None = None
    temperature: npt.NDArray[np.float64] | None = None
    inclination: npt.NDArray[np.float64] | None = None
    orientation: npt.NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        columns = self.__dict__
        stamps = _frozen(np.asarray(self.stamps, dtype=np.int64))
        if stamps.ndim != 1:
            raise DataError(f'stamps must have shape (n,), got {stamps.shape}')
        columns['stamps'] = stamps
        n = stamps.shape[0]
        for quantity in QUANTITIES:
            name = quantity.field
            if columns[name] is not None:
                columns[name] = _accepted(name, columns[name], (n, *quantity.shape))

    def __len__(self) -> int:
        return len(self.stamps)

    def __getitem__(self, part: slice) -> Samples:
        """Return the samples of a slice; the arrays are views, nothing is copied."""
        if not isinstance(part, slice):
            raise TypeError(f'Samples are sliced, not indexed: got {part!r}')
        # slices of what was checked need no check, and stay read-only
        run = object.__new__(Samples)
        run.__dict__.update(
            (name, None if column is None else column[part])
            for name, column in self.__dict__.items()
        )
        return run

    @property
    def columns(self) -> dict[str, npt.NDArray[np.float64]]:
        """The columns that it has beside the stamps, by their names."""
        every = self.__dict__
        return {name: every[name] for name in _FIELDS if every[name] is not None}

    def restamped(self, stamps: npt.NDArray[np.int64]) -> Samples:
        """
        Return the same values with other stamps; cheap, for it happens with every run.

        Raises
        ------
        DataError
            If there are more or fewer stamps than samples.

        Examples
        --------
        >>> run = Samples(stamps=[0, 10], temperature=[20.0, 21.0])
        >>> run.restamped(np.array([5, 15])).stamps.tolist()
        [5, 15]
        """
        if stamps.shape != self.stamps.shape:
            raise DataError(f'{len(self)} samples cannot have stamps of shape {stamps.shape}')
        run = object.__new__(Samples)
        run.__dict__.update(self.__dict__, stamps=_frozen(stamps))
        return run

    @classmethod
    def concatenate(cls, runs: Iterable[Samples]) -> Samples:
        """
        Return one run made of several, in the order given.

        Raises
        ------
        DataError
            If the runs do not carry the same quantities.
        """
        parts = list(runs)
        if not parts:
            return cls(stamps=np.empty(0, dtype=np.int64))
        joined = {}
        for field in fields(cls):
            columns = [getattr(part, field.name) for part in parts]
            if all(column is None for column in columns):
                continue
            if any(column is None for column in columns):
                raise DataError(f'cannot join runs with and without {field.name}')
            joined[field.name] = columns[0] if len(columns) == 1 else np.concatenate(columns)
        return cls(**joined)


def _accepted(name: str, given: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Return a column as it is kept; raise if its shape is not the one it must have."""
    values = np.asarray(given, dtype=np.float64)
    if values.size == 0 == shape[0]:
        values = values.reshape(shape)
    if values.shape != shape:
        raise DataError(f'{name} must have shape {shape} like the stamps, got {values.shape}')
    return _frozen(values)


def _frozen(array: np.ndarray) -> np.ndarray:
    """Return a read-only view, so that the caller's own array stays as it was."""
    view = array.view()
    view.setflags(write=False)
    return view
