# SPDX-License-Identifier: Apache-2.0
"""What never arrived, told by the numbers that publishers give their messages."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from imu_bench.account import FIRST, MISSED

_NOBODY = -1


class Sequences:
    """
    Follows the numbers of one topic's messages; the first one of a publisher is number 0.

    Blocks name their publisher.  Single messages do not: theirs is the publisher whose number
    is due, else the one whose number is nearest below.  Where several lose messages at once
    the sum may be wrong by a few.
    """

    def __init__(self, around: Callable[[], int] = lambda: 1) -> None:
        self._around = around
        self.received = 0
        # messages that were sent after the first one that arrived, and did not arrive
        self.missed = 0
        # messages sent before the first one that arrived, by all publishers together
        self.before = 0
        # false once a message came without a number, or with one that several publishers may have
        # sent: then nothing is known of what was missed
        self.known = True
        # whether messages of several publishers came in turn: both are there
        self.interleaved = False
        self._last: int | None = _NOBODY
        self._due: dict[int, int] = {}

    @property
    def publishers(self) -> int:
        """How many were heard: more than one after a restart, or when several publish."""
        return len(self._due)

    def take(self, numbers: Sequence[int | None]) -> None:
        """Take single messages in the order of their arrival; None stands for no number."""
        for first, length in _runs(numbers):
            publisher = None if first is None else self._sender(first)
            if first is None or publisher is None:
                self.known = False
                self.received += length
                self._last = None
            else:
                self.take_run(publisher, first, length)

    def take_run(self, publisher: int, first: int, length: int) -> None:
        """Take messages of one publisher with consecutive numbers."""
        self.received += length
        due = self._due.get(publisher)
        if due is not None and self._last not in (publisher, _NOBODY):
            self.interleaved = True
        self._last = publisher
        if due is None:
            self.before += first
        elif first > due:
            self.missed += first - due
        self._due[publisher] = max(due or 0, first + length)

    def entries(self, topic: str) -> dict[str, object]:
        """Return what goes to /diagnostics."""
        if not self.known:
            return {MISSED + topic: 'not known'}
        return {
            MISSED + topic: self.missed,
            FIRST + topic: self.before,
            f'publishers.{topic}': self.publishers,
        }

    def _sender(self, number: int) -> int | None:
        """Return whose message this is, a new publisher if need be; None if that is not known."""
        for publisher, due in self._due.items():
            if due == number:
                return publisher
        below = {due: publisher for publisher, due in self._due.items() if due < number}
        unheard = not self._due or len(self._due) < self._around()
        if unheard:
            return None if below else len(self._due)
        return below[max(below)] if below else None


def _runs(numbers: Sequence[int | None]) -> Iterator[tuple[int | None, int]]:
    """Yield the first number and the length of each run of consecutive numbers."""
    if not numbers:
        return
    first = numbers[0]
    # nearly always there is one publisher, and nothing missing
    if first is not None and list(numbers) == list(range(first, first + len(numbers))):
        yield first, len(numbers)
        return
    start = 0
    for end in range(1, len(numbers) + 1):
        before = numbers[end - 1]
        if end == len(numbers) or before is None or numbers[end] != before + 1:
            yield numbers[start], end - start
            start = end
