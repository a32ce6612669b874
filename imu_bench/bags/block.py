# SPDX-License-Identifier: Apache-2.0
"""What every bag format gives: channels, and blocks of raw messages."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

_LONGEST_NAME = 255
"""Of DDS topics: ROS 2 design, "Topic and service name mapping to DDS"."""


@dataclass(frozen=True)
class Channel:
    """A topic as a bag describes it."""

    # topic, type: as spelled in the bag; what damage has put into them is made printable
    topic: str
    type: str
    serialization: str = 'cdr'  # 'cdr' in every bag of ROS 2 that we can decode
    # encoding, definition: kind ('ros2msg', 'ros2idl') and text of the message definition; empty
    # if not stored
    encoding: str = ''
    definition: str = ''

    def __post_init__(self) -> None:
        for name in ('topic', 'type', 'serialization'):
            object.__setattr__(self, name, printable(getattr(self, name)))


def printable(text: str) -> str:
    r"""
    Return a name in one line that a terminal shows as it is.

    Examples
    --------
    >>> printable('/imu\n\x1b[2J')
    '/imu\\n\\x1b[2J'
    """
    shown = ''.join(c if c.isprintable() else repr(c)[1:-1] for c in text[:_LONGEST_NAME])
    return shown if len(text) <= _LONGEST_NAME else shown + '...'


@dataclass(frozen=True, eq=False)
class Block:
    """Consecutive messages of one channel, in the order stored."""

    channel: Channel
    receive_ns: npt.NDArray[np.int64]  # time of arrival at the recorder
    buffer: bytes | memoryview  # holds the messages, and maybe other bytes between them
    # offsets, sizes: where each message lies in the buffer, in bytes
    offsets: npt.NDArray[np.int64]
    sizes: npt.NDArray[np.int64]

    def __len__(self) -> int:
        return int(self.offsets.size)

    def blobs(self) -> list[bytes]:
        """Return the messages one by one."""
        view = memoryview(self.buffer)
        return [
            bytes(view[start : start + size])
            for start, size in zip(self.offsets.tolist(), self.sizes.tolist(), strict=True)
        ]


def join(channel: Channel, receive_ns: npt.NDArray[np.int64], blobs: list[bytes]) -> Block:
    """Return a block made of single messages."""
    sizes = np.array([len(blob) for blob in blobs], np.int64)
    return Block(channel, receive_ns, b''.join(blobs), np.cumsum(sizes) - sizes, sizes)


class Messages(NamedTuple):
    """Messages to be stored, of one topic and one length: receive_ns (n,), rows (n, bytes)."""

    topic: str
    receive_ns: npt.NDArray[np.int64]
    rows: npt.NDArray[np.uint8]

    @property
    def number(self) -> int:
        """How many they are."""
        return len(self.rows)

    @property
    def nbytes(self) -> int:
        """Memory they take."""
        return self.rows.nbytes + self.receive_ns.nbytes


class Storage(Protocol):
    """One storage file of a bag."""

    path: Path
    channels: tuple[Channel, ...]

    @property
    def problems(self) -> list[str]:
        """What is wrong with the file, as far as it has been read."""

    @property
    def counts(self) -> dict[str, int]:
        """Messages stored per topic; may take a pass over the file."""

    @property
    def message_count(self) -> int:
        """Messages stored, quickly counted."""

    def blocks(self, topics: Collection[str]) -> Iterator[Block]:
        """Yield the messages of some topics, in the order stored."""

    def close(self) -> None:
        """Give temporary files back."""
