# SPDX-License-Identifier: Apache-2.0
"""
Messages that wait on the disk, uncompressed, until the writer of a bag gets to them.

They lie in the folder of the bag as further files of it.  A recording that is killed meanwhile
is read with them: by their number they come after the files of the bag.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from imu_bench.bags.block import Block, Messages
from imu_bench.bags.mcap import McapFile
from imu_bench.bags.mcap_writer import McapWriter
from imu_bench.bags.topic_info import TopicInfo
import numpy as np

FILE_SIZE = 16 * 2**20
"""Bytes after which the next file begins; the disk gets them back file by file."""

FIRST_NUMBER = 1_000_000
"""Of the files: more than a bag has files of its own."""


class Spill:
    """A queue of messages on the disk, first in, first out."""

    def __init__(self, bag: Path) -> None:
        # by name; those of what is written have to be in it
        self.topics: dict[str, TopicInfo] = {}
        self._bag = bag
        self._begun = 0
        self._current: McapWriter | None = None
        self._closed: deque[McapWriter] = deque()

    @property
    def size(self) -> int:
        """Bytes on the disk."""
        return sum(file.size for file in self._files())

    @property
    def messages(self) -> int:
        """How many wait."""
        return sum(file.stored.total() for file in self._files())

    def write(self, item: Messages) -> None:
        """Add messages."""
        if self._current is None:
            self._current = self._begin()
        try:
            if item.topic not in self._current.stored:
                self._current.add_topic(self.topics[item.topic])
            self._current.write_many(item.topic, item.receive_ns, item.rows)
            self._current.flush()
        except OSError:
            self.finish()
            raise
        if self._current.size >= FILE_SIZE:
            self.finish()

    def finish(self) -> None:
        """Close the file that is being written, if there is one."""
        file, self._current = self._current, None
        if file is None:
            return
        # what is complete in a file without its end is read as well
        with suppress(OSError):
            file.abandon('')
        if file.stored.total():
            self._closed.append(file)
        else:
            file.path.unlink()

    def oldest(self) -> Path | None:
        """Return the file to be read next, None if nothing waits."""
        if not self._closed:
            self.finish()
        return self._closed[0].path if self._closed else None

    def read(self, file: Path) -> Iterator[Messages]:
        """Yield what is in a file, in the order of each topic."""
        for block in McapFile(file).blocks(self.topics):
            yield from _runs(block)

    def forget(self) -> None:
        """Delete the oldest file."""
        self._closed.popleft().path.unlink()

    def _begin(self) -> McapWriter:
        path = self._bag / f'{self._bag.name}_{FIRST_NUMBER + self._begun}{McapWriter.suffix}'
        try:
            file = McapWriter(path, compression='')
        except OSError:
            path.unlink(missing_ok=True)
            raise
        self._begun += 1
        return file

    def _files(self) -> list[McapWriter]:
        return [*self._closed, *([] if self._current is None else [self._current])]


def _runs(block: Block) -> Iterator[Messages]:
    """Yield the messages of a block, those of one length together."""
    edges = np.flatnonzero(np.diff(block.sizes, prepend=-1, append=-1))
    blobs = block.blobs()
    for start, end in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        rows = np.frombuffer(b''.join(blobs[start:end]), np.uint8).reshape(end - start, -1)
        yield Messages(block.channel.topic, block.receive_ns[start:end], rows)
