# SPDX-License-Identifier: Apache-2.0
"""
A bag that is written by a thread of its own, so that who records never waits for a disk.

What the writer cannot take at once waits in memory.  When that is full, what comes is laid
down uncompressed beside the bag by a second thread, and folded into the bag in its order
once the writer gets there; only when that cannot keep up either are messages dropped.

What waits on the disk lies in the folder of the bag as further files of it.  A recording that is
killed meanwhile is read with them: by their number they come after the files of the bag.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
import threading
import time

from imu_bench.bags.block import Block, Messages
from imu_bench.bags.mcap import McapFile
from imu_bench.bags.mcap_writer import McapWriter
from imu_bench.bags.topic_info import TopicInfo
from imu_bench.bags.writer import BagWriter
from imu_bench.errors import RecordingError
import numpy as np
import numpy.typing as npt

FLUSH_S = 0.5
"""Seconds between flushes: with the time in the queue, a killed process loses less than one."""

MEMORY = 64 * 2**20
"""Bytes that may wait in memory: 40 s of a bench of six sensors, at 4800 messages/s of 340 B."""

_DRAIN_S = 0.1


class _Queue:
    """Messages in order, and how much they are."""

    def __init__(self) -> None:
        self._items: deque[Messages] = deque()
        self.nbytes = 0
        self.messages = 0

    def append(self, item: Messages) -> None:
        self._items.append(item)
        self.nbytes += item.nbytes
        self.messages += item.number

    def popleft(self) -> Messages:
        item = self._items.popleft()
        self.nbytes -= item.nbytes
        self.messages -= item.number
        return item

    def __len__(self) -> int:
        return len(self._items)


class BackgroundWriter:
    """
    Hands messages to a bag from a thread.

    Parameters
    ----------
    flush_s : float
        Seconds between flushes.
    memory : int
        Bytes that may wait in memory: half of them for the bag, half to be laid down beside it.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import mkdtemp
    >>> from imu_bench.bags.topic_info import describe
    >>> writer = BackgroundWriter(BagWriter(Path(mkdtemp()) / 'bag'))
    >>> writer.add_topic(describe('/text', 'std_msgs/msg/String'))
    >>> writer.put('/text', np.array([1, 2]), np.frombuffer(b'onetwo', np.uint8).reshape(2, 3))
    >>> writer.close()
    >>> writer.counts, writer.dropped
    ({'/text': 2}, 0)
    """

    def __init__(self, bag: BagWriter, *, flush_s: float = FLUSH_S, memory: int = MEMORY) -> None:
        # messages that are not on the disk and will not be: it failed, or did not keep up
        self.dropped = 0
        self.error: RecordingError | None = None  # why recording ended early
        self._bag = bag
        self._flush_s = flush_s
        self._half = memory // 2
        self._handed_over = 0
        self._new_topics: deque[TopicInfo] = deque()
        # in the order of their age: what the writer takes next, what lies beside the bag, and
        # what is to go there; the last two are empty but while the writer is far behind
        self._front, self._spill, self._back = _Queue(), Spill(bag.path), _Queue()
        self._spilling = False
        # of the queues, held for a moment; and of the files beside the bag, taken before it
        self._lock, self._files = threading.Lock(), threading.Lock()
        self._stop, self._much = threading.Event(), threading.Event()
        self._threads = (
            threading.Thread(target=self._run, name='bag writer', daemon=True),
            threading.Thread(target=self._lay_down, name='bag spill', daemon=True),
        )
        for thread in self._threads:
            thread.start()

    @property
    def counts(self) -> dict[str, int]:
        """Messages on disk by topic."""
        return self._bag.counts

    @property
    def waiting(self) -> int:
        """Messages that are not handed to the bag yet."""
        with self._lock:
            return self._front.messages + self._spill.messages + self._back.messages

    @property
    def spilled(self) -> int:
        """Bytes that lie beside the bag and wait to be folded in."""
        return self._spill.size

    def add_topic(self, topic: TopicInfo) -> None:
        """Add a topic; returns at once."""
        self._spill.topics[topic.name] = topic
        self._new_topics.append(topic)

    def put(
        self, topic: str, receive_ns: npt.NDArray[np.int64], blobs: npt.NDArray[np.uint8]
    ) -> None:
        """Add messages of one length, shape (n, bytes); returns at once."""
        item = Messages(topic, receive_ns, blobs)
        with self._lock:
            self._handed_over += item.number
            if self.error is not None:
                self.dropped += item.number
                return
            self._spilling = self._spilling or not self._fits(self._front, item)
            queue = self._back if self._spilling else self._front
            if not self._fits(queue, item):
                self.dropped += item.number
                return
            queue.append(item)
            if self._spilling:
                self._much.set()

    def _fits(self, queue: _Queue, item: Messages) -> bool:
        # one that is larger than all there may be must get through as well
        return not queue or queue.nbytes + item.nbytes <= self._half

    def close(self) -> None:
        """
        Write everything that waits and finish the bag.

        Raises
        ------
        RecordingError
            If the disk is full or failed, now or earlier.
        """
        self._stop.set()
        self._much.set()
        for thread in self._threads:
            thread.join()
        try:
            self._bag.close()
        finally:
            if self.error is not None:
                raise self.error

    # --- the thread that writes the bag --------------------------------------------------

    def _run(self) -> None:
        due = time.monotonic() + self._flush_s
        behind = False
        try:
            while True:
                stopping = self._stop.wait(0.0 if behind else _DRAIN_S)
                self._drain()
                behind = self._fold_in()
                if time.monotonic() >= due:
                    # on the disk, so that a power failure costs no more than a killed process
                    self._bag.flush(sync=True)
                    due = time.monotonic() + self._flush_s
                if stopping and not behind:
                    return
        except RecordingError as problem:
            self._fail(problem)

    def _drain(self) -> None:
        # not more than is there now, so that a flood cannot put off the next flush
        for _ in range(len(self._front)):
            with self._lock:
                item = self._front.popleft()
            self._write(item)
        self._add_new_topics()

    def _write(self, item: Messages) -> None:
        self._add_new_topics()
        self._bag.write_many(item.topic, item.receive_ns, item.rows)

    def _add_new_topics(self) -> None:
        while self._new_topics:
            self._bag.add_topic(self._new_topics.popleft())

    def _fold_in(self) -> bool:
        """Write a file of what lies beside the bag; return whether more waits."""
        if not self._spilling:
            return False
        with self._files:
            file = self._spill.oldest()
            if file is None:
                with self._lock:
                    if not self._front:
                        # nothing lies between the two queues any more
                        self._front, self._back = self._back, self._front
                        self._spilling = False
                return True
        for item in self._spill.read(file):
            self._write(item)
        self._bag.flush(sync=True)
        with self._files:
            self._spill.forget()
        return True

    def _fail(self, problem: RecordingError) -> None:
        """Count what is lost; what lies beside the bag stays there, as part of it."""
        with self._files, self._lock:
            self._front, self._back = _Queue(), _Queue()
            self._spill.finish()
            on_disk = sum(self._bag.counts.values()) + self._spill.messages
            self.dropped = max(0, self._handed_over - on_disk)
            self.error = problem

    # --- the thread that lays down what memory cannot hold --------------------------------

    def _lay_down(self) -> None:
        while not self._stop.is_set():
            self._much.wait()
            self._much.clear()
            while self._lay_down_one():
                pass

    def _lay_down_one(self) -> bool:
        with self._files:
            with self._lock:
                # at the end the writer takes what waits here from memory
                if self._stop.is_set() or not self._spilling or not self._back:
                    return False
                item = self._back.popleft()
            try:
                self._spill.write(item)
            except OSError:
                with self._lock:
                    self.dropped += item.number
        return True


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
