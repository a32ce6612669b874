# SPDX-License-Identifier: Apache-2.0
"""
From stamps to an unbroken sequence of samples: which samples to keep, where some are missing.

The rule is local (a sample is judged with a few neighbours on either side), so
that a recording judged at once and a stream judged block by block agree:

1. A stamp that leaps forward and is followed by one that fits its predecessor,
   and a stamp earlier than one already seen, are order faults and are dropped;
   a clock set back for good is a break and the samples are kept.
2. Samples that follow one another in less than a quarter period form a group:
   a burst read from a FIFO, or a backlog delivered after a stall.
3. A group is late by ``U = time / period - samples so far``.  Samples are
   missing before a group when it and the next groups are all late by half a
   period or more with respect to the groups before; the missing number is that
   lateness, rounded.  A stall that is caught up therefore leaves no gap, and
   without stalls this is the rounding of successive differences.  Between stamps with
   jitter the lateness must last.
4. A group among single samples after which everything is early by its surplus
   holds duplicates; the later copies are dropped.
5. Where stamps take two steps by turns, only a longer one is a gap.
6. Where stamps are coarser than a twentieth of the period, lateness within one
   step of the stamps proves nothing and is not called a gap.
"""

from __future__ import annotations

from imu_bench.metrology.stamps.stamp_rule import GROUPED, Rule
from imu_bench.metrology.stretches import stretches
import numpy as np
import numpy.typing as npt

Integers = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

LOOK_AHEAD = 8
"""Groups that must all be late before samples are called missing."""

LASTING = 24
"""
Groups on either side of a leap whose medians must differ.  Of 8 that happened by chance in one of
10⁶ samples with jitter of 0.2 periods and one of 8000 of 0.3; of 24 in one of 5·10⁴ of 0.3.
"""

LOOK_BACK = 4
"""Single samples required around a group that is called a duplicate."""

CLOCK_STEP = 64
"""A clock is set back for good when this many stamps in a row stay behind."""

CONTEXT = 256
"""Settled stamps kept as context for the next block."""

PENDING_LIMIT = 1 << 16
"""Samples that wait at most for what follows; bounds the memory."""

_LOWEST = -(1 << 63)
_HALF = 0.5
_SAME = 0.7
"""Groups that differ by less in lateness, in periods, are on one level."""
_BACKLOG = 0.4
"""A group earlier than the level by more ends a backlog.  This and `_SAME` were chosen by
Monte Carlo: fewest gaps missed and invented for jitter of 0.1 to 0.3 periods."""


class Continuity:
    """
    Judges a stream of stamps block by block.

    A sample whose step is plain is settled at once; one that follows a leap, a
    burst or a step back waits until its neighbours are known.
    """

    def __init__(self, rule: Rule, pending_limit: int = PENDING_LIMIT) -> None:
        self.rule = rule
        self._limit = pending_limit
        self.order_faults = 0
        self.duplicates = 0
        self._context = np.empty(0, dtype=np.int64)
        self._pending = np.empty(0, dtype=np.int64)

    @property
    def pending(self) -> int:
        """Samples handed in and not settled yet."""
        return int(self._pending.size)

    def settle(self, stamps: Integers, *, final: bool = False) -> tuple[Mask, Floats]:
        """Take more stamps; return the judgement of those settled, in the order handed in."""
        work = np.concatenate([self._pending, stamps]) if self._pending.size else stamps
        keep, step, settled, faults = self._judge(work)
        if final or work.size - settled > self._limit:
            settled = work.size
        keep, step = keep[:settled], step[:settled]
        self._pending = work[settled:].copy()
        self.order_faults += int(np.count_nonzero(faults[:settled]))
        self.duplicates += int(np.count_nonzero(~keep & ~faults[:settled]))
        recent = work[:settled] if settled < CONTEXT else work[settled - CONTEXT : settled]
        recent = recent[keep[-recent.size :]] if recent.size else recent
        self._context = np.concatenate([self._context, recent])[-CONTEXT:]
        return keep, step

    def preview(self) -> tuple[Mask, Floats]:
        """Return the judgement of the pending samples as if nothing followed."""
        keep, step, _, _ = self._judge(self._pending)
        return keep, step

    def _judge(self, work: Integers) -> tuple[Mask, Floats, int, Mask]:
        """Return keep, step, how many leading samples are settled, and the order faults."""
        keep = np.ones(work.size, dtype=np.bool_)
        step = np.zeros(work.size)
        faults = np.zeros(work.size, dtype=np.bool_)
        if work.size == 0:
            return keep, step, 0, faults
        steps = np.diff(work, prepend=self._context[-1:])
        lead = work.size - steps.size  # 1 for the very first sample, which has no step
        plain = (steps >= GROUPED * self.rule.period) & (steps < 1.5 * self.rule.period)
        if plain.all():  # the very first sample may still turn out to be a wild one
            return keep, step, work.size if steps.size else 0, faults
        first = int(np.argmin(plain)) + lead
        first = max(0, first - CONTEXT)
        context = np.concatenate([self._context, work[:first]])[-CONTEXT:]
        part = work[first:]
        in_order, back = _in_order(context, part, self.rule.period)
        faults[first:] = ~in_order
        kept, gaps, starts = _place(context, part[in_order], back[in_order], self.rule)
        keep[first:] = in_order
        keep[np.flatnonzero(in_order)[~kept] + first] = False
        step[first:][in_order] = gaps
        settled = _settled(plain, lead, np.flatnonzero(in_order)[starts] + first, work.size)
        return keep, step, settled, faults


def _settled(plain: Mask, lead: int, starts: Integers, size: int) -> int:
    """Return how many leading samples no later sample can change; a group stays whole."""
    odd = int(np.flatnonzero(~plain)[-1]) + lead
    after = starts[starts > odd]
    if after.size > LOOK_AHEAD and size - odd > CLOCK_STEP:
        return size
    bound = size - CLOCK_STEP
    if starts.size > LOOK_AHEAD + 1:
        bound = min(bound, int(starts[-LOOK_AHEAD - 1]))
        earlier = starts[starts <= bound]
        bound = int(earlier[-1]) if earlier.size else 0
    else:
        bound = 0
    return max(bound, 0)


def _in_order(context: Integers, part: Integers, period: float) -> tuple[Mask, Mask]:
    """Return which stamps are in order, and which are the first after a clock set back."""
    kept = np.ones(part.size, dtype=np.bool_)
    back = np.zeros(part.size, dtype=np.bool_)
    base = context[-1:]
    for _ in range(2):  # the second pass finds the first of two wild stamps in a row
        place = np.flatnonzero(kept)
        stamps = np.concatenate([base, part[place]])
        steps = np.diff(stamps)
        if base.size == 0 and steps.size and steps[0] < 0:
            kept[place[0]] = False
        leap = (steps[:-1] >= 1.5 * period) & (steps[1:] < 0) & (stamps[2:] >= stamps[:-2])
        kept[place[np.flatnonzero(leap) + 1 - base.size]] = False
    place = np.flatnonzero(kept)
    stamps = part[place]
    start = 0
    highest = int(base[0]) if base.size else _LOWEST
    while start < stamps.size:
        top = np.maximum.accumulate(np.maximum(stamps[start:], highest))
        late = stamps[start:] < top
        begin, end = stretches(late).T
        lasting = np.flatnonzero(end - begin >= CLOCK_STEP)
        stop = stamps.size if lasting.size == 0 else start + int(begin[lasting[0]])
        kept[place[start:stop][late[: stop - start]]] = False
        if stop < stamps.size:
            # the few that leapt ahead of the many that follow are wild; otherwise it is the clock
            earlier = np.concatenate([base[:1] if start == 0 else base[:0], stamps[start:stop]])
            leapt = int(np.argmax(earlier > stamps[stop]))
            few = earlier.size - leapt < CLOCK_STEP
            if few and leapt and earlier[leapt] - earlier[leapt - 1] >= 1.5 * period:
                kept[place[stop - (earlier.size - leapt) : stop]] = False
            else:
                back[place[stop]] = True
                highest = _LOWEST
        start = stop
    return kept, back


def _place(
    context: Integers, stamps: Integers, back: Mask, rule: Rule
) -> tuple[Mask, Floats, Integers]:
    """Return keep and step of stamps in order, and where their groups start."""
    gaps = np.zeros(stamps.size)
    keep = np.ones(stamps.size, dtype=np.bool_)
    if stamps.size == 0:
        return keep, gaps, np.empty(0, dtype=np.int64)
    joined = np.concatenate([context, stamps])
    before = context.size
    steps = np.diff(joined, prepend=joined[0]).astype(np.float64)
    steps[steps < 0] = rule.period  # where the clock was set back
    late = (np.cumsum(steps) / rule.period) - np.arange(joined.size)
    opens = steps >= GROUPED * rule.period
    opens[0] = True
    starts = np.flatnonzero(opens)
    sizes = np.diff(starts, append=joined.size)
    ends = late[starts + sizes - 1]
    holes = np.zeros(starts.size)
    holes[1:] = _holes(ends, starts, rule)
    surplus = _surplus(ends, sizes, rule)
    new = starts >= before
    gaps[starts[new] - before] = holes[new]
    gaps[back] = -1.0
    for group in np.flatnonzero(surplus):
        end = int(starts[group] + sizes[group]) - before
        keep[max(0, end - int(surplus[group])) : max(0, end)] = False
    return keep, gaps, starts[new] - before


def _holes(ends: Floats, starts: Integers, rule: Rule) -> Floats:
    """Return the time across the gap before each group but the first; 0 where there is none."""
    found = np.zeros(ends.size - 1)
    leap = np.flatnonzero(np.diff(ends) >= _HALF)
    before = _level(ends, leap, -1)
    after = _level(ends, leap + 1, 1)
    lowest = after.copy()
    for ahead in range(1, LOOK_AHEAD + 1):
        lowest = np.minimum(lowest, ends[np.minimum(leap + ahead, ends.size - 1)])
    # jitter takes the lowest a little below the level; what is far below is a backlog
    backlog = lowest <= after - _BACKLOG
    late = np.where(backlog, lowest, after) - before
    # the leap itself is surer of the number than levels that may span another gap
    number = np.where(backlog, late, 0.5 * (late + ends[leap + 1] - ends[leap]))
    lasting = late >= rule.lateness
    lasting[lasting] = _lasts(ends, starts, leap[lasting])
    if rule.uneven:  # steps of two lengths wander; only a step longer than both is a gap
        lasting &= ends[leap + 1] - ends[leap] >= rule.lateness
    found[leap] = np.where(lasting, (number + 1.0) * rule.period, 0.0)
    return found


def _lasts(ends: Floats, starts: Integers, leap: Integers) -> Mask:
    """Return whether the groups after a leap stay late."""
    # Missing samples shift everything that follows, jitter the next group only; so the medians of
    # `LASTING` groups on either side must differ as well, of fewer where groups are long.
    reach = np.arange(LASTING)
    first, last = (
        np.searchsorted(starts, starts[leap + 1] + far) for far in (-2 * LASTING, 2 * LASTING)
    )
    first = np.maximum(np.minimum(first, leap + 1 - LOOK_AHEAD), 0)
    last = np.minimum(np.maximum(last - 1, leap + LOOK_AHEAD), ends.size - 1)
    before = ends[np.maximum(leap[:, None] - reach, first[:, None])]
    after = ends[np.minimum(leap[:, None] + 1 + reach, last[:, None])]
    late = np.median(after, axis=1) - np.median(before, axis=1)
    return np.asarray(late >= _HALF, np.bool_)


def _level(ends: Floats, place: Integers, direction: int) -> Floats:
    """Return the mean lateness of up to four groups from each place on without a leap."""
    level = ends[place].copy()
    count = np.ones(place.size)
    here = place
    on = np.ones(place.size, dtype=np.bool_)
    for _ in range(LOOK_BACK - 1):
        there = np.clip(here + direction, 0, ends.size - 1)
        on &= (there != here) & (np.abs(ends[there] - ends[here]) < _SAME)
        level[on] += ends[there[on]]
        count[on] += 1
        here = there
    return level / count


def _surplus(ends: Floats, sizes: Integers, rule: Rule) -> Integers:
    """Return how many samples of each group are copies."""
    found = np.zeros(sizes.size, dtype=np.int64)
    count = np.concatenate([[0], np.cumsum(sizes == 1)])
    place = np.arange(sizes.size)
    lower = np.maximum(place - LOOK_BACK, 0)
    upper = np.minimum(place + 1 + LOOK_BACK, sizes.size)
    lonely = (sizes > 1) & (count[upper] - count[lower] == upper - lower - 1)
    lonely[:1] = False  # nothing says whether a first group is a backlog or holds copies
    for group in np.flatnonzero(lonely):
        past = ends[lower[group] : group].min()
        early = past - ends[group : upper[group]].max()
        if early >= rule.lateness:
            found[group] = min(int(early + _HALF), int(sizes[group]) - 1)
    return found
