# SPDX-License-Identifier: Apache-2.0
"""Samples from registers that are overwritten: each once, or counted, though nothing tells."""

from hypothesis import given, settings
from hypothesis import strategies as st
from imu_bench.drivers.driver.polled import Updates
import numpy as np
import pytest

PERIOD = 10_000_000  # 100 Hz
GOLDEN = 0.6180339887498949


class Chip:
    """Registers that change at an even pace; `alike` samples have the words of the last one."""

    def __init__(self, rng, error=0.0, alike=0.0, jitter=0.0):
        self.period = PERIOD / (1 + error)
        self.phase = rng.uniform(0, self.period)
        n = 5000
        self.when = self.phase + np.arange(n) * self.period + rng.uniform(-jitter, jitter, n)
        fresh = rng.random(n) >= alike
        fresh[0] = True
        self.words = np.cumsum(fresh)

    def number(self, t):
        return int(np.searchsorted(self.when, t, side='right')) - 1


def polled(chip, looks, cost=800_000):
    """Return the words that were taken, gaps as 0, and what is true of each look."""
    updates = Updates(100.0)
    taken, seen, lost_track = [], [], 0
    for t in looks:
        number = chip.number(t + 400_000)
        if number < 0:
            continue
        seen.append(number)
        look = updates.look(np.array([chip.words[number]]), round(t), round(t + cost))
        lost_track += look.lost_track
        taken += [0] * look.skipped + look.rows.tolist()
        if len(look.rows):
            assert look.stamps[-1] == (round(t) + round(t + cost)) // 2
            assert (np.abs(np.diff(look.stamps) - PERIOD) < 0.015 * PERIOD).all()
    return np.array(taken), seen, lost_track


def schedule(seconds, poll=0.65, late=0.0, rng=None):
    """Return when acquisition reads: deadlines shifted by the golden ratio, and late."""
    turns = np.arange(int(seconds * 1e9 / PERIOD / poll))
    shift = turns * GOLDEN % 1.0 * 0.5 * poll * PERIOD
    delays = 0 if rng is None else rng.uniform(0, late, turns.size)
    return np.maximum.accumulate(turns * poll * PERIOD + shift + delays)


@given(
    seed=st.integers(0, 2**32 - 1),
    error=st.floats(-0.01, 0.01),
    alike=st.sampled_from([0.0, 1e-3, 0.02]),
    cost=st.sampled_from([800_000, 3_400_000]),
    late=st.floats(0, 0.5e6),
)
@settings(max_examples=15, deadline=None)
def test_every_sample_is_taken_once_also_when_it_has_the_words_of_the_last(
    seed, error, alike, cost, late
):
    rng = np.random.default_rng(seed)
    chip = Chip(rng, error, alike)
    taken, seen, lost_track = polled(chip, schedule(8.0, late=late, rng=rng), cost)
    assert not lost_track
    true = chip.words[seen[0] : seen[-1] + 1]
    # before the first change nothing tells how many samples had the same words
    assert (taken == true[0]).sum() == 1
    true, taken = true[true != true[0]], taken[1:]
    # the last ones may wait for a change
    assert 0 not in taken
    assert len(true) - len(taken) <= 12
    true = true[: len(taken)]
    if alike:
        # looked at right after it, or at first, such a sample may be noticed one later, or not
        off = taken - true
        assert np.abs(off).max() <= 2
        assert np.count_nonzero(np.diff(off)) <= 3 * (np.diff(true) == 0).sum() + 4
    else:
        np.testing.assert_array_equal(taken, true)


@given(seed=st.integers(0, 2**32 - 1), pauses=st.lists(st.integers(12, 190), max_size=5))
@settings(max_examples=15, deadline=None)
def test_what_passes_between_two_looks_is_counted_or_said_to_be_uncertain(seed, pauses):
    rng = np.random.default_rng(seed)
    chip = Chip(rng, rng.uniform(-0.01, 0.01))
    looks = schedule(8.0)
    for k, pause in enumerate(pauses):
        looks = np.where(looks > (1 + 2 * k) * 1e9, looks + pause * 1e6, looks)
    taken, seen, lost_track = polled(chip, looks)
    assert lost_track <= len(pauses)
    # what was looked at while it was written may be counted as missing
    assert set(taken) - {0} <= set(chip.words[seen].tolist())
    if not lost_track:
        true = chip.words[seen[0] : seen[-1] + 1]
        assert len(taken) == len(true)
        np.testing.assert_array_equal(taken[taken != 0], true[taken != 0])


def test_most_pauses_are_counted_exactly():
    lost_track = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        looks = schedule(7.5)
        looks = np.where(looks > 7e9, looks + rng.uniform(15e6, 150e6), looks)
        lost_track += polled(Chip(rng, 0.005), looks)[2]
    assert lost_track <= 10


@pytest.mark.parametrize('jitter', [0.3e6, 1e6])
def test_an_uneven_pace_is_followed(jitter):
    rng = np.random.default_rng(4)
    chip = Chip(rng, 0.005, jitter=jitter)
    # seldom enough to miss nothing although an update comes early after a late one
    taken, seen, _ = polled(chip, schedule(8.0, poll=0.55))
    assert len(taken) == len(set(seen))
    assert 0 not in taken


def test_a_chip_that_stands_still_gives_nothing():
    updates = Updates(100.0)
    total = 0
    for t in schedule(10.0):
        total += len(updates.look(np.array([7]), round(t), round(t) + 1).rows)
    assert total == 1


def test_beginning_anew_forgets_what_was():
    updates = Updates(100.0)
    updates.look(np.array([7]), 0, 1)
    updates.begin()
    look = updates.look(np.array([7]), 10**12, 10**12 + 1)
    assert look.rows.tolist() == [7]
    assert (look.repeated, look.skipped) == (0, 0)


def test_only_the_words_given_are_compared():
    updates = Updates(100.0)
    rows = [np.array([k]) for k in range(3)]
    words = [b'a', b'a', b'b']
    found = [
        updates.look(row, k * PERIOD, k * PERIOD + 1, word).rows.tolist()
        for k, (row, word) in enumerate(zip(rows, words, strict=True))
    ]
    assert found == [[0], [], [2]]


# --- looked at more seldom than it writes ------------------------------------------------
def seldom(chip, looks, cost=6_000_000, held_up=None):
    """Return what was taken, how old it was by its stamp, and every look."""
    updates = Updates(100.0)
    taken, off, found = [], [], []
    for k, t in enumerate(looks):
        number = chip.number(t)
        before = t if held_up is None else t - held_up[k]
        look = updates.look(np.array([chip.words[number]]), round(before), round(t + cost))
        found.append(look)
        taken += look.rows.tolist()
        off += (look.stamps - chip.when[number]).tolist()
    return np.array(taken), np.array(off), found


@given(
    seed=st.integers(0, 2**32 - 1),
    error=st.floats(-0.01, 0.01),
    apart=st.floats(1.05, 6.0),
    waits=st.booleans(),
)
@settings(max_examples=25, deadline=None)
def test_looked_at_too_seldom_what_is_seen_is_taken_once(seed, error, apart, waits):
    rng = np.random.default_rng(seed)
    chip = Chip(rng, error)
    looks = 1e9 + np.arange(300) * apart * PERIOD + rng.uniform(0, 0.02 * PERIOD, 300)
    held_up = rng.uniform(0, 2 * PERIOD, 300) if waits else None
    taken, off, found = seldom(chip, looks, held_up=held_up)
    seen = np.unique([chip.number(t) for t in looks])
    # every sample that was seen, once, but for some at the beginning
    missed = set(chip.words[seen]) - set(taken)
    assert missed <= set(chip.words[seen[:6]])
    assert len(set(taken)) == len(taken)
    assert all(look.undated for look in found[6:])
    assert sum(look.lost_track for look in found) <= 1
    # half a period, and the uncertainty of where in its transfer the chip latches
    assert np.abs(off[6:]).max() <= 0.5 * PERIOD * 1.02 + 3_000_000


def test_looking_often_again_finds_the_pace_anew():
    rng = np.random.default_rng(3)
    chip = Chip(rng, 0.008)
    often, late = 2e7 + schedule(5.0), 5.1e9 + np.arange(400) * 2.37 * PERIOD
    looks = np.concatenate([often, late, late[-1] + 3e7 + schedule(3.0)])
    taken, _, found = seldom(chip, looks, cost=800_000)
    undated = np.array([look.undated for look in found])
    assert not undated[: often.size].any()
    assert undated[often.size + 100 : often.size + 400].all()
    assert not undated[often.size + 410 :].any()
    lost_track = np.flatnonzero([look.lost_track for look in found])
    assert lost_track.size == 1
    assert often.size + 400 < lost_track[0] < often.size + 410
    assert len(set(taken)) == len(taken)


def test_a_chip_that_stands_still_gives_nothing_however_seldom_it_is_looked_at():
    updates = Updates(100.0)
    for k in range(60):
        row = np.array([min(k, 20)])
        look = updates.look(row, k * 25_000_000, k * 25_000_000 + 1)
        assert len(look.rows) == 0 or 0 <= k <= 20
