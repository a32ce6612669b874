# SPDX-License-Identifier: Apache-2.0
"""
Whole blocks of stamped sensor messages from their bytes on the wire.

Imu, MagneticField, Temperature and Vector3Stamped have one shape in common: a header
(stamp, frame_id) followed by nothing but float64.  For a given frame_id every such message
is the same number of bytes with every number at the same place, so a block of them is
one structured numpy array, and decoding or encoding it costs a fraction of a microsecond per
message instead of tens.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from msg_conversions import covariance, stamps
from msg_conversions.wire_layout import head_type, layout, TEXT
import numpy as np
import numpy.typing as npt

Bytes = npt.NDArray[np.uint8]
Integers = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]
Buffer = bytes | bytearray | memoryview

IMU = 37
"""Number of float64 in sensor_msgs/Imu."""
IMU_ANGULAR_VELOCITY = slice(13, 16)
IMU_ANGULAR_VELOCITY_COVARIANCE = slice(16, 25)
IMU_LINEAR_ACCELERATION = slice(25, 28)
IMU_LINEAR_ACCELERATION_COVARIANCE = slice(28, 37)
IMU_ORIENTATION = slice(0, 4)
IMU_ORIENTATION_COVARIANCE = slice(4, 13)

MAGNETIC_FIELD = 12
"""Number of float64 in sensor_msgs/MagneticField."""
MAGNETIC_FIELD_VECTOR = slice(0, 3)
MAGNETIC_FIELD_COVARIANCE = slice(3, 12)

TEMPERATURE = 2
"""Number of float64 in sensor_msgs/Temperature."""
TEMPERATURE_VALUE = slice(0, 1)
TEMPERATURE_VARIANCE = slice(1, 2)

VECTOR3_STAMPED = 3
"""Number of float64 in geometry_msgs/Vector3Stamped."""
VECTOR3_VECTOR = slice(0, 3)

_IMU_COLUMNS = (
    IMU_LINEAR_ACCELERATION,
    IMU_ANGULAR_VELOCITY,
    # the first element says whether the quantity is reported
    slice(IMU_LINEAR_ACCELERATION_COVARIANCE.start, IMU_LINEAR_ACCELERATION_COVARIANCE.start + 1),
    slice(IMU_ANGULAR_VELOCITY_COVARIANCE.start, IMU_ANGULAR_VELOCITY_COVARIANCE.start + 1),
)
_EVERYTHING = (slice(0, IMU),)
_COVARIANCES = (
    IMU_ORIENTATION_COVARIANCE,
    IMU_ANGULAR_VELOCITY_COVARIANCE,
    IMU_LINEAR_ACCELERATION_COVARIANCE,
)


class Stamped(NamedTuple):
    """A block of decoded messages: stamps (n,) in ns, values (n, k), and the frame_ids."""

    stamps: npt.NDArray[np.int64]
    values: Floats
    frame_ids: tuple[str, ...]


class Columns(NamedTuple):
    """Stamps (n,) in ns, the columns asked for, each (n, width), and the frame_ids."""

    stamps: npt.NDArray[np.int64]
    columns: tuple[Floats, ...]
    frame_ids: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ImuBlock:
    """A block of sensor_msgs/Imu."""

    stamps: npt.NDArray[np.int64]  # nanoseconds since the epoch
    # acceleration, angular_velocity: in m/s² and rad/s, as found; see `has_acceleration`
    acceleration: Floats
    angular_velocity: Floats
    # acceleration_covariance, angular_velocity_covariance: first element of each covariance: -1
    # where the quantity is not reported
    acceleration_covariance: Floats
    angular_velocity_covariance: Floats
    frame_ids: tuple[str, ...]  # each frame_id that occurs, once, sorted
    orientation: Floats | None = None  # x, y, z, w; None unless asked for
    # those of orientation, angular velocity and acceleration; None unless asked for
    covariances: Floats | None = None

    def __len__(self) -> int:
        return int(self.stamps.size)

    @property
    def has_acceleration(self) -> bool:
        """Whether any message reports linear acceleration (REP-145)."""
        return bool(np.any(self.acceleration_covariance != covariance.NOT_REPORTED[0]))

    @property
    def has_angular_velocity(self) -> bool:
        """Whether any message reports angular velocity (REP-145)."""
        return bool(np.any(self.angular_velocity_covariance != covariance.NOT_REPORTED[0]))


def decode_imu(blobs: Sequence[bytes]) -> ImuBlock:
    """
    Decode serialised sensor_msgs/Imu.

    Parameters
    ----------
    blobs : sequence of bytes, length n
        Messages with their encapsulation header, as raw subscriptions and bags hold them.

    Raises
    ------
    ValueError
        If a message is not a complete Imu; the text gives its index.

    Examples
    --------
    >>> from msg_conversions.encoding import ImuTemplate
    >>> template = ImuTemplate('imu_link', acceleration_covariance=covariance.UNKNOWN)
    >>> block = decode_imu(template.encode_imu([10, 20], [[0, 0, 9.8], [0, 0, 9.9]]))
    >>> block.stamps.tolist(), block.acceleration[:, 2].tolist(), block.has_angular_velocity
    ([10, 20], [9.8, 9.9], False)
    """
    return decode_imu_joined(*_end_to_end(blobs))


def decode_imu_joined(data: Buffer, offsets: npt.ArrayLike) -> ImuBlock:
    """Decode sensor_msgs/Imu that lie end to end; see `decode_joined`."""
    edges = np.asarray(offsets, dtype=np.int64)
    return decode_imu_at(data, edges[:-1], np.diff(edges))


def decode_imu_at(
    data: Buffer, offsets: npt.ArrayLike, sizes: npt.ArrayLike, *, full: bool = False
) -> ImuBlock:
    """
    Decode sensor_msgs/Imu that lie anywhere in a buffer, touching only the bytes that are used.

    Parameters
    ----------
    offsets, sizes : array_like of int64, shape (n,)
        Where each message lies, in bytes.
    full : bool
        Orientation and covariances, too.

    Raises
    ------
    ValueError
        As `decode_stamped`.

    Examples
    --------
    >>> from msg_conversions.encoding import ImuTemplate
    >>> blob = ImuTemplate('imu_link').encode_imu([10], [[0, 0, 9.8]])[0]
    >>> decode_imu_at(b'...' + blob, [3], [len(blob)]).acceleration.tolist()
    [[0.0, 0.0, 9.8]]
    """
    if full:
        everything = decode_at(data, offsets, sizes, IMU, _EVERYTHING)
        return imu_block(everything.stamps, everything.columns[0], everything.frame_ids, full=True)
    stamps_, columns, frame_ids = decode_at(data, offsets, sizes, IMU, _IMU_COLUMNS)
    acceleration, angular_velocity, *first = columns
    return ImuBlock(
        stamps=stamps_,
        acceleration=acceleration,
        angular_velocity=angular_velocity,
        acceleration_covariance=first[0][:, 0],
        angular_velocity_covariance=first[1][:, 0],
        frame_ids=frame_ids,
    )


def imu_block(
    stamps_: npt.NDArray[np.int64],
    numbers: Floats,
    frame_ids: tuple[str, ...],
    *,
    full: bool = False,
) -> ImuBlock:
    """
    Return messages whose numbers are all known, shape (n, 37), in the order of the message.

    Orientation and covariances are taken over with `full` only.

    Examples
    --------
    >>> numbers = np.arange(37.0)[None]
    >>> imu_block(np.array([10]), numbers, ('imu_link',), full=True).orientation.tolist()
    [[0.0, 1.0, 2.0, 3.0]]
    """
    return ImuBlock(
        stamps=stamps_,
        # copies, so that the other numbers of the messages do not stay in memory with these
        acceleration=numbers[:, IMU_LINEAR_ACCELERATION].copy(),
        angular_velocity=numbers[:, IMU_ANGULAR_VELOCITY].copy(),
        acceleration_covariance=numbers[:, IMU_LINEAR_ACCELERATION_COVARIANCE.start].copy(),
        angular_velocity_covariance=numbers[:, IMU_ANGULAR_VELOCITY_COVARIANCE.start].copy(),
        frame_ids=frame_ids,
        orientation=numbers[:, IMU_ORIENTATION].copy() if full else None,
        covariances=np.hstack([numbers[:, part] for part in _COVARIANCES]) if full else None,
    )


def decode_stamped(blobs: Sequence[bytes], count: int) -> Stamped:
    """
    Decode messages that are a header followed by `count` float64.

    Parameters
    ----------
    count : int
        Such as `IMU`, `MAGNETIC_FIELD`, `TEMPERATURE`.
    """
    return decode_joined(*_end_to_end(blobs), count)


def decode_joined(data: Buffer, offsets: npt.ArrayLike, count: int) -> Stamped:
    """
    Decode messages that lie end to end in one buffer.

    Parameters
    ----------
    offsets : array_like of int64, shape (n + 1,)
        Message i is ``data[offsets[i]:offsets[i + 1]]``.
    count : int
        Number of float64 after the header, such as `IMU`.
    """
    edges = np.asarray(offsets, dtype=np.int64)
    found = decode_at(data, edges[:-1], np.diff(edges), count, (slice(0, count),))
    return Stamped(found.stamps, found.columns[0], found.frame_ids)


def decode_at(
    data: Buffer,
    offsets: npt.ArrayLike,
    sizes: npt.ArrayLike,
    count: int,
    columns: Sequence[slice],
) -> Columns:
    """
    Decode some of the numbers of messages that lie anywhere in a buffer.

    Parameters
    ----------
    offsets, sizes : array_like of int64, shape (n,)
        Where each message lies, in bytes.
    count : int
        Number of float64 after the header, such as `IMU`.
    columns : sequence of slice
        Which of them; an array of shape (n, width) each is returned.

    Raises
    ------
    ValueError
        As `decode_stamped`, and if a message lies outside of the buffer.
    """
    everything = np.frombuffer(data, dtype=np.uint8)
    starts = np.asarray(offsets, dtype=np.int64)
    lengths = np.asarray(sizes, dtype=np.int64)
    outside = (starts < 0) | (lengths < 0) | (starts > everything.size - lengths)
    if outside.any():
        raise ValueError(f'message {int(np.argmax(outside))} lies outside of the buffer')
    if lengths.size and (lengths == lengths[0]).all():
        regular = _decode_regular(everything, starts, int(lengths[0]), count, columns)
        if regular is not None:
            return regular
    stamp_parts = np.empty(lengths.size, np.int64)
    value_parts = tuple(np.empty((lengths.size, part.stop - part.start)) for part in columns)
    frame_ids: set[str] = set()
    for length in np.unique(lengths).tolist():
        members = np.flatnonzero(lengths == length)
        found = _decode_regular(everything, starts[members], length, count, columns)
        if found is None:
            found = _decode_singly(everything, starts, members, length, count, columns)
        stamp_parts[members] = found.stamps
        for values, part in zip(value_parts, found.columns, strict=True):
            values[members] = part
        frame_ids.update(found.frame_ids)
    return Columns(stamp_parts, value_parts, tuple(sorted(frame_ids)))


def _end_to_end(blobs: Sequence[bytes]) -> tuple[bytes, npt.NDArray[np.int64]]:
    lengths = np.fromiter(map(len, blobs), dtype=np.int64, count=len(blobs))
    return b''.join(blobs), np.concatenate(([0], np.cumsum(lengths)))


def _decode_regular(
    data: Bytes, starts: Integers, size: int, count: int, columns: Sequence[slice]
) -> Columns | None:
    """Decode messages of one size; None if they are not all of one layout."""
    if size < TEXT:
        return None
    first = data[starts[0] : starts[0] + TEXT].tobytes()
    try:
        order, text, start = layout(first, size, count)
    except ValueError:
        return None
    heads = _taken(data, starts, TEXT + text).view(head_type(order, text))
    for name in ('encapsulation', 'length'):
        if (heads[name] != heads[name][0]).any():
            return None
    names = heads['frame_id']
    distinct = names[:1] if (names == names[0]).all() else np.unique(names)
    # one piece of each message, with numbers nobody asked for: two lines of the cache at once
    # are read faster than a few numbers here and there
    low, high = min(part.start for part in columns), max(part.stop for part in columns)
    numbers = _numbers(data, starts + start, slice(low, high), order)
    return Columns(
        stamps.join(heads['sec'], heads['nanosec']),
        tuple(numbers[:, part.start - low : part.stop - low] for part in columns),
        tuple(sorted(_text(name) for name in distinct.tolist())),
    )


def _decode_singly(
    data: Bytes,
    starts: Integers,
    members: npt.NDArray[np.intp],
    size: int,
    count: int,
    columns: Sequence[slice],
) -> Columns:
    """Decode messages of one size but several layouts; name the first that is broken."""
    parts = []
    for index in members.tolist():
        one = _decode_regular(data, starts[index : index + 1], size, count, columns)
        if one is None:
            head = data[starts[index] :][: min(size, TEXT)].tobytes()
            try:
                layout(head, size, count)
            except ValueError as error:
                raise ValueError(f'message {index}: {error}') from error
        else:
            parts.append(one)
    return Columns(
        np.concatenate([part.stamps for part in parts]),
        tuple(np.concatenate(found) for found in zip(*(p.columns for p in parts), strict=True)),
        tuple(sorted({name for part in parts for name in part.frame_ids})),
    )


def _taken(data: Bytes, starts: Integers, width: int) -> npt.NDArray[Any]:
    """Return so many bytes from each start on, end to end."""
    if width == 0 or data.size < width:
        return np.empty(0, np.uint8)
    # one opaque item from every byte on: numpy copies such items faster than rows of bytes
    every = np.ndarray((data.size - width + 1,), f'V{width}', data.data, 0, (1,))
    return every[starts]


def _numbers(data: Bytes, starts: Integers, part: slice, order: str) -> Floats:
    width = part.stop - part.start
    found = _taken(data, starts + 8 * part.start, 8 * width).view(f'{order}f8')
    return np.asarray(found.reshape(-1, width), dtype=np.float64)


def _text(raw: bytes) -> str:
    return raw.rstrip(b'\0').decode('utf-8', errors='replace')
