# SPDX-License-Identifier: Apache-2.0
"""Raw Imu messages to arrays: whole blocks at once, one by one where a block is irregular."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from imu_bench.bags.block import Block
from imu_bench.offline.recordings.source import Chunk
from msg_conversions import cdr, covariance
import numpy as np
import numpy.typing as npt

_ROS1_TEXT = 16
"""Bytes of seq, sec, nanosec and the length of frame_id: wiki.ros.org/msg, std_msgs/Header."""


class Decoded(NamedTuple):
    """Samples of a block, the messages that are no Imu, and what was odd about the others."""

    chunk: Chunk
    undecodable: int
    remarks: tuple[str, ...]


def decode(block: Block, path: str = '') -> Decoded:
    """
    Return the samples of a block of Imu messages, or of messages with an Imu at some path.

    Messages that cannot be decoded are counted and left out.
    """
    decoded, receive_ns = _inside(block, path) if path else _whole(block)
    remarks: list[str] = []
    chunk = Chunk(
        stamps=decoded.stamps,
        receive_ns=receive_ns,
        acceleration=_reported(
            'linear_acceleration', decoded.acceleration, decoded.acceleration_covariance, remarks
        ),
        angular_velocity=_reported(
            'angular_velocity',
            decoded.angular_velocity,
            decoded.angular_velocity_covariance,
            remarks,
        ),
        frame_ids=decoded.frame_ids,
    )
    return Decoded(chunk, len(block) - len(chunk), tuple(remarks))


def _inside(block: Block, path: str) -> tuple[cdr.ImuBlock, npt.NDArray[np.int64]]:
    from imu_bench.offline.recordings import nested  # brings a type system along

    decoded, kept = nested.decode(block, path)
    return decoded, block.receive_ns[kept]


def _whole(block: Block) -> tuple[cdr.ImuBlock, npt.NDArray[np.int64]]:
    decode_at = _DECODERS[block.channel.serialization]
    offsets, sizes, receive_ns = block.offsets, block.sizes, block.receive_ns
    try:
        decoded = decode_at(block.buffer, offsets, sizes)
    except ValueError:
        kept = _decodable(block, decode_at)
        offsets, sizes, receive_ns = offsets[kept], sizes[kept], receive_ns[kept]
        decoded = decode_at(block.buffer, offsets, sizes)
    return decoded, receive_ns


def _decodable(block: Block, decode_at: Callable[..., cdr.ImuBlock]) -> npt.NDArray[np.int64]:
    """Return the indexes of the messages that are complete Imu messages."""
    kept = []
    for index in range(len(block)):
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
    """
    Return values unless they are declared as not reported and look like it (REP-145).

    Some drivers declare quantities as not reported that they do report.
    """
    if variance.size and (variance == covariance.NOT_REPORTED[0]).all():
        if not np.nan_to_num(values).any():
            return None
        remarks.append(f'{name} is declared as not reported (covariance -1) but has values: used')
    return values


def _ros1(
    buffer: bytes | memoryview, offsets: npt.NDArray[np.int64], sizes: npt.NDArray[np.int64]
) -> cdr.ImuBlock:
    """
    Decode Imu messages as ROS 1 serializes them: little-endian, without padding.

    Raises
    ------
    ValueError
        If a message is not a complete Imu.
    """
    data = np.frombuffer(buffer, np.uint8)
    stamps = np.empty(sizes.size, np.int64)
    values = np.empty((sizes.size, cdr.IMU))
    frame_ids: set[str] = set()
    for size in np.unique(sizes).tolist():
        text = size - _ROS1_TEXT - 8 * cdr.IMU
        if text < 0:
            raise ValueError(f'{size} bytes cannot hold an Imu of ROS 1')
        layout = np.dtype(
            [
                ('seq', '<u4'),
                ('sec', '<u4'),
                ('nanosec', '<u4'),
                ('text', '<u4'),
                ('frame_id', np.uint8, (text,)),
                ('values', '<f8', (cdr.IMU,)),
            ]
        )
        mine = np.flatnonzero(sizes == size)
        every = np.ndarray((data.size - size + 1,), f'V{size}', data.data, 0, (1,))
        table = every[offsets[mine]].view(layout)
        if (table['text'] != text).any():
            raise ValueError(f'{size} bytes with a frame_id of another length are no Imu of ROS 1')
        stamps[mine] = table['sec'].astype(np.int64) * 1_000_000_000 + table['nanosec']
        values[mine] = table['values']
        names = np.unique(table['frame_id'], axis=0)
        frame_ids.update(name.tobytes().decode('utf-8', 'replace') for name in names)
    return cdr.ImuBlock(
        stamps=stamps,
        # copies, so that the other numbers of the messages do not stay in memory with these
        acceleration=values[:, cdr.IMU_LINEAR_ACCELERATION].copy(),
        angular_velocity=values[:, cdr.IMU_ANGULAR_VELOCITY].copy(),
        acceleration_covariance=values[:, cdr.IMU_LINEAR_ACCELERATION_COVARIANCE.start].copy(),
        angular_velocity_covariance=values[:, cdr.IMU_ANGULAR_VELOCITY_COVARIANCE.start].copy(),
        frame_ids=tuple(sorted(frame_ids)),
    )


_DECODERS: dict[str, Callable[..., cdr.ImuBlock]] = {'cdr': cdr.decode_imu_at, 'ros1': _ros1}
"""By serialization format."""
