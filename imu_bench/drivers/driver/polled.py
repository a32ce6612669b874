# SPDX-License-Identifier: Apache-2.0
"""
Chips that overwrite their registers and do not say when: no FIFO, no counter, no data-ready.

All a host can do is look and compare.  Looking a little more often than the chip writes sees
every sample; what is the same as before was either looked at twice or is two samples with the
same words.  The chip's pace is even, so time tells which: each look bounds the moment of the
next update from one side (it is kept as an interval, with which the pace is measured), and a
look well behind that moment that finds nothing new has found an update that left all words as
they were.  After a pause in which samples came and went their number is counted if time tells
it for certain, and said to be uncertain if not.

A host that looks more seldom than the chip writes, as on a bus that is too full, sees something
new each time and learns nothing of the moment of an update.  Then each sample that is seen is
taken and called undated: it is older than its look by anything up to a period, and half of one
is taken for it.  How many passed in between only the time can tell.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

from imu_bench.bus.interface import Clock
from imu_bench.drivers.driver.base import Bus, Driver
import numpy as np
import numpy.typing as npt

GUARD = 0.25
"""Part of a period by which an update may be late, or the estimate of it wrong."""

CERTAIN = 0.98
"""Looks that are less of a period apart have one update at most between them."""

DOUBT = 0.05
"""So near to a whole number of periods the number of updates in a longer pause is not certain."""

EARLY = 0.02
"""Part of a period by which no update comes early once the pace is known: a broken transfer."""

EARLY_ALIKE = 0.3
"""The same for a chip some of whose samples have the words of the one before."""

PATIENCE = 3
"""So many in a row are believed to be updates; so many looks in time find the pace again."""

SELDOM = 5
"""So many looks in a row that came too late, each by less than `AWAY`: the bus is too full."""

AWAY = 8
"""Periods; after a longer pause something else was wrong."""

TOLERANCE = 0.01
"""Of the nominal period, until it is known better."""

SETTLED = 50
"""From the one of the first updates that is known best to the newest the period is measured."""

BEST_TOLERANCE = 5e-4
"""The period changes a little with temperature."""


class Look(NamedTuple):
    """What a look at the registers has found."""

    rows: npt.NDArray[Any]  # samples that were not taken before; none if nothing is new
    # first guess in ns: the newest was there in the middle of the reading
    stamps: npt.NDArray[np.int64]
    # how many of them were seen at looks before and had the words of the one before them
    repeated: int = 0
    skipped: int = 0  # samples before them that came and went between two looks
    lost_track: bool = False  # some came and went before them, and how many is not certain
    undated: bool = False  # the stamps are uncertain by half a period, and `skipped` is not known


class Updates:
    """
    Takes each sample once from registers that a chip overwrites.

    Parameters
    ----------
    rate_hz : float
        Nominal rate of the updates; the true one may differ by a percent.

    Examples
    --------
    Samples at 0 ms, 10 ms, 20 ms, 30 ms, 40 ms, looked at five times:

    >>> updates, ms = Updates(100.0), 1_000_000
    >>> looks = [(2, 5), (9, 5), (11, 6), (18, 6), (46, 9)]
    >>> found = [updates.look(np.array([x]), t * ms, t * ms) for t, x in looks]
    >>> [(look.rows.tolist(), look.skipped) for look in found]
    [([5], 0), ([], 0), ([6], 0), ([], 0), ([9], 2)]
    """

    def __init__(self, rate_hz: float) -> None:
        self._nominal = 1e9 / rate_hz
        self.begin()

    def begin(self) -> None:
        """Forget everything: the chip starts to write."""
        self._row: npt.NDArray[Any] | None = None
        self._words = b''
        self._early = self._waited = 0
        self._early_by = EARLY
        self._looked = 0, 0
        self._seen: int | None = None
        self._seldom = self._often = 0
        self._undated = False
        self._begun = self._doubtful = False
        self._repeated = 0
        self._shortest: float = self._nominal
        self._period, self._tolerance = self._nominal, TOLERANCE

    def lose_track(self) -> None:
        """Find the pace anew, as after readings that were broken; what was taken stays taken."""
        self._begun, self._doubtful, self._undated = False, True, False
        self._seldom = 0

    def _track(self, since_ns: int, seen_ns: int) -> None:
        """Begin to follow the updates with one that was not there yet, and is seen now."""
        self._due = seen_ns + self._period
        self._earliest = max(float(seen_ns), since_ns + self._period)
        self._made = 0
        self._settled: tuple[int, float, float] | None = None
        self._repeated = 0
        self._begun, self._doubtful = True, False

    def look(
        self, row: npt.NDArray[Any], before_ns: int, after_ns: int, words: bytes | None = None
    ) -> Look:
        """
        Take note of a look.

        Parameters
        ----------
        row : ndarray, shape (1,)
            What was read.
        before_ns, after_ns : int
            It was read between these times.
        words : bytes, optional
            What differs from one sample to the next; the whole row by default.
        """
        words = row.tobytes() if words is None else words
        # the chip latches at the same place of every reading, which the longer ones reach later
        self._shortest = min(self._shortest, after_ns - before_ns)
        seen_ns = after_ns - int(self._shortest)
        held_up = after_ns - before_ns > CERTAIN * self._period
        self._note_pace(seen_ns, held_up)
        middle_ns = (before_ns + after_ns) // 2
        if self._undated or (held_up and self._seldom >= SELDOM):
            self._looked = before_ns, seen_ns
            # whatever held it up did so before the transfer
            read_ns = after_ns - int(self._shortest) // 2 if held_up else middle_ns
            return self._take_undated(row, words, read_ns)
        if held_up:
            # nobody knows which sample this is; the next look will tell
            return self._found(row[:0], after_ns)
        if self._is_broken(words, seen_ns):
            self._looked = before_ns, seen_ns
            return self._found(row[:0], after_ns)
        looked, self._looked = self._looked, (before_ns, seen_ns)
        paused = self._row is not None and seen_ns - looked[0] > CERTAIN * self._period
        if self._row is not None and words == self._words:
            self._unchanged(before_ns, looked[1], paused)
            return self._found(row[:0], middle_ns)
        if self._row is None:
            self._row, self._words = row, words
            return self._found(row, middle_ns)
        return self._changed(row, words, (before_ns, seen_ns, middle_ns), looked, paused)

    def _changed(
        self,
        row: npt.NDArray[Any],
        words: bytes,
        times: tuple[int, int, int],
        looked: tuple[int, int],
        paused: bool,
    ) -> Look:
        """Take words that are new, after counting those that came and went since the last look."""
        before_ns, seen_ns, middle_ns = times
        gone = self._gone(before_ns, seen_ns, paused)
        if self._seldom >= SELDOM and (gone is None or self._doubtful or not self._begun):
            return self._take_undated(row, words, middle_ns)
        if gone is None and self._begun and not self._doubtful and self._waited < PATIENCE:
            # looked at in the very moment of an update: the next look will tell
            self._waited += 1
            self._looked = looked
            return self._found(row[:0], middle_ns)
        last = row if self._row is None else self._row
        self._row, self._words, self._waited = row, words, 0
        if gone is None or self._doubtful or not self._begun:
            lost_track = self._doubtful or paused
            self._track(looked[0], seen_ns)
            return self._found(row, middle_ns)._replace(lost_track=lost_track)
        if not paused:
            self._earliest = max(self._earliest, looked[0])
        # it cannot be written later than it is seen
        self._next(min(self._due, seen_ns), gone + 1)
        return self._with_repeated(last, row, middle_ns, gone)

    def _note_pace(self, seen_ns: int, held_up: bool) -> None:
        """Count the looks in a row that came too late to miss nothing, or in time."""
        apart = 0 if self._seen is None else seen_ns - self._seen
        self._seen = seen_ns
        if held_up or apart > CERTAIN * self._period:
            self._seldom, self._often = self._seldom + 1, 0
            if apart > AWAY * self._period:
                self._seldom = 0
            return
        self._seldom, self._often = 0, self._often + 1
        if self._undated and self._often >= PATIENCE:
            self.lose_track()

    def _take_undated(self, row: npt.NDArray[Any], words: bytes, read_ns: int) -> Look:
        """Take what is new, though nobody knows which sample it is."""
        self._undated, self._waited, self._repeated = True, 0, 0
        new = row[:0] if words == self._words else row
        self._row, self._words = row, words
        return self._found(new, read_ns - round(self._period / 2))._replace(undated=True)

    def _with_repeated(
        self, last: npt.NDArray[Any], row: npt.NDArray[Any], middle_ns: int, gone: int
    ) -> Look:
        """Return what is new behind the samples that had the words of the last one."""
        repeated, self._repeated = self._repeated, 0
        if repeated:
            self._early_by = EARLY_ALIKE
            row = np.concatenate([np.repeat(last, repeated), row])
        return self._found(row, middle_ns, repeated, gone)

    def _is_broken(self, words: bytes, seen_ns: int) -> bool:
        """Return whether words that changed long before they can have been written."""
        if (
            not self._begun
            or self._settled is None
            or self._repeated
            or words == self._words
            or seen_ns > self._earliest - self._early_by * self._period
        ):
            self._early = 0
            return False
        self._early = (self._early + 1) % PATIENCE
        return self._early > 0

    def _gone(self, before_ns: int, seen_ns: int, paused: bool) -> int | None:
        """Return how many updates came and went before the one seen; None if not certain."""
        if not self._begun:
            return 0
        late = (before_ns - self._due) / self._period
        if self._repeated and late < -0.5:
            # what was taken for an update without a change was none: it came only now
            late += 1.0
            self._repeated -= 1
            self._made -= 1
            self._due -= self._period
            self._earliest -= self._period
        if not paused:
            return 0
        latest = (seen_ns - self._earliest) / self._period
        doubt = DOUBT + self._tolerance * abs(late)
        least, most = max(0, int(late - doubt)), max(0, int(latest + doubt))
        return least if least == most else None

    def _unchanged(self, before_ns: int, looked_ns: int, paused: bool) -> None:
        if not self._begun:
            self._doubtful |= paused
            return
        late = (before_ns - self._due) / self._period
        if before_ns - looked_ns > self._period:
            # some must have come and gone, or the chip stands still
            self._doubtful = True
        elif late < GUARD:
            # not written yet, or with the same words, so it may be later than thought
            self._due = max(self._due, before_ns)
        elif late >= GUARD:
            # written with the same words
            self._repeated += 1
            self._expect(self._due, 1)

    def _next(self, seen: float, updates: int) -> None:
        """Expect the update after the one that was due and seen, and others behind it."""
        self._learn(self._made + 1, min(self._earliest, seen), seen)
        self._expect(seen, updates)

    def _expect(self, seen: float, updates: int) -> None:
        self._made += updates
        passed = updates * self._period
        self._earliest = min(self._earliest, seen) + passed * (1 - self._tolerance)
        self._due = seen + passed * (1 + self._tolerance)

    def _learn(self, made: int, earliest: float, latest: float) -> None:
        """Measure the period, and how well it is known, with an update between two times."""
        if self._settled is None:
            self._settled = made, earliest, latest
        first, since, until = self._settled
        if made <= SETTLED and latest - earliest < until - since:
            self._settled = made, earliest, latest
        if made - first < SETTLED:
            return
        span = (made - first) * self._period
        tolerance = max((latest - earliest + until - since) / 2 / span, BEST_TOLERANCE)
        if tolerance < 0.7 * self._tolerance or tolerance == BEST_TOLERANCE:
            period = (earliest + latest - since - until) / 2 / (made - first)
            if abs(period / self._nominal - 1) > 1.1 * TOLERANCE:
                self._settled = None  # miscounted
                return
            self._period, self._tolerance = period, tolerance

    def _found(
        self, rows: npt.NDArray[Any], middle_ns: int, repeated: int = 0, skipped: int = 0
    ) -> Look:
        if len(rows) == 1:
            return Look(rows, np.array([middle_ns]), repeated, skipped)
        ages = np.arange(len(rows) - 1, -1, -1) * self._period
        return Look(rows, middle_ns - np.rint(ages).astype(np.int64), repeated, skipped)


class PolledDriver(Driver):
    """Base for a chip that overwrites its registers and does not say when: see `Updates`."""

    counter_names: ClassVar[tuple[str, ...]] = ('repeated', 'lost_samples', 'undated')

    def __init__(
        self, bus: Bus | Mapping[str, Bus], clock: Clock, settings: Mapping[str, object]
    ) -> None:
        super().__init__(bus, clock, settings)
        self.updates = Updates(self.rate_hz)

    @property
    def poll_period_s(self) -> float:
        """Return less than a period by what acquisition varies it, so that nothing is missed."""
        return 0.65 / self.rate_hz

    def start(self) -> None:
        """Start the stream."""
        super().start()
        self.updates.begin()

    def look(self, row: Any, before_ns: int, after_ns: int, words: bytes) -> Look:
        """Look for new samples and count; of those that are missing the acquisition learns."""
        look = self.updates.look(row, before_ns, after_ns, words)
        if len(look.rows):
            self.counters['repeated'] += look.repeated
            self.counters['lost_samples'] += look.skipped
            self.counters['undated'] += len(look.rows) * look.undated
            self.dated = not look.undated
        if look.lost_track:
            self.continuity += 1
        elif look.skipped:
            self.skipped[0] = look.skipped
        return look
