# SPDX-License-Identifier: Apache-2.0
"""Raw Imu messages to arrays: whole blocks at once, one by one where a block is irregular."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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


def decode(blocks: Sequence[Block]) -> Decoded:
    """
    Return the samples of some blocks of Imu messages of one channel.

    Messages that cannot be decoded are counted and left out.
    """
    decode_joined = _DECODERS[blocks[0].channel.serialization]
    parts = [_joined(block) for block in blocks]
    data = parts[0] if len(parts) == 1 else np.concatenate(parts)
    sizes = np.concatenate([block.sizes for block in blocks])
    edges = np.concatenate(([0], np.cumsum(sizes)))
    receive_ns = np.concatenate([block.receive_ns for block in blocks])
    try:
        decoded = decode_joined(data, edges)
    except ValueError:
        kept = _decodable(data, edges, decode_joined)
        receive_ns = receive_ns[kept]
        blobs = [data[edges[index] : edges[index + 1]].tobytes() for index in kept.tolist()]
        whole = np.frombuffer(b''.join(blobs), np.uint8)
        decoded = decode_joined(whole, np.concatenate(([0], np.cumsum(sizes[kept]))))
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
    return Decoded(chunk, sizes.size - len(chunk), tuple(remarks))


def _joined(block: Block) -> npt.NDArray[np.uint8]:
    """Return the messages of a block end to end."""
    data = np.frombuffer(block.buffer, np.uint8)
    offsets, sizes = block.offsets, block.sizes
    if (offsets[1:] == (offsets + sizes)[:-1]).all():
        return data[int(offsets[0]) : int(offsets[-1] + sizes[-1])]
    size = int(sizes[0])
    if 0 < size <= data.size and (sizes == size).all():
        every = np.ndarray((data.size - size + 1, size), np.uint8, data, 0, (1, 1))
        return every[offsets].reshape(-1)
    return np.frombuffer(b''.join(block.blobs()), np.uint8)


def _decodable(
    data: npt.NDArray[np.uint8],
    edges: npt.NDArray[np.int64],
    decode_joined: Callable[..., cdr.ImuBlock],
) -> npt.NDArray[np.int64]:
    """Return the indexes of the messages that are complete Imu messages."""
    kept = []
    for index, (start, end) in enumerate(
        zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)
    ):
        try:
            decode_joined(data[start:end], np.array([0, end - start]))
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
    # a copy, so that the other numbers of the messages do not stay in memory with these
    return values.copy()


def _ros1(data: npt.NDArray[np.uint8], edges: npt.NDArray[np.int64]) -> cdr.ImuBlock:
    """
    Decode Imu messages as ROS 1 serializes them: little-endian, without padding.

    Raises
    ------
    ValueError
        If a message is not a complete Imu.
    """
    sizes = np.diff(edges)
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
        rows = np.ndarray((data.size - size + 1, size), np.uint8, data, 0, (1, 1))[edges[mine]]
        table = rows.view(layout)[:, 0]
        if (table['text'] != text).any():
            raise ValueError(f'{size} bytes with a frame_id of another length are no Imu of ROS 1')
        stamps[mine] = table['sec'].astype(np.int64) * 1_000_000_000 + table['nanosec']
        values[mine] = table['values']
        names = np.unique(table['frame_id'], axis=0)
        frame_ids.update(name.tobytes().decode('utf-8', 'replace') for name in names)
    return cdr.ImuBlock(
        stamps=stamps,
        acceleration=values[:, cdr.IMU_LINEAR_ACCELERATION],
        angular_velocity=values[:, cdr.IMU_ANGULAR_VELOCITY],
        acceleration_covariance=values[:, cdr.IMU_LINEAR_ACCELERATION_COVARIANCE.start],
        angular_velocity_covariance=values[:, cdr.IMU_ANGULAR_VELOCITY_COVARIANCE.start],
        frame_ids=tuple(sorted(frame_ids)),
    )


_DECODERS: dict[str, Callable[..., cdr.ImuBlock]] = {'cdr': cdr.decode_imu_joined, 'ros1': _ros1}
"""By serialization format."""
