# SPDX-License-Identifier: Apache-2.0
"""A bag that is written by a thread of its own, so that who records never waits for a disk."""

from __future__ import annotations

from collections import deque
import threading
import time

from imu_bench.bags.topic_info import TopicInfo
from imu_bench.bags.writer import BagWriter
from imu_bench.errors import RecordingError

FLUSH_S = 0.5
"""Seconds between flushes: with the time in the queue, a killed process loses less than one."""

CAPACITY = 200_000
"""Messages that may wait; what comes on top is dropped and counted."""

_DRAIN_S = 0.1


class BackgroundWriter:
    """
    Hands messages to a bag from a thread.

    Parameters
    ----------
    bag : BagWriter
    flush_s : float
        Seconds between flushes.
    capacity : int
        Messages that may wait.

    Attributes
    ----------
    dropped : int
        Messages dropped because the disk did not keep up.
    error : RecordingError or None
        Why recording ended early.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import mkdtemp
    >>> from imu_bench.bags.topic_info import describe
    >>> writer = BackgroundWriter(BagWriter(Path(mkdtemp()) / 'bag'))
    >>> writer.add_topic(describe('/text', 'std_msgs/msg/String'))
    >>> writer.put('/text', 1, b'...')
    >>> writer.close()
    >>> writer.counts, writer.dropped
    ({'/text': 1}, 0)
    """

    def __init__(
        self, bag: BagWriter, *, flush_s: float = FLUSH_S, capacity: int = CAPACITY
    ) -> None:
        self.dropped = 0
        self.error: RecordingError | None = None
        self._bag = bag
        self._flush_s = flush_s
        self._capacity = capacity
        self._waiting: deque[TopicInfo | tuple[str, int, bytes]] = deque()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='bag writer', daemon=True)
        self._thread.start()

    @property
    def counts(self) -> dict[str, int]:
        """Messages on disk by topic."""
        return self._bag.counts

    @property
    def waiting(self) -> int:
        """Messages that are not handed to the bag yet."""
        return len(self._waiting)

    def add_topic(self, topic: TopicInfo) -> None:
        """Add a topic; returns at once."""
        self._waiting.append(topic)

    def put(self, topic: str, receive_ns: int, data: bytes) -> None:
        """Add a message; returns at once."""
        if self.error is not None or len(self._waiting) >= self._capacity:
            self.dropped += 1
        else:
            self._waiting.append((topic, receive_ns, data))

    def close(self) -> None:
        """
        Write everything that waits and finish the bag.

        Raises
        ------
        RecordingError
            If the disk is full or failed, now or earlier.
        """
        self._stop.set()
        self._thread.join()
        try:
            self._bag.close()
        finally:
            if self.error is not None:
                raise self.error

    def _run(self) -> None:
        due = time.monotonic() + self._flush_s
        try:
            while not self._stop.wait(_DRAIN_S):
                self._drain()
                if time.monotonic() >= due:
                    # on the disk, so that a power failure costs no more than a killed process
                    self._bag.flush(sync=True)
                    due = time.monotonic() + self._flush_s
            self._drain()
        except RecordingError as problem:
            self.error = problem

    def _drain(self) -> None:
        # not more than is there now, so that a flood cannot put off the next flush
        for _ in range(len(self._waiting)):
            item = self._waiting.popleft()
            if isinstance(item, TopicInfo):
                self._bag.add_topic(item)
            else:
                self._bag.write(*item)
