# SPDX-License-Identifier: Apache-2.0
"""Raw messages to arrays: whole blocks at once, one by one where a block is irregular."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple, TypeVar

from imu_bench.bags.block import Block
from imu_bench.offline.recordings.source import Chunk, Covariance
from imu_bench.samples import Samples
from msg_conversions import cdr, covariance
import numpy as np
import numpy.typing as npt

_ROS1_TEXT = 16
"""Bytes of seq, sec, nanosec and the length of frame_id: wiki.ros.org/msg, std_msgs/Header."""

Integers = npt.NDArray[np.int64]
Found = TypeVar('Found')
DecodeAt = Callable[[bytes | memoryview, Integers, Integers], Found]
"""Takes a buffer, offsets and sizes; raises ValueError if a message is not of the kind."""


class Decoded(NamedTuple):
    """Samples of a block, the messages that are no Imu, and what was odd about the others."""

    chunk: Chunk
    undecodable: int
    remarks: tuple[str, ...]


def decode(block: Block, path: str = '', *, full: bool = False) -> Decoded:
    """
    Return the samples of a block of Imu messages, or of messages with an Imu at some path.

    Messages that cannot be decoded are counted and left out.  With `full`, orientation and
    covariances are there, too.
    """
    outer_ns = None
    if path:
        from imu_bench.offline.recordings import nested  # brings a type system along

        decoded, kept, outer_ns = nested.decode(block, path, full=full)
        receive_ns = block.receive_ns[kept]
    else:
        imu_at = _ros1_imu if block.channel.serialization == 'ros1' else cdr.decode_imu_at
        decoded, receive_ns = _whole(block, partial(imu_at, full=full), cdr.IMU)
    remarks: list[str] = []
    samples = Samples(
        decoded.stamps,
        acceleration=_reported(
            'linear_acceleration', decoded.acceleration, decoded.acceleration_covariance, remarks
        ),
        angular_velocity=_reported(
            'angular_velocity',
            decoded.angular_velocity,
            decoded.angular_velocity_covariance,
            remarks,
        ),
        orientation=decoded.orientation,
    )
    covariances = () if decoded.covariances is None else constant(decoded.covariances, 9)
    chunk = Chunk(samples, receive_ns, outer_ns, decoded.frame_ids, covariances)
    return Decoded(chunk, len(block) - len(chunk), tuple(remarks))


def decode_numbers(block: Block, count: int) -> tuple[cdr.Stamped, Integers]:
    """
    Return messages that are a header and so many numbers, and when they arrived.

    Messages that cannot be decoded are left out.
    """
    if block.channel.serialization == 'ros1':
        return _whole(block, partial(_ros1_numbers, count=count), count)
    return _whole(block, partial(_cdr_numbers, count=count), count)


def constant(rows: npt.NDArray[np.float64], width: int) -> tuple[Covariance, ...]:
    """Return so many columns of a table after the other, each as a row, None if rows differ."""
    bits = np.ascontiguousarray(rows).view(np.int64)  # NaN equals itself
    return tuple(
        tuple(rows[0, start : start + width].tolist())
        if len(rows) and (bits[:, start : start + width] == bits[0, start : start + width]).all()
        else None
        for start in range(0, rows.shape[1], width)
    )


def _whole(block: Block, decode_at: DecodeAt[Found], numbers: int) -> tuple[Found, Integers]:
    """Return the messages that can be decoded, of so many numbers each, and when they arrived."""
    offsets, sizes, receive_ns = block.offsets, block.sizes, block.receive_ns
    try:
        decoded = decode_at(block.buffer, offsets, sizes)
    except ValueError:
        kept = _decodable(block, decode_at, 8 * numbers)
        offsets, sizes, receive_ns = offsets[kept], sizes[kept], receive_ns[kept]
        decoded = decode_at(block.buffer, offsets, sizes)
    return decoded, receive_ns


def _decodable(block: Block, decode_at: DecodeAt[Found], least: int) -> Integers:
    """Return the indexes of the messages that are complete, none of fewer bytes than least."""
    kept = []
    for index in np.flatnonzero(block.sizes >= least).tolist():
        one = slice(index, index + 1)
        try:
            decode_at(block.buffer, block.offsets[one], block.sizes[one])
        except ValueError:
            continue
        kept.append(index)
    return np.array(kept, np.int64)


def _reported(
    name: str,
    values: npt.NDArray[np.float64],
    variance: npt.NDArray[np.float64],
    remarks: list[str],
) -> npt.NDArray[np.float64] | None:
    """Return values unless they are declared as not reported and look like it (REP-145)."""
    # Some drivers declare quantities as not reported that they do report.
    if variance.size and (variance == covariance.NOT_REPORTED[0]).all():
        if not np.nan_to_num(values).any():
            return None
        remarks.append(f'{name} is declared as not reported (covariance -1) but has values: used')
    return values


def _cdr_numbers(
    buffer: bytes | memoryview, offsets: Integers, sizes: Integers, count: int
) -> cdr.Stamped:
    found = cdr.decode_at(buffer, offsets, sizes, count, (slice(0, count),))
    return cdr.Stamped(found.stamps, found.columns[0], found.frame_ids)


def _ros1_imu(
    buffer: bytes | memoryview, offsets: Integers, sizes: Integers, *, full: bool = False
) -> cdr.ImuBlock:
    found = _ros1_numbers(buffer, offsets, sizes, cdr.IMU)
    return cdr.imu_block(found.stamps, found.values, found.frame_ids, full=full)


def _ros1_numbers(
    buffer: bytes | memoryview, offsets: Integers, sizes: Integers, count: int
) -> cdr.Stamped:
    """Decode messages as ROS 1 serializes them: little-endian, without padding."""
    data = np.frombuffer(buffer, np.uint8)
    stamps = np.empty(sizes.size, np.int64)
    values = np.empty((sizes.size, count))
    frame_ids: set[str] = set()
    for size in np.unique(sizes).tolist():
        text = size - _ROS1_TEXT - 8 * count
        if text < 0:
            raise ValueError(f'{size} bytes cannot hold {count} numbers of ROS 1')
        layout = np.dtype(
            [
                ('seq', '<u4'),
                ('sec', '<u4'),
                ('nanosec', '<u4'),
                ('text', '<u4'),
                ('frame_id', np.uint8, (text,)),
                ('values', '<f8', (count,)),
            ]
        )
        mine = np.flatnonzero(sizes == size)
        every = np.ndarray((data.size - size + 1,), f'V{size}', data.data, 0, (1,))
        table = every[offsets[mine]].view(layout)
        if (table['text'] != text).any():
            raise ValueError(f'{size} bytes with a frame_id of another length are not of ROS 1')
        stamps[mine] = table['sec'].astype(np.int64) * 1_000_000_000 + table['nanosec']
        values[mine] = table['values']
        names = np.unique(table['frame_id'], axis=0)
        frame_ids.update(name.tobytes().decode('utf-8', 'replace') for name in names)
    return cdr.Stamped(stamps, values, tuple(sorted(frame_ids)))
